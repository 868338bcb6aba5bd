"""A lack of memory is a MemoryError; threads that nobody uses end."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import primfit

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")

LIMITED = """
import numpy as np, primfit, resource
rng = np.random.default_rng(0)
points = rng.random((1_000_000, 3))
triangles = rng.integers(0, 300_000, (300_000, 3))
# All threads have worked: glibc ends the process when one finds no memory for its own data.
primfit.estimate_normals(points[:200_000], 8)
tree = primfit._primfit.PointTree(points[:300_000])
caster = primfit.RayCaster((points[:9], triangles[:3] % 9))
pages = int(open("/proc/self/statm").read().split()[0])
limit = pages * resource.getpagesize() + MORE * 2**20
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    CALL
except MemoryError as error:
    print(f"MemoryError: {error}")
else:
    print("enough")
"""

CALLS = [
    "primfit.estimate_normals(points, 32)",
    "primfit.dbscan(points, 0.01, 5)",
    "primfit.dbscan(points, 0.1, 5)",
    "primfit.RayCaster((points, triangles))",
    "caster.cast(points, points)",
    "tree.neighbors(points, 60)",
    "tree.segment()",
    "primfit.detect_planes(points[:600_000])",
    "primfit._primfit.score_planes(points[:64], np.tile([0, 0, 1.0, 0], (300_000, 1)), 0.1, None, True)",
]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("more", [8, 24, 60])
def test_too_little_is_an_error(call, more):
    code = LIMITED.replace("MORE", str(more)).replace("CALL", call)
    # A thread of OpenBLAS that begins late would end the process as ours would.
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert result.returncode == 0, result.stderr[-500:]
    assert result.stdout.startswith("MemoryError: ") or result.stdout == "enough\n"


def test_the_error_says_how_much():
    poses = np.tile(np.eye(4).ravel(), (1 << 24, 1))
    with pytest.raises(MemoryError, match=r"there is no memory for \d+ bytes"):
        primfit._primfit.turned(poses, np.ones((1 << 20, 3)))


PARALLEL = """
import os, numpy as np, primfit, threading
rng = np.random.default_rng(0)
def n_threads():
    return len(os.listdir("/proc/self/task")) - threading.active_count()
n_before = n_threads()
for n in (20, 6000, 60_000):
    points = rng.random((n, 3)) * [1.0, 1.0, 1e-3]
    triangles = rng.integers(0, n, (n, 3))
    primfit.estimate_normals(points, 16)
    primfit.dbscan(points, 0.02, 5)
    for plane in primfit.detect_planes(points):
        plane.boundary
    primfit.RayCaster((points, triangles)).cast(points[:999], points[:999] + 1.0)
print(n_threads() - n_before, len(os.sched_getaffinity(0)))
"""


def test_all_work_is_done_by_the_threads_of_the_call():
    # Those of another pool would begin late, and end the process where memory is short.
    result = subprocess.run(
        [sys.executable, "-c", PARALLEL],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    n_threads, n_cores = map(int, result.stdout.split())
    assert n_threads == n_cores


def test_threads_that_nobody_uses_end():
    most = len(os.listdir("/proc/self/task")) + max(32, os.cpu_count() or 1)
    points = np.random.default_rng(0).random((2000, 3))
    for n_jobs in range(1, 49):
        primfit.estimate_normals(points, 16, n_jobs=n_jobs)
    calls = [
        threading.Thread(target=primfit.estimate_normals, args=(points, 16), kwargs={"n_jobs": 16})
        for _ in range(16)
    ]
    for call in calls:
        call.start()
    for call in calls:
        call.join()
    # They have ended, but the system may show them a little longer.
    deadline = time.monotonic() + 20.0
    while len(os.listdir("/proc/self/task")) > most and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(os.listdir("/proc/self/task")) <= most
