"""Other programs that find or fit curved surfaces; each is imported only where it is installed.

CGAL's Efficient RANSAC (wheel `cgal`) is told the noise and half of the points of the smallest
primitive that counts; its thresholds are multiples of noise and spacing (`CGAL`), or its documented
defaults, 1 % of the diagonal (`CGAL_DEFAULTS`). pyransac3d and cylfit fit single primitives.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable

import numpy as np
from surface_scenes import FEWEST, SurfaceScene

CGAL = [(2.0, 3.0), (2.0, 5.0), (3.0, 3.0), (3.0, 5.0)]
"""Standard deviations of the noise that a point may be off, and spacings between points of one
surface; all four are tried."""

_COSINE = 0.8
"""Least cosine of the angle between the normals of point and surface: better than 0.9, the default,
on noisy clouds."""

_NEIGHBORS = 24

_NUMBER = r"[-+0-9.e]+|nan"


def _normals(scene: SurfaceScene):
    from CGAL import CGAL_Point_set_3 as sets
    from CGAL import CGAL_Point_set_processing_3 as processing
    from CGAL.CGAL_Kernel import Point_3

    cloud = sets.Point_set_3()
    cloud.add_normal_map()
    for point in scene.points.tolist():
        cloud.insert(Point_3(*point))
    start = time.process_time()
    processing.jet_estimate_normals(cloud, _NEIGHBORS)
    spacing = processing.compute_average_spacing(cloud, 6)
    return cloud, spacing, time.process_time() - start


def cgal(
    scene: SurfaceScene, setting: tuple[float, float] | None
) -> tuple[np.ndarray, list[str], float]:
    """Labels, what CGAL says of each shape, and its CPU seconds; None for its defaults."""
    from CGAL import CGAL_Shape_detection as shapes

    cloud, spacing, before = _normals(scene)
    numbers = cloud.add_int_map("shape")
    sizes = np.bincount(scene.truth[scene.truth >= 0])
    told = {"min_points": int(max(FEWEST, sizes[sizes >= FEWEST].min() // 2))}
    if setting is not None:
        told |= {
            "epsilon": setting[0] * scene.sigma,
            "cluster_epsilon": setting[1] * spacing,
            "normal_threshold": _COSINE,
        }
    kinds = dict.fromkeys(("planes", "cones", "cylinders", "spheres", "tori"), True)
    start = time.process_time()
    lines = shapes.efficient_RANSAC(cloud, numbers, **told, **kinds)
    seconds = before + time.process_time() - start
    # The set is permuted; its points tell which is which.
    rows = {tuple(point): i for i, point in enumerate(scene.points.tolist())}
    labels = np.full(len(scene.points), -1)
    for index in cloud.indices():
        point = cloud.point(index)
        labels[rows[(point.x(), point.y(), point.z())]] = numbers.get(index)
    return labels, list(lines), seconds


def shape_of(line: str) -> tuple[str, dict[str, float], np.ndarray | None]:
    """Kind, sizes by name and axis of a shape from its description."""
    kind = re.search(r"Type: (\w+)", line).group(1)
    axis = re.search(rf"axis: ?\(({_NUMBER}), ({_NUMBER}), ({_NUMBER})\)", line)
    names = {
        "angle": r"angle: ?",
        "major_radius": r"major radius ?[=:] ?",
        "radius": r"(?:minor radius ?[=:] ?|(?<!major )(?<!minor )radius ?[=:] ?)",
    }
    found = {name: re.search(rf"{text}({_NUMBER})", line) for name, text in names.items()}
    sizes = {name: float(match.group(1)) for name, match in found.items() if match}
    return kind, sizes, None if axis is None else np.array(axis.groups(), dtype=float)


def pyransac3d_radius(kind: str, cloud: np.ndarray, sigma: float) -> float:
    """Radius of a sphere or cylinder, within three standard deviations."""
    import pyransac3d

    np.random.seed(7)  # noqa: NPY002
    peer = {"sphere": pyransac3d.Sphere, "cylinder": pyransac3d.Cylinder}[kind]()
    fit = peer.fit(cloud, thresh=3.0 * sigma, maxIteration=1000)
    return float(fit[1] if kind == "sphere" else fit[2])


def cylfit_radius(_kind: str, cloud: np.ndarray, sigma: float) -> float:
    """Radius of a cylinder, within three standard deviations: the best of six ways to call it."""
    import cylfit

    fit = cylfit.fit_cylinder_auto(cloud, threshold=3.0 * sigma, ransac_trials=512, random_state=7)
    return float(fit.radius)


SINGLE: dict[str, tuple[Callable[[str, np.ndarray, float], float], tuple[str, ...]]] = {
    "pyransac3d": (pyransac3d_radius, ("sphere", "cylinder")),
    "cylfit": (cylfit_radius, ("cylinder",)),
}
"""By package: what fits a radius, and of which kinds."""
