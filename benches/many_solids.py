"""How the time to find solids grows with their number.

    python benches/many_solids.py 6 12 25 80 --seeds 1 3

n solids of the reference in an arena of 2 sqrt(n / 6) m, as dense as six in 2 x 2 m, seen from a grid
of 0.25 m with 50 mm of noise; CPU seconds on one thread. The kernels by themselves are in
`scaling.py`.
"""

from __future__ import annotations

import argparse

import numpy as np
from scenes import Scene
from scenes_accuracy import looked_at

import primfit


def scene(n: int, seed: int, sigma: float = 0.05) -> Scene:
    """`n` solids as dense as those of the reference."""
    world = primfit.random_world(n, 2.0 * np.sqrt(n / 6.0), rng=seed)
    path = primfit.grid_path(world, 0.25, rng=seed)
    scan = primfit.scan(world, path, primfit.Lidar(noise=sigma), rng=seed)
    return Scene(world, scan, {"sigma": sigma})


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("numbers", type=int, nargs="*", default=[6, 25, 80], metavar="n")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 1), metavar=("FIRST", "N"))
    options = parser.parse_args()
    first, many = options.seeds
    print(f"primfit {primfit.__version__}")
    for n in options.numbers:
        runs = []
        for seed in range(first, first + many):
            made = scene(n, seed)
            runs.append((*looked_at(made, seed, {"n_jobs": 1}), len(made.scan)))
        counting, found, kind, spurious = (
            sum(getattr(verdict, name) for verdict, *_ in runs)
            for name in ("counting", "found", "kind", "spurious")
        )
        cpu = np.median([seconds for _, seconds, _ in runs])
        beams = np.median([beams for *_, beams in runs])
        print(
            f"{n} solids: {cpu:.1f} CPU s ({1e3 * cpu / n:.0f} ms a solid, {beams:.0f} beams); "
            f"{found} of {counting} found, kind {kind}, spurious {spurious}",
            flush=True,
        )


if __name__ == "__main__":
    main()
