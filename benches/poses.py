"""Detection where the poses are not exact: the table of docs/poses.md.

    python benches/poses.py --seeds 200000 10
    python benches/poses.py "10 mm, 5 mm 0.5 deg" --seeds 200000 40 --naive

Maps of the reference (2 x 2 m, 5 to 7 solids, grid of 0.25 m, four headings), of which the scan
believes poses that are not those from which it was taken: each off by itself, or each step. Centres
are compared after the found arena was laid on the true one. `region` is the share of the centres, as
they are in the world, within their own 95 % regions. CPU seconds are also given in those that the
same map takes with exact poses. A solid is found within a tenth of its size, and counts if two
thirds of its walls returned ten beams or more.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import primfit

FOUND = 0.1
"""Distance of centres, in the size of the true solid, within which it is found."""

SHARE, RETURNS = 2 / 3, 10
"""Walls of a solid that must have been seen, and by how many beams each."""

CHI2_95 = 5.991
"""Squared distance, in sigmas, that holds 95 % of a normal distribution in the plane."""

ROWS: dict[str, tuple[float, str, float, float]] = {
    "0, 5 mm 0.5 deg": (0.0, "pose", 0.005, 0.5),
    "0, 20 mm 2 deg": (0.0, "pose", 0.02, 2.0),
    "10 mm, 1 mm 0.1 deg": (0.01, "pose", 0.001, 0.1),
    "10 mm, 5 mm 0.5 deg": (0.01, "pose", 0.005, 0.5),
    "10 mm, 20 mm 2 deg": (0.01, "pose", 0.02, 2.0),
    "10 mm, 50 mm 5 deg": (0.01, "pose", 0.05, 5.0),
    "50 mm, 5 mm 0.5 deg": (0.05, "pose", 0.005, 0.5),
    "10 mm, steps 3 mm 0.3 deg": (0.01, "step", 0.003, 0.3),
}
"""Range noise (metres), what is noisy, position (metres) and heading (degrees), by name."""


@dataclass
class Sums:
    """Of the maps of one row."""

    counting: int = 0
    found: int = 0
    right: int = 0
    spurious: int = 0
    centers_mm: list[float] = field(default_factory=list)
    angles_deg: list[float] = field(default_factory=list)
    inside: list[bool] = field(default_factory=list)
    path_mm: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    cpu_exact: list[float] = field(default_factory=list)
    lost: int = 0


def made(seed: int, noise: float, what: str | None, sigmas: Any) -> tuple[Any, Any]:
    """A map of the reference and its scan."""
    world = primfit.random_world((5, 7), 2.0, rng=seed)
    path = primfit.grid_path(world, 0.25, headings=4, rng=seed)
    told = {} if what is None else {f"{what}_noise": sigmas}
    return world, primfit.scan(world, path, primfit.Lidar(noise=noise), rng=seed, **told)


def told_walls(world: Any, scan: Any) -> list[bool]:
    """Whether enough walls of each solid were seen, by where the beams truly ended."""
    path = np.asarray(scan.true_path)[scan.pose_index]
    believed = np.asarray(scan.path)[scan.pose_index]
    turn = np.exp(1j * (path - believed)[:, 2])
    ends = ((scan.points - np.pad(believed[:, :2], ((0, 0), (0, 1))))[:, :2] @ [1, 1j]) * turn
    places = np.stack([ends.real, ends.imag], axis=1) + path[:, :2]
    seen = []
    for i, solid in enumerate(world.solids):
        at = places[(scan.solid_index == i) & scan.is_return]
        a = np.asarray(solid.footprint)
        along = np.roll(a, -1, axis=0) - a
        share = np.clip(((at[:, None] - a) * along).sum(-1) / (along**2).sum(-1), 0, 1)
        off = np.linalg.norm(at[:, None] - a - share[..., None] * along, axis=-1)
        numbers = np.bincount(off.argmin(axis=1), minlength=len(a)) if len(at) else np.zeros(1)
        seen.append(bool((numbers >= RETURNS).mean() >= SHARE))
    return seen


def look(sums: Sums, seed: int, row: tuple[float, str, float, float], *, naive: bool) -> None:
    """One map, with what is known of the poses told or not."""
    noise, what, position, degrees = row
    sigmas = (position, float(np.radians(degrees)))
    world, scan = made(seed, noise, what, sigmas)
    start = time.process_time()
    found = primfit.detect(scan, rng=seed, **({} if naive else {f"{what}_sigma": sigmas}))
    sums.cpu.append(time.process_time() - start)
    exact = made(seed, noise, None, None)[1]
    start = time.process_time()
    primfit.detect(exact, rng=seed)
    sums.cpu_exact.append(time.process_time() - start)
    report = primfit.evaluate(found, world, frame="arena")
    counts = told_walls(world, scan)
    sums.counting += sum(counts)
    sums.spurious += len(report.spurious)
    sums.lost += len(found.lost_poses)
    for each, counting in zip(report.rows, counts, strict=True):
        solid = world.solids[each.solid]
        size = float(np.ptp(np.asarray(solid.footprint), axis=0).max())
        if not counting or each.found is None or each.center_error_mm > 1e3 * FOUND * size:
            continue
        sums.found += 1
        sums.right += each.found == each.truth
        sums.centers_mm.append(each.center_error_mm)
        if np.isfinite(each.angle_error_deg) and each.found == each.truth:
            sums.angles_deg.append(each.angle_error_deg)
        one = found.solids[each.detection]
        error = (one.center - solid.center)[:2]
        spread = one.covariance[:2, :2]
        sums.inside.append(bool(error @ np.linalg.solve(spread, error) < CHI2_95))
    path = scan.path if naive else found.path
    used = np.unique(scan.pose_index)
    off = np.linalg.norm((path - scan.true_path)[used, :2], axis=1)
    sums.path_mm += (1e3 * off).tolist()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", default=list(ROWS), metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 5), metavar=("FIRST", "N"))
    parser.add_argument("--naive", action="store_true", help="take the poses as exact")
    options = parser.parse_args()
    first, many = options.seeds
    warnings.simplefilter("ignore")
    print(f"primfit {primfit.__version__}, {many} maps a row, from seed {first}")
    for name in options.rows:
        sums = Sums()
        for seed in range(first, first + many):
            look(sums, seed, ROWS[name], naive=options.naive)
        centers = sums.centers_mm or [np.nan]
        ratio = np.median(sums.cpu) / np.median(sums.cpu_exact)
        print(
            f"{name}: right {sums.right} of {sums.counting} (found {sums.found}), spurious "
            f"{sums.spurious}; centre median {np.median(centers):.4f}, 95 % "
            f"{np.quantile(centers, 0.95):.3f}, worst {max(centers):.3f} mm; angle median "
            f"{np.median(sums.angles_deg or [np.nan]):.4f} deg; path median "
            f"{np.median(sums.path_mm):.2f} mm; region {np.mean(sums.inside or [np.nan]):.3f} of "
            f"{len(sums.inside)}; poses lost {sums.lost}; CPU {np.median(sums.cpu):.1f} s, "
            f"{ratio:.1f} times exact",
            flush=True,
        )


if __name__ == "__main__":
    main()
