"""How well the likelihood finds the solids of random maps, and whether its covariances are honest.

    python benches/accuracy.py --noise 0 0.01 0.05 0.2 --maps 40 --rng 70000 --jobs 2

Map i is made, scanned and looked at from seed rng + i. Prints solids found (within 100 mm), kinds
right, spurious and gross ones (over 10 mm off), centre and angle errors, the share of the truth in the
50 % and 95 % regions of the covariances, heights, and CPU seconds a map on one thread. With --single
KIND there is one solid in 1 m (a star in 1.2 m), and its rms centre error is divided by the
Cramer-Rao bound of the ranges that hit it.
"""

from __future__ import annotations

import argparse
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np
from scipy.stats import chi2

import primfit
from primfit.geometry.footprints import symmetry_angle

KINDS = ("triangle", "square", "rectangle", "pentagon")

STEP = 1e-6
"""By which parameters differ, metres and radians, for the slopes of ranges."""


@dataclass(frozen=True)
class Job:
    seed: int
    noise: float
    columns: int
    spacing: float | None
    single: str | None
    without_sigma: bool


def run(job: Job) -> dict:
    rng = np.random.default_rng(job.seed)
    if job.single:
        size = 1.2 if job.single == "star" else 1.0
        world = primfit.random_world(1, size, [job.single], rng)
    else:
        world = primfit.random_world((5, 7), 2.0, KINDS, rng)
    spacing = job.spacing or (0.125 if job.single else 0.25)
    path = primfit.grid_path(world, spacing, rng=rng)
    with warnings.catch_warnings():
        # Few columns are outside the domain that Webots documents.
        warnings.simplefilter("ignore", UserWarning)
        lidar = primfit.Lidar(noise=job.noise, horizontal_resolution=job.columns)
    scan = primfit.scan(world, path, lidar, rng=rng)
    if job.without_sigma:
        scan = replace(scan, sigma=None)
    is_bounded = job.single and job.noise and not job.without_sigma
    bound = cramer_rao(scan, world) if is_bounded else np.nan
    return judged(world, scan) | {"bound": bound}


def judged(world, scan) -> dict:
    """What is found of each solid, in CPU seconds on one thread."""
    start = time.process_time()
    found = primfit.detect(scan, rng=1, n_jobs=1)
    cpu = time.process_time() - start
    report = primfit.evaluate(found, world)
    rows = []
    for row in report.rows:
        truth = world.solids[row.solid]
        solid = found.solids[row.detection] if row.found else None
        rows.append(
            {
                "truth": row.truth,
                "found": row.found,
                "center": row.center_error_mm,
                "angle": row.angle_error_deg,
                "level": confidence(truth, solid) if row.found == row.truth else np.nan,
                "height": 1e3 * abs(solid.height - truth.height) if solid else np.nan,
                "height_sigma": 1e3 * solid.height_sigma if solid else np.nan,
            }
        )
    lost = found.settings["dropouts"]
    return {
        "rows": rows,
        "spurious": len(report.spurious),
        "cpu": cpu,
        "bound": np.nan,
        "lost": lost,
    }


def confidence(truth, solid) -> float:
    """Confidence at which the region of a solid's covariance just holds the truth."""
    period = symmetry_angle(truth.footprint)
    turn = (solid.angle - truth.angle + period / 2) % period - period / 2
    sizes = np.atleast_1d(solid.size) - np.atleast_1d(truth.size)
    off = np.array([*(solid.center - truth.center)[:2], turn, *sizes])
    return float(chi2.cdf(off @ np.linalg.pinv(solid.covariance, rcond=1e-14) @ off, len(off)))


def cramer_rao(scan, world) -> float:
    """Root of the trace of the bound of the centre, mm, from the ranges that hit the solid."""
    solid = world.solids[0]
    hits = scan.select(scan.is_return & (scan.solid_index == 0))
    truth = np.array([*solid.center[:2], solid.angle, *np.atleast_1d(solid.size)])

    def ranges(parameters: np.ndarray) -> np.ndarray:
        other = primfit.World([same_kind(solid, parameters)])
        return primfit.RayCaster(other).cast(hits.origins, hits.directions)[0]

    slopes = np.stack(
        [
            (ranges(truth + step) - ranges(truth - step)) / (2 * STEP)
            for step in STEP * np.eye(len(truth))
        ],
        axis=1,
    )
    # Beams at the very edge of the solid pass it on one side.
    slopes = slopes[np.isfinite(slopes).all(axis=1)]
    covariance = np.linalg.inv(slopes.T @ slopes) * np.max(scan.sigma) ** 2
    return 1e3 * float(np.sqrt(np.trace(covariance[:2, :2])))


def same_kind(solid, parameters: np.ndarray) -> primfit.Prism:
    """A prism of the same kind and height with other centre, angle and sizes."""
    x, y, angle, *sizes = parameters
    place = {"center": (x, y), "angle": angle, "height": solid.height}
    if solid.kind == "rectangle":
        return primfit.Prism.rectangle(*sizes, **place)
    if solid.kind == "star":
        return primfit.Prism.star(len(solid.footprint) // 2, *sizes, **place)
    return primfit.Prism.regular(len(solid.footprint), *sizes, **place)


def summary(results: list[dict]) -> str:
    rows = [row for result in results for row in result["rows"]]

    def column(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows if row["found"]], dtype=float)

    center, angle, level = column("center"), column("angle"), column("level")
    height, sigma = column("height"), column("height_sigma")
    known = np.isfinite(height)
    level = level[np.isfinite(level)]
    cpu = [result["cpu"] for result in results]
    lines = [
        f"{len(results)} worlds, {len(rows)} solids: found {len(center)}, "
        f"kind right {sum(row['truth'] == row['found'] for row in rows)}, "
        f"spurious {sum(result['spurious'] for result in results)}, gross {(center > 10).sum()}",
        f"centre median {np.median(center):.4f}, 95 % {np.quantile(center, 0.95):.4f}, "
        f"worst {center.max():.3f} mm; angle median {np.nanmedian(angle):.4f}, "
        f"worst {np.nanmax(angle):.3f} deg",
        f"inside the 50 % region {np.mean(level <= 0.5):.3f}, 95 % {np.mean(level <= 0.95):.3f}",
    ]
    if known.any():
        within = np.mean(height[known] <= 3.0 * sigma[known])
        lines.append(
            f"height known for {known.sum()}, median error {np.median(height[known]):.3f} mm, "
            f"within 3 sigma {within:.3f}"
        )
    bounds = np.array([result["bound"] for result in results])
    if np.isfinite(bounds).all() and len(center) == len(bounds):
        ratio = np.sqrt(np.mean(center**2) / np.mean(bounds**2))
        lines.append(f"rms centre error over the Cramer-Rao bound of the hits {ratio:.3f}")
    lines.append(f"CPU median {np.median(cpu):.2f} s, most {max(cpu):.2f} s")
    return "\n  ".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.05])
    parser.add_argument("--maps", type=int, default=20)
    parser.add_argument("--rng", type=int, default=0)
    parser.add_argument("--columns", type=int, default=100)
    parser.add_argument("--spacing", type=float, help="of the grid of poses, metres")
    parser.add_argument("--single", choices=[*KINDS, "star"])
    parser.add_argument("--without-sigma", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(f"primfit {primfit.__version__}, {vars(options)}")
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as executor:
        for noise in options.noise:
            jobs = [
                Job(
                    options.rng + i,
                    noise,
                    options.columns,
                    options.spacing,
                    options.single,
                    options.without_sigma,
                )
                for i in range(options.maps)
            ]
            print(f"noise {noise}\n  {summary(list(executor.map(run, jobs)))}", flush=True)


if __name__ == "__main__":
    main()
