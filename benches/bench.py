"""Speed of primfit beside others, in one run, after checking that the answers agree.

    python benches/bench.py            all benchmarks
    python benches/bench.py pipeline --repeat 5

Each line is the median over interleaved repetitions. A peer is one entry in `PEERS`: a name and
a function from the benchmark to a callable that gives the answer.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import networkx
import numpy as np
import scipy

import primfit
from primfit import _primfit

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import reference


@dataclass(frozen=True)
class Bench:
    """Something to do: by primfit, and by each peer."""

    name: str
    unit: str
    amount: float
    ours: Callable[[], Any]
    twin: Callable[[], Any]
    twin_amount: float
    agree: Callable[[Any, Any], bool]
    inputs: dict[str, Any]


def boxes(n_triangles: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Small boxes in a 2 m cube."""
    cube = primfit.Prism.regular(4, 1.0, height=1.0)
    corners, triangles = cube.to_mesh()
    n = n_triangles // 12
    places = rng.uniform(0, 2, (n, 1, 3)) + rng.uniform(0.02, 0.08, (n, 1, 1)) * corners
    rows = 8 * np.arange(n)[:, None, None] + triangles
    return places.reshape(-1, 3), rows.reshape(-1, 3)


def rays() -> list[Bench]:
    """Ray casting against all rays x all triangles."""
    rng = np.random.default_rng(7)
    world = primfit.random_world(rng=rng)
    scan = primfit.scan(world, primfit.grid_path(world, rng=rng), rng=rng)
    meshes = {"the paper's map": world.to_mesh()[:2], "10 000 triangles": boxes(10_000, rng)}
    benches = []
    for name, mesh in meshes.items():
        vertices, triangles = (np.ascontiguousarray(part) for part in mesh)
        n_twin = min(len(scan), 4_000_000 // len(triangles))
        some = rng.permutation(len(scan))[:n_twin]
        caster, twin = (
            _primfit.RayCaster(vertices, triangles),
            reference.RayCaster(vertices, triangles),
        )
        origins, directions = np.array(scan.origins), np.array(scan.directions)
        few = np.ascontiguousarray(origins[some]), np.ascontiguousarray(directions[some])

        def agree(ours: Any, theirs: Any, some: np.ndarray = some) -> bool:
            close = np.isclose(ours[0][some], theirs[0], atol=1e-9)
            return bool(close.mean() > 0.999)  # rays within rounding of an edge may differ

        benches.append(
            Bench(
                f"rays, {name} ({len(triangles)} triangles)",
                "Mrays/s",
                len(scan) / 1e6,
                lambda c=caster, o=origins, d=directions: c.cast(o, d),
                lambda t=twin, few=few: t.cast(*few),
                n_twin / 1e6,
                agree,
                {
                    "vertices": vertices,
                    "triangles": triangles,
                    "origins": origins,
                    "directions": directions,
                },
            )
        )
    return benches


def pipeline() -> list[Bench]:
    """Scan and detection of a map of the paper's by its method, on Rust and on the twins."""
    world = primfit.random_world(rng=7)
    path = primfit.grid_path(world, 0.3, rng=7)

    def run() -> primfit.Detection:
        return primfit.detect(primfit.scan(world, path, rng=7), "paper", rng=7)

    def on_twins() -> primfit.Detection:
        with reference.instead_of_rust():
            return run()

    def agree(ours: primfit.Detection, theirs: primfit.Detection) -> bool:
        pairs = list(zip(ours.solids, theirs.solids, strict=False))
        return len(ours.solids) == len(theirs.solids) and all(
            a.kind == b.kind and np.allclose(a.center, b.center, atol=1e-6, equal_nan=True)
            for a, b in pairs
        )

    return [Bench("scan and detection of a map", "runs/s", 1.0, run, on_twins, 1.0, agree, {})]


BENCHES = {"rays": rays, "pipeline": pipeline}
PEERS: dict[str, Callable[[Bench], Callable[[], Any]]] = {"NumPy": lambda bench: bench.twin}


def timed(call: Callable[[], Any]) -> tuple[float, float, Any]:
    """Wall and CPU seconds of a call, and its answer."""
    wall, cpu = time.perf_counter(), time.process_time()
    answer = call()
    return time.perf_counter() - wall, time.process_time() - cpu, answer


def main() -> int:
    """Run the benchmarks and print the table; exit status 1 when answers differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("benches", nargs="*", choices=[*BENCHES, []], help="which; all if none")
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    print(
        f"primfit {primfit.__version__}, Python {platform.python_version()}, numpy {np.__version__},"
    )
    print(
        f"scipy {scipy.__version__}, networkx {networkx.__version__}; {os.cpu_count()} processors"
    )
    differ = False
    for name in arguments.benches or BENCHES:
        for bench in BENCHES[name]():
            print(f"\n{bench.name}")
            calls = {"primfit": bench.ours} | {peer: make(bench) for peer, make in PEERS.items()}
            answers = {who: timed(call)[2] for who, call in calls.items()}
            times: dict[str, list[tuple[float, float]]] = {who: [] for who in calls}
            for _ in range(arguments.repeat):
                for who, call in calls.items():
                    times[who].append(timed(call)[:2])
            for who, runs in times.items():
                amount = bench.amount if who == "primfit" else bench.twin_amount
                wall, cpu = (amount / max(median(run[k] for run in runs), 1e-9) for k in (0, 1))
                ours = bench.amount / median(run[0] for run in times["primfit"])
                same = who == "primfit" or bench.agree(answers["primfit"], answers[who])
                differ |= not same
                print(
                    f"  {who:10} {wall:12.4g} {bench.unit} wall {cpu:12.4g} cpu   "
                    f"primfit is {ours / wall:8.1f} times as fast{'' if same else '  ANSWERS DIFFER'}"
                )
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
