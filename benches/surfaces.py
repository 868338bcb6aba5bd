"""How well surfaces are found: kinds, partition, parameters, time, beside peers.

    python benches/surfaces.py --scenes mixed rack --seeds 1 2 3 [--each]
    python benches/surfaces.py --single

A primitive with at least 100 points counts. It is found at an intersection over union of 0.5 or 0.8
with the points of some surface; a surface is right at 0.5. Errors of radii, and of half angles of
cones, are over their own standard deviations. ``--single`` fits single primitives beside pyransac3d,
where that is installed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from measure import print_versions
from scipy.optimize import linear_sum_assignment
from surface_scenes import FEWEST, SCENES, SurfaceScene

import primfit
from primfit.planes.plane import Plane

Found = tuple[np.ndarray, list[str], list[dict[str, tuple[float, float]]]]
"""Labels, kinds, and by name the value and standard deviation of what is judged."""


def ours(scene: SurfaceScene) -> Found:
    found = primfit.detect_surfaces(scene.points, scene.origins)
    numbers = []
    for surface in found:
        names = [] if isinstance(surface, Plane) else NAMES[surface.kind]
        numbers.append({n: (getattr(surface, n), surface.sigmas[n]) for n in names})
    return found.labels, list(found.kinds), numbers


def ours_planes(scene: SurfaceScene) -> Found:
    found = primfit.detect_planes(scene.points, scene.origins)
    return found.labels, ["plane"] * len(found), [{}] * len(found)


NAMES = {
    "sphere": ["radius"],
    "cylinder": ["radius"],
    "cone": ["angle"],
    "torus": ["major_radius", "radius"],
}

METHODS: dict[str, Callable[[SurfaceScene], Found]] = {
    "detect_surfaces": ours,
    "detect_planes": ours_planes,
}


def single_fits(scene: SurfaceScene) -> None:
    """Radii of spheres and cylinders, given their points with 30 % outliers, beside pyransac3d's."""
    try:
        import pyransac3d
    except ModuleNotFoundError:
        print("pyransac3d is missing: no single fits beside it")
        return
    rng = np.random.default_rng(0)
    for kind, peer in (("sphere", pyransac3d.Sphere), ("cylinder", pyransac3d.Cylinder)):
        errors = []
        for i, primitive in enumerate(scene.primitives):
            if primitive.kind != kind:
                continue
            own = scene.points[scene.truth == i][::8]
            low, high = own.min(axis=0) - 0.1, own.max(axis=0) + 0.1
            cloud = np.vstack([own, rng.uniform(low, high, (len(own) * 3 // 7, 3))])
            fit = getattr(primfit, f"fit_{kind}")(cloud, outliers=0.3)
            theirs = peer().fit(cloud, thresh=3.0 * scene.sigma, maxIteration=1000)
            radius = theirs[1] if kind == "sphere" else theirs[2]
            errors.append([abs(fit.radius - primitive.sizes[0]), abs(radius - primitive.sizes[0])])
        ours_mm, theirs_mm = 1000.0 * np.median(errors, axis=0)
        print(f"radius of a {kind}, median error: {ours_mm:.2f} mm, pyransac3d {theirs_mm:.2f} mm")


def judged(scene: SurfaceScene, found: Found) -> dict[str, list[float]]:
    """What counts of one scene: a list for each figure."""
    labels, kinds, numbers = found
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
        if j is not None and kinds[j] == primitive.kind:
            names = NAMES.get(primitive.kind, [])
            for name, truth in zip(names, primitive.sizes, strict=False):
                if name in numbers[j]:
                    value, sigma = numbers[j][name]
                    result.setdefault(f"z {primitive.kind}", []).append((value - truth) / sigma)
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
    print_versions("pyransac3d")
    if args.single:
        single_fits(SCENES["mixed"](args.seeds[0]))
        return
    print("scene      method           R.5   R.8   kind  P     CPU s  z mean/rms")
    for name in args.scenes:
        for method in args.methods:
            pooled: dict[str, list[float]] = {}
            seconds = []
            for seed in args.seeds:
                scene = SCENES[name](seed)
                start = time.process_time()
                found = METHODS[method](scene)
                seconds.append(time.process_time() - start)
                one = judged(scene, found)
                if args.each:
                    print_row(scene.name, method, one, seconds[-1:])
                for key, values in one.items():
                    pooled.setdefault(key, []).extend(values)
            print_row(name, method, pooled, seconds)


def print_row(name: str, method: str, one: dict[str, list[float]], seconds: list[float]) -> None:
    shares = "  ".join(
        f"{np.mean(one[key]) if one[key] else np.nan:4.2f}"
        for key in ("recall", "recall_8", "kind", "precision")
    )
    scores = ", ".join(
        f"{key[2:]} {np.mean(values):+.1f}/{np.sqrt(np.mean(np.square(values))):.1f} ({len(values)})"
        for key, values in sorted(one.items())
        if key.startswith("z ")
    )
    print(f"{name:10} {method:16} {shares}  {np.mean(seconds):5.1f}  {scores}", flush=True)


if __name__ == "__main__":
    main()
