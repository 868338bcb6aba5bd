"""The same bits whatever processor the BLAS of NumPy was tuned for."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

CORES = ["SkylakeX", "Haswell", "Nehalem"]
"""What OpenBLAS is told to take the processor for; SkylakeX only where there is AVX-512."""

CODE = """
import hashlib, numpy as np, primfit
rng = np.random.default_rng(0)
points = rng.random((3000, 3)) * [3, 2, 1]
for k in range(6):
    points[k * 400 : k * 400 + 400, k // 2] = k % 2 * (3, 2, 1)[k // 2]
points += rng.normal(0, 0.003, points.shape)
turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
points = np.einsum("ni,ij->nj", points, turn) + 100.0
digest = hashlib.sha1()
for origins, orientation in ((None, "any"), ((103.0, 101.0, 109.0), "any"), (None, (0.36, 0.48, -0.8))):
    found = primfit.detect_planes(points, origins, orientation=orientation, max_angle=0.1)
    assert len(found) >= 1
    digest.update(found.labels.tobytes() + np.float64(found.sigma).tobytes())
    for plane in found:
        for array in (plane.equation, plane.covariance, plane.boundary, np.float64([plane.area, plane.rms])):
            digest.update(np.ascontiguousarray(array).tobytes())
digest.update(primfit.estimate_normals(points, 16).tobytes())
digest.update(primfit.dbscan(points, 0.05, 5).tobytes())
world = primfit.random_world(2, 1.0, rng=1)
scan = primfit.scan(world, (0.5, 0.5, 0.3), primfit.Lidar(noise=0.01), rng=1)
digest.update(scan.points.tobytes() + scan.ranges.tobytes())
print(digest.hexdigest())
"""


@pytest.mark.skipif(
    platform.machine() != "x86_64" or sys.platform != "linux", reason="names of x86 processors"
)
def test_planes_scans_normals_and_clusters():
    cores = CORES if "avx512" in Path("/proc/cpuinfo").read_text() else CORES[1:]
    digests = {}
    for core in cores:
        environment = {**os.environ, "OPENBLAS_CORETYPE": core}
        command = [sys.executable, "-c", CODE]
        result = subprocess.run(
            command, capture_output=True, text=True, check=True, env=environment
        )
        digests[core] = result.stdout
    assert len({*digests.values()}) == 1, digests
