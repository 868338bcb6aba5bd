"""Which method `detect` takes by itself: one rule for library and command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_cli import primfit_command

import primfit
from primfit.clouds.upright import uprightness

ROUND = ("triangle", "square", "rectangle", "pentagon", "star", "circle", "polygon")
TILTED = ("box", "wedge", "pyramid", "frustum", "prism", "cube")


def returns(world, path, lidar, seed):
    scan = primfit.scan(world, path, lidar, rng=seed)
    return scan.points[scan.is_return]


def upright(seed, noise=0.0, kinds=ROUND):
    """Upright solids whose tops nobody saw."""
    world = primfit.random_world(rng=seed, kinds=kinds)
    path = primfit.grid_path(world, rng=seed)
    return returns(world, path, primfit.Lidar(noise=noise), seed)


@pytest.mark.parametrize("seed", range(50, 56))
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.005])
def test_upright_solids_without_tops(seed, noise):
    cloud = upright(seed, noise)
    assert primfit.choose_method(cloud)[0] == "paper"
    # Neither scale, place, order, density, a filtered floor nor a few outliers change that.
    rng = np.random.default_rng(seed)
    assert primfit.choose_method(100.0 * cloud[::-1] + (5e5, 4e6, 100.0))[0] == "paper"
    assert primfit.choose_method(rng.permutation(cloud)[:8000])[0] == "paper"
    assert primfit.choose_method(cloud[cloud[:, 2] > 0.02])[0] == "paper"
    strays = rng.uniform(-5, 5, size=(100, 3))
    assert primfit.choose_method(np.concatenate([cloud, strays]))[0] == "paper"


@pytest.mark.parametrize("seed", range(3))
def test_the_setting_of_the_paper(seed):
    world = primfit.paper_world(rng=seed)
    path = primfit.paper_path(world, 0.4)
    lidar = primfit.Lidar.paper(noise=0.005)
    assert primfit.choose_method(returns(world, path, lidar, seed))[0] == "paper"


@pytest.mark.parametrize("seed", range(50, 56))
def test_solids_with_tops(seed):
    world = primfit.random_world(rng=seed, height=(0.05, 0.12))
    lidar = primfit.Lidar(noise=0.002, vertical_field_of_view=1.2, mount=(0, 0, 0.25))
    cloud = returns(world, primfit.grid_path(world, rng=seed), lidar, seed)
    assert primfit.choose_method(cloud) == ("planes", "a cloud not of upright walls alone")


@pytest.mark.parametrize("seed", range(50, 56))
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_tilted_polyhedra(seed, noise):
    world = primfit.random_world(rng=seed, kinds=TILTED)
    path = primfit.grid_path(world, rng=seed)
    cloud = returns(world, path, primfit.Lidar(noise=noise), seed)
    assert primfit.choose_method(cloud)[0] == "planes"


@pytest.mark.parametrize("n", [300, 1000, 12_000])
def test_one_box(n):
    rng = np.random.default_rng(n)
    size, face = np.array([0.4, 0.3, 0.2]), np.arange(n) % 6
    box = size * rng.random((n, 3))
    box[np.arange(n), face // 2] = face % 2 * size[face // 2]
    assert primfit.choose_method(box)[0] == "planes"
    assert primfit.choose_method(box @ Rotation.from_rotvec([0.5, 0.3, 0.1]).as_matrix())[0] == (
        "planes"
    )
    walls = box[face < 4]
    assert primfit.choose_method(walls)[0] == "paper"
    # Turned with the walls, what is upright is so no more.
    fallen = walls @ Rotation.from_rotvec([1.0, 0.0, 0.0]).as_matrix()
    assert primfit.choose_method(fallen)[0] == "planes"


def test_recorded_turns_of_spinning_sensors(data):
    files = sorted([*data.glob("os1_board/*full.pcd"), *data.glob("vlp16_board/*full.pcd")])
    assert files
    for file in files:
        points = primfit.read_points(file)
        assert primfit.choose_method(points[np.isfinite(points).all(axis=1)])[0] == "planes", file


def test_what_the_beams_know_decides_first(small_scan):
    box = primfit.World([primfit.Polyhedron.box(0.4, 0.3, 0.2, quat_xyzw=(0.2, 0.1, 0, 1))])
    lidar = primfit.Lidar(vertical_field_of_view=1.0)
    of_box = primfit.scan(box, primfit.grid_path(box, rng=1), lidar, rng=1)
    for scan, alone in ((small_scan, "likelihood"), (of_box, "planes")):
        assert primfit.choose_method(scan)[0] == "likelihood"
        points, origins = scan.points[scan.is_return], scan.origins[scan.is_return]
        known = primfit.Scan.from_points(points, origins, max_range=1.0)
        assert primfit.choose_method(known)[0] == "likelihood"
        returns_alone = primfit.Scan.from_points(points, origins)
        assert primfit.choose_method(returns_alone)[0] == alone
    origin = (1.0, 1.0, 0.06)
    rays = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    passed = primfit.Scan.from_rays(origin, rays, [1.0, np.inf])
    assert primfit.choose_method(passed) == (
        "likelihood",
        "origins of the beams are known, and which did not return",
    )
    returned = primfit.Scan.from_rays(origin, rays, [1.0, 2.0])
    assert primfit.choose_method(returned)[0] == "planes"
    with pytest.raises(FileNotFoundError, match=r"there is no file none\.npz"):
        primfit.choose_method("none.npz")


@pytest.mark.parametrize(
    "cloud", [np.zeros((5, 3)), np.eye(3), np.insert(np.eye(2), 2, 0.0, axis=1)]
)
def test_hardly_a_cloud(cloud):
    assert not uprightness(cloud).has_only_walls
    assert primfit.choose_method(cloud)[0] == "planes"


def test_the_result_says_which_and_why(small_scan):
    found = primfit.detect(small_scan, rng=1)
    method, reason = primfit.choose_method(small_scan)
    assert (found.method, found.settings["method_reason"]) == (method, reason)
    assert json.loads(found.to_json())["settings"]["method_reason"] == reason
    asked = primfit.detect(small_scan, "planes", rng=1)
    assert (asked.method, asked.settings["method_reason"]) == ("planes", "asked for")


@pytest.mark.parametrize("seed", [2, 3])
def test_upright_solids_are_found_in_a_cloud(seed):
    world = primfit.random_world(rng=seed)
    path = primfit.grid_path(world, rng=seed)
    scan = primfit.scan(world, path, primfit.Lidar(noise=0.002), rng=seed)
    cloud, origins = scan.points[scan.is_return], scan.origins[scan.is_return]
    for recorded, method in (
        (cloud, "paper"),
        (primfit.Scan.from_points(cloud, origins), "likelihood"),
    ):
        found = primfit.detect(recorded, rng=1)
        assert found.method == method
        assert primfit.evaluate(found, world).all_right


def test_options_of_another_method_are_explained(small_scan):
    message = (
        r"'likelihood' are .*; not threshold, which 'planes' would take .why .*: origins and reach"
    )
    with pytest.raises(TypeError, match=message):
        primfit.detect(small_scan, threshold=0.01)
    with pytest.raises(
        TypeError, match=r"'planes' are .*; not colour \(why this method: asked for\)$"
    ):
        primfit.detect(small_scan, "planes", colour=1)


def test_the_command_line_follows_the_rule(tmp_path, small_scan):
    small_scan.save(tmp_path / "scan.npz")
    primfit.write_points(tmp_path / "cloud.ply", small_scan.points[small_scan.is_return])
    for file in ("scan.npz", "cloud.ply"):
        result = primfit_command("detect", file, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        is_scan = file == "scan.npz"
        loaded = (
            primfit.Scan.load(tmp_path / file) if is_scan else primfit.read_points(tmp_path / file)
        )
        assert "method {}: {}".format(*primfit.choose_method(loaded)) in result.stdout
    wish = primfit_command("detect", "scan.npz", "--min-points", "20", cwd=tmp_path)
    assert wish.returncode == 2
    assert "not likelihood (origins and reach of the beams are known)" in wish.stderr
    asked = primfit_command(
        "detect", "scan.npz", "--method", "paper", "--min-points", "20", cwd=tmp_path
    )
    assert "method paper: asked for" in asked.stdout
