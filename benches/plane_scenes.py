"""Clouds with known planes: generated ones, and the shared recorded ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import primfit


@dataclass(frozen=True)
class Scene:
    """A cloud; truth (n,) numbers its planes, -1 is none; sigma is the noise, if known."""

    name: str
    points: np.ndarray
    truth: np.ndarray | None = None
    sigma: float | None = None
    extra: dict[str, Any] = field(default_factory=dict)


def faces_of(vertices: np.ndarray) -> list[np.ndarray]:
    """Triangles of a convex solid, put together by face."""
    hull = ConvexHull(vertices)
    faces: dict[tuple[float, ...], list[np.ndarray]] = {}
    for triangle, equation in zip(hull.simplices, hull.equations, strict=True):
        faces.setdefault(tuple(np.round(equation, 6)), []).append(vertices[triangle])
    return [np.array(triangles) for triangles in faces.values()]


def sampled(
    faces: list[np.ndarray],
    sigma: list[float],
    n: int,
    outliers: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over faces (lists of triangles), with isotropic noise and outliers."""
    triangles = np.concatenate(faces)
    owner = np.repeat(np.arange(len(faces)), [len(face) for face in faces])
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    n_inside = round(n * (1 - outliers))
    which = rng.choice(len(triangles), size=n_inside, p=areas / areas.sum())
    uv = rng.uniform(size=(n_inside, 2))
    uv = np.where(uv.sum(axis=1, keepdims=True) > 1, 1 - uv, uv)
    points = triangles[which, 0] + np.einsum("ni,nij->nj", uv, edges[which])
    noise = np.asarray(sigma)[owner[which], None]
    points = points + noise * rng.normal(size=points.shape)
    low, high = points.min(axis=0), points.max(axis=0)
    clutter = rng.uniform(low, high, (n - n_inside, 3))
    truth = np.concatenate([owner[which], np.full(len(clutter), -1)])
    mix = rng.permutation(n)
    return np.concatenate([points, clutter])[mix], truth[mix]


def quad(a: Any, b: Any, c: Any, d: Any) -> np.ndarray:
    """Two triangles."""
    return np.array([[a, b, c], [a, c, d]], dtype=float)


def prisms(sigma_mm: float, seed: int) -> Scene:
    """The walls of a random map, 0.4 m high, and those of its arena."""
    rng = np.random.default_rng(seed)
    world = primfit.random_world(rng=rng)
    (x, y), h = world.arena.size, 0.4
    outlines = [solid.footprint for solid in world.solids]
    outlines.append(np.array([[0, 0], [x, 0], [x, y], [0, y]], dtype=float))
    walls = [
        quad((*a, 0), (*b, 0), (*b, h), (*a, h))
        for outline in outlines
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True)
    ]
    points, truth = sampled(walls, [sigma_mm / 1000] * len(walls), 20_000, 0.0, rng)
    return Scene(f"prisms {sigma_mm:g} mm, seed {seed}", points, truth, sigma_mm / 1000)


def polyhedra(seed: int, n: int = 200_000) -> Scene:
    """20 tilted solids of 4 to 8 faces over a floor; noise 1 % of the size of each."""
    rng = np.random.default_rng(seed)
    faces, sigma = [quad((0, 0, 0), (10, 0, 0), (10, 8, 0), (0, 8, 0))], [0.01]
    for k in range(20):
        size = rng.uniform(0.7, 1.4)
        turn = np.arange(int(rng.integers(3, 7))) * 2 * np.pi
        ring = np.column_stack([np.cos(turn / len(turn)), np.sin(turn / len(turn))])
        top = rng.choice([0.0, 0.6, 1.0])
        corners = np.concatenate(
            [
                np.column_stack([ring, np.full(len(ring), -0.6)]),
                np.column_stack([ring * top, np.full(len(ring), 0.6)]),
            ]
        )
        corners = np.unique(np.round(corners, 9), axis=0) * size / 1.6
        corners = Rotation.random(rng=rng).apply(corners)
        corners += [2 * (k % 5) + 1, 2 * (k // 5) + 1, 1.5]
        solid = faces_of(corners)
        faces += solid
        sigma += [0.01 * size] * len(solid)
    points, truth = sampled(faces, sigma, n, 0.05, rng)
    return Scene(f"polyhedra, seed {seed}", points, truth)


def building(seed: int, n: int = 2_000_000) -> Scene:
    """100 planes of 1 to 500 square metres: 5 x 5 rooms of different height, each with its own."""
    rng = np.random.default_rng(seed)
    faces = []
    for i in range(5):
        for j in range(5):
            w, d = np.exp(rng.uniform(np.log(1.0), np.log(22.0), 2))
            h = rng.uniform(1.0, 8.0)
            x, y, z = 26.0 * i, 26.0 * j, rng.uniform(0, 2)
            tilt = Rotation.from_euler("zyx", rng.uniform(-0.3, 0.3, 3))
            a, b, c = tilt.apply([[w, 0, 0], [0, d, 0], [0, 0, h]])
            o = np.array([x, y, z])
            faces += [
                quad(o, o + a, o + a + b, o + b),
                quad(o, o + a, o + a + c, o + c),
                quad(o, o + b, o + b + c, o + c),
                quad(o + c, o + c + a, o + c + a + 0.3 * b, o + c + 0.3 * b),
            ]
    points, truth = sampled(faces, [0.01] * len(faces), n, 0.2, rng)
    return Scene(f"building, seed {seed}", points, truth, 0.01)


def mixed(seed: int, n: int = 100_000) -> Scene:
    """A floor and a wall with spheres, cylinders and cones in front, which are no planes."""
    rng = np.random.default_rng(seed)
    m = n // 12
    u, v = rng.uniform(size=(2, m))
    flat = [np.column_stack([6 * u, 4 * v, 0 * u]), np.column_stack([6 * u, 0 * u, 2 * v])]
    curved = []
    for k in range(5):
        turn, up = 2 * np.pi * rng.uniform(size=m), rng.uniform(size=m)
        around = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(m)])
        radius = rng.uniform(0.25, 0.4)
        place = np.array([0.8 + 1.1 * k, 1.2, 0.0])
        axis = np.column_stack([0 * up, 0 * up, up])
        sphere = rng.normal(size=(m, 3))
        sphere *= radius / np.linalg.norm(sphere, axis=1, keepdims=True)
        curved.append(sphere + place + (0, 0, 0.8))
        shape = radius * around + axis if k % 2 else radius * around * (1 - axis[:, 2:]) + axis
        curved.append(shape + place + (0, 1.6, 0.3))
    points = np.concatenate(flat + curved)
    points += 0.008 * rng.normal(size=points.shape)
    truth = np.repeat([0, 1, *[-1] * len(curved)], m)
    return Scene(f"mixed, seed {seed}", points, truth, 0.008)


def turns(n: int, seed: int) -> Scene:
    """Turns of a sensor with 16 layers that stands still in a room of 8 x 6 x 3 m, 10 mm of noise."""
    rng = np.random.default_rng(seed)
    blocks = [
        primfit.Prism.regular(4, side, center=place, angle=angle, height=height)
        for place, side, angle, height in zip(
            [(1.5, 1.5), (6.5, 1.5), (1.5, 4.5), (6.5, 4.5), (4.0, 5.0)],
            rng.uniform(0.6, 1.4, 5),
            rng.uniform(0, np.pi, 5),
            rng.uniform(0.5, 2.5, 5),
            strict=True,
        )
    ]
    world = primfit.World(blocks, arena=primfit.Arena((8.0, 6.0), height=3.0))
    lidar = primfit.Lidar(
        16, np.radians(30), 1800, 2 * np.pi, max_range=100.0, noise=1e-4, mount=(0, 0, 1.2)
    )
    place = [*rng.uniform([3.5, 2.5], [4.5, 3.5]), rng.uniform(0, np.pi)]
    scan = primfit.scan(world, np.tile(place, (n, 1)), lidar, rng=rng)
    vertices, triangles, solids = world.to_mesh()
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = np.column_stack([normals, (normals * corners[:, 0]).sum(axis=1), solids])
    face = np.unique(np.round(planes, 6), axis=0, return_inverse=True)[1].ravel()
    hit = primfit.RayCaster((vertices, triangles)).cast(scan.origins, scan.directions)[1]
    is_seen = scan.is_return & (hit >= 0)
    truth = face[hit[is_seen]]
    truth[np.bincount(truth)[truth] < 50 * n] = -1
    return Scene(f"{n} turns, seed {seed}", scan.points[is_seen], truth, 0.01)


def roofs(data: Path) -> list[Scene]:
    scenes = []
    for name in ("Pyramid_roof_1054136", "Two-sided_hip_roof_17234"):
        points = np.loadtxt(data / f"roofs/{name}.pts")[:, :3]
        truth = np.loadtxt(data / f"roofs/{name}.seg", dtype=int)
        scenes.append(Scene(f"roof {name}", points, np.where(truth == 5, -1, truth)))
    table = np.loadtxt(data / "roofs/building3d_22523.txt")
    table = np.unique(table, axis=0)
    scenes.append(Scene("roof building3d_22523", table[:, :3], table[:, 3].astype(int)))
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


GENERATED: dict[str, tuple[Callable[[int], Scene], tuple[int, ...]]] = {
    "prisms10": (lambda seed: prisms(10, seed), (1, 2, 3)),
    "prisms25": (lambda seed: prisms(25, seed), (1, 2, 3)),
    "prisms50": (lambda seed: prisms(50, seed), (1, 2, 3)),
    "polyhedra": (polyhedra, (1,)),
    "building": (building, (1,)),
    "mixed": (mixed, (1,)),
    "turn": (lambda seed: turns(1, seed), (1, 2, 3)),
    "turns5": (lambda seed: turns(5, seed), (1, 2, 3)),
    "turns30": (lambda seed: turns(30, seed), (1, 2, 3)),
}
"""How a scene is made from a seed, and the seeds that are used if none are given."""

RECORDED: dict[str, Callable[[Path], list[Scene]]] = {
    "roofs": roofs,
    "board": boards,
    "boxes": boxes,
    "room": lambda data: [room(data)],
    "kinect": kinect,
}
