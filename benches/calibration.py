"""What the scene tells of the sensor: errors in their own sigmas.

    python benches/calibration.py --seeds 310001 5
    python benches/calibration.py --seeds 310001 5 --divergence 0.02

Maps of the reference at 10 mm of noise, poses off by 5 mm and half a degree. First bias and mount: the
ranges are 30 mm too long, and the sensor sits 20 mm before and 10 mm to the right of where it is
believed to be. With a divergence, radians, the sensor sees 3 m with beams so wide instead, and its noise
is not told: the divergence is sought.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace

import numpy as np

import primfit

NOISE, POSITION, HEADING = 0.01, 0.005, float(np.radians(0.5))
TRUE = {"bias": 0.03, "mount_x": 0.02, "mount_y": -0.01}
"""What is sought, metres. The turn of the mount is not told from headings that are not exact."""


def made(seed: int) -> tuple[primfit.World, primfit.Scan]:
    """A map, and its scan by a sensor that is neither exact nor where it is believed to be."""
    world = primfit.random_world((5, 7), 2.0, rng=seed)
    path = primfit.grid_path(world, 0.25, headings=4, rng=seed)
    lidar = primfit.Lidar(noise=NOISE)
    scan = primfit.scan(world, path, lidar, rng=seed, pose_noise=(POSITION, HEADING))
    yaw = np.asarray(scan.path)[scan.pose_index, 2]
    x, y = TRUE["mount_x"], TRUE["mount_y"]
    lever = np.stack([np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y], axis=1)
    origins = scan.origins - np.pad(lever, ((0, 0), (0, 1)))
    ranges = scan.ranges + TRUE["bias"]
    reach = np.where(np.isfinite(ranges), ranges, np.nan)[:, None]
    points = origins + reach * scan.directions
    return world, replace(scan, origins=origins, ranges=ranges, points=points)


def wide(seed: int, divergence: float) -> tuple[primfit.World, primfit.Scan]:
    """A map, and its scan by wide beams, whose noise is not told."""
    world = primfit.random_world((5, 7), 2.0, rng=seed)
    path = primfit.grid_path(world, 0.4, headings=4, rng=seed)
    lidar = primfit.Lidar(noise=NOISE / 3.0, max_range=3.0, beam_divergence=divergence)
    scan = primfit.scan(world, path, lidar, rng=seed, pose_noise=(POSITION, HEADING))
    return world, replace(scan, sigma=None)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 5), metavar=("FIRST", "N"))
    parser.add_argument("--divergence", type=float, help="of the beams, radians")
    args = parser.parse_args()
    first, many = args.seeds
    known = TRUE if args.divergence is None else {"divergence": args.divergence}
    sought = ("bias", "mount") if args.divergence is None else ("incidence",)
    warnings.simplefilter("ignore")
    right, solids, off = 0, 0, []
    for seed in range(first, first + many):
        world, scan = made(seed) if args.divergence is None else wide(seed, args.divergence)
        found = primfit.detect(scan, rng=seed, pose_sigma=(POSITION, HEADING), estimate=sought)
        got, rows = found.calibration, primfit.evaluate(found, world, frame="arena").rows
        right += sum(each.found == each.truth for each in rows)
        solids += len(rows)
        off.append([(got[name] - true) / got[f"{name}_sigma"] for name, true in known.items()])
        told = ", ".join(
            f"{name} {1e3 * got[name]:.2f} +- {1e3 * got[f'{name}_sigma']:.2f} mm or mrad"
            for name in known
        )
        print(f"{seed}: kinds right {right} of {solids} so far; {told}", flush=True)
    squares = np.mean(np.square(off), axis=0)
    shares = (np.abs(off) < 2.0).mean(axis=0)
    for name, square, share in zip(known, squares, shares, strict=True):
        print(f"{name}: root mean square {np.sqrt(square):.2f} sigmas, {share:.2f} within two")


if __name__ == "__main__":
    main()
