"""Mistakes that do not stop the work are told, with what they cost."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import primfit

ARENA = primfit.Arena((2, 2))
SQUARE = primfit.Prism.regular(4, 0.4, center=(1, 1))


def scanned(*solids, arena=ARENA, path=(0.3, 0.3, 0.0)):
    return primfit.scan(primfit.World(solids, arena), path, rng=1)


class TestSolids:
    def test_outside_the_arena(self):
        with pytest.warns(UserWarning, match=r"solids 1 reach beyond the arena of World\(2 solids"):
            scanned(SQUARE, primfit.Prism.regular(3, 0.4, center=(1.9, 1.9)))

    @pytest.mark.parametrize(
        "other",
        [
            primfit.Prism.regular(4, 0.1, center=(1, 1)),
            primfit.Prism.rectangle(1.0, 0.1, center=(1, 1)),
            primfit.Polyhedron.box(0.1, 0.1, 0.1, center=(1, 1, 0.1)),
            primfit.Polyhedron.pyramid(4, 0.5, 0.9, center=(1, 1, 0.3)),
        ],
    )
    def test_inside_each_other(self, other):
        with pytest.warns(
            UserWarning, match=r"solids \(0, 1\) of World\(2 .* reach into each other"
        ):
            scanned(SQUARE, other)

    @pytest.mark.parametrize(
        "other",
        [
            primfit.Prism(SQUARE.footprint + np.array([0.4, 0.0]), 0.2),
            primfit.Prism(SQUARE.footprint, 0.2, base=0.2),
            primfit.Polyhedron.box(0.1, 0.1, 0.1, center=(1, 1, 0.25)),
            primfit.Prism(np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]), 0.2),
        ],
        ids=["beside", "upon", "box upon", "in the corner"],
    )
    def test_that_touch_are_right(self, other):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scanned(SQUARE, other, path=(0.5, 0.3, 0.0))

    def test_random_worlds_are_right(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for seed in range(20):
                world = primfit.random_world(rng=seed)
                primfit.scan(world, primfit.grid_path(world, 0.5, rng=seed), rng=seed)


class TestPaths:
    def test_poses_that_are_left_out_are_counted(self):
        path = [(0.3, 0.3, 0.0), (1.0, 1.0, 0.0), (5.0, 1.0, 0.0)]
        with pytest.warns(
            UserWarning, match="path has 2 of 3 poses inside a solid or outside the arena"
        ):
            scan = scanned(SQUARE, path=path)
        assert np.unique(scan.pose_index).tolist() == [0]

    def test_waypoints_too(self):
        world = primfit.World([SQUARE], ARENA)
        with pytest.warns(
            UserWarning, match=r"points lead .*: \d+ of 35 positions are nearer than"
        ):
            path = primfit.waypoints(world, [(0.3, 1.0), (2.0, 1.0)])
        assert len(path) < 35

    def test_yaws_in_degrees(self):
        with pytest.warns(UserWarning, match="more than a full turn, 90 radians in row 1"):
            scanned(path=[(1, 1, 0), (1, 1, 90)])
        world = primfit.World(arena=ARENA)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for headings in (1, 4, 5):
                path = primfit.waypoints(world, [(1.5, 1), (0.5, 1), (0.5, 0.5)], headings=headings)
                primfit.scan(world, path)


def test_angles_in_degrees():
    with pytest.warns(UserWarning, match=r"angle is 45 radians, more than a full turn"):
        primfit.Prism.regular(4, 0.3, angle=45)
    with pytest.warns(UserWarning, match=r"max_angle is 10 radians"):
        primfit.detect_planes(
            np.random.default_rng(0).random((50, 3)), orientation="vertical", max_angle=10
        )


def test_coordinates_in_millimetres():
    rng = np.random.default_rng(0)
    points = rng.integers(-3000, 3000, (500, 3))
    with pytest.warns(UserWarning, match=r"points are whole numbers, half of them beyond 2\d\d\d"):
        primfit.Scan.from_points(points)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        primfit.Scan.from_points(points + 0.5)
        primfit.Scan.from_points(points // 100)
        primfit.Scan.from_points(np.r_[points, [[0.5, 0, 0]]])
        primfit.Scan.from_points(np.zeros((0, 3)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"threshold": "0.1"}, "threshold must be a number, not '0.1'"),
        ({"eps": [0.1]}, r"eps must be a number, not \[0.1\]"),
        ({"local": "no"}, "local must be a bool, not str"),
        ({"z_low": "low"}, "z_low must be a number, not 'low'"),
        ({"min_points": 3.5}, "min_points must be an integer"),
    ],
)
def test_settings_of_the_wrong_type(settings, message):
    with pytest.raises(TypeError, match=message):
        primfit.PaperSettings(**settings)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: primfit.Arena(primfit.Cloud(np.eye(3))), TypeError, "size must be a number or"),
        (lambda: primfit.paper_world(kinds=7), TypeError, "kinds must be a sequence of names"),
        (lambda: primfit.paper_world(kinds=np.arange(3)), TypeError, "kinds must be a sequence"),
        (lambda: primfit.paper_world(kinds=[]), ValueError, "kinds must be taken from"),
        (lambda: primfit.paper_world(2**63), ValueError, "n_solids must be a count"),
        (lambda: primfit.random_world(kinds=3), TypeError, "kinds must be a sequence of names"),
        (lambda: primfit.grid_path(EMPTY, 1e-300), ValueError, "spacing must leave at most"),
        (lambda: primfit.paper_path(EMPTY, 1e-9), ValueError, "spacing must leave at most"),
    ],
)
def test_mistakes_in_worlds_and_paths_are_named(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_settings_of_another_method_are_refused():
    scan = primfit.scan(EMPTY, (0.5, 0.5, 0.0), rng=1)
    with pytest.raises(TypeError, match="settings must be a LikelihoodSettings"):
        primfit.detect(scan, "likelihood", settings=primfit.PaperSettings())


EMPTY = primfit.World(arena=primfit.Arena(1.0))
