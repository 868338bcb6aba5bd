"""How the kernels scale: time and memory against size, as a figure.

    python benches/scaling.py --largest 1000000     writes docs/performance.png alone

Needs Linux and the extra `plot`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

import primfit
from primfit import _primfit

DOCS = Path(__file__).parent.parent / "docs"
THREADS = (1, 2)


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


def planes(n: int) -> Callable[[int], Any]:
    points = walls(n)
    return lambda threads: primfit.detect_planes(points, n_jobs=threads)


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
    "finding planes, a point": (planes, 10_000, 1_000_000, True),
    "building, a triangle": (building, 100, 1_000_000, True),
    "casting, a random ray": (casting, 100, 1_000_000, False),
}
"""What is measured, from how many to how many, and whether time is that of one of them."""


def measured(name: str, n: int) -> tuple[list[float], float]:
    """Best wall seconds at each number of threads, and megabytes above those of the input."""
    prepare, *_ = CURVES[name]
    call = prepare(n)
    above = peak_from_now()
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
    return seconds, above()


def peak_from_now() -> Callable[[], float]:
    """Tells when asked by how many megabytes this process has grown at most."""
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far
    before = resident("VmRSS")
    return lambda: resident("VmHWM") - before


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
        axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    plt.savefig(DOCS / "performance.png", dpi=130, bbox_inches="tight")


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=10_000_000)
    draw(parser.parse_args().largest)


if __name__ == "__main__":
    main()
