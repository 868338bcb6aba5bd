"""Planes found in recorded and generated clouds, beside others, in one table.

    python benches/planes.py                              everything that takes seconds
    python benches/planes.py roofs board --peers          those, and the peers
    python benches/planes.py prisms25 --told              with the noise given to primfit
    python benches/planes.py prisms25 --seeds 601 602     other scenes than 1, 2 and 3

PRIMFIT_DATA names the folder of the recorded clouds. Peers come with the extra "bench"; they are
given what they need: Open3D the settings of its tutorial on planar patches; pyransac3d, and CGAL's
Efficient RANSAC and region growing, a threshold of three times the noise, or where that is unknown
of what primfit estimates; growing also gets the best of 36 settings by the truth on small clouds,
and its CPU seconds are those of all. Each method runs in a process of its own, which is stopped after
`TIME_LIMIT`; CPU seconds are those of the call, memory what it adds to the peak of the process, and
that peak.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import shapely
from plane_scenes import GENERATED, Scene
from recorded_scenes import RECORDED, scenes_of

import primfit
from primfit.planes.plane import axes_of

MOST_PLANES = 60

MOST_TRIED = 50_000
"""Points of clouds on which CGAL's growing is tried with several settings."""

TIME_LIMIT = 120.0
"""Seconds of wall after which a method is stopped, and said to be."""


def ours(scene: Scene, threshold: float | None) -> primfit.Planes:
    return primfit.detect_planes(scene.points, threshold=threshold)


def open3d_patches(scene: Scene, threshold: float) -> np.ndarray:
    """`detect_planar_patches` as in its documentation; points go to the largest box around them."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(scene.points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
    patches = cloud.detect_planar_patches(
        normal_variance_threshold_deg=60,
        coplanarity_deg=75,
        outlier_ratio=0.75,
        min_plane_edge_length=0,
        min_num_points=0,
        search_param=open3d.geometry.KDTreeSearchParamKNN(knn=30),
    )
    labels = np.full(len(scene.points), -1)
    for k, box in enumerate(sorted(patches, key=lambda box: box.volume())):
        labels[box.get_point_indices_within_bounding_box(cloud.points)] = k
    return labels


def pyransac3d_planes(scene: Scene, threshold: float) -> np.ndarray:
    """One plane after the other until none holds 1 in 200 points."""
    import pyransac3d

    np.random.seed(7)  # noqa: NPY002
    labels = np.full(len(scene.points), -1)
    for k in range(MOST_PLANES):
        rest = np.flatnonzero(labels < 0)
        if len(rest) < 3:
            break
        _, inliers = pyransac3d.Plane().fit(scene.points[rest], threshold, maxIteration=1000)
        if len(inliers) < max(10, len(labels) / 200):
            break
        labels[rest[inliers]] = k
    return labels


def cgal_ransac(scene: Scene, threshold: float) -> np.ndarray:
    return cgal(
        scene,
        "efficient_RANSAC",
        epsilon=threshold,
        normal_threshold=0.8,
        planes=True,
    )


def cgal_growing(scene: Scene, threshold: float) -> np.ndarray:
    """With the settings of several under which it finds most by the truth, which favours it."""
    if scene.truth is None or len(scene.points) > MOST_TRIED:
        return cgal(scene, "region_growing", epsilon=threshold, normal_treshold=0.8, k=30)
    found = [
        cgal(scene, "region_growing", epsilon=factor * threshold, normal_treshold=cosine, k=k)
        for factor in (0.5, 0.75, 1.0, 1.5)
        for cosine in (0.7, 0.8, 0.9)
        for k in (12, 24, 48)
    ]
    return max(found, key=lambda labels: scores(labels, scene)["f_0.75"])


def cgal(scene: Scene, method: str, **settings: object) -> np.ndarray:
    """One of CGAL's detections."""
    from CGAL import CGAL_Point_set_3 as sets
    from CGAL import CGAL_Point_set_processing_3 as processing
    from CGAL import CGAL_Shape_detection as shapes
    from CGAL.CGAL_Kernel import Point_3

    cloud = sets.Point_set_3()
    cloud.add_normal_map()
    for point in scene.points - scene.points.mean(axis=0):
        cloud.insert(Point_3(*point.tolist()))
    processing.jet_estimate_normals(cloud, 48)
    numbers = cloud.add_int_map("shape")
    if method == "efficient_RANSAC":
        settings["cluster_epsilon"] = 5 * processing.compute_average_spacing(cloud, 16)
    least = max(10, len(scene.points) // 1000)
    getattr(shapes, method)(cloud, numbers, min_points=least, **settings)
    # The set is permuted; its points tell which is which.
    rows = {tuple(p): i for i, p in enumerate((scene.points - scene.points.mean(axis=0)).tolist())}
    labels = np.full(len(scene.points), -1)
    for index in cloud.indices():
        point = cloud.point(index)
        labels[rows[(point.x(), point.y(), point.z())]] = numbers.get(index)
    return labels


PEERS: dict[str, tuple[str, Callable[[Scene, float], np.ndarray]]] = {
    "open3d": ("open3d-cpu", open3d_patches),
    "pyransac3d": ("pyransac3d", pyransac3d_planes),
    "cgal RANSAC": ("cgal", cgal_ransac),
    "cgal growing": ("cgal", cgal_growing),
}


def overlaps(labels: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Intersection over union of found and true planes (k, t)."""
    true, truth = np.unique(truth, return_inverse=True)
    found, labels = np.unique(labels, return_inverse=True)
    both = np.zeros((len(found), len(true)), dtype=int)
    np.add.at(both, (labels, truth), 1)
    union = both.sum(axis=1, keepdims=True) + both.sum(axis=0) - both
    return (both / union)[found >= 0][:, true >= 0]


def scores(labels: np.ndarray, scene: Scene) -> dict[str, float | None]:
    counts = np.sort(np.bincount(labels[labels >= 0]))[::-1]
    row: dict[str, float | None] = {
        "planes": float((counts > 0).sum()),
        "in_planes": float((labels >= 0).mean()),
        "in_largest_4": float(counts[:4].sum() / len(labels)),
    }
    if scene.truth is None:
        return row
    iou = overlaps(labels, scene.truth)
    ignored = scene.extra.get("ignored", np.zeros(len(labels), dtype=bool))
    counted = [ignored[labels == k].mean() < 0.5 for k in np.unique(labels[labels >= 0])]
    counted = np.array(counted, dtype=bool)
    for limit in (0.5, 0.75, 0.8):
        right = (iou >= limit).any(axis=0).mean() if iou.size else 0.0
        precise = (iou[counted] >= limit).any(axis=1).mean() if iou[counted].size else 0.0
        row[f"recall_{limit}"], row[f"precision_{limit}"] = float(right), float(precise)
        row[f"f_{limit}"] = float(2 * right * precise / max(right + precise, 1e-12))
    row["normal_error_deg"] = normal_error(labels, scene.truth, iou, scene.points)
    row["least_iou"] = float(iou.max(axis=0).min()) if iou.size else 0.0
    return row


def normal_error(
    labels: np.ndarray, truth: np.ndarray, iou: np.ndarray, points: np.ndarray
) -> float | None:
    """Median angle to the least-squares plane of the true points, of planes matched at 0.5."""

    def normal(some: np.ndarray) -> np.ndarray:
        return np.linalg.eigh(np.cov(some.T))[1][:, 0]

    found, true = np.unique(labels[labels >= 0]), np.unique(truth[truth >= 0])
    angles = [
        np.degrees(
            np.arccos(
                min(1.0, abs(normal(points[labels == found[k]]) @ normal(points[truth == true[t]])))
            )
        )
        for k, t in np.argwhere(iou >= 0.5)
    ]
    return float(np.median(angles)) if angles else None


def board_rows(found: list[tuple[Scene, primfit.Planes]]) -> None:
    """Size of the board, and angles between its poses against the camera's."""
    normals, sizes = {}, []
    for scene, planes in found:
        on_board = planes.labels[(scene.truth == 0) & (planes.labels >= 0)]
        plane = planes[int(np.bincount(on_board).argmax())]
        flat = (plane.boundary - plane.centroid) @ axes_of(plane.equation[:3]).T
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.Polygon(flat)))
        sizes.append(np.sort(np.linalg.norm(np.diff(box[:3], axis=0), axis=1)))
        camera = scene.extra["all"]["poses"][f"pose{scene.extra['pose']}"]["camera_normal"]
        normals[scene.extra["pose"]] = (plane.equation[:3], np.array(camera))
    print("board size in mm:", *(np.round(1000 * size, 1) for size in sizes), "of 610 x 850")
    poses = list(normals)
    for i, a in enumerate(poses):
        for b in poses[i + 1 :]:
            ours_, camera = (
                np.degrees(np.arccos(abs(normals[a][k] @ normals[b][k]))) for k in (0, 1)
            )
            print(f"angle of poses {a} and {b}: {ours_:.2f} deg, camera {camera:.2f} deg")


def run_one(args: argparse.Namespace, data: Path) -> dict[str, object]:
    """One method on one scene, in this process."""
    group, number, method = args.one
    # Made elsewhere, so that making the scene does not set the peak of the memory.
    with ProcessPoolExecutor(1) as elsewhere:
        scene = elsewhere.submit(scenes_of, group, data, args.seeds).result()[int(number)]
    threshold = None if scene.sigma is None else 3 * scene.sigma
    if method != "primfit" and threshold is None:
        threshold = 3 * ours(scene, None).sigma
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start, wall = time.process_time(), time.perf_counter()
    if method == "primfit":
        labels = ours(scene, threshold if args.told else None).labels
    else:
        labels = PEERS[method][1](scene, threshold)
    seconds, wall = time.process_time() - start, time.perf_counter() - wall
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    row = {"scene": scene.name, "method": method, "cpu_s": seconds, "wall_s": wall}
    memory = {"memory_mb": (peak - before) / 1024, "peak_mb": peak / 1024}
    return {**row, **memory, **scores(np.asarray(labels), scene)}


def main() -> None:
    groups = [*RECORDED, *GENERATED]
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("groups", nargs="*", help=", ".join(groups))
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--told", action="store_true", help="give primfit the noise too")
    parser.add_argument("--seeds", nargs="+", type=int, help="of the generated scenes")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    data = Path(os.environ.get("PRIMFIT_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if args.one:
        print(json.dumps(run_one(args, data)))
        return
    methods = ["primfit"]
    print("primfit", primfit.__version__)
    for name, (package, _) in PEERS.items() if args.peers else ():
        try:
            print(package, version(package))
            methods.append(name)
        except PackageNotFoundError:
            print(package, "is not installed")
    print("recall and precision at IoU 0.5 / 0.8; F at 0.75; normal error against the true points")
    for group in args.groups or [g for g in groups if g != "building"]:
        scenes = scenes_of(group, data, args.seeds)
        options = ["--told"] * args.told
        options += ["--seeds", *map(str, args.seeds)] if args.seeds else []
        rows = [
            outcome(scene.name, method, ["--one", group, str(number), method, *options])
            for number, scene in enumerate(scenes)
            for method in methods
        ]
        for method in methods if len(scenes) > 1 else ():
            averages(group, [row for row in rows if row.get("method") == method])
        if group == "board":
            board_rows([(scene, ours(scene, None)) for scene in scenes])


def outcome(scene: str, method: str, options: list[str]) -> dict:
    """One row of the table, printed, from a process of its own; empty when it fails."""
    command = [sys.executable, __file__, *options]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT)
    except subprocess.TimeoutExpired:
        print(f"{scene:30s} {method:12s} stopped after {TIME_LIMIT:g} s", flush=True)
        return {}
    if result.returncode:
        print(f"{scene:30s} {method:12s} failed: {result.stderr.splitlines()[-1]}", flush=True)
        return {}
    row = json.loads(result.stdout)
    print(line(row), flush=True)
    return row


def averages(group: str, rows: list[dict]) -> None:
    """Means of recall and precision over scenes with a truth, printed."""
    names = ("planes", "recall_0.5", "recall_0.8", "precision_0.5", "precision_0.8", "f_0.75")
    if rows and "f_0.75" in rows[0]:
        planes, *rest = (np.mean([row[name] for row in rows]) for name in names)
        print(
            f"{f'mean of {len(rows)} {group}':30s} {rows[0]['method']:12s} {planes:5.1f} planes, "
            "R {:.3f}/{:.3f} P {:.3f}/{:.3f} F {:.3f}".format(*rest),
            flush=True,
        )


def line(row: dict) -> str:
    text = (
        f"{row['scene']:30s} {row['method']:12s} {row['planes']:5.0f} planes, "
        f"{row['in_planes']:4.0%} of points, {row['in_largest_4']:4.0%} in 4"
    )
    if "f_0.75" in row:
        angle = "-" if row["normal_error_deg"] is None else f"{row['normal_error_deg']:.2f}"
        text += (
            f", R {row['recall_0.5']:.2f}/{row['recall_0.8']:.2f}"
            f" P {row['precision_0.5']:.2f}/{row['precision_0.8']:.2f}"
            f" F {row['f_0.75']:.3f}, least IoU {row['least_iou']:.3f}, {angle} deg"
        )
    return (
        f"{text}, {row['cpu_s']:.2f} CPU s, {row['memory_mb']:.0f} MB, peak {row['peak_mb']:.0f} MB"
    )


if __name__ == "__main__":
    main()
