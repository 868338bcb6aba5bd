"""Solids from the planes of a scan: kinds that are right, and errors of centre and orientation.

    python benches/solids.py around resting tilted --scenes 20 --rng 3000 --jobs 2

"around": one tilted solid in the air, of a kind each scene, seen from 30 places on a sphere with noise
of 1 % of its size. "resting" and "tilted": four solids of random kinds on the floor of an arena of
2 x 2 m, on a face or turned anyhow, seen from 0.15, 0.4 and 0.8 m above a grid of places with 3 mm of
noise; of many a face or two is seen by no beam or by few. "round" and "leaning": the same of
cylinders, cones, spheres and boxes. Scene i is made from seed rng + i. Errors are those of the solids
with the right kind; centres are also given as a share of the size. With `--flat` nothing curved is
looked for.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from scipy.spatial.transform import Rotation

import primfit
from primfit.worlds.random_polyhedra import POLYHEDRA, random_polyhedron
from primfit.worlds.random_rounds import ROUNDS


def around(seed: int) -> tuple[primfit.World, primfit.Scan]:
    """One solid, seen from all around."""
    rng = np.random.default_rng(seed)
    kind = list(POLYHEDRA)[seed % len(POLYHEDRA)]
    solid = random_polyhedron(kind, POLYHEDRA[kind], (0.0, 2 * np.pi), rng, tilted=True)
    size = float(np.ptp(solid.vertices, axis=0).max())
    solid = solid.moved([0.0, 0.0, 5 * size])
    ways = rng.normal(size=(30, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    path = np.tile(np.eye(4), (len(ways), 1, 1))
    across = np.cross([0.0, 0.0, 1.0], -ways)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    path[:, :3, 0], path[:, :3, 1], path[:, :3, 2] = -ways, across, np.cross(-ways, across)
    path[:, :3, 3] = solid.center + 4 * size * ways
    view = 2 * np.arctan(0.9 / 4)
    lidar = primfit.Lidar(40, view, 41, view, 0.001, 6 * size, noise=0.01 / 6)
    world = primfit.World([solid])
    return world, primfit.scan(world, path, lidar, rng=seed)


def on_the_floor(
    seed: int, tilted: bool, kinds: tuple[str, ...] = tuple(POLYHEDRA)
) -> tuple[primfit.World, primfit.Scan]:
    """Four solids in an arena, seen from three heights."""
    world = primfit.random_world(4, 2.0, kinds, rng=seed, tilted=tilted)
    places = primfit.grid_path(world, 0.5, rng=seed)[::2]
    path = np.tile(np.eye(4), (3, len(places), 1, 1))
    path[..., :3, :3] = Rotation.from_rotvec(places[:, 2:] * [0, 0, 1]).as_matrix()
    path[..., :2, 3] = places[:, :2]
    path[..., 2, 3] = np.array([[0.15], [0.4], [0.8]])
    lidar = primfit.Lidar(24, 1.6, 160, 2 * np.pi, max_range=4.0, noise=0.003 / 4.0)
    return world, primfit.scan(world, path.reshape(-1, 4, 4), lidar, rng=seed)


SCENES = {
    "around": around,
    "resting": lambda seed: on_the_floor(seed, tilted=False),
    "tilted": lambda seed: on_the_floor(seed, tilted=True),
    "round": lambda seed: on_the_floor(seed, tilted=False, kinds=(*ROUNDS, "box")),
    "leaning": lambda seed: on_the_floor(seed, tilted=True, kinds=(*ROUNDS, "box")),
}


def run(job: tuple[str, int, primfit.PlaneSettings]) -> tuple[list[tuple], int, float]:
    """Each solid (truth, found, centre in mm, over the size, angle), spurious ones, CPU seconds."""
    name, seed, how = job
    world, scan = SCENES[name](seed)
    start = time.process_time()
    found = primfit.detect(scan, how, n_jobs=1)
    seconds = time.process_time() - start
    report = primfit.evaluate(found, world)
    rows = []
    for row, solid in zip(report.rows, world.solids, strict=True):
        size = np.ptp(solid.to_mesh()[0], axis=0).max()
        share = 1e-3 * row.center_error_mm / size
        rows.append((row.truth, row.found, row.center_error_mm, share, row.angle_error_deg))
    return rows, len(report.spurious), seconds


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes_of", nargs="*", default=list(SCENES), metavar="scene")
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--rng", type=int, default=3000)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--flat", action="store_true", help="look for planes alone")
    arguments = parser.parse_args()
    how = primfit.PlaneSettings(kinds=("plane",)) if arguments.flat else primfit.PlaneSettings()
    print(f"primfit {primfit.__version__}")
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        for name in arguments.scenes_of:
            seeds = range(arguments.rng, arguments.rng + arguments.scenes)
            results = list(pool.map(run, [(name, seed, how) for seed in seeds]))
            rows = [row for each, _, _ in results for row in each]
            right = np.array([row[2:] for row in rows if row[0] == row[1]])
            median = np.nanmedian(right, axis=0)
            print(
                f"{name:8} {len(right)} of {len(rows)} right, "
                f"{sum(row[1] is None for row in rows)} missed, "
                f"{sum(n for _, n, _ in results)} spurious; centre median {median[0]:.3f} mm, "
                f"{100 * median[1]:.3f} % of the size, angle {median[2]:.3f} deg; "
                f"{np.mean([seconds for *_, seconds in results]):.1f} CPU s a scene"
            )
            wrong = [(row[0], row[1]) for row in rows if row[0] != row[1]]
            for pair in sorted(set(wrong), key=str):
                print(f"    {pair[0]} as {pair[1]}: {wrong.count(pair)}")


if __name__ == "__main__":
    main()
