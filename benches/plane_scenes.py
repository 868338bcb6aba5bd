"""Generated clouds with known planes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import ndimage
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


def furnished(layers: int, columns: int, field_of_view_deg: float, seed: int) -> Scene:
    """A furnished room seen once by a spinning sensor, 20 mm of noise along the beams.

    Walls, floor, ceiling, tables, cupboards, shelves, doors ajar, crates: the truth numbers their
    faces; what is seen of one in pieces, beside a person or a leg of a table, are several. People (ellipsoids), a round column and stray returns are no planes. Faces that fewer than 50 beams
    meet, or that are seen less than 6 sigma wide, count neither way.
    """
    rng = np.random.default_rng(seed)
    meshes, is_flat = [box_mesh([0, 0, 0], [7.0, 5.5, 2.8], 0.0)], [True]
    corners = [(0.35, 0.3), (6.6, 0.3), (0.35, 5.1), (6.6, 5.1)]
    for x, y in corners:
        size = rng.uniform([0.5, 0.4, 0.8], [1.4, 0.6, 2.0])
        low = [x - size[0] / 2 if 0.8 < x < 6.2 else (0.05 if x < 1 else 6.95 - size[0])]
        low += [0.04 if y < 1 else 5.46 - size[1], 0.0]
        meshes.append(box_mesh(low, size, 0.0))
        is_flat.append(True)
    for x, y in ((1.7, 2.7), (5.2, 2.9)):
        width, depth, height = rng.uniform([1.2, 0.7, 0.68], [1.8, 0.9, 0.78])
        turn = rng.uniform(0, np.pi)
        meshes.append(box_mesh([x - width / 2, y - depth / 2, height], [width, depth, 0.04], turn))
        meshes.append(
            box_mesh([x - width / 2, y - depth / 2, 0], [0.04, depth, height], turn, (x, y))
        )
        meshes.append(
            box_mesh([x + width / 2 - 0.04, y - depth / 2, 0], [0.04, depth, height], turn, (x, y))
        )
        is_flat += [True] * 3
    for shelf in (0.5, 1.0, 1.5, 2.0):
        meshes.append(box_mesh([2.6, 0.0, shelf], [1.4, 0.35, 0.03], 0.0))
        is_flat.append(True)
    meshes.append(
        box_mesh([0.02, 3.6, 0.0], [0.9, 0.04, 2.0], rng.uniform(-1.2, -0.3), (0.02, 3.6))
    )
    meshes.append(box_mesh([3.0, 4.6, 0.0], rng.uniform(0.4, 0.8, 3), rng.uniform(0, np.pi)))
    is_flat += [True] * 2
    for _ in range(4):
        place = [*rng.uniform([2.2, 1.0], [4.8, 4.4]), 0.85]
        for height, size in ((0.0, (0.22, 0.16, 0.85)), (0.75, (0.11, 0.11, 0.14))):
            center = np.add(place, (0.0, 0.0, height))
            meshes.append(ellipsoid_mesh(center, size, rng.uniform(0, np.pi)))
            is_flat.append(False)
    vertices = np.concatenate([mesh[0] for mesh in meshes])
    starts = np.cumsum([0, *(len(mesh[0]) for mesh in meshes)])[:-1]
    triangles = np.concatenate(
        [mesh[1] + start for mesh, start in zip(meshes, starts, strict=True)]
    )
    owner = np.repeat(np.arange(len(meshes)), [len(mesh[1]) for mesh in meshes])
    up = np.radians(np.linspace(field_of_view_deg / 2, -field_of_view_deg / 2, layers))
    around = 2 * np.pi * (np.arange(columns) + rng.uniform()) / columns
    up, around = (grid.ravel() for grid in np.meshgrid(up, around, indexing="ij"))
    directions = np.column_stack(
        [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
    )
    origins = np.tile(rng.uniform([3.2, 1.8, 1.1], [4.0, 3.4, 1.4]), (len(up), 1))
    ranges, hit = primfit.RayCaster((vertices, triangles)).cast(origins, directions)
    ranges = ranges + 0.02 * rng.normal(size=len(ranges))
    # Rain on the lens, edges that a beam half meets, mirrors: one return in 100 is anywhere.
    stray = rng.uniform(size=len(ranges)) < 0.01
    ranges = np.where(stray, rng.uniform(0.3, 1.0, len(ranges)) * ranges, ranges)
    points = origins + ranges[:, None] * directions
    face = faces_hit(vertices[triangles], owner)[hit]
    truth = np.where(np.array(is_flat)[owner[hit]] & ~stray, face, -1)
    truth = seen_pieces(truth.reshape(layers, columns)).ravel()
    ignored = np.zeros(len(points), dtype=bool)
    for k in np.unique(truth[truth >= 0]):
        own = truth == k
        widths = (
            np.sqrt(12 * np.linalg.eigvalsh(np.cov(points[own].T))) if own.sum() > 3 else [0, 0]
        )
        if own.sum() < 50 or widths[1] < 6 * 0.02:
            ignored |= own
    truth[ignored] = -1
    name = f"furnished {layers} x {columns}, seed {seed}"
    return Scene(name, points, truth, 0.02, {"ignored": ignored})


def seen_pieces(faces: np.ndarray) -> np.ndarray:
    """Number of the piece (layers, columns) that each beam meets of a face, -1 for none.

    Beams are together that meet the same face at most 2 layers and 4 columns apart.
    """
    pieces = np.full(faces.shape, -1)
    n_before = 0
    for face in np.unique(faces[faces >= 0]):
        own = faces == face
        # Around the turn: the last column is beside the first.
        wide = np.concatenate([own] * 2, axis=1)
        labels, _ = ndimage.label(ndimage.binary_dilation(wide, np.ones((3, 5))), np.ones((3, 3)))
        once = np.unique(labels[:, faces.shape[1] // 2 : -(faces.shape[1] // 2)])
        first, second = np.split(labels, 2, axis=1)
        number = np.where(np.isin(second, once), second, first)
        pieces[own] = n_before + np.unique(number[own], return_inverse=True)[1]
        n_before = pieces.max() + 1
    return pieces


def box_mesh(
    low: Any, size: Any, turn: float, about: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a box, turned about its middle or a place."""
    low, size = np.asarray(low, float), np.asarray(size, float)
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    vertices = low + corners * size
    middle = np.array([*(about if about is not None else (low + size / 2)[:2]), 0.0])
    vertices = Rotation.from_euler("z", turn).apply(vertices - middle) + middle
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def ellipsoid_mesh(center: Any, size: Any, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an ellipsoid with these half axes, as round as its beams see."""
    around, up = np.meshgrid(
        np.linspace(0, 2 * np.pi, 48, endpoint=False), np.linspace(-1.56, 1.56, 24)
    )
    round_ = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    vertices = Rotation.from_euler("z", turn).apply(round_.reshape(-1, 3) * size) + center
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(23), np.arange(48), indexing="ij"))
    a, b = 48 * i + j, 48 * i + (j + 1) % 48
    return vertices, np.concatenate(
        [np.column_stack([a, b, a + 48]), np.column_stack([b, b + 48, a + 48])]
    )


def faces_hit(corners: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Number of the face that each triangle (t, 3, 3) is part of."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = np.column_stack([normals, (normals * corners[:, 0]).sum(axis=1), owner])
    return np.unique(np.round(planes, 6), axis=0, return_inverse=True)[1].ravel()


def scattered(seed: int) -> Scene:
    """Returns in the air of a room, of dust or rain: no plane."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(500, 4000))
    around, up = rng.uniform(0, 2 * np.pi, n), rng.uniform(-0.4, 0.4, n)
    ranges = 20 * rng.uniform(size=n) ** (1 / rng.integers(1, 4))
    directions = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
    return Scene(f"scattered, seed {seed}", (ranges * np.array(directions)).T, np.full(n, -1))


def patches(name: str, parts: list[np.ndarray], sigma: float) -> Scene:
    truth = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return Scene(name, np.concatenate(parts), truth, sigma)


def rectangle(
    corner: Any, u: Any, v: Any, per_m2: float, sigma: float, rng: np.random.Generator
) -> np.ndarray:
    """Points scattered over a rectangle, noise across it."""
    corner, u, v = (np.array(x, float) for x in (corner, u, v))
    normal = np.cross(u, v)
    n = max(10, round(per_m2 * np.linalg.norm(normal)))
    at = rng.uniform(size=(n, 2))
    off = rng.normal(0, sigma, (n, 1)) * normal / np.linalg.norm(normal)
    return corner + at[:, :1] * u + at[:, 1:] * v + off


def layered(seed: int) -> list[Scene]:
    """Sheets 10 sigma apart, stairs, panels, slats and cartons with equal gaps, doors, a slab."""
    rng = np.random.default_rng(seed)

    def wall(y: float, sigma: float, per_m2: float) -> np.ndarray:
        return rectangle([0, y, 0], [5, 0, 0], [0, 0, 2.5], per_m2, sigma, rng)

    def step(k: int, sigma: float) -> list[np.ndarray]:
        tread = rectangle(
            [0.28 * k, 0, 0.17 * (k + 1)], [0.28, 0, 0], [0, 1.2, 0], 3000, sigma, rng
        )
        riser = rectangle([0.28 * k, 0, 0.17 * k], [0, 0, 0.17], [0, 1.2, 0], 3000, sigma, rng)
        return [tread, riser]

    def grid(nx: int, ny: int, size: tuple[float, float], gap: float, n: float) -> list[np.ndarray]:
        return [
            rectangle(
                [(size[0] + gap) * i, (size[1] + gap) * j, 0],
                [size[0], 0, 0],
                [0, size[1], 0],
                n,
                0.003,
                rng,
            )
            for i in range(nx)
            for j in range(ny)
        ]

    def door(thick: float, per_m2: float, sigma: float) -> list[np.ndarray]:
        w, h = 0.9, 2.0
        return [
            rectangle([0, 0, 0], [w, 0, 0], [0, 0, h], per_m2, sigma, rng),
            rectangle([0, thick, 0], [w, 0, 0], [0, 0, h], per_m2, sigma, rng),
            rectangle([0, 0, 0], [0, thick, 0], [0, 0, h], per_m2, sigma, rng),
            rectangle([w, 0, 0], [0, thick, 0], [0, 0, h], per_m2, sigma, rng),
            rectangle([0, 0, 0], [w, 0, 0], [0, thick, 0], per_m2, sigma, rng),
            rectangle([0, 0, h], [w, 0, 0], [0, thick, 0], per_m2, sigma, rng),
        ]

    thick = rectangle([0, 0, 0], [5, 0, 0], [0, 0, 2.5], 960, 0.05, rng)
    return [
        patches("wall 100 mm, noise 10", [wall(0, 0.01, 480), wall(0.1, 0.01, 480)], 0.01),
        patches("boards 20 mm, noise 1", [wall(0, 0.001, 480), wall(0.02, 0.001, 480)], 0.001),
        patches("one wall, noise 50", [thick], 0.05),
        patches("stairs, noise 5", [part for k in range(8) for part in step(k, 0.005)], 0.005),
        patches("stairs, noise 15", [part for k in range(8) for part in step(k, 0.015)], 0.015),
        patches("panels 6 x 1", grid(6, 1, (1.0, 1.6), 0.3, 940), 0.003),
        patches("panels 3 x 3", grid(3, 3, (1.0, 1.0), 0.3, 940), 0.003),
        patches("slats 7 x 1", grid(7, 1, (0.1, 1.2), 0.05, 20_000), 0.003),
        patches("cartons 3 x 2", grid(3, 2, (0.4, 0.3), 0.03, 40_000), 0.003),
        patches("door 40 mm", door(0.04, 5000, 0.001), 0.001),
        patches("plywood 18 mm", door(0.018, 20_000, 0.001), 0.001),
    ]


def curved(seed: int) -> list[Scene]:
    """A tank, a dome, a sphere, rolling ground: no plane."""
    rng = np.random.default_rng(seed)
    a, z = rng.uniform(0, 2 * np.pi, 20_000), rng.uniform(0, 5, 20_000)
    r = 10 + rng.normal(0, 0.02, 20_000)
    tank = np.column_stack([r * np.cos(a), r * np.sin(a), z])

    def ball(n: int, radius: float, sigma: float) -> np.ndarray:
        p = rng.normal(size=(n, 3))
        p /= np.linalg.norm(p, axis=1, keepdims=True)
        return p * (radius + rng.normal(0, sigma, (n, 1)))

    dome = ball(40_000, 20.0, 0.02)
    xy = rng.uniform(0, 60, (30_000, 2))
    height = 1.5 * np.sin(xy[:, 0] / 6) * np.cos(xy[:, 1] / 8) + rng.normal(0, 0.02, 30_000)
    clouds = {
        "tank": tank,
        "dome": dome[dome[:, 2] > 0],
        "sphere 20k": ball(20_000, 1.0, 0.005),
        "sphere 100k": ball(100_000, 1.0, 0.005),
        "ground": np.column_stack([xy, height]),
    }
    return [Scene(name, cloud, np.full(len(cloud), -1)) for name, cloud in clouds.items()]


def rosette(n: int, seed: int) -> Scene:
    """A board before a wall in the curves of a rosette scanner (two rotating prisms)."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 100_000
    one, other = 2 * np.pi * 121.57 * t, -2 * np.pi * 77.97 * t
    tan = 0.17 * np.column_stack([np.cos(one) + np.cos(other), np.sin(one) + np.sin(other)])
    directions = np.column_stack([np.ones(n), tan])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    on_board = (np.abs(4 * tan - [0.2, 0.1]) < [0.4, 0.5]).all(axis=1)
    depth = np.where(on_board, 4.0, 6.0)
    ranges = depth / directions[:, 0] + 0.02 * rng.normal(size=n)
    return Scene(f"rosette {n}", ranges[:, None] * directions, np.where(on_board, 0, 1), 0.02)


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
    "furnished64": (lambda seed: furnished(64, 1024, 45.0, seed), (1, 2, 3)),
    "furnished16": (lambda seed: furnished(16, 1800, 30.0, seed), (1, 2, 3)),
    "scattered": (scattered, tuple(range(1, 21))),
    "rosette": (lambda seed: rosette(48_000 * seed, seed), (1, 2, 5)),
}
"""How a scene is made from a seed, and the seeds that are used if none are given."""
