"""Planes by tiles against those of the whole, on a town of gabled houses.

    python benches/tiles.py                          2 million points, tiles of 50 m
    python benches/tiles.py --houses 4 --tiles 30    16 houses, tiles of 30 m

CPU seconds are of one thread, of the calls alone.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import primfit

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from town import PITCH, share_alike, town


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--houses", type=int, default=14, help="in a row, of as many rows")
    parser.add_argument("--points", type=int, default=2_000_000)
    parser.add_argument("--tiles", type=float, default=50.0)
    parser.add_argument("--halo", type=float)
    wanted = parser.parse_args()
    points, truth = town(wanted.houses, wanted.points / (wanted.houses * PITCH) ** 2, 1)
    found = []
    for options in ({}, {"tiles": wanted.tiles, "halo": wanted.halo}):
        start = time.process_time()
        found.append(primfit.detect_planes(points, n_jobs=1, **options))
        seconds = time.process_time() - start
        print(f"{options or 'whole'}: {len(found[-1])} planes, {seconds:.1f} CPU s", flush=True)
    whole, tiled = found
    print(
        f"{tiled.settings['n_tiles']} tiles, the largest of {tiled.settings['largest_tile']} points"
    )
    print(
        f"IoU above 0.9 with the whole's: {share_alike(whole.labels, tiled.labels):.2%} of planes"
    )
    print(f"with the truth's: {share_alike(truth, tiled.labels):.2%} of {truth.max() + 1}")


if __name__ == "__main__":
    main()
