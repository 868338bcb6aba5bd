"""Tilted solids in one call: scanned from around, as a scan and as a bare cloud."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import primfit
from primfit import plotting
from primfit.worlds.random_polyhedra import POLYHEDRA, random_polyhedron


def looking(place, target):
    """Pose of a sensor that looks at a point."""
    x = (target - place) / np.linalg.norm(target - place)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y)
    pose = np.eye(4)
    pose[:3] = np.stack([x, y, np.cross(x, y), place], axis=1)
    return pose


def scanned(seed, n_poses=30):
    """A random tilted solid above the floor, seen from all around with noise of 1 % of its size."""
    rng = np.random.default_rng(seed)
    kind = list(POLYHEDRA)[seed % len(POLYHEDRA)]
    solid = random_polyhedron(kind, POLYHEDRA[kind], (0.0, 2 * np.pi), rng, tilted=True)
    size = float(np.ptp(solid.vertices, axis=0).max())
    solid = solid.moved([0.0, 0.0, 5 * size])
    ways = rng.normal(size=(n_poses, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    path = np.stack([looking(solid.center + 4 * size * way, solid.center) for way in ways])
    view = 2 * np.arctan(0.9 / 4)
    lidar = primfit.Lidar(32, view, 33, view, 0.001, 6 * size, noise=0.01 / 6)
    world = primfit.World([solid])
    return world, primfit.scan(world, path, lidar, rng=seed), size


@pytest.mark.parametrize("seed", [6, 7, 8, 9, 10, 11])
@pytest.mark.parametrize("as_cloud", [False, True])
def test_tilted_solids_in_one_call(seed, as_cloud):
    world, scan, size = scanned(seed)
    points = scan.points[scan.is_return]
    found = primfit.detect(points) if as_cloud else primfit.detect(scan, method="planes")
    assert found.method == "planes"
    (row,) = primfit.evaluate(found, world, max_distance=size).rows
    assert row.found == row.truth
    assert row.center_error_mm < 5.0 * size
    assert row.angle_error_deg < 0.5
    assert not found.shells


@pytest.mark.parametrize("tilted", [False, True])
def test_solids_on_the_floor_of_an_arena(tilted):
    """With faces that nobody sees, or few beams; the arena, which is seen from inside, is none."""
    n_right = n_solids = 0
    for seed in range(2):
        world = primfit.random_world(4, kinds=list(POLYHEDRA), rng=seed, tilted=tilted)
        places = primfit.grid_path(world, 0.5, rng=seed)[::2]
        levels = np.tile(np.eye(4), (3, len(places), 1, 1))
        levels[..., :3, :3] = Rotation.from_rotvec(places[:, 2:] * [0, 0, 1]).as_matrix()
        levels[..., :2, 3] = places[:, :2]
        levels[..., 2, 3] = np.array([[0.15], [0.4], [0.8]])
        path = levels.reshape(-1, 4, 4)
        lidar = primfit.Lidar(24, 1.6, 160, 2 * np.pi, max_range=4.0, noise=0.003 / 4.0)
        scan = primfit.scan(world, path, lidar, rng=seed)
        report = primfit.evaluate(primfit.detect(scan, method="planes"), world)
        assert not report.spurious
        n_right += report.n_right
        n_solids += len(report.rows)
    assert n_solids == 8
    assert n_right >= 7


def test_covariances_are_honest():
    distances = []
    for seed in range(2000, 2024):
        world, scan, _ = scanned(seed)
        (found,) = primfit.detect(scan, method="planes").solids
        (truth,) = world.solids
        assert found.kind == truth.kind
        assert len(found.sigmas) == len(found.covariance)
        turn = Rotation.from_quat(truth.quat_xyzw) * Rotation.from_quat(found.quat_xyzw).inv()
        turns = Rotation.from_matrix(truth.symmetry) * turn
        off = [
            truth.center - found.center,
            turns[int(turns.magnitude().argmin())].as_rotvec(),
            np.atleast_1d(truth.size) - found.size,
        ]
        off = np.concatenate(off)
        distances.append(off @ np.linalg.pinv(found.covariance) @ off / len(off))
    # The mean of 24 times some 9 squares of standard normal numbers.
    assert 0.7 < np.mean(distances) < 1.4


def test_what_becomes_of_them(tmp_path):
    world, scan, _ = scanned(8)
    found = primfit.detect(scan, method="planes")
    (solid,) = found.solids
    vertices, triangles, index = found.to_mesh()
    corners = vertices[triangles]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(solid.volume)
    assert volume == pytest.approx(world.solids[0].volume, rel=0.02)
    assert set(index) == {0}
    content = json.loads(found.to_json())
    assert content["solids"][0]["kind"] == "wedge"
    assert content["shells"] == []
    found.to_csv(tmp_path / "solids.csv")
    with open(tmp_path / "solids.csv") as stream:
        (line,) = csv.DictReader(stream)
    assert (line["kind"], line["corners"]) == ("wedge", "6")
    assert float(line["size_3_m"]) == pytest.approx(solid.size[2])
    assert solid.height == pytest.approx(np.ptp(solid.vertices[:, 2]))
    figure = plotting.new_figure(4, 4)
    ax = found.plot(world=world, ax=figure.add_subplot())
    assert "wedge" in {text.get_text() for text in ax.texts}


def test_walls_that_do_not_close_are_shells():
    rng = np.random.default_rng(2)
    points = rng.random((3000, 3))
    points[np.arange(3000), np.arange(3000) % 3] = 0.0
    found = primfit.detect(points + 0.002 * rng.normal(size=points.shape), "planes")
    assert found.solids == ()
    assert [sorted(shell) for shell in found.shells] == [[0, 1, 2]]
