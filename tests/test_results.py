"""Evaluation, exports, files, pictures."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import primfit
from primfit import plotting
from primfit.solids.found import FoundSolid


def as_found(world, found, changes=()):
    """A detection that holds the truth, but for some changes {row: fields}."""
    solids = []
    for i, solid in enumerate(world.solids):
        perfect = {
            "kind": solid.kind,
            "footprint": solid.footprint,
            "base": 0.0,
            "top": solid.height,
            "angle": solid.angle,
            "size": solid.size,
            "covariance": np.eye(4),
            "planes": (),
            "observed": (),
        }
        change = dict(changes).get(i, {})
        if change is not None:
            solids.append(FoundSolid.upright(**(perfect | change)))
    return replace(found, solids=tuple(solids))


class TestEvaluation:
    def test_truth_scores_zero(self, world, found):
        report = primfit.evaluate(as_found(world, found), world)
        assert report.all_right
        for row in report.rows:
            assert row.center_error_mm == row.angle_error_deg == row.size_error_mm == 0.0

    def test_missed_and_spurious(self, world, found):
        moved = world.solids[1].footprint + 0.15
        report = primfit.evaluate(as_found(world, found, {0: None, 1: {"footprint": moved}}), world)
        assert report.missed == (0, 1)
        assert report.spurious == (0,)
        assert not report.all_right
        assert report.n_right == len(world.solids) - 2

    def test_errors_are_in_their_units(self, world, found):
        solid = world.solids[0]
        report = primfit.evaluate(
            as_found(world, found, {0: {"footprint": solid.footprint + np.array([0.003, 0.004])}}),
            world,
        )
        assert report.rows[0].center_error_mm == pytest.approx(5.0)

    @pytest.mark.parametrize(
        ("kind", "period"),
        [("triangle", 120), ("square", 90), ("pentagon", 72), ("rectangle", 180)],
    )
    def test_angles_are_compared_on_the_circle(self, found, kind, period):
        world = primfit.random_world(1, 1.0, [kind], rng=1)
        angle = world.solids[0].angle
        for turn, expected in [
            (1.0, 1.0),
            (-1.0, 1.0),
            (period - 1.0, 1.0),
            (period / 2, period / 2),
        ]:
            turned = {0: {"angle": angle + np.radians(turn)}}
            row = primfit.evaluate(as_found(world, found, turned), world).rows[0]
            assert row.angle_error_deg == pytest.approx(expected)

    def test_without_a_kind_in_common_outlines_are_laid_over_each_other(self, found):
        world = primfit.random_world(1, 1.0, ["square"], rng=1)
        solid = world.solids[0]
        turned = primfit.Prism.regular(
            4, solid.size, center=solid.center[:2], angle=solid.angle + 0.1
        )
        change = {0: {"kind": "polygon", "footprint": turned.footprint}}
        row = primfit.evaluate(as_found(world, found, change), world).rows[0]
        assert row.angle_error_deg == pytest.approx(np.degrees(0.1))
        assert np.isnan(row.size_error_mm)
        fewer = {0: {"kind": "polygon", "footprint": turned.footprint[:3]}}
        assert np.isnan(
            primfit.evaluate(as_found(world, found, fewer), world).rows[0].angle_error_deg
        )

    def test_matching_is_one_to_one(self, world, found):
        doubled = as_found(world, found)
        doubled = replace(doubled, solids=doubled.solids + doubled.solids[:1])
        report = primfit.evaluate(doubled, world)
        assert len(report.spurious) == 1
        assert not report.missed

    def test_tables(self, world, found):
        report = primfit.evaluate(found, world)
        text = str(report)
        assert text.splitlines()[0].split() == [
            "Ground",
            "Truth",
            "Detected",
            "Center",
            "Error",
            "(mm)",
            "Angle",
            "Error",
            "(deg)",
            "Size",
            "Error",
            "(mm)",
        ]
        assert f"{len(world.solids)} of {len(world.solids)} right" in text
        frame = report.to_frame()
        assert list(frame["truth"]) == [solid.kind for solid in world.solids]
        assert json.loads(report.to_json())["missed"] == []
        empty = primfit.evaluate(replace(found, solids=()), world)
        assert json.loads(empty.to_json())["rows"][0]["center_error_mm"] is None
        assert "missed" in str(empty)
        nothing = primfit.evaluate(found, primfit.World())
        assert len(nothing.spurious) == len(found.solids)


class TestExports:
    def test_json(self, found, tmp_path):
        content = json.loads(found.to_json(tmp_path / "found.json"))
        assert json.loads((tmp_path / "found.json").read_text()) == content
        assert len(content["solids"]) == len(found.solids)
        assert content["solids"][0]["sigmas"]["center_x"] > 0

    def test_json_of_the_papers_own_rules(self, small_scan):
        literal = primfit.PaperSettings.literal(threshold=0.01)
        content = json.loads(primfit.detect(small_scan, "paper", rng=1, settings=literal).to_json())
        assert content["floor"] is None

    def test_csv(self, found, tmp_path):
        found.to_csv(tmp_path / "found.csv")
        with open(tmp_path / "found.csv") as stream:
            rows = list(csv.DictReader(stream))
        assert [row["kind"] for row in rows] == [solid.kind for solid in found.solids]
        assert float(rows[0]["x_m"]) == found.solids[0].center[0]

    @pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl"])
    def test_mesh(self, found, tmp_path, suffix):
        import trimesh

        found.save_mesh(tmp_path / f"found{suffix}")
        mesh = trimesh.load_mesh(tmp_path / f"found{suffix}")
        mesh.merge_vertices()
        assert mesh.is_watertight
        vertices, triangles, index = found.to_mesh()
        assert len(mesh.faces) == len(triangles) == len(index)
        assert triangles.max() < len(vertices)

    def test_bad_mesh_format(self, found, tmp_path):
        with pytest.raises(ValueError, match=r"file must end in \.ply, \.obj or \.stl"):
            found.save_mesh(tmp_path / "found.fbx")


class TestPictures:
    def test_all_plots_draw_without_a_display(self, world, scan, found, tmp_path):
        figure = plotting.new_figure(4, 4)
        for plot in (world.plot, scan.plot, found.plot):
            ax = plot(ax=figure.add_subplot())
            assert ax.get_xlabel() == "x [m]"
            figure.clear()
        plotting.save_demo(tmp_path / "demo.png", world, scan, found, "7 of 7 right")
        plotting.save_detection(tmp_path / "planes.png", found)
        for name in ("demo.png", "planes.png"):
            assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")

    def test_plots_make_their_own_axes(self, world):
        import matplotlib as mpl
        import matplotlib.pyplot as plt

        mpl.use("Agg")
        assert world.plot().get_title() == "map"
        plt.close("all")

    def test_neighbouring_colors_differ(self):
        colors = plotting.plane_colors(40).astype(int)
        assert colors.shape == (41, 3)
        assert np.abs(np.diff(colors[:-1], axis=0)).sum(axis=1).min() > 60


def test_national_grid_coordinates_keep_their_digits(tmp_path):
    offset = np.array([5e6, -5e6, 100.0])
    world = primfit.random_world(1, 1.0, ["rectangle"], rng=4)
    scan = primfit.scan(world, primfit.grid_path(world, 0.25, rng=4), rng=4)
    moved = primfit.Scan.from_rays(
        scan.origins + offset, scan.directions, scan.ranges, sigma=0.0, max_range=1.0
    )
    here, there = primfit.detect(scan, rng=1), primfit.detect(moved, rng=1)
    assert [each.kind for each in there.solids] == ["rectangle"]
    difference = (there.solids[0].center - here.solids[0].center - offset)[:2]
    np.testing.assert_allclose(difference, 0.0, atol=1e-6)
    distance = moved.points[there.planes[0].inliers] @ there.planes[0].equation[:3]
    np.testing.assert_allclose(distance + there.planes[0].equation[3], 0.0, atol=1e-6)
    far = primfit.Prism(world.solids[0].footprint + offset[:2])
    assert far.kind == "rectangle"
    np.testing.assert_allclose(far.size, world.solids[0].size, atol=1e-7)
    for suffix in (".ply", ".las"):
        primfit.write_points(tmp_path / f"far{suffix}", moved.points[moved.is_return])
        again = primfit.read_points(tmp_path / f"far{suffix}")
        np.testing.assert_allclose(again, moved.points[moved.is_return], rtol=0, atol=1e-4)
