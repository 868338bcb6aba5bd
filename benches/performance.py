"""The speed of the kernels beside other libraries, and how it scales: table, figure and page.

    python benches/performance.py                  all; writes docs/performance.md and .png
    python benches/performance.py --repeat 3 --largest 1000000

Needs Linux, the extras `bench` and `plot`, and for Open3D the system's libusb-1.0. The page is
filled in between its markers; what stands around them is written by hand. Answers are compared by
the benchmarks of the single kernels (`rays.py`, `dbscan.py`, `scoring.py`, `bench.py`); here is only
measured. The figure is that of `scaling.py`.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import bench
import numpy as np
import open3d
import rays as rays_bench
from measure import rounds, runs
from plane_scenes import building
from scaling import DOCS, draw, peak_from_now, scored

import primfit
from primfit import _primfit

MAPS = 5


def ray_rows(repeat: int, share: float) -> list[str]:
    """Rays a CPU-second of one thread on each scene with each set of beams."""
    rows = []
    for make in rays_bench.SCENES.values():
        rng = np.random.default_rng(7)
        mesh, places = make(rng)
        if isinstance(mesh, primfit.World):
            continue  # Open3D has no round solids
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
        for beams, make_rays in rays_bench.BEAMS.items():
            some = make_rays(places, rng, share)
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
        for name, times in runs(calls, 2 * repeat).items():
            # With beams, a plane and the same one turned round are two.
            tests = n * k * (1 if calls[name].args[3] is None else 2)
            usual, best = (tests / of(cpu for _, cpu in times) / 1e9 for of in (median, min))
            rows.append(
                f"| {name}, {n} points x {k} planes | {usual:.2f} G/s, at best {best:.2f} | | |"
            )
    return rows


def clustering_rows(repeat: int) -> list[str]:
    """Seconds of DBSCAN beside the fastest of its peers, by CPU."""
    here = Path(__file__).parent
    spec = importlib.util.spec_from_file_location("clustering_bench", here / "dbscan.py")
    clusterings = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(clusterings)
    sys.path.insert(0, str(here))  # which that benchmark takes out
    rows = []
    for make, eps in clusterings.CASES.values():
        points = np.ascontiguousarray(make(np.random.default_rng(7)))
        for min_samples in (1, 10):
            settings = (points, eps, min_samples)
            calls = {name: partial(peer, *settings) for name, peer in clusterings.PEERS.items()}
            calls["primfit"] = partial(primfit.dbscan, *settings)
            times = rounds(calls, max(1, min(repeat, 1_000_000 // len(points))))
            mine = times.pop("primfit")[1]
            name, (_, other) = min(times.items(), key=lambda item: item[1][1])
            rows.append(
                f"| DBSCAN, {len(points)} points, `min_samples` {min_samples} | {mine:.4f} s | "
                f"{other:.4f} s ({name}) | {other / mine:.1f} |"
            )
    return rows


def cloud_rows() -> list[str]:
    """Seconds of what is done with a bare cloud of a building, and the memory for its planes."""
    points = np.ascontiguousarray(building(7).points)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    nearest = open3d.geometry.KDTreeSearchParamKNN(16)
    seconds = rounds(
        {
            "ours": partial(primfit.estimate_normals, points, 16, n_jobs=1),
            "open3d": lambda: cloud.estimate_normals(nearest),
        },
        1,
    )
    ours, peer = (cpu for _, cpu in seconds.values())
    peak = peak_from_now()
    whole = rounds({"all": partial(primfit.detect_planes, points, n_jobs=1)}, 1)["all"][1]
    n = len(points)
    return [
        f"| normals of {n} points, k = 16 | {ours:.1f} s | {peer:.1f} s (Open3D) | "
        f"{peer / ours:.1f} |",
        f"| `detect_planes` of {n} points, {peak():.0f} MB above the input | {whole:.1f} s | | |",
    ]


def map_rows(repeat: int) -> list[str]:
    """Seconds of a whole map of the paper's: by its method beside the twin, by the likelihood."""
    (paper,) = bench.pipeline()
    ours = rounds({"ours": paper.ours}, repeat)["ours"][1]
    twin = rounds({"twin": paper.twin}, 1)["twin"][1]
    each = []
    for seed in range(MAPS):
        world = primfit.random_world(rng=seed)
        path = primfit.grid_path(world, 0.25, rng=seed)
        scan = primfit.scan(world, path, primfit.Lidar(noise=0.05), rng=seed)
        call = partial(primfit.detect, scan, "likelihood", rng=seed, n_jobs=1)
        each.append(rounds({"map": call}, 1)["map"][1])
    return [
        f"| scan to solids, the paper's method | {ours:.2f} s | {twin:.1f} s (NumPy twin) | "
        f"{twin / ours:.0f} |",
        f"| solids by the likelihood, {MAPS} maps with 50 mm of noise | "
        f"{np.mean(each):.2f} s a map | | |",
    ]


def alone(measure: Callable[..., list[str]], *arguments: float) -> list[str]:
    """Rows measured in a process of their own: threads that some peers leave spin on."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        return executor.submit(measure, *arguments).result()


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
        *alone(ray_rows, arguments.repeat, arguments.share),
        *alone(scan_rows, arguments.repeat),
        *alone(score_rows, arguments.repeat),
        *alone(clustering_rows, arguments.repeat),
        *alone(cloud_rows),
        *alone(map_rows, arguments.repeat),
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
