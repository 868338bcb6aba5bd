"""Scenes in space, the page that shows them, and tables of notebooks."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from test_cli import primfit_command

import primfit
from primfit.viewing.layers import layers_of

trimesh = pytest.importorskip("trimesh")


@pytest.fixture(scope="module")
def planes_of_box():
    rng = np.random.default_rng(5)
    points = rng.uniform(0.0, 0.5, (3000, 3))
    points[np.arange(3000), np.arange(3000) % 3] = 0.0
    return primfit.detect_planes(points), points


class TestScenes:
    def test_of_a_world_has_its_solids(self, world):
        scene = world.to_scene()
        for i, solid in enumerate(world.solids):
            mesh = scene.geometry[f"solid-{i}"]
            mesh.merge_vertices(merge_norm=True, merge_tex=True, digits_vertex=9)
            assert mesh.is_watertight
            expected = trimesh.Trimesh(*solid.to_mesh()).volume
            assert mesh.volume == pytest.approx(expected, rel=1e-6)
        assert len(scene.export(file_type="glb")) > 1000

    def test_of_a_detection_has_planes_of_their_area(self, found):
        scene = found.to_scene()
        for i, plane in enumerate(found.planes):
            assert scene.geometry[f"plane-{i}"].area == pytest.approx(plane.area, rel=1e-6)
            assert len(scene.geometry[f"points-{i}"].vertices) == len(plane.inliers)
        assert {f"solid-{j}" for j in range(len(found.solids))} <= set(scene.geometry)

    def test_of_planes_with_holes(self):
        xy = np.random.default_rng(0).uniform(-1, 1, (20_000, 2))
        xy = xy[np.abs(xy).max(axis=1) > 0.5]
        (plane,) = planes = primfit.detect_planes(np.column_stack([xy, np.zeros(len(xy))]))
        assert len(plane.holes) == 1
        assert planes.to_scene().geometry["plane-0"].area == pytest.approx(plane.area)

    def test_all_points_are_there_once(self, planes_of_box):
        planes, points = planes_of_box
        layers = list(layers_of(planes, points=points))
        shown = np.concatenate([each.corners for each in layers if each.shape == "points"])
        assert np.array_equal(np.unique(shown, axis=0), np.unique(points, axis=0))
        assert len({layer.name for layer in layers}) == len(layers)

    def test_what_is_far_keeps_its_digits(self, planes_of_box):
        _, points = planes_of_box
        far = points + np.array([4.5e5, 5.4e6, 300.0])
        scene = primfit.Cloud(far).to_scene()
        offset = scene.metadata["offset"]
        np.testing.assert_array_equal(scene.geometry["points"].vertices + offset, far)

    def test_the_camera_sees_all_and_stands_upright(self, world):
        scene = world.to_scene()
        to_camera = np.linalg.inv(scene.camera_transform)
        corners = trimesh.bounds.corners(scene.bounds)
        x, y, z = (trimesh.transform_points(corners, to_camera) / 1.0).T
        assert (z < 0.0).all()
        half = np.tan(np.radians(scene.camera.fov) / 2)
        assert (np.abs(x / z) < half[0]).all()
        assert (np.abs(y / z) < half[1]).all()
        assert scene.camera_transform[2, 0] == pytest.approx(0.0, abs=1e-12)

    def test_points_of_another_cloud_are_refused(self, planes_of_box):
        planes, points = planes_of_box
        with pytest.raises(ValueError, match="points must be the 3000 of which the planes are"):
            planes.to_scene(points=points[1:])

    def test_of_nothing(self):
        cloud = primfit.Cloud(np.empty((0, 3)))
        assert cloud.to_scene().camera is not None


def test_pages_tell_of_every_part(found, world, tmp_path):
    page = found.show(tmp_path / "view.html", world=world).read_text()
    told = json.loads(re.search(r"const VIEW = (.*);\n", page).group(1))["parts"]
    assert told["plane-3"]["text"].startswith("plane 3: ")
    assert told["plane-3"]["label"] == "3"
    groups = {part["group"] for part in told.values()}
    assert {"points", "planes", "solids", "truth", "beams", "arena"} <= groups
    assert "http" not in re.sub(
        r"https?://(www\.)?(w3|khronos|github|threejs|jcgt|mathworks)", "", page[-9000:]
    )
    with pytest.raises(ValueError, match=r"must end in \.html"):
        found.show(tmp_path / "view.png")


@pytest.fixture(scope="module")
def browser():
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    pytest.skip("no Chromium to show pages")


def in_browser(browser, page, *words):
    options = ["--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
    options += ["--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND"]
    options += ["--window-size=1000,700", "--virtual-time-budget=8000", *words, page.as_uri()]
    return subprocess.run(
        [browser, *options], capture_output=True, timeout=240, check=True, cwd=page.parent
    )


def test_the_page_in_a_browser(browser, planes_of_box, tmp_path):
    """Without a network: planes are seen in their colours, and the mouse is told which it is at."""
    image = pytest.importorskip("matplotlib.image")
    planes, points = planes_of_box
    path = planes.show(tmp_path / "view.html", points=points)
    assert path.stat().st_size < 5e6
    in_browser(browser, path, f"--screenshot={tmp_path / 'view.png'}")
    pixels = image.imread(tmp_path / "view.png")[..., :3]
    colored = np.ptp(pixels, axis=2) > 0.2
    assert colored.mean() > 0.05
    assert len(np.unique(pixels[colored].argmax(axis=1))) == 3
    # A mouse that goes over the middle, in a page that does so by itself.
    script = """<script>setTimeout(() => {
      const view = renderer.domElement, told = new Set();
      for (let x = 100; x < 900; x += 20) for (let y = 150; y < 650; y += 20) {
        view.dispatchEvent(new MouseEvent("mousemove", {clientX: x, clientY: y}));
        told.add(document.getElementById("told").textContent.split(":")[0]);
      }
      document.querySelector("[data-group=planes]").click();
      const hidden = [...VIEW_OBJECTS("planes")].every((object) => !object.visible);
      document.body.dataset.told = [...told].sort().join("|") + "|" + hidden;
    }, 3000);</script>"""
    moved = tmp_path / "moved.html"
    moved.write_text(path.read_text().replace("</body>", script + "</body>"))
    shown = in_browser(browser, moved, "--dump-dom").stdout.decode()
    assert re.search(r'data-told="([^"]*)"', shown).group(1) == "|plane 0|plane 1|plane 2|true"


def test_notebooks(found, world, monkeypatch):
    tables = {
        "31 planes": found._repr_html_(),
        "7 of 7 right": primfit.evaluate(found, world)._repr_html_(),
        "Planes(": primfit.Planes((), np.zeros(3, int), 0.0, np.zeros(0), {})._repr_html_(),
    }
    for told, table in tables.items():
        assert f"{told}" in table
        assert table.count("<tr>") == table.count("</tr>")
    assert "<td>3</td>" in tables["31 planes"]
    html = pytest.importorskip("IPython.display").HTML
    monkeypatch.setattr("primfit.viewing.shown._in_notebook", lambda: True)
    shown = world.show()
    assert isinstance(shown, html)
    assert shown.data.startswith("<div><iframe srcdoc=")


def test_scripts_open_a_browser(world, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert world.show() is None
    assert opened[0].endswith("/view.html")


def test_command_line(tmp_path, small_scan, small_world):
    small_scan.save(tmp_path / "scan.npz")
    small_world.save(tmp_path / "world.json")
    words = ("detect", "scan.npz", "--method", "paper", "--world", "world.json")
    result = primfit_command(*words, "--view", "view.html", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "written: view.html" in result.stdout
    assert "truth-0" in (tmp_path / "view.html").read_text()


def test_data_frames_name_their_extra(found, world, monkeypatch):
    report = primfit.evaluate(found, world)
    assert len(report.to_frame()) == len(world.solids)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'primfit\[tables\]'"):
        report.to_frame()
