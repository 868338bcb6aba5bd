"""DBSCAN of primfit, PyPI's dbscan, Open3D and SciPy on the same points, answers compared first.

    python benches/dbscan.py                          20 000, 200 000 and 2 million points
    python benches/dbscan.py --cases map --repeat 9

Needs the extra `bench`. Labels are compared number by number with scikit-learn's on the two smaller
clouds, and on the largest with SciPy's on core points; where primfit differs, the exit status is 1.
Peers are free to give a border point to any cluster within reach, so theirs are compared on the
other points.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from measure import print_versions, rounds
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from sklearn.cluster import DBSCAN

import primfit

# A package has the name of this file.
sys.path.remove(str(Path(__file__).parent))
try:
    from dbscan import DBSCAN as WangDBSCAN
except ImportError:
    WangDBSCAN = None
try:
    import open3d
except ImportError:
    open3d = None

Labels = np.ndarray
NOT_JUDGED_ABOVE = 500_000
"""Points from which scikit-learn needs minutes."""


def scanned_map(rng: np.random.Generator) -> np.ndarray:
    """Returns from the walls of one of the paper's maps, 10 mm of noise."""
    world = primfit.random_world(rng=rng)
    path = primfit.grid_path(world, rng=rng)
    scan = primfit.scan(world, path, primfit.Lidar(noise=0.01), rng=rng).filter_z(0.02)
    return rng.permutation(scan.points[scan.is_return])[:20_000]


def walls(
    n: int, n_walls: int, size: float, outliers: float, rng: np.random.Generator
) -> np.ndarray:
    """Points on tilted rectangles in a box, 10 mm of noise, and outliers."""
    box = np.array([size, size, 0.4 * size])
    on = round((1 - outliers) * n / n_walls)
    parts = []
    for _ in range(n_walls):
        axes = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        sides = rng.uniform(0.02, 0.4, 2) * size
        places = rng.uniform(-0.5, 0.5, (on, 2)) * sides
        parts.append(rng.uniform(0, box) + places @ axes + rng.normal(scale=0.01, size=(on, 3)))
    parts.append(rng.uniform(0, box, (n - on * n_walls, 3)))
    return rng.permutation(np.concatenate(parts))


CASES: dict[str, tuple[Callable[[np.random.Generator], np.ndarray], float]] = {
    "map": (scanned_map, 0.1),
    "yard": (lambda rng: walls(200_000, 113, 15.0, 0.05, rng), 0.1),
    "building": (lambda rng: walls(2_000_000, 100, 50.0, 0.2, rng), 0.2),
}


def with_scipy(points: np.ndarray, eps: float, min_samples: int) -> Labels:
    """Components of the core points; the others join the nearest of them."""
    counts = np.ones(len(points), dtype=int)
    if min_samples > 1:
        counts = KDTree(points).query_ball_point(points, eps, return_length=True, workers=-1)
    core = np.flatnonzero(counts >= min_samples)
    labels = np.full(len(points), -1)
    if not len(core):
        return labels
    tree = KDTree(points[core])
    a, b = tree.query_pairs(eps, output_type="ndarray").T
    links = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(len(core), len(core)))
    labels[core] = connected_components(links, directed=False)[1]
    others = np.flatnonzero(counts < min_samples)
    distance, nearest = tree.query(points[others], distance_upper_bound=np.nextafter(eps, np.inf))
    near = np.isfinite(distance)
    labels[others[near]] = labels[core[nearest[near]]]
    return labels


def with_open3d(points: np.ndarray, eps: float, min_samples: int) -> Labels:
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return np.asarray(cloud.cluster_dbscan(eps, min_samples))


def with_wang(points: np.ndarray, eps: float, min_samples: int) -> Labels:
    return WangDBSCAN(points, eps, min_samples)[0]


PEERS = {"SciPy": with_scipy}
if WangDBSCAN is not None:
    PEERS["dbscan"] = with_wang
if open3d is not None:
    PEERS["Open3D"] = with_open3d


def n_differing(ours: Labels, theirs: Labels, core: np.ndarray) -> int:
    """Points that are noise for one only, and core points outside the peer's matching cluster."""
    noise = (ours < 0) != (theirs < 0)
    pairs, counts = np.unique(np.stack([ours[core], theirs[core]]), axis=1, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    _, first = np.unique(pairs[0][order], return_index=True)
    _, first_back = np.unique(pairs[1][order], return_index=True)
    matched = np.intersect1d(order[first], order[first_back])
    return int(noise.sum() + counts.sum() - counts[matched].sum())


def main() -> int:
    """Print the table; exit status 1 when primfit's labels are not the judge's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--repeat", type=int, default=0, help="rounds; by the number of points")
    arguments = parser.parse_args()
    print_versions("dbscan", "open3d-cpu", "scipy", "scikit-learn", "numpy")
    differ = False
    for case in arguments.cases:
        make, eps = CASES[case]
        points = np.ascontiguousarray(make(np.random.default_rng(7)))
        for min_samples in (1, 10):
            settings = (points, eps, min_samples)
            ours = primfit.dbscan(*settings)
            core = np.ones(len(points), dtype=bool)
            if len(points) < NOT_JUDGED_ABOVE:
                judge = DBSCAN(eps=eps, min_samples=min_samples).fit(points)
                differ |= not np.array_equal(ours, judge.labels_)
                core[:] = False
                core[judge.core_sample_indices_] = True
                verdict = "equal to" if np.array_equal(ours, judge.labels_) else "NOT EQUAL TO"
                verdict += " scikit-learn's"
            else:
                if min_samples > 1:
                    near = KDTree(points).query_ball_point(points, eps, return_length=True)
                    core = near >= min_samples
                same = n_differing(ours, with_scipy(*settings), core) == 0
                differ |= not same
                verdict = ("the same clusters as" if same else "NOT THE CLUSTERS OF") + " SciPy"
            print(
                f"\n{case}: {len(points)} points, eps {eps} m, min_samples {min_samples}: "
                f"{ours.max() + 1} clusters, {(ours < 0).sum()} noise; labels {verdict}"
            )
            calls = {"primfit": partial(primfit.dbscan, *settings)}
            for name, peer in PEERS.items():
                calls[name] = partial(peer, *settings)
                n = n_differing(ours, calls[name](), core)
                if n:
                    print(f"  {name}: {n} points differ")
            seconds = rounds(calls, arguments.repeat or max(1, min(9, 1_000_000 // len(points))))
            for name, (wall, cpu) in seconds.items():
                times = tuple(t / o for t, o in zip((wall, cpu), seconds["primfit"], strict=True))
                print(
                    f"  {name:8} {wall:8.4f} s wall {cpu:8.4f} s CPU   "
                    f"primfit is {times[0]:5.1f} and {times[1]:5.1f} times as fast"
                )
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
