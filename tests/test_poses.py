"""Poses that are not exact: what scans believe, and what detection makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import primfit
from primfit.geometry.motions import Motion, turned, wrapped
from primfit.likelihood.bundle import Problem
from primfit.likelihood.environment import initial_scene
from primfit.likelihood.fitting import Fit, Top
from primfit.likelihood.footprint_models import RECTANGLE, SQUARE
from primfit.likelihood.hypotheses import Candidate, Hypothesis, Region
from primfit.likelihood.pose_graph import Blocks, PoseGraph
from primfit.likelihood.settings import LikelihoodSettings
from primfit.likelihood.tracks import Track

POSE = (0.005, np.radians(0.5))
STEP = (0.002, np.radians(0.2))


@pytest.fixture(scope="module")
def path(small_world):
    return primfit.grid_path(small_world, 0.25, rng=3)


@pytest.fixture(scope="module")
def lidar():
    return primfit.Lidar(noise=0.005)


@pytest.fixture(scope="module")
def mistaken(small_world, path, lidar):
    return primfit.scan(small_world, path, lidar, rng=3, pose_noise=POSE)


@pytest.fixture(scope="module")
def joint(mistaken):
    return primfit.detect(mistaken, rng=3, pose_sigma=POSE)


def test_beams_are_cast_from_where_the_robot_is(small_world, path, lidar, mistaken):
    exact = primfit.scan(small_world, path, lidar, rng=3)
    np.testing.assert_array_equal(exact.path, path)
    np.testing.assert_array_equal(exact.true_path, path)
    np.testing.assert_array_equal(mistaken.true_path, path)
    np.testing.assert_array_equal(mistaken.ranges, exact.ranges)
    errors = (mistaken.path - path) / [*POSE[:1] * 2, POSE[1]]
    assert 0.7 < errors.std() < 1.3
    # The same beams, seen from where it believes to be.
    of = mistaken.pose_index
    for scan, poses in ((exact, exact.path), (mistaken, mistaken.path)):
        local = turned(scan.directions[:, :2], -poses[of, 2])
        np.testing.assert_allclose(local[:800], turned(exact.directions[:800, :2], -path[0, 2]))
        np.testing.assert_allclose(scan.origins[:, :2], poses[of, :2], atol=1e-12)
        ends = scan.origins + scan.ranges[:, None] * scan.directions
        np.testing.assert_allclose(scan.points[scan.is_return], ends[scan.is_return])


def test_steps_add_up(small_world, path, lidar):
    scan = primfit.scan(small_world, path, lidar, rng=3, step_noise=STEP)
    used = np.unique(scan.pose_index)
    np.testing.assert_array_equal(scan.path[used[0]], path[used[0]])
    off = np.linalg.norm((scan.path - path)[:, :2], axis=1)
    assert off[-len(off) // 4 :].mean() > 2.0 * off[: len(off) // 4].mean()


def test_poses_inside_solids_go_along():
    world = primfit.World([primfit.Prism.regular(4, 0.3, center=(0.5, 0.5))], primfit.Arena((1, 1)))
    path = np.array([[0.2, 0.2, 0.0], [0.5, 0.5, 0.0], [0.8, 0.8, 0.0]])
    with pytest.warns(UserWarning, match="left out"):
        scan = primfit.scan(world, path, rng=1, step_noise=(0.01, 0.01))
    assert np.unique(scan.pose_index).tolist() == [0, 2]
    np.testing.assert_array_equal(scan.path[:2], path[:2])
    assert np.linalg.norm(scan.path[2] - path[2]) > 1e-3


def test_what_a_noisy_path_may_not_be(small_world, path):
    with pytest.raises(ValueError, match="exclude each other"):
        primfit.scan(small_world, path, pose_noise=POSE, step_noise=STEP)
    with pytest.raises(ValueError, match="planar path"):
        primfit.scan(small_world, np.eye(4) + 0.0, pose_noise=POSE)
    with pytest.raises(ValueError, match="at least 0"):
        primfit.scan(small_world, path, pose_noise=(-0.1, 0.0))
    with pytest.raises(ValueError, match="position, heading"):
        primfit.scan(small_world, path, step_noise=0.1)


def test_scans_keep_their_paths(tmp_path, mistaken):
    mistaken.save(tmp_path / "scan.npz")
    again = primfit.Scan.load(tmp_path / "scan.npz")
    np.testing.assert_array_equal(again.path, mistaken.path)
    np.testing.assert_array_equal(again.true_path, mistaken.true_path)
    np.testing.assert_array_equal(mistaken.select(np.arange(5)).path, mistaken.path)
    moved = mistaken.moved(np.array([1.0, -2.0, 0.5]))
    np.testing.assert_allclose(moved.path, mistaken.path + np.array([1.0, -2.0, 0.0]))


def test_recorded_beams_with_a_path():
    ways, ranges = [[1, 0, 0], [0, 1, 0]], [1.0, 2.0]
    path = [[0, 0, 0.0], [1, 0, 0.1]]
    told = {"pose_index": [0, 1], "path": path}
    scan = primfit.Scan.from_rays([[0, 0, 0], [1, 0, 0]], ways, ranges, **told)
    np.testing.assert_array_equal(scan.path, path)
    with pytest.raises(ValueError, match="path needs pose_index"):
        primfit.Scan.from_rays((0, 0, 0), ways, ranges, path=path)
    with pytest.raises(ValueError, match="rows of path"):
        primfit.Scan.from_rays((0, 0, 0), ways, ranges, path=path, pose_index=[0, 2])


@pytest.mark.parametrize("is_chain", [False, True])
def test_blocks_are_a_matrix(is_chain):
    rng = np.random.default_rng(2)
    p = 7
    root = rng.normal(size=(3 * p, 3 * p))
    for i in range(p):
        for j in range(p):
            if abs(i - j) > is_chain:
                root[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = 0.0
    dense = (root + root.T) / 2 + 20.0 * np.eye(3 * p)
    cells = dense.reshape(p, 3, p, 3).transpose(0, 2, 1, 3)
    each = np.arange(p)
    below = cells[each[1:], each[:-1]] if is_chain else None
    blocks = Blocks(cells[each, each], below)
    right = rng.normal(size=(p, 3, 4))
    expected = np.linalg.solve(dense, right.reshape(3 * p, 4)).reshape(p, 3, 4)
    np.testing.assert_allclose(blocks.solve(right), expected, atol=1e-12)
    inverse = np.linalg.inv(dense).reshape(p, 3, p, 3).transpose(0, 2, 1, 3)
    np.testing.assert_allclose(blocks.inverse_diagonal(), inverse[each, each], atol=1e-12)


@pytest.mark.parametrize("is_chain", [False, True])
def test_the_slopes_of_a_prior_are_those_of_its_cost(is_chain):
    rng = np.random.default_rng(1)
    believed = rng.normal(size=(5, 3))
    graph = PoseGraph(believed, np.full((5 - is_chain, 3), 0.1), is_chain)
    poses = believed + 0.05 * rng.normal(size=(5, 3))
    poses[0] = believed[0]
    assert graph.costs(believed).sum() == pytest.approx(0.0, abs=1e-20)
    _, descent = graph.normal(poses)
    for i in range(1, 5):
        for k in range(3):
            step = np.zeros((5, 3))
            step[i, k] = 1e-6
            slope = (graph.costs(poses + step) - graph.costs(poses - step)).sum() / 2e-6
            assert slope == pytest.approx(-descent[i, k], rel=1e-5, abs=1e-5)


def test_drift_grows_along_a_chain():
    believed = np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])
    graph = PoseGraph(believed, np.full((8, 3), 0.01), True)
    expected = [k * 1e-4 + 1e-4 * sum((k - j) ** 2 for j in range(1, k + 1)) for k in range(9)]
    np.testing.assert_allclose(graph.covariances[:, 1, 1], expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(graph.covariances[:, 2, 2], 1e-4 * np.arange(9), atol=1e-12)


@pytest.fixture(scope="module")
def problem(mistaken, small_world):
    """Poses, room and solid near the truth, without a cost for what beams hit."""
    track = Track.of(mistaken, POSE, None)
    scene, _ = initial_scene(mistaken, np.float64(0.005), LikelihoodSettings(), None)
    solid, top = small_world.solids[0], Top(0.2, 0.01)
    region = Region.of_polygon(shapely.Polygon(solid.footprint), 0.2, 0.01, is_cut=False)
    parameters = np.array([*solid.center[:2], solid.angle, solid.size + 0.001])
    fit = Fit(SQUARE, parameters, np.eye(4), 0.0)
    room = Fit(RECTANGLE, np.array([0.5, 0.5, 0.001, 1.001, 1.0]), np.eye(5), 0.0)
    scene = replace(
        scene,
        # Far below: the floor would tell a bias, which is left to the walls.
        floor_z=-10.0,
        room=Candidate.unsampled(room, Top(0.3, 0.01)),
        solids=(Hypothesis(region, (Candidate.unsampled(fit, top),)),),
    )
    return Problem(track, scene, free=(0, 1, 2, 3))


def test_the_normal_equations_are_those_of_the_cost(problem):
    # So short a step that hardly a beam changes what it meets.
    robust = (0.0, 2.0, 12.0)
    here = problem.normal(robust)
    d = len(here.downhill)
    for k in range(d):
        step = np.zeros(d)
        step[k] = 1e-7
        still = np.zeros_like(problem.track.poses)
        costs = [problem.stepped(sign * step, still).normal(robust).cost for sign in (1, -1)]
        slope = (costs[0] - costs[1]) / 2e-7
        assert slope == pytest.approx(-here.downhill[k], rel=0.02, abs=2.0), k


def test_eliminated_poses_leave_what_the_whole_system_says(problem):
    here = problem.normal((0.05, np.inf, 4.0))
    p, _, d = here.cross.shape
    whole = np.zeros((3 * p + d, 3 * p + d))
    for i in range(p):
        whole[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = here.poses.diagonal[i]
    whole[: 3 * p, 3 * p :] = here.cross.reshape(3 * p, d)
    whole[3 * p :, : 3 * p] = whole[: 3 * p, 3 * p :].T
    whole[3 * p :, 3 * p :] = here.information
    inverse = np.linalg.inv(whole)
    of_map, of_poses = here.covariances()
    np.testing.assert_allclose(of_map, inverse[3 * p :, 3 * p :], rtol=1e-5, atol=1e-12)
    for i in range(p):
        block = inverse[3 * i : 3 * i + 3, 3 * i : 3 * i + 3]
        np.testing.assert_allclose(of_poses[i], block, rtol=1e-5, atol=1e-12)
    step, pose_step = here.steps(np.zeros(p), 0.0)
    right = np.concatenate([here.pull.ravel(), here.downhill])
    expected = inverse @ right
    np.testing.assert_allclose(np.append(pose_step.ravel(), step), expected, rtol=1e-4, atol=1e-9)


def test_poses_and_map_as_a_whole_lie_where_the_poses_are_believed_to_be(problem):
    motion = Motion(0.02, np.array([0.03, -0.01]))
    poses = problem.track.poses
    moved = np.column_stack([motion.of(poses[:, :2]), poses[:, 2] + motion.turn])
    fits = [
        replace(fit, parameters=fit.shape.moved(fit.parameters, motion)) for fit in problem.fits
    ]
    solid = problem.scene.solids[0]
    solid = replace(solid, candidates=(replace(solid.best, fit=fits[0], best=fits[0].parameters),))
    room = replace(problem.scene.room, fit=fits[1], best=fits[1].parameters)
    there = problem.at(replace(problem.scene, solids=(solid,), room=room), moved, np.zeros(4))
    robust = (0.0, np.inf, 4.0)
    costs = there.normal(robust).beam_costs
    np.testing.assert_allclose(costs, problem.normal(robust).beam_costs, rtol=1e-6, atol=1e-6)
    # A turn of 0.02 is not so small that one step is all.
    back = there.anchored().anchored()
    np.testing.assert_allclose(back.track.poses, poses, atol=1e-6)
    for fit, expected in zip(back.fits, problem.fits, strict=True):
        np.testing.assert_allclose(fit.footprint, expected.footprint, atol=1e-6)


def test_the_first_pose_holds_a_chain(problem):
    track = problem.track
    graph = PoseGraph(track.poses, np.full((len(track.poses) - 1, 3), 0.01), True)
    motion = graph.motion(track.poses + 0.1)
    assert motion.turn == 0.0
    assert not motion.move.any()


def test_poses_and_solid_are_found_together(small_world, mistaken, joint):
    (solid,) = joint.solids
    assert solid.kind == "square"
    report = primfit.evaluate(joint, small_world, frame="arena")
    assert report.all_right
    assert report.rows[0].center_error_mm < 1.0
    assert joint.path.shape == mistaken.path.shape
    off = [
        np.linalg.norm((p - mistaken.true_path)[:, :2], axis=1) for p in (mistaken.path, joint.path)
    ]
    assert np.median(off[1]) < 0.5 * np.median(off[0])
    error = joint.path - mistaken.true_path
    error[:, 2] = wrapped(error[:, 2])
    squares = np.einsum("pi,pij,pj->p", error, np.linalg.inv(joint.path_covariance), error)
    assert (squares < 7.815).mean() > 0.8
    # The scan is as it was found to be: its beams begin where the path says.
    places = joint.path[mistaken.pose_index]
    np.testing.assert_allclose(joint.scan.origins[:, :2], places[:, :2], atol=1e-9)
    np.testing.assert_array_equal(joint.scan.path, joint.path)
    assert len(joint.lost_poses) < 0.1 * len(joint.path)
    assert joint.calibration == {}


def test_the_same_without_a_path_and_in_any_order(small_world, mistaken, joint):
    # Poses follow from where the beams begin, and which were taken from one of them.
    order = np.random.default_rng(1).permutation(len(mistaken))
    scan = replace(mistaken.select(order), path=None, true_path=None)
    found = primfit.detect(scan, rng=3, pose_sigma=POSE)
    assert found.path.shape == (len(np.unique(mistaken.pose_index)), 3)
    np.testing.assert_allclose(found.solids[0].center, joint.solids[0].center, atol=5e-4)


def test_steps_hold_the_map_where_the_first_pose_is(small_world, path, lidar):
    scan = primfit.scan(small_world, path, lidar, rng=4, step_noise=STEP)
    found = primfit.detect(scan, rng=3, step_sigma=STEP)
    report = primfit.evaluate(found, small_world, frame="arena")
    assert report.all_right
    assert report.rows[0].center_error_mm < 1.5
    np.testing.assert_allclose(found.path[0], path[0], atol=1e-6)
    assert found.path_covariance[0].max() < 1e-12


def test_bias_and_mount_are_told_by_the_scene(small_world, path, lidar):
    true = primfit.scan(small_world, path, lidar, rng=5, pose_noise=POSE)
    yaw = true.path[true.pose_index, 2]
    origins = true.origins.copy()
    # The scan believes the sensor 20 mm farther back and 10 mm farther left than it is.
    origins[:, :2] -= turned(np.tile([0.02, -0.01], (len(true), 1)), yaw)
    scan = primfit.Scan.from_rays(
        origins, true.directions, true.ranges + 0.03, sigma=0.005, max_range=lidar.max_range,
        min_range=lidar.min_range, pose_index=true.pose_index, path=true.path,
    )  # fmt: skip
    found = primfit.detect(scan, rng=3, pose_sigma=POSE, estimate=("bias", "mount"))
    assert primfit.evaluate(found, small_world, frame="arena").all_right
    told = found.calibration
    for name, value in {"bias": 0.03, "mount_x": 0.02, "mount_y": -0.01}.items():
        assert abs(told[name] - value) < 3.0 * told[f"{name}_sigma"]
        assert told[f"{name}_sigma"] < 0.003


@pytest.mark.parametrize("sigma", [None, 0.01])
def test_noise_by_incidence_tells_the_divergence_of_the_beams(sigma):
    world = primfit.random_world(3, 2.0, rng=1)
    path = primfit.grid_path(world, 0.5, headings=4, rng=1)
    lidar = primfit.Lidar(noise=0.01 / 3, max_range=3.0, beam_divergence=0.02)
    scan = replace(primfit.scan(world, path, lidar, rng=1, pose_noise=POSE), sigma=sigma)
    found = primfit.detect(scan, rng=1, pose_sigma=POSE, estimate="incidence")
    assert primfit.evaluate(found, world, frame="arena").all_right
    told = found.calibration
    assert abs(told["divergence"] - 0.02) < 3.5 * told["divergence_sigma"]
    assert told["divergence_sigma"] < 0.001


def test_beams_like_lines_have_no_divergence(small_world, mistaken):
    told = primfit.detect(mistaken, rng=3, pose_sigma=POSE, estimate="incidence").calibration
    assert told["divergence"] < 3.0 * told["divergence_sigma"] < 0.05


def test_a_pose_that_fits_nothing_is_named(small_world, mistaken):
    lost = 7
    own = mistaken.pose_index == lost
    ranges = np.where(own & mistaken.is_return, 0.35, mistaken.ranges)
    with pytest.warns(UserWarning, match=f"poses {lost}"):
        found = primfit.detect(replace(mistaken, ranges=ranges), rng=3, pose_sigma=POSE)
    assert lost in found.lost_poses
    assert primfit.evaluate(found, small_world, frame="arena").all_right


def test_exact_poses_are_as_before(small_scan):
    told = primfit.detect(small_scan, rng=1, pose_sigma=None, step_sigma=None)
    assert told.to_json() == primfit.detect(small_scan, rng=1).to_json()
    assert told.path is None
    assert told.path_covariance is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pose_sigma": POSE, "step_sigma": STEP}, "exclude each other"),
        ({"estimate": ("bias",)}, "needs pose_sigma"),
        ({"pose_sigma": POSE, "estimate": ("scale",)}, "estimate"),
        ({"pose_sigma": 0.1}, "position, heading"),
        ({"pose_sigma": (-1.0, 0.0)}, "at least 0"),
        ({"pose_sigma": np.zeros((3, 3))}, "for each pose"),
    ],
)
def test_what_cannot_be_told_of_poses(small_scan, options, message):
    with pytest.raises(ValueError, match=message):
        primfit.detect(small_scan, "likelihood", rng=1, **options)


def test_beams_of_no_pose_are_refused(small_scan):
    rng = np.random.default_rng(1)
    origins = small_scan.origins + 1e-6 * rng.normal(size=small_scan.origins.shape)
    scan = replace(small_scan, origins=origins, pose_index=None, path=None)
    with pytest.raises(ValueError, match="pose_index"):
        primfit.detect(scan, "likelihood", rng=1, pose_sigma=POSE)


def test_motions_lay_places_on_others():
    rng = np.random.default_rng(4)
    places = rng.normal(size=(6, 2))
    motion = Motion(0.7, np.array([1.0, -2.0]))
    again = Motion.laying(places, motion.of(places))
    assert again.turn == pytest.approx(0.7)
    np.testing.assert_allclose(again.move, motion.move)


@pytest.mark.parametrize("with_arena", [True, False])
def test_a_moved_map_is_right_in_the_frame_of_its_arena(world, found, with_arena):
    motion = Motion(np.radians(4.0), np.array([0.05, -0.03]))
    solids = tuple(each.laid(motion) for each in found.solids)
    arena = replace(found.arena, footprint=motion.of(found.arena.footprint))
    moved = replace(found, solids=solids, arena=arena if with_arena else None)
    before = primfit.evaluate(found, world, frame="arena")
    after = primfit.evaluate(moved, world, frame="arena")
    for a, b in zip(before.rows, after.rows, strict=True):
        assert a.found == b.found
        assert a.center_error_mm == pytest.approx(
            b.center_error_mm, abs=1e-3 if with_arena else 1.0
        )
        assert a.angle_error_deg == pytest.approx(
            b.angle_error_deg, abs=1e-3 if with_arena else 0.5
        )
    assert max(row.center_error_mm for row in primfit.evaluate(moved, world).rows) > 30.0
    with pytest.raises(ValueError, match="frame"):
        primfit.evaluate(found, world, frame="robot")


def test_the_robot_of_the_documentation():
    page = (Path(__file__).parent.parent / "docs" / "poses.md").read_text()
    (code,) = (block for block in page.split("```python\n") if block.startswith("import numpy"))
    names = {}
    exec(code.partition("```")[0], names)
    assert names["report"].all_right
    true, believed, found = names["true"], names["path"], names["found"].path
    assert np.linalg.norm((believed - true)[:, :2], axis=1).max() > 0.05
    assert np.linalg.norm((found - true)[:, :2], axis=1).max() < 0.003
