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

SOLIDS = """
import hashlib, numpy as np, primfit
digest = hashlib.sha1()

def add(*arrays):
    for array in arrays:
        digest.update(np.ascontiguousarray(array, dtype=float).tobytes())

def cloud(solid, faces, rng):
    vertices, triangles = solid.to_mesh()
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    across = np.cross(b - a, c - a)
    areas = np.sqrt((across**2).sum(axis=1))
    kept = np.ones(len(areas), bool)
    for normal in faces:
        kept &= (across * normal).sum(axis=1) / areas < 0.9
    which = rng.choice(np.flatnonzero(kept), 4000, p=areas[kept] / areas[kept].sum())
    u, v = np.sort(rng.random((2, 4000)), axis=0)
    at = a[which] + u[:, None] * (b - a)[which] + (v - u)[:, None] * (c - a)[which]
    return at + rng.normal(0, 0.003, at.shape)

rng = np.random.default_rng(3)
quat = (0.1, 0.2, 0.3, 0.9)
solids = (
    primfit.Polyhedron.box(1.5, 1.0, 0.7, quat_xyzw=quat),
    primfit.Polyhedron.pyramid(5, 1.0, 1.2, quat_xyzw=quat),
    primfit.Polyhedron.prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 1.0, quat_xyzw=quat),
)
kinds = []
for solid in solids:
    for hidden in ([], [solid.normals[0]]):
        points = cloud(solid, hidden, rng) + 20.0
        found = primfit.detect(points, method="planes")
        kinds += [each.kind for each in found.solids]
        add(primfit.find_polyhedra(found.planes, points).edges, found.sigma)
        for each in found.solids:
            add(each.vertices, each.center, each.centroid, each.size, each.quat_xyzw)
            add(each.covariance, list(each.sigmas.values()), *each.faces)
        if solid is solids[0]:
            fit = primfit.fit_box(found.planes, points)
            add(fit.box.vertices, fit.end_sigmas, fit.face_rms, fit.tilts, fit.angles)
for kind in ("rectangle", "star", "hexagon"):
    world = primfit.random_world(1, 1.2, [kind], rng=1)
    scan = primfit.scan(world, primfit.grid_path(world, 0.125, rng=1), primfit.Lidar(noise=0.005), rng=1)
    found = primfit.detect(scan, method="paper", rng=1)
    kinds += [each.kind for each in found.solids]
    for each in found.solids:
        add(each.footprint, each.center, each.angle, each.size, each.covariance)
        add(list(each.sigmas.values()))
print(len(kinds), *kinds, digest.hexdigest())
"""


@pytest.mark.skipif(
    platform.machine() != "x86_64" or sys.platform != "linux", reason="names of x86 processors"
)
@pytest.mark.parametrize("code", [CODE, SOLIDS], ids=["planes", "solids"])
def test_results_have_the_same_bits(code):
    cores = CORES if "avx512" in Path("/proc/cpuinfo").read_text() else CORES[1:]
    digests = {}
    for core in cores:
        environment = {**os.environ, "OPENBLAS_CORETYPE": core}
        command = [sys.executable, "-c", code]
        result = subprocess.run(
            command, capture_output=True, text=True, check=True, env=environment
        )
        digests[core] = result.stdout
    assert len({*digests.values()}) == 1, digests
