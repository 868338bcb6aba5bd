"""The speed of the kernels beside other libraries, and how it scales: table, figure and page.

    python benches/performance.py                  all; writes docs/performance.md and .png
    python benches/performance.py --repeat 3 --largest 1000000

Needs Linux and the extras `bench` and `plot`. The page is filled in between its markers; what stands around
them is written by hand. Answers are compared by the benchmarks of the single kernels (`rays.py`,
`dbscan.py`, `scoring.py`, `bench.py`); here is only measured.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import re
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import rays as rays_bench
from matplotlib import pyplot as plt
from measure import rounds

import primfit
from primfit import _primfit

DOCS = Path(__file__).parent.parent / "docs"
THREADS = (1, 2)


def ray_rows(repeat: int, share: float) -> list[str]:
    """Rays a CPU-second of one thread on each scene with each set of beams."""
    rows = []
    for make in rays_bench.SCENES.values():
        rng = np.random.default_rng(7)
        mesh, places = make(rng)
        build = rounds(
            {
                "ours": partial(rays_bench.build_primfit, mesh, 1),
                "theirs": partial(rays_bench.build_open3d, mesh, 1),
            },
            3,
        )
        rows.append(
            f"| build, {len(mesh[1])} triangles | {build['ours'][1]:.4f} s | "
            f"{build['theirs'][1]:.4f} s | {build['theirs'][1] / build['ours'][1]:.2f} |"
        )
        ours, theirs = rays_bench.build_primfit(mesh, 1), rays_bench.build_open3d(mesh, 1)
        for beams, draw in rays_bench.BEAMS.items():
            some = draw(places, rng, share)
            seconds = rounds({"ours": ours(some), "theirs": theirs(some)}, repeat)
            mine, other = (len(some[0]) / 1e6 / seconds[who][1] for who in ("ours", "theirs"))
            rows.append(
                f"| rays, {len(mesh[1])} triangles, {beams} | {mine:.1f} M/s | {other:.1f} M/s | "
                f"{mine / other:.2f} |"
            )
    return rows


def scan_rows(repeat: int) -> list[str]:
    """Beams a CPU-second of a scan, beside casting the same rays."""
    rng = np.random.default_rng(7)
    world = primfit.random_world(rng=rng)
    path = primfit.grid_path(world, rng=rng)
    spinning = primfit.Lidar(64, 0.6, 1024, 2 * np.pi, max_range=100.0)
    rows = []
    for name, lidar, poses in (
        ("8 x 100", primfit.Lidar(), 500),
        ("8 x 100 with noise", primfit.Lidar(noise=0.01), 500),
        ("64 x 1024", spinning, 10),
    ):
        some = path[rng.integers(0, len(path), poses)]
        scan = primfit.scan(world, some, lidar)
        caster = primfit.RayCaster(world)
        origins, directions = np.array(scan.origins), np.array(scan.directions)
        seconds = rounds(
            {
                "scan": partial(primfit.scan, world, some, lidar, rng=1, n_jobs=1),
                "cast": partial(caster.cast, origins, directions, 1),
            },
            repeat,
        )
        mine, other = (len(scan) / 1e6 / seconds[who][1] for who in ("scan", "cast"))
        rows.append(
            f"| `scan` beside `cast`, {name} | {mine:.1f} M/s | {other:.1f} M/s | "
            f"{mine / other:.2f} |"
        )
    return rows


def score_rows(repeat: int) -> list[str]:
    """Tests of a point against a plane a CPU-second."""
    rows = []
    for n, k in ((200_000, 500), (2_000_000, 100)):
        points, directions, equations = scored(n, k)
        how = {
            "count": (None, False),
            "MSAC": (None, True),
            "range count": (directions, False),
            "range MSAC": (directions, True),
        }
        calls = {
            name: partial(_primfit.score_planes, points, equations, 0.01, *each, 1)
            for name, each in how.items()
        }
        for name, (_, cpu) in rounds(calls, repeat).items():
            rows.append(f"| {name}, {n} points x {k} planes | {n * k / cpu / 1e9:.2f} G/s | | |")
    return rows


def clustering_rows(repeat: int) -> list[str]:
    """Seconds of DBSCAN beside the fastest of its peers, by CPU."""
    here = Path(__file__).parent
    spec = importlib.util.spec_from_file_location("clustering_bench", here / "dbscan.py")
    bench = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bench)
    sys.path.insert(0, str(here))  # which that benchmark takes out
    rows = []
    for make, eps in bench.CASES.values():
        points = np.ascontiguousarray(make(np.random.default_rng(7)))
        for min_samples in (1, 10):
            settings = (points, eps, min_samples)
            calls = {name: partial(peer, *settings) for name, peer in bench.PEERS.items()}
            calls["primfit"] = partial(primfit.dbscan, *settings)
            times = rounds(calls, max(1, min(repeat, 1_000_000 // len(points))))
            mine = times.pop("primfit")[1]
            name, (_, other) = min(times.items(), key=lambda item: item[1][1])
            rows.append(
                f"| DBSCAN, {len(points)} points, `min_samples` {min_samples} | {mine:.4f} s | "
                f"{other:.4f} s ({name}) | {other / mine:.1f} |"
            )
    return rows


def scored(n: int, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, directions and planes without order."""
    rng = np.random.default_rng(7)
    directions, equations = rng.normal(size=(n, 3)), rng.normal(size=(k, 4))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    equations /= np.linalg.norm(equations[:, :3], axis=1, keepdims=True)
    return rng.uniform(size=(n, 3)), directions, equations


def walls(n: int) -> np.ndarray:
    """Points on 100 walls at one density, 10 mm of noise."""
    rng = np.random.default_rng(7)
    axes = np.linalg.qr(rng.normal(size=(100, 3, 2)))[0]
    size = np.sqrt(n / 100 / 400.0)
    wall = rng.integers(0, 100, n)
    places = np.einsum("ijk,ik->ij", axes[wall], size * rng.uniform(-0.5, 0.5, (n, 2)))
    return (
        3 * size * rng.uniform(size=(100, 3))[wall] + places + rng.normal(scale=0.01, size=(n, 3))
    )


def clustering(n: int) -> Callable[[int], Any]:
    points = walls(n)
    return lambda _: primfit.dbscan(points, 0.15, 10)


def scoring(n: int) -> Callable[[int], Any]:
    points, _, equations = scored(n, 100)
    return lambda threads: _primfit.score_planes(points, equations, 0.01, None, False, threads)


def terrain(n: int) -> tuple[np.ndarray, np.ndarray]:
    """About n triangles over a square."""
    side = max(2, round(np.sqrt(n / 2)) + 1)
    axis = np.linspace(0, 100, side)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    row = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (row[:-1, :-1], row[1:, :-1], row[1:, 1:], row[:-1, 1:]))
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x, y, 3 * np.sin(x / 7) * np.cos(y / 5)]), triangles


def building(n: int) -> Callable[[int], Any]:
    mesh = terrain(n)
    return lambda _: primfit.RayCaster(mesh)


def casting(n: int) -> Callable[[int], Any]:
    rng = np.random.default_rng(7)
    caster = primfit.RayCaster(terrain(n))
    origins = rng.uniform((10, 10, 4), (90, 90, 8), (200_000, 3))
    directions = rng.normal(size=(200_000, 3))
    return lambda threads: caster.cast(origins, directions, threads)


CURVES: dict[str, tuple[Callable[[int], Callable[[int], Any]], int, int, bool]] = {
    "clustering, a point": (clustering, 10_000, 10_000_000, True),
    "scoring by 100 planes, a point": (scoring, 10_000, 10_000_000, True),
    "building, a triangle": (building, 100, 1_000_000, True),
    "casting, a random ray": (casting, 100, 1_000_000, False),
}
"""What is measured, from how many to how many, and whether time is that of one of them."""


def measured(name: str, n: int) -> tuple[list[float], float]:
    """Best wall seconds at each number of threads, and megabytes above those of the input."""
    prepare, *_ = CURVES[name]
    call = prepare(n)
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far
    before = resident("VmRSS")
    seconds = []
    for threads in THREADS:
        runs = []
        for _ in range(3):
            start = time.perf_counter()
            kept = call(threads)
            runs.append(time.perf_counter() - start)
            del kept
            if runs[-1] > 2.0:
                break
        seconds.append(min(runs))
    return seconds, resident("VmHWM") - before


def resident(field: str) -> float:
    """Megabytes of this process, by Linux."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(rf"{field}:\s+(\d+)", status)[1]) / 1024


def draw(largest: int) -> None:
    """The figure: nanoseconds for one, and memory, against the number."""
    context = multiprocessing.get_context("spawn")
    _, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), constrained_layout=True)
    for color, (name, (_, first, last, is_each)) in enumerate(CURVES.items()):
        numbers = [n for n in 10 ** np.arange(2, 9) if first <= n <= min(last, largest)]
        results = []
        for n in numbers:
            # Each in a process of its own, so that its peak of memory is its own.
            with context.Pool(1) as pool:
                results.append(pool.apply(measured, (name, int(n))))
        for i, threads in enumerate(THREADS):
            if name.startswith(("clustering", "building")) and threads > 1:
                continue  # they take all threads
            each = [
                1e9 * seconds[i] / (n if is_each else 200_000)
                for n, (seconds, _) in zip(numbers, results, strict=True)
            ]
            label = f"{name}, {threads} thread{'s' * (threads > 1)}"
            if name.startswith(("clustering", "building")):
                label = f"{name}, all threads"
            left.loglog(numbers, each, "-o" if i == 0 else "--s", color=f"C{color}", label=label)
        if is_each:
            right.loglog(
                numbers, [max(mb, 0.1) for _, mb in results], "-o", color=f"C{color}", label=name
            )
    left.set(xlabel="points or triangles", ylabel="ns of wall for one", title="Time")
    right.set(xlabel="points or triangles", ylabel="MB at the peak above the input", title="Memory")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    plt.savefig(DOCS / "performance.png", dpi=130)


def main() -> None:
    """Measure, draw, and fill in the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--share", type=float, default=0.2, help="of the rays of `rays.py`")
    parser.add_argument("--largest", type=int, default=10_000_000)
    arguments = parser.parse_args()
    rows = [
        "| kernel | primfit | beside it | times as fast |",
        "|---|---:|---:|---:|",
        *ray_rows(arguments.repeat, arguments.share),
        *scan_rows(arguments.repeat),
        *score_rows(arguments.repeat),
        *clustering_rows(arguments.repeat),
    ]
    libraries = f"primfit {primfit.__version__}, Open3D {version('open3d-cpu')}"
    table = "\n".join([f"{libraries}; one thread, CPU seconds, medians.", "", *rows])
    draw(arguments.largest)
    page = DOCS / "performance.md"
    begin, end = "<!-- measured -->", "<!-- end -->"
    text = re.sub(
        f"{begin}.*{end}",
        lambda _: f"{begin}\n{table}\n{end}",
        page.read_text(),
        flags=re.DOTALL,
    )
    page.write_text(text)
    print(table)


if __name__ == "__main__":
    main()
