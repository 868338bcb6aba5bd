"""How well surfaces are found: kinds, partition, parameters, time, beside peers.

    python benches/surfaces.py --scenes mixed rack --seeds 1 2 3 [--each]
    python benches/surfaces.py --methods cgal cgal_defaults
    python benches/surfaces.py --single

A primitive with at least 100 points counts. It is found at an intersection over union of 0.5 or 0.8
with the points of some surface; a surface is right at 0.5. Errors of radii, and of half angles of
cones, are over their own standard deviations (z), and over the bound of Cramer and Rao (b): that of
a fit which is told points and noise. Errors of axes (two components each) are over both too, and
their own standard deviations over the bound (s). CGAL's settings are those of four with the most
right kinds, by the truth; its CPU seconds are those of normals and one search. ``--single`` fits single primitives
beside pyransac3d and cylfit. Peers take part where they are installed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
from measure import print_versions
from scipy.optimize import linear_sum_assignment
from surface_peers import CGAL, SINGLE, cgal, shape_of
from surface_scenes import FEWEST, SCENES, Primitive, SurfaceScene

import primfit
from primfit.planes.plane import Plane, axes_of

NAMES = {
    "sphere": ["radius"],
    "cylinder": ["radius"],
    "cone": ["angle"],
    "torus": ["major_radius", "radius"],
}


@dataclass(frozen=True)
class Shape:
    """What is judged of a found surface: sizes by name, with standard deviations where it has some."""

    kind: str
    sizes: dict[str, float] = field(default_factory=dict)
    sigmas: dict[str, float] = field(default_factory=dict)
    axis: np.ndarray | None = None
    axis_covariance: np.ndarray | None = None


@dataclass(frozen=True)
class Found:
    labels: np.ndarray
    shapes: list[Shape]
    seconds: float


def _shape(surface: Plane | primfit.SphereSurface) -> Shape:
    if isinstance(surface, Plane):
        return Shape("plane")
    sizes = {name: getattr(surface, name) for name in NAMES[surface.kind]}
    if surface.kind == "sphere":
        return Shape(surface.kind, sizes, surface.sigmas)
    of_axis = surface.covariance[3:6, 3:6]
    return Shape(surface.kind, sizes, surface.sigmas, surface.axis, of_axis)


def _timed(call: Callable[[], object]) -> tuple[object, float]:
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def ours(scene: SurfaceScene) -> list[Found]:
    found, seconds = _timed(lambda: primfit.detect_surfaces(scene.points, scene.origins))
    return [Found(found.labels, [_shape(surface) for surface in found], seconds)]


def ours_planes(scene: SurfaceScene) -> list[Found]:
    found, seconds = _timed(lambda: primfit.detect_planes(scene.points, scene.origins))
    return [Found(found.labels, [Shape("plane")] * len(found), seconds)]


def cgal_told(scene: SurfaceScene) -> list[Found]:
    return [_cgal(scene, setting) for setting in CGAL]


def cgal_defaults(scene: SurfaceScene) -> list[Found]:
    return [_cgal(scene, None)]


def _cgal(scene: SurfaceScene, setting: tuple[float, float] | None) -> Found:
    labels, lines, seconds = cgal(scene, setting)
    shapes = [Shape(kind, sizes, axis=axis) for kind, sizes, axis in map(shape_of, lines)]
    return Found(labels, shapes, seconds)


METHODS: dict[str, Callable[[SurfaceScene], list[Found]]] = {
    "detect_surfaces": ours,
    "detect_planes": ours_planes,
    "cgal": cgal_told,
    "cgal_defaults": cgal_defaults,
}
"""Each result of a method is of one of its settings."""


def single_fits(scene: SurfaceScene) -> None:
    """Radii, given their points with 30 % outliers."""
    rng = np.random.default_rng(0)
    peers = [name for name in SINGLE if find_spec(name) is not None]
    for kind in ("sphere", "cylinder"):
        errors: dict[str, list[float]] = {}
        seconds: dict[str, float] = {}
        for i, primitive in enumerate(scene.primitives):
            if primitive.kind != kind:
                continue
            own = scene.points[scene.truth == i][::8]
            low, high = own.min(axis=0) - 0.1, own.max(axis=0) + 0.1
            cloud = np.vstack([own, rng.uniform(low, high, (len(own) * 3 // 7, 3))])
            fit = getattr(primfit, f"fit_{kind}")
            calls = {"primfit": lambda c=cloud, f=fit: f(c, outliers=0.3).radius}
            for name in peers:
                radius_of, kinds = SINGLE[name]
                if kind in kinds:
                    calls[name] = lambda c=cloud, r=radius_of, k=kind: r(k, c, scene.sigma)
            for name, call in calls.items():
                radius, took = _timed(call)
                errors.setdefault(name, []).append(abs(radius - primitive.sizes[0]))
                seconds[name] = seconds.get(name, 0.0) + took
        for name, own in errors.items():
            took = seconds[name] / len(own)
            print(
                f"radius of a {kind:8} {name:10} median error {1000.0 * np.median(own):.2f} mm, "
                f"{took:.2f} CPU s each"
            )


def bound_of(scene: SurfaceScene, i: int, primitive: Primitive) -> dict[str, float]:
    """Standard deviations of a fit that is told which points are of a primitive, and the noise."""
    own = scene.truth == i
    origins = None if scene.origins is None else scene.origins[own]
    fit = getattr(primfit, f"fit_{primitive.kind}")
    return fit(scene.points[own], origins, scene.sigma).sigmas


def judge_numbers(
    result: dict[str, list[float]], shape: Shape, primitive: Primitive, bound: dict[str, float]
) -> None:
    """Adds the errors of sizes and axis of a surface of the right kind."""
    kind = primitive.kind
    for name, truth in zip(NAMES[kind], primitive.sizes, strict=False):
        if name in shape.sizes:
            error = shape.sizes[name] - truth
            result.setdefault(f"b {kind}", []).append(error / bound[name])
            if name in shape.sigmas:
                result.setdefault(f"z {kind}", []).append(error / shape.sigmas[name])
    if shape.axis is None or kind == "sphere":
        return
    across = axes_of(primitive.axis)
    off = across @ shape.axis
    # Two components, of which the bound is the root of the sum of the variances.
    result.setdefault("b axis", []).extend(off * np.sqrt(2.0) / bound["axis"])
    if shape.axis_covariance is not None:
        own = across @ shape.axis_covariance @ across.T
        result.setdefault("z axis", []).extend(np.linalg.solve(np.linalg.cholesky(own), off))
        result.setdefault("s axis", []).append(np.sqrt(np.trace(own)) / bound["axis"])


def judged(scene: SurfaceScene, found: Found) -> dict[str, list[float]]:
    """What counts of one scene: a list for each figure."""
    labels, kinds = found.labels, [shape.kind for shape in found.shapes]
    n_true, n_found = len(scene.primitives), len(kinds)
    sizes = np.bincount(scene.truth[scene.truth >= 0], minlength=n_true)
    both = (scene.truth >= 0) & (labels >= 0)
    shared = np.zeros((n_true, n_found))
    np.add.at(shared, (scene.truth[both], labels[both]), 1)
    found_sizes = np.bincount(labels[labels >= 0], minlength=n_found)
    iou = shared / (sizes[:, None] + found_sizes - shared)
    result: dict[str, list[float]] = {"recall": [], "recall_8": [], "kind": [], "precision": []}
    rows, columns = linear_sum_assignment(-iou) if n_found else ([], [])
    pairs = {i: j for i, j in zip(rows, columns, strict=True) if iou[i, j] >= 0.5}
    for i, primitive in enumerate(scene.primitives):
        if sizes[i] < FEWEST:
            continue
        j = pairs.get(i)
        result["recall"].append(j is not None)
        result["recall_8"].append(j is not None and iou[i, j] >= 0.8)
        result["kind"].append(j is not None and kinds[j] == primitive.kind)
        if j is not None and kinds[j] == primitive.kind != "plane":
            bound = bound_of(scene, i, primitive)
            judge_numbers(result, found.shapes[j], primitive, bound)
    right = set(pairs.values())
    # What is of primitives too small to count is neither right nor wrong.
    of_small = iou[sizes < FEWEST].max(axis=0, initial=0.0) >= 0.3
    result["precision"] = [j in right for j in range(n_found) if j in right or not of_small[j]]
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--methods", nargs="+", default=["detect_surfaces"])
    parser.add_argument("--single", action="store_true", help="fits of single primitives")
    parser.add_argument("--each", action="store_true", help="print each scene too")
    args = parser.parse_args()
    print_versions("pyransac3d", "cylfit", "cgal")
    if args.single:
        single_fits(SCENES["mixed"](args.seeds[0]))
        return
    print("scene      method           R.5   R.8   kind  P     CPU s  errors mean/rms (number)")
    for name in args.scenes:
        for method in args.methods:
            # One dictionary of figures for each setting.
            pooled: list[dict[str, list[float]]] = []
            for seed in args.seeds:
                scene = SCENES[name](seed)
                every = METHODS[method](scene)
                pooled = pooled or [{} for _ in every]
                for figures, found in zip(pooled, every, strict=True):
                    one = judged(scene, found) | {"seconds": [found.seconds]}
                    if args.each:
                        print_row(scene.name, method, one)
                    for key, values in one.items():
                        figures.setdefault(key, []).extend(values)
            print_row(name, method, max(pooled, key=lambda figures: np.mean(figures["kind"])))


def print_row(name: str, method: str, one: dict[str, list[float]]) -> None:
    shares = "  ".join(
        f"{np.mean(one[key]) if one[key] else np.nan:4.2f}"
        for key in ("recall", "recall_8", "kind", "precision")
    )
    scores = ", ".join(
        f"{key} {np.mean(values):+.1f}/{np.sqrt(np.mean(np.square(values))):.1f} ({len(values)})"
        for key, values in sorted(one.items())
        if key[1] == " "
    )
    seconds = np.mean(one["seconds"])
    print(f"{name:10} {method:16} {shares}  {seconds:5.1f}  {scores}", flush=True)


if __name__ == "__main__":
    main()
