"""Recorded clouds, most with labelled planes, and all groups of scenes by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from plane_scenes import GENERATED, Scene, curved, layered

import primfit


def roofs(data: Path) -> list[Scene]:
    """All roofs; rows that repeat are left out."""
    scenes = []
    for file in sorted((data / "roofs").glob("*.*")):
        if file.suffix == ".seg":
            continue
        table = np.loadtxt(file)
        if file.suffix == ".pts":
            truth = np.loadtxt(file.with_suffix(".seg"), dtype=int)
            truth[truth == 5] = -1
        elif file.name.startswith("roofn3d"):
            truth = table[:, 6].astype(int)
            truth[truth == 0] = -1
        else:
            truth = table[:, 3].astype(int)
        _, first = np.unique(table[:, :3], axis=0, return_index=True)
        scenes.append(Scene(f"roof {file.stem}", table[first, :3], truth[first]))
    return scenes


def os1(data: Path) -> list[Scene]:
    """A board in five poses before a sensor of 64 layers."""
    scenes = []
    for file in sorted((data / "os1_board").glob("*_full.pcd")):
        points = primfit.read_points(file)
        points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
        target = primfit.read_points(str(file).replace("full", "target"))
        rows = {tuple(row) for row in target.tolist()}
        truth = np.array([0 if tuple(row) in rows else -1 for row in points.tolist()])
        scenes.append(Scene(f"os1 {file.stem[:-5]}", points, truth))
    return scenes


def halves(scenes: list[Scene]) -> list[Scene]:
    """Every second return left out, by chance."""
    rng = np.random.default_rng(7)
    keeps = [rng.uniform(size=len(scene.points)) < 0.5 for scene in scenes]
    return [
        Scene(f"{scene.name}, half", scene.points[keep], scene.truth[keep])
        for scene, keep in zip(scenes, keeps, strict=True)
        if scene.truth is not None
    ]


def depth_images(data: Path) -> list[Scene]:
    """Depth images at every second row and column; of `icl` all the planes are labelled."""
    scenes = []
    for file in sorted((data / "kinect").glob("*.pcd")):
        points = primfit.read_points(file).reshape(480, 640, 3)[::2, ::2].reshape(-1, 3)
        scenes.append(Scene(f"half {file.stem[:12]}", points[np.isfinite(points).all(axis=1)]))
    depth = np.asarray(Image.open(data / "icl_rendered/icl_frame0_depth.png")) / 5000.0
    v, u = np.mgrid[:480, :640]
    points = np.stack([(u - 319.5) / 481.2 * depth, (v - 239.5) / 480 * depth, depth], -1)
    truth = np.load(data / "icl_rendered/icl_frame0_labels.npz")["gt"].reshape(480, 640) - 1
    for name, step in (("icl", 1), ("icl half", 2)):
        some = (points[::step, ::step].reshape(-1, 3), truth[::step, ::step].ravel().astype(int))
        valid = some[0][:, 2] > 0
        scenes.append(Scene(name, some[0][valid], some[1][valid]))
    return scenes


def boards(data: Path) -> list[Scene]:
    scenes = []
    poses = json.loads((data / "vlp16_board/board_gt.json").read_text())
    for pose in (3, 16, 38):
        points = primfit.read_points(data / f"vlp16_board/pose{pose}_full.pcd")
        board = primfit.read_points(data / f"vlp16_board/pose{pose}_target.pcd")
        rows = {tuple(row) for row in board.tolist()}
        truth = np.array([0 if tuple(row) in rows else -1 for row in points.tolist()])
        scenes.append(
            Scene(f"board, pose {pose}", points, truth, extra={"pose": pose, "all": poses})
        )
    return scenes


def ascii_pcd(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points and the column called label."""
    with file.open() as lines:
        names: list[str] = []
        for line in lines:
            if line.startswith("FIELDS"):
                names = line.split()[1:]
            if line.startswith("DATA"):
                break
        table = np.loadtxt(lines)
    return table[:, :3], table[:, names.index("label")].astype(int)


def room(data: Path) -> Scene:
    """The labelled parts that are flat within 30 mm rms."""
    points, labels = ascii_pcd(data / "room/room2_gt_fine.pcd")
    truth = np.full(len(points), -1)
    for label in np.unique(labels[labels > 0]):
        own = points[labels == label]
        if np.linalg.eigvalsh(np.cov(own.T, bias=True))[0] <= 0.03**2:
            truth[labels == label] = label
    return Scene("room, flat parts", points, truth)


def boxes(data: Path) -> list[Scene]:
    return [
        Scene(f"boxes {name}", primfit.read_points(data / f"boxes/{name}.ply"))
        for name in ("caixa", "caixa3")
    ]


def kinect(data: Path) -> list[Scene]:
    scenes = []
    for name in ("mosd_learn5", "mosd_learn40"):
        points, labels = pcd_with_labels(data / f"kinect/{name}.pcd")
        scenes.append(Scene(f"kinect {name}", points, np.where(labels == 0, -1, labels)))
    return scenes


def pcd_with_labels(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Finite points and labels of a PCD file of any kind."""
    cloud = primfit.read_cloud(file)
    label = cloud.fields.get("label", np.zeros(len(cloud)))
    finite = np.isfinite(cloud.points).all(axis=1)
    return cloud.points[finite], label[finite].astype(int)


RECORDED: dict[str, Callable[[Path], list[Scene]]] = {
    "roofs": roofs,
    "board": boards,
    "boxes": boxes,
    "room": lambda data: [room(data)],
    "kinect": kinect,
    "os1": os1,
    "halves": lambda data: halves([*boards(data), *os1(data)]),
    "depth": depth_images,
    "layered": lambda _: layered(1),
    "curved": lambda _: curved(1),
}


def scenes_of(group: str, data: Path, seeds: list[int] | None) -> list[Scene]:
    """The scenes of a group; seeds other than its own are for those that are generated."""
    if group in GENERATED:
        scene, default = GENERATED[group]
        return [scene(seed) for seed in seeds or default]
    return RECORDED[group](data)
