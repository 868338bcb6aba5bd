"""Point-plane tests a second of primfit, NumPy, Open3D and a plain C loop, answers compared first.

    python benches/scoring.py
    python benches/scoring.py --repeat 9

Open3D needs the extra `bench`, the C loop a compiler named `cc`. NumPy in float64 is the judge: a
point within rounding of the threshold may count on one side only, and more than one in 100 000
such tests makes the exit status 1. Rates are medians by wall and CPU time, and the best by CPU
time, which other work on the machine slows least. Open3D draws its own planes and fits the best to
its inliers, so that primfit's count for it is close to Open3D's but not equal.
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from measure import print_versions, runs

from primfit import _primfit

try:
    import open3d
except ImportError:
    open3d = None

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import reference

THRESHOLD = 0.01
SIZES = ((20_000, 2000), (200_000, 500), (2_000_000, 100))
C_LOOP = """
void count(const float *x, const float *y, const float *z, long n, const float *planes, long k,
           float t, long *counts) {
    for (long start = 0; start < n; start += 2048) {
        long end = start + 2048 < n ? start + 2048 : n;
        for (long j = 0; j < k; j++) {
            float a = planes[4 * j], b = planes[4 * j + 1], c = planes[4 * j + 2];
            float d = planes[4 * j + 3];
            int sum = 0;
            for (long i = start; i < end; i++)
                sum += __builtin_fabsf(a * x[i] + b * y[i] + c * z[i] + d) <= t;
            counts[j] += sum;
        }
    }
}
"""


def compiled_loop() -> ctypes._CFuncPtr | None:
    """The C loop for this very processor, or None without a compiler."""
    if shutil.which("cc") is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "count.c"), Path(folder, "count.so")
        source.write_text(C_LOOP)
        flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
        subprocess.run(["cc", *flags, str(source), "-o", str(library)], check=True)
        return ctypes.CDLL(str(library)).count


def with_c(loop: ctypes._CFuncPtr, rows: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Counts by the C loop, on one thread, from coordinates that are float32 already."""
    counts = np.zeros(len(planes), dtype=np.int64)
    address = [ctypes.c_void_p(row.ctypes.data) for row in (*rows, planes, counts)]
    x, y, z, equations, out = address
    n, k = ctypes.c_long(rows.shape[1]), ctypes.c_long(len(planes))
    loop(x, y, z, n, equations, k, ctypes.c_float(THRESHOLD), out)
    return counts


def main() -> int:
    """Print the table; exit status 1 when counts differ by more than rounding."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    print_versions("numpy", "open3d-cpu")
    loop = compiled_loop()
    differ = False
    for n, k in SIZES:
        rng = np.random.default_rng(7)
        points, directions = rng.uniform(size=(n, 3)), rng.normal(size=(n, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        equations = rng.normal(size=(k, 4))
        equations /= np.linalg.norm(equations[:, :3], axis=1, keepdims=True)
        single = points.astype(np.float32), equations.astype(np.float32)
        print(f"\n{n} points x {k} planes")
        calls = {
            f"primfit {name}": partial(_primfit.score_planes, points, equations, THRESHOLD, *how)
            for name, how in {
                "count": (None, False),
                "MSAC": (None, True),
                "range count": (directions, False),
                "range MSAC": (directions, True),
            }.items()
        }
        few = equations[:20]
        for name, call in calls.items():
            how = call.args[3:]
            expected = reference.score_planes(points, few, THRESHOLD, *how)
            ours = call().reshape(-1, k)[:, : len(few)].ravel()
            off = np.abs(ours - expected).sum() / (n * len(few))
            differ |= off > 1e-5
            print(f"  {name}: off by {off:.1e} a test from NumPy in float64")
        calls["NumPy float64"] = partial(reference.score_planes, points, equations, THRESHOLD)
        calls["NumPy float32"] = partial(reference.score_planes, *single, np.float32(THRESHOLD))
        if loop is not None:
            rows = np.ascontiguousarray(single[0].T)
            calls["C loop count"] = partial(with_c, loop, rows, single[1])
            off = np.abs(calls["C loop count"]() - calls["primfit count"]()).sum() / (n * k)
            differ |= off > 1e-5
            print(f"  C loop: off by {off:.1e} a test from primfit")
        if open3d is not None:
            cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
            calls["Open3D"] = partial(cloud.segment_plane, THRESHOLD, 3, k, 1.0)
            plane, inliers = calls["Open3D"]()
            (count,) = _primfit.score_planes(points, np.array([plane]), THRESHOLD)
            print(f"  Open3D's plane: {len(inliers)} inliers by Open3D, {count:.0f} by primfit")
        for name, times in runs(calls, arguments.repeat).items():
            # With beams, a plane and the same one turned round are two.
            tests = 2 * n * k if "range" in name else n * k
            wall = tests / median(wall for wall, _ in times)
            usual, best = (tests / of(cpu for _, cpu in times) for of in (median, min))
            print(
                f"  {name:20} {wall:9.3g} tests/s wall {usual:9.3g} tests/s CPU, "
                f"at best {best:9.3g}"
            )
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
