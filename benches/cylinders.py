"""Upright cylinders by the likelihood: kinds that are right, and radii over their own deviations.

    python benches/cylinders.py --maps 20

Four cylinders with radii of 5 to 50 cm on each map of 4 x 4 m, seen by 8 layers from a grid of
places, with noise of 0, 1 and 5 mm. Map i is made from seed rng + i.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import primfit


def scattered(rng: np.random.Generator) -> primfit.World:
    """A map with four cylinders, 30 cm apart at least."""
    solids: list[primfit.Cylinder] = []
    while len(solids) < 4:
        radius = rng.uniform(0.05, 0.5)
        place = rng.uniform(radius + 0.3, 3.7 - radius, 2)
        away = [np.linalg.norm(place - s.center[:2]) - s.radius - radius for s in solids]
        if all(gap > 0.3 for gap in away):
            solids.append(primfit.Cylinder(radius, 0.5, place))
        elif rng.random() < 0.02:
            solids = []
    return primfit.World(solids, primfit.Arena((4.0, 4.0)))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--maps", type=int, default=20)
    parser.add_argument("--rng", type=int, default=901)
    arguments = parser.parse_args()
    print(f"primfit {primfit.__version__}")
    for noise in (0.0, 0.001, 0.005):
        errors, n, spurious = [], 0, 0
        start = time.process_time()
        for i in range(arguments.maps):
            seed = arguments.rng + i
            world = scattered(np.random.default_rng(seed))
            lidar = primfit.Lidar(8, 0.4, 100, max_range=6.0, noise=noise / 6.0)
            scan = primfit.scan(world, primfit.grid_path(world, 0.8, rng=seed), lidar, rng=seed)
            found = primfit.detect(scan, rng=seed)
            report = primfit.evaluate(found, world)
            n += len(report.rows)
            spurious += len(report.spurious)
            for row in report.rows:
                if row.found == "circle":
                    solid, truth = found.solids[row.detection], world.solids[row.solid]
                    errors.append((solid.size - truth.radius) / solid.sigmas["size"])
        z = np.array(errors)
        print(
            f"noise {1000 * noise:g} mm: {len(z)} of {n} right, {spurious} spurious; radii over their "
            f"deviations: mean {z.mean():.2f}, rms {np.sqrt((z**2).mean()):.2f}, most "
            f"{np.abs(z).max():.1f}; {time.process_time() - start:.0f} CPU s"
        )


if __name__ == "__main__":
    main()
