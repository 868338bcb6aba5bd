"""Rays a CPU-second of primfit, Open3D and Embree on the same scenes, answers compared first.

    python benches/rays.py                        all scenes and beams
    python benches/rays.py --scenes paper city --repeat 5 --threads 2

Needs the extra `bench`. embreex offers no packets: it casts one ray after the other. Every round
builds and casts with each library in turn; a figure is the median over the rounds. The scene "rounds" holds
round solids, which primfit casts in closed form; the others, and primfit itself once more, cast the
meshes of 64 sides that stand for them. Open3D and Embree work in float32, so their ranges may differ
by its rounding, and rays within rounding of an edge may differ altogether; how many do is printed,
and more than one in a thousand (of round solids, one in twenty) makes the exit status 1.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from statistics import median
from typing import Any

import numpy as np

import primfit

Mesh = tuple[np.ndarray, np.ndarray]
Scene = Mesh | primfit.World
Rays = tuple[np.ndarray, np.ndarray]


SQUARE = np.array([[0, 1, 2], [0, 2, 3]])


def paper(rng: np.random.Generator) -> tuple[Mesh, np.ndarray]:
    """A map of the paper's, about 100 triangles; from its valid poses."""
    world = primfit.random_world(rng=rng)
    path = primfit.grid_path(world, rng=rng)
    places = np.column_stack([path[:, :2], np.full(len(path), 0.06)])
    return world.to_mesh()[:2], places


def city(rng: np.random.Generator) -> tuple[Mesh, np.ndarray]:
    """200 000 triangles: houses at random on a plain; from the height of a car."""
    n = 16_666
    width = 20.0 * np.sqrt(n)
    corners, triangles = primfit.Prism.regular(4, 1.0, height=1.0).to_mesh()
    places = np.column_stack([rng.uniform(0, width, (n, 2)), np.zeros(n)])
    houses = places[:, None] + rng.uniform(3, 12, (n, 1, 3)) * corners
    rows = 8 * np.arange(n)[:, None, None] + triangles
    plain = width * np.array([[-0.1, -0.1, 0], [1.1, -0.1, 0], [1.1, 1.1, 0], [-0.1, 1.1, 0]])
    vertices = np.concatenate([houses.reshape(-1, 3), plain])
    ground = 8 * n + SQUARE
    eyes = np.column_stack([rng.uniform(0, width, (500, 2)), np.full(500, 1.8)])
    return (vertices, np.concatenate([rows.reshape(-1, 3), ground])), eyes


def terrain(rng: np.random.Generator) -> tuple[Mesh, np.ndarray]:
    """A million triangles: a rough hilly square of 100 m; from some metres above."""
    n = 708
    axis = np.linspace(0, 100, n)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    z = 3 * np.sin(x / 7) * np.cos(y / 5) + 0.5 * np.sin(1.3 * x + y)
    z += rng.normal(scale=0.02, size=z.shape)
    row = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (row[:-1, :-1], row[1:, :-1], row[1:, 1:], row[:-1, 1:]))
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    eyes = np.column_stack([rng.uniform(10, 90, (500, 2)), np.full(500, 6.0)])
    return (np.column_stack([x.ravel(), y.ravel(), z.ravel()]), triangles), eyes


def prisms(rng: np.random.Generator) -> tuple[Mesh, np.ndarray]:
    """200 000 triangles: 10 000 prisms of 5 to 7 sides, a cell of 20 m each; from the crossings.

    They are 4 to 8 m wide and 4 to 50 m high, on a ground of two triangles, and streets are
    between them: much of what neighbouring beams meet is far apart.
    """
    n, cell = 100, 20.0
    row, column = (each.ravel() for each in np.meshgrid(np.arange(n), np.arange(n)))
    middles = cell * (np.column_stack([row, column]) + 0.5) + rng.uniform(-5, 5, (n * n, 2))
    sides = rng.integers(5, 8, n * n)
    sizes = np.column_stack([rng.uniform(2, 4, n * n)] * 2 + [rng.uniform(4, 50, n * n)])
    yaw = rng.uniform(0, 2 * np.pi, n * n)
    vertices, triangles, count = [], [], 0
    for m in (5, 6, 7):
        some = np.flatnonzero(sides == m)
        corners, rows = primfit.Prism.regular(m, 2 * np.sin(np.pi / m), height=1.0).to_mesh()
        x, y, z = (corners * sizes[some, None]).transpose(2, 0, 1)
        cos, sin = np.cos(yaw[some, None]), np.sin(yaw[some, None])
        turned = np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
        turned[..., :2] += middles[some, None]
        vertices.append(turned.reshape(-1, 3))
        triangles.append(
            (count + 2 * m * np.arange(len(some))[:, None, None] + rows).reshape(-1, 3)
        )
        count += 2 * m * len(some)
    far = n * cell
    ground = np.array([[0, 0, 0], [far, 0, 0], [far, far, 0], [0, far, 0]], dtype=float)
    mesh = np.vstack([*vertices, ground]), np.vstack([*triangles, count + SQUARE])
    return mesh, np.column_stack([cell * rng.integers(1, n, (500, 2)), np.full(500, 1.8)])


def rounds(rng: np.random.Generator) -> tuple[primfit.World, np.ndarray]:
    """100 round solids in a hall of 20 m: cylinders, cones, spheres and tori; from between them."""
    solids: list[primfit.Solid] = []
    for i in range(100):
        place = 2.0 * np.array([i % 10 + 0.5, i // 10 + 0.5]) + rng.uniform(-0.3, 0.3, 2)
        radius, height = rng.uniform(0.2, 0.5), rng.uniform(0.5, 2.5)
        if i % 4 == 0:
            solids.append(primfit.Cylinder(radius, height, place))
        elif i % 4 == 1:
            solids.append(primfit.Cone(radius, height, place, top_radius=radius * rng.uniform()))
        elif i % 4 == 2:
            solids.append(primfit.Sphere(radius, [*place, rng.uniform(0.5, 2.0)]))
        else:
            axis = rng.normal(size=3)
            tube = radius * rng.uniform(0.2, 0.6)
            solids.append(primfit.Torus(radius, tube, [*place, rng.uniform(0.8, 2.0)], axis))
    world = primfit.World(solids, primfit.Arena((20, 20), height=3.0))
    return world, np.column_stack([2.0 * rng.integers(1, 10, (500, 2)), np.full(500, 1.2)])


def grid(places: np.ndarray, rng: np.random.Generator, *, poses: int, lidar: primfit.Lidar) -> Rays:
    """The beams of a lidar at some places, turned about the vertical."""
    some = places[rng.integers(0, len(places), poses)]
    yaw = rng.uniform(0, 2 * np.pi, (poses, 1))
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y, z = lidar.directions.reshape(-1, 3).T
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, np.tile(z, (poses, 1))], axis=-1)
    return np.repeat(some, len(x), axis=0), turned.reshape(-1, 3)


def scattered(places: np.ndarray, rng: np.random.Generator, *, n: int) -> Rays:
    """Rays in all directions from all over the scene."""
    low, high = places.min(axis=0), places.max(axis=0)
    origins = rng.uniform(low, high * [1, 1, 2], (n, 3))
    directions = rng.normal(size=(n, 3))
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


SPINNING = primfit.Lidar(64, 0.6, 1024, 2 * np.pi, max_range=100.0)
SCENES: dict[str, Callable[[np.random.Generator], tuple[Scene, np.ndarray]]] = {
    "paper": paper,
    "city": city,
    "terrain": terrain,
    "prisms": prisms,
    "rounds": rounds,
}
BEAMS: dict[str, Callable[[np.ndarray, np.random.Generator, float], Rays]] = {
    "8 x 100": lambda p, rng, share: grid(
        p, rng, poses=max(1, int(500 * share)), lidar=primfit.Lidar()
    ),
    "64 x 1024": lambda p, rng, share: grid(p, rng, poses=max(1, int(50 * share)), lidar=SPINNING),
    "random": lambda p, rng, share: scattered(p, rng, n=int(1_000_000 * share)),
}


def build_primfit(mesh: Scene, threads: int) -> Callable[[Rays], Callable[[], np.ndarray]]:
    """primfit, as its users call it."""
    caster = primfit.RayCaster(mesh)
    return lambda rays: lambda: caster.cast(*rays, threads)[0]


def build_open3d(mesh: Mesh, threads: int) -> Callable[[Rays], Callable[[], np.ndarray]]:
    """Open3D's RaycastingScene."""
    import open3d

    tensor = open3d.core.Tensor
    scene = open3d.t.geometry.RaycastingScene(nthreads=threads)
    scene.add_triangles(tensor(mesh[0].astype(np.float32)), tensor(mesh[1].astype(np.uint32)))
    scene.cast_rays(tensor(np.zeros((1, 6), np.float32)), nthreads=threads)  # builds the tree

    def prepare(rays: Rays) -> Callable[[], np.ndarray]:
        rows = tensor(np.concatenate(rays, axis=1).astype(np.float32))
        return lambda: scene.cast_rays(rows, nthreads=threads)["t_hit"].numpy()

    return prepare


def build_embree(mesh: Mesh, threads: int) -> Callable[[Rays], Callable[[], np.ndarray]]:
    """Embree through embreex, which casts on one thread."""
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    built = TriangleMesh(scene, mesh[0].astype(np.float32), mesh[1].astype(np.int32))
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree

    def prepare(rays: Rays) -> Callable[[], np.ndarray]:
        origins, directions = (np.ascontiguousarray(part, dtype=np.float32) for part in rays)

        def cast(mesh: Any = built) -> np.ndarray:
            ranges = scene.run(origins, directions, query="DISTANCE")
            return np.where(ranges < 1e30, ranges, np.inf)

        return cast

    return prepare


LIBRARIES = {
    "primfit": ("primfit", build_primfit),
    "primfit, meshed": ("primfit", build_primfit),
    "Open3D": ("open3d-cpu", build_open3d),
    "Embree (embreex)": ("embreex", build_embree),
}


def timed(call: Callable[[], Any]) -> tuple[float, float, Any]:
    """CPU and wall seconds of a call, and its answer."""
    cpu, wall = time.process_time(), time.perf_counter()
    answer = call()
    return time.process_time() - cpu, time.perf_counter() - wall, answer


def share_that_differs(ours: np.ndarray, theirs: np.ndarray, extent: float) -> float:
    """The share of rays whose ranges are farther apart than float32 explains."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    differ = np.isfinite(ours) != np.isfinite(theirs)
    # A grazing ray multiplies the rounding of coordinates.
    differ[both] = np.abs(ours[both] - theirs[both]) > 1e-4 * extent
    return float(differ.mean())


def main() -> int:
    """Print a table a scene; exit status 1 when answers differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--beams", nargs="+", choices=BEAMS, default=list(BEAMS))
    parser.add_argument("--share", type=float, default=0.2, help="of the poses and rays")
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rng", type=int, default=7)
    arguments = parser.parse_args()
    libraries = {}
    for name, (package, build) in LIBRARIES.items():
        try:
            print(f"{name} {version(package)}", end=", ")
            libraries[name] = build
        except PackageNotFoundError:
            print(f"{name} not installed", end=", ")
    print(f"Python {platform.python_version()}, numpy {np.__version__};", end=" ")
    print(f"{arguments.threads} of {os.cpu_count()} processors")
    differ = False
    for scene in arguments.scenes:
        rng = np.random.default_rng(arguments.rng)
        given, places = SCENES[scene](rng)
        mesh = given.to_mesh()[:2] if isinstance(given, primfit.World) else given
        # The sides of a mesh are up to 1.4 mm within the solid it stands for, and more along grazing
        # rays: 1.8 % of the answers differ; with 256 sides it is 0.01 %, with 1024 none.
        most_differing = 1e-3 if mesh is given else 5e-2
        extent = float(np.ptp(mesh[0], axis=0).max())
        print(f"\n{scene}, {len(mesh[1])} triangles; seconds to build (CPU, wall):")
        builders = {
            name: partial(build, given if name == "primfit" else mesh, arguments.threads)
            for name, build in libraries.items()
            if mesh is not given or name != "primfit, meshed"
        }
        casters, built = {}, {name: [] for name in builders}
        for _ in range(arguments.repeat):
            for name, build in builders.items():
                cpu, wall, casters[name] = timed(build)
                built[name].append((cpu, wall))
        ours = median(run[0] for run in built["primfit"])
        for name, runs in built.items():
            cpu, wall = (median(run[i] for run in runs) for i in (0, 1))
            print(
                f"  {name:18} {cpu:8.4f} {wall:8.4f}   primfit is {cpu / ours:5.2f} times as fast"
            )
        for beams in arguments.beams:
            rays = BEAMS[beams](places, rng, arguments.share)
            n = len(rays[0])
            calls = {name: prepare(rays) for name, prepare in casters.items()}
            answers = {name: call() for name, call in calls.items()}
            rounds = {name: [] for name in calls}
            for _ in range(arguments.repeat):
                for name, call in calls.items():
                    rounds[name].append(timed(call)[:2])
            print(f"  {beams}, {n} rays; Mrays per CPU-second, per second:")
            ours = n / 1e6 / median(run[0] for run in rounds["primfit"])
            for name, runs in rounds.items():
                cpu, wall = (n / 1e6 / max(median(run[i] for run in runs), 1e-9) for i in (0, 1))
                off = share_that_differs(answers["primfit"], answers[name], extent)
                differ |= off > most_differing
                print(
                    f"    {name:18} {cpu:7.2f} {wall:7.2f}   primfit is {ours / cpu:5.2f} times as "
                    f"fast; {off:.1e} of the answers differ"
                )
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
