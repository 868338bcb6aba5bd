"""The command line, as a user types it."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import primfit


def primfit_command(*words, cwd):
    return subprocess.run(
        [sys.executable, "-m", "primfit.cli", *map(str, words)],
        capture_output=True,
        text=True,
        cwd=cwd,
        check=False,
    )


def test_demo(tmp_path):
    result = primfit_command("demo", "--rng", "7", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "Ground Truth" in result.stdout
    assert "7 of 7 right, 0 missed, 0 spurious" in result.stdout
    assert (tmp_path / "demo.png").stat().st_size > 20_000
    again = primfit_command(
        "demo", "--rng", "7", "--noise", "0.05", "--method", "likelihood", "--json", cwd=tmp_path
    )
    content = json.loads(again.stdout)
    assert content["report"]["missed"] == []


def test_scan_then_detect(tmp_path):
    made = primfit_command(
        "scan",
        "scan.npz",
        "--save-world",
        "world.json",
        "--rng",
        "3",
        "--noise",
        "0.002",
        cwd=tmp_path,
    )
    assert made.returncode == 0, made.stderr
    world = primfit.World.load(tmp_path / "world.json")
    found = primfit_command(
        "detect", "scan.npz", "--world", "world.json", "--mesh", "solids.obj", "--csv", "solids.csv",
        "--picture", "found.png", cwd=tmp_path,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert f"{len(world.solids)} of {len(world.solids)} right" in found.stdout
    for name in ("solids.obj", "solids.csv", "found.png"):
        assert (tmp_path / name).stat().st_size > 0
    as_json = primfit_command("detect", "scan.npz", "--world", "world.json", "--json", cwd=tmp_path)
    assert json.loads(as_json.stdout)["report"]["spurious"] == []
    cloud = primfit_command(
        "scan", "cloud.ply", "--world", "world.json", "--rng", "3", cwd=tmp_path
    )
    assert cloud.returncode == 0, cloud.stderr
    assert len(primfit.read_points(tmp_path / "cloud.ply")) > 10_000


@pytest.mark.parametrize(
    ("camera", "preset"),
    [
        ("kinect", primfit.DepthCamera.kinect),
        ("d435", primfit.DepthCamera.realsense_d435),
        ("range-finder", primfit.DepthCamera.range_finder),
    ],
)
def test_scan_with_a_depth_camera(camera, preset, tmp_path):
    words = ["--camera", camera, "--rng", "3", "--spacing", "2", "--headings", "1"]
    primfit.World(arena=primfit.Arena((3, 2))).save(tmp_path / "world.json")
    made = primfit_command("scan", "scan.npz", "--world", "world.json", *words, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    scan, sensor = primfit.Scan.load(tmp_path / "scan.npz"), preset()
    assert len(scan) == scan.image("depth").size
    assert scan.image("depth").shape[1:] == (sensor.height, sensor.width)
    depths = scan.image("depth")[np.isfinite(scan.image("depth"))]
    assert len(depths) > 100
    assert depths.max() <= sensor.max_depth * 1.1


def test_kinds_of_the_random_world(tmp_path):
    made = primfit_command(
        "scan", "scan.npz", "--save-world", "world.json", "--kind", "circle", "--kind", "ellipse",
        "--rng", "5", "--spacing", "0.5", cwd=tmp_path,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    kinds = {solid.kind for solid in primfit.World.load(tmp_path / "world.json").solids}
    assert kinds == {"circle", "ellipse"}


def test_detect_a_cloud(tmp_path):
    rng = np.random.default_rng(1)
    uv = rng.uniform(size=(2, 800, 2))
    cloud = np.concatenate([np.insert(uv[k], k, 0.0, axis=1) for k in range(2)])
    primfit.write_points(tmp_path / "corner.xyz", cloud + 0.002 * rng.normal(size=cloud.shape))
    result = primfit_command("detect", "corner.xyz", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "2 planes hold" in result.stdout
    assert (tmp_path / "corner_planes.png").stat().st_size > 0
    assert len(primfit.read_points(tmp_path / "corner_planes.ply")) == 1600


def test_detect_by_tiles(tmp_path):
    xy = np.random.default_rng(1).uniform(size=(3000, 2)) * [30.0, 10.0]
    points = np.column_stack([xy, 0.01 * np.random.default_rng(2).normal(size=3000)])
    primfit.write_points(tmp_path / "floor.xyz", points)
    words = ("detect", "floor.xyz", "--tiles", 10, "--halo", 2, "--jobs", 2)
    result = primfit_command(*words, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "1 planes hold 100.0%" in result.stdout
    labels = np.load(tmp_path / "floor_planes.npy")
    assert labels.shape == (3000,)
    assert (labels == 0).mean() > 0.99
    content = json.loads(primfit_command(*words, "--json", cwd=tmp_path).stdout)
    assert content["planes"][0]["area"] == pytest.approx(300.0, rel=0.05)
    refused = primfit_command(*words, "--mesh", "solids.obj", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--mesh does not go with --tiles" in refused.stderr


def test_help_and_version(tmp_path):
    assert primfit.__version__ in primfit_command("--version", cwd=tmp_path).stdout
    result = primfit_command("--help", cwd=tmp_path)
    for command in ("demo", "scan", "detect", "reproduce"):
        assert command in result.stdout
        assert "--help" in primfit_command(command, "--help", cwd=tmp_path).stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["detect", "nothing.ply"], "there is no file nothing.ply"),
        (["detect", "empty.npz"], "empty.npz is not readable as .npz"),
        (["detect", "nan.npy"], "nan.npy holds no finite point"),
        (["scan", "out.npz", "--world", "empty.npz"], "empty.npz is not a world"),
        (["scan", "out.npz", "--layers", "0"], "number_of_layers must be at least 1"),
        (["scan", "out.npz", "--camera", "kinect", "--layers", "4"], "not --camera kinect"),
        (["demo", "--noise", "-1"], "noise must be at least 0"),
        (["demo", "--noise", "50"], "noise must be at most 1, a fraction of max_range, not 50"),
        (["demo", "--rng", "-1"], "rng must be None, an integer of at least 0"),
        (["demo", "--picture", "no/demo.png"], "there is no folder no to write demo.png to"),
        (["demo", "--kind", "blob"], "kinds must be taken from triangle, square"),
        (["scan", "out.npz", "--kind", "star", "--world", "w.json"], "--kind is for random worlds"),
        (["scan", "no/out.npz"], "there is no folder no"),
        (["scan", "out.npz", "--spacing", "1e-5"], "spacing must leave at most 1000000 positions"),
        (["detect", "nan.npy", "--csv", "no/x.csv"], "there is no folder no"),
        (["detect", "scan.npz", "--world", "scan.npz"], "scan.npz is not a world"),
        (["detect", "scan.npz", "--origin", "0", "0", "0"], "--origin is for clouds"),
        (["detect", "scan.npz", "--method", "likelihood", "--threshold", "1"], "wishes for planes"),
    ],
)
def test_mistakes_are_explained_in_a_line(words, message, tmp_path):
    (tmp_path / "empty.npz").write_bytes(b"")
    np.save(tmp_path / "nan.npy", np.full((5, 3), np.nan))
    primfit.scan(primfit.World(), [[0.0, 0.0, 0.0]], rng=1).save(tmp_path / "scan.npz")
    result = primfit_command(*words, cwd=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert len(result.stderr) < 300
