"""Planes of organised clouds: recorded ones, rooms and curved surfaces, in one table.

    python benches/organised.py              all of them
    python benches/organised.py rooms        those
    python benches/organised.py --peers      with Open3D's planar patches (open3d-cpu) beside each
    python benches/organised.py --bare       with the path of clouds without an image beside each

PRIMFIT_DATA names the folder of the recorded clouds. CPU seconds are those of the call on one thread,
without outlines, which nobody asks for here, the least of three; peers get the points that are finite. The truth of rooms is that
of each part of a face that touches in the image, of at least 100 beams.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from plane_scenes import Scene
from planes import open3d_patches
from scipy import ndimage

import primfit
from primfit.clouds.cloud import Cloud

LEAST = 100
"""Beams of a part of a face that counts."""

ROOMS = range(501, 511)


@dataclass(frozen=True)
class Image:
    """Points (h, w, 3); truth (h, w) numbers faces, -1 is none; or a mask of one board."""

    name: str
    points: np.ndarray
    truth: np.ndarray | None = None
    board: np.ndarray | None = None
    is_curved: bool = field(default=False)


def rendered(data: Path) -> Iterator[Image]:
    from PIL import Image as Picture

    depth = np.asarray(Picture.open(data / "icl_rendered" / "icl_frame0_depth.png"))
    points = primfit.points_of_depth(depth, 481.2, -480.0, 319.5, 239.5, scale=1 / 5000)
    truth = np.load(data / "icl_rendered" / "icl_frame0_labels.npz")["gt"].astype(int) - 1
    for step in (1, 2):
        yield Image(f"icl_rendered, 1 in {step}", points[::step, ::step], truth[::step, ::step])


def kinect(data: Path) -> Iterator[Image]:
    for file in sorted((data / "kinect").glob("*.pcd")):
        points = image(primfit.read_cloud(file))
        for step in (1, 2):
            yield Image(f"{file.stem[:18]}, 1 in {step}", points[::step, ::step])


def boards(data: Path) -> Iterator[Image]:
    for file in sorted((data / "os1_board").glob("*_full.pcd")):
        cloud = primfit.read_cloud(file)
        board = primfit.read_points(str(file).replace("_full", "_target"))
        known = {tuple(point) for point in np.round(board, 4).tolist()}
        on_board = np.array([tuple(point) in known for point in np.round(cloud.points, 4).tolist()])
        on_board = on_board.reshape(cloud.shape)
        yield Image(file.stem[:-5], image(cloud), board=on_board)
        half = cloud.points.copy()
        half[np.flatnonzero(half.any(axis=1))[1::2]] = 0.0
        half = half.reshape(*cloud.shape, 3)
        yield Image(f"{file.stem[:-5]}, half", half, board=on_board & half.any(axis=2))


def image(cloud: Cloud) -> np.ndarray:
    return cloud.points.reshape(*cloud.shape, 3)


def rooms(data: Path) -> Iterator[Image]:
    for layers, columns, view in ((64, 1024, 0.785), (16, 1800, 0.524)):
        for seed in ROOMS:
            yield room(seed, layers, columns, view)


def room(seed: int, layers: int, columns: int, view: float) -> Image:
    """A room with up to nine boxes, seen from a place in its middle with 20 mm of noise."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(6.0, 12.0, 2)
    boxes: list[primfit.Prism] = []
    for _ in range(200):
        place = rng.uniform(1.2, size - 1.2)
        others = [np.array(box.center[:2]) for box in boxes]
        far = [np.linalg.norm(place - other) > 1.6 for other in others]
        if len(boxes) < 9 and np.linalg.norm(place - size / 2) > 1.8 and all(far):
            sides = rng.uniform((0.5, 0.4, 0.4), (2.0, 1.2, 2.0))
            turn = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
            boxes.append(
                primfit.Prism.rectangle(*sides[:2], center=place, angle=turn, height=sides[2])
            )
    world = primfit.World(solids=boxes, arena=primfit.Arena(size=tuple(size), height=2.8))
    pose = (*(size / 2 + rng.uniform(-0.5, 0.5, 2)), rng.uniform(0.0, 6.0))
    noisy, exact = (
        primfit.scan(
            world,
            [pose],
            primfit.Lidar(
                number_of_layers=layers,
                vertical_field_of_view=view,
                horizontal_resolution=columns,
                field_of_view=2 * np.pi,
                min_range=0.3,
                max_range=50.0,
                noise=noise / 50.0,
                mount=(0.0, 0.0, 1.2),
            ),
            rng=seed,
        )
        for noise in (0.02, 0.0)
    )
    x, y = size
    faces = [(-2, (1, 0, 0, 0)), (-2, (1, 0, 0, -x)), (-2, (0, 1, 0, 0)), (-2, (0, 1, 0, -y))]
    faces.append((-3, (0, 0, 1, 0)))
    for i, box in enumerate(boxes):
        faces.append((i, (0, 0, 1, -box.height)))
        for a, b in zip(box.footprint, np.roll(box.footprint, -1, axis=0), strict=True):
            across = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
            faces.append((i, (*across, 0, -across @ a)))
    truth = np.full(len(noisy), -1)
    for k, (owner, equation) in enumerate(faces):
        off = np.abs(exact.points @ np.array(equation[:3], dtype=float) + equation[3])
        truth[(exact.solid_index == owner) & (off < 1e-6)] = k
    points = noisy.points.reshape(layers, columns, 3)
    name = f"room {seed}, {layers} x {columns}"
    return Image(name, points, visible_parts(truth.reshape(layers, columns)))


def visible_parts(truth: np.ndarray) -> np.ndarray:
    """Parts of the faces that touch in the image of a ring."""
    parts = np.full(truth.shape, -1)
    number = 0
    for face in np.unique(truth[truth >= 0]):
        labels, n = ndimage.label(truth == face, np.ones((3, 3)))
        for row in range(len(truth)):
            a, b = labels[row, 0], labels[row, -1]
            if a and b and a != b:
                labels[labels == max(a, b)] = min(a, b)
        own = labels > 0
        parts[own] = number + labels[own]
        number += n + 1
    return parts


def curved(data: Path) -> Iterator[Image]:
    """A ball and a tank from outside, a dome and a silo from inside, with 2 and 20 mm of noise."""
    azimuth, elevation = np.linspace(-1, 1, 512), np.linspace(0.6, -0.6, 64)[:, None]
    beams = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation) + 0.0 * azimuth,
        ],
        axis=-1,
    )
    for name, origin, is_round, radius in (
        ("ball", (-3.0, 0.0, 0.0), 1.0, 1.0),
        ("tank", (-6.0, 0.0, 0.0), 0.0, 2.0),
        ("dome", (0.5, 0.3, 0.0), 1.0, 8.0),
        ("silo", (0.3, 0.2, 0.0), 0.0, 5.0),
    ):
        weights, start = np.array([1.0, 1.0, is_round]), np.array(origin)
        a, b = (beams**2 * weights).sum(axis=-1), (beams * start * weights).sum(axis=-1)
        c = (start**2 * weights).sum() - radius**2
        root = b**2 - a * c
        ranges = (-b - np.sign(c) * np.sqrt(np.maximum(root, 0.0))) / a
        ranges = np.where(root > 0.0, ranges, np.nan)
        for noise in (0.002, 0.02):
            off = noise * np.random.default_rng(7).normal(size=ranges.shape)
            points = start + beams * (ranges + off)[..., None]
            yield Image(f"{name}, {1000 * noise:g} mm", points, is_curved=True)


GROUPS: dict[str, Callable[[Path], Iterator[Image]]] = {
    "rendered": rendered,
    "kinect": kinect,
    "boards": boards,
    "rooms": rooms,
    "curved": curved,
}


def found_by(method: str, scene: Image) -> tuple[np.ndarray, float]:
    """Labels (h, w), and CPU seconds."""
    is_point = np.isfinite(scene.points).all(axis=-1) & scene.points.any(axis=-1)
    some = scene.points[is_point]
    least = np.inf
    for _ in range(3 if method == "image" else 1):
        start = time.process_time()
        if method == "image":
            labels = primfit.detect_planes(scene.points, n_jobs=1).labels
        elif method == "bare":
            labels = primfit.detect_planes(some, n_jobs=1).labels
        else:
            labels = open3d_patches(Scene(scene.name, some), 0.0)
        least = min(least, time.process_time() - start)
    if len(labels) == is_point.size:
        return labels.reshape(is_point.shape), least
    of_pixel = np.full(is_point.shape, -1)
    of_pixel[is_point] = labels
    return of_pixel, least


def line(scene: Image, labels: np.ndarray) -> tuple[str, dict[str, float]]:
    is_point = np.isfinite(scene.points).all(axis=-1) & scene.points.any(axis=-1)
    share = (labels[is_point] >= 0).mean()
    sizes = np.bincount(labels[labels >= 0]) if (labels >= 0).any() else np.zeros(0)
    text, row = f"{(sizes > 0).sum():4d} planes, {share:4.0%} of points", {"share": share}
    if scene.truth is not None:
        for limit in (0.5, 0.75):
            report = primfit.evaluate_segmentation(labels, counted(scene.truth), min_iou=limit)
            row |= {
                f"R {limit}": report.recall,
                f"P {limit}": precision(labels, scene.truth, limit),
            }
            text += f", R {report.recall:.2f} P {row[f'P {limit}']:.2f} at {limit}"
        text += f", F {report.f_score:.2f}"
    if scene.board is not None and sizes.any():
        both = np.bincount(labels[scene.board & (labels >= 0)], minlength=len(sizes))
        row["IoU"] = (both / (sizes + scene.board.sum() - both)).max()
        text += f", IoU of the board {row['IoU']:.3f}"
    return text, row


def counted(truth: np.ndarray) -> np.ndarray:
    """The truth without parts that are too small to count."""
    sizes = np.bincount(truth[truth >= 0])
    is_small = (truth >= 0) & (sizes[np.maximum(truth, 0)] < LEAST)
    return np.where(is_small, -1, truth)


def precision(labels: np.ndarray, truth: np.ndarray, limit: float) -> float:
    """Share of the planes that are a face, of any size."""
    return float(primfit.evaluate_segmentation(labels, truth, min_iou=limit).precision)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("groups", nargs="*", help=", ".join(GROUPS))
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--bare", action="store_true")
    args = parser.parse_args()
    data = Path(os.environ.get("PRIMFIT_DATA", Path(__file__).parents[2] / "shared" / "data"))
    methods = ["image", *["bare"] * args.bare, *["open3d"] * args.peers]
    for group in args.groups or GROUPS:
        rows: dict[str, list[dict[str, float]]] = {method: [] for method in methods}
        for scene in GROUPS[group](data):
            for method in methods:
                labels, seconds = found_by(method, scene)
                text, row = line(scene, labels)
                rows[method].append(row)
                print(f"{scene.name:28s} {method:6s} {text}, {seconds:.3f} CPU s", flush=True)
        for method in methods:
            means = {
                name: np.mean([row[name] for row in rows[method] if name in row])
                for name in dict.fromkeys(name for row in rows[method] for name in row)
            }
            text = ", ".join(f"{name} {value:.3f}" for name, value in means.items())
            print(f"mean of {len(rows[method])} {group:15s} {method:6s} {text}", flush=True)


if __name__ == "__main__":
    main()
