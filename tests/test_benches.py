"""What the benches of scenes make, judge and change."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import primfit
from primfit import _primfit
from primfit.planes.surfaces import flat_parts

# At the end: some benches are called as libraries are.
sys.path.append(str(Path(__file__).parents[1] / "benches"))
from judging import judge, tells_of_motion
from plane_settings import held_out
from scenes import SCENES, moved, one_sided, reference, room
from settings_tree import changed, name_of, numbers, scaled


def as_found(scene, *, leave_out=(), shift=0.0, sigma=0.001, room=True, **more):
    """What a detection would be that finds the world of a scene, but for what is said."""
    solids = [
        SimpleNamespace(
            kind=solid.kind,
            footprint=solid.footprint + np.array([shift, 0.0]),
            center=solid.center + np.array([shift, 0.0, 0.0]),
            covariance=sigma**2 * np.eye(3),
            **more,
        )
        for i, solid in enumerate(scene.world.solids)
        if i not in leave_out
    ]
    arena = SimpleNamespace(footprint=np.asarray(scene.world.arena.outline))
    return SimpleNamespace(solids=solids, arena=arena if room else None)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_are_the_same_by_seed(name):
    a, b = SCENES[name](5), SCENES[name](5)
    np.testing.assert_array_equal(a.scan.ranges, b.scan.ranges)
    assert len(a.world.solids) >= 1
    assert a.scan.min_range is not None
    assert a.scan.solid_index.max() >= 0
    assert not np.array_equal(a.scan.ranges[:1000], SCENES[name](6).scan.ranges[:1000])


def test_reach_changes_nothing_else_in_a_room():
    near, far = room(3, max_range=20.0), room(3)
    np.testing.assert_allclose(near.world.bounds, far.world.bounds)
    np.testing.assert_array_equal(near.scan.origins, far.scan.origins)
    np.testing.assert_allclose(near.scan.ranges, far.scan.ranges, atol=1e-9)


def test_a_moved_scene_is_two_scans_and_knows_it():
    scene, twin = moved(1), moved(1, static=True)
    poses = scene.scan.pose_index
    assert (np.diff(poses) >= 0).all()
    assert len(np.unique(poses)) == poses[-1] + 1
    assert scene.facts["change"] == "moves"
    assert scene.facts["contradictions"] > 1000
    assert twin.facts["contradictions"] == 0
    assert len(twin.world.solids) == len(scene.world.solids) + 1
    half = len(poses) // 3
    np.testing.assert_array_equal(scene.scan.origins[:half], twin.scan.origins[:half])


def test_the_truth_is_right():
    scene = reference(1)
    verdict = judge(scene, as_found(scene))
    assert verdict.counting == verdict.found == verdict.kind == verdict.n_solids
    assert verdict.reported == verdict.seen == verdict.n_solids
    assert (verdict.spurious, verdict.room, verdict.warned) == (0, "right", False)
    assert max(verdict.sigmas) == 0.0


def test_what_is_wrong_is_seen():
    scene = reference(1)
    found = as_found(scene, leave_out=[0], room=False)
    found.solids[0].kind = "octagon"
    lost = SimpleNamespace(**vars(found.solids[0]) | {"center": np.array([9.0, 9.0, 0.1])})
    found.solids.append(lost)
    verdict = judge(scene, found)
    assert verdict.found == verdict.n_solids - 1
    assert verdict.kind == verdict.n_solids - 2
    assert verdict.spurious == 1
    assert verdict.room == "MISSED"
    assert verdict.wrong_kinds == ((scene.world.solids[1].kind, "octagon"),)


def test_errors_in_sigmas_with_and_without_the_tolerance():
    scene = reference(1)
    verdict = judge(scene, as_found(scene, shift=0.004, sigma=0.001, tolerance_sigma=0.003))
    np.testing.assert_allclose(verdict.sigmas, 4.0, rtol=1e-6)
    np.testing.assert_allclose(verdict.tolerant_sigmas, 4.0 / np.sqrt(10.0), rtol=1e-6)
    np.testing.assert_allclose(verdict.centers_mm, 4.0, rtol=1e-6)


def test_far_but_wide_is_unsure():
    scene = reference(1)
    verdict = judge(scene, as_found(scene, shift=0.06, sigma=0.05))
    assert verdict.found == 0
    assert verdict.unsure == verdict.counting
    assert verdict.spurious == 0


def test_solids_seen_from_one_side_may_not_count():
    counting = [judge(scene, as_found(scene)).counting for scene in map(one_sided, range(4))]
    solids = [len(one_sided(seed).world.solids) for seed in range(4)]
    assert sum(counting) < sum(solids)


def test_a_wall_that_nobody_saw_makes_a_room_right_in_part():
    scene = next(
        scene
        for scene in map(one_sided, range(20))
        if scene.facts["reach"] < scene.world.arena.size[1] - 0.6
    )
    found = as_found(scene)
    found.arena.footprint = found.arena.footprint * [1, 1.5]
    assert judge(scene, found).room == "in part"
    found.arena.footprint = found.arena.footprint * [1.5, 1]
    assert judge(scene, found).room == "WRONG"


def test_no_room_is_not_invented():
    scene = reference(1)
    bare = scene._replace(world=primfit.World(scene.world.solids))
    assert judge(bare, as_found(scene)).room == "INVENTED"
    assert judge(bare, as_found(scene, room=False)).room == "-"


@pytest.mark.parametrize(
    ("text", "is_so"),
    [
        ("the solid at (1, 2) moved, came or went", True),
        ("beams contradict each other", True),
        ("number_of_layers=8 is outside the domain that Webots documents", False),
        ("remove points that are removed", False),
    ],
)
def test_warnings_of_motion(text, is_so):
    assert tells_of_motion(text) is is_so


def test_a_warned_scene():
    scene = moved(1)
    found = as_found(scene)
    told = judge(scene, found, [("UserWarning", "solid 2 moved")])
    assert (told.warned, told.should_warn) == (True, True)
    assert judge(moved(1, static=True), found).should_warn is False
    # What is found where the solid was or is, is no other solid.
    there = SimpleNamespace(**vars(found.solids[0]))
    there.center = scene.facts["changed"][0].center
    found.solids.append(there)
    assert judge(scene, found).spurious == 0


@dataclass(frozen=True)
class Inner:
    share: float = 0.5
    rounds: int = 1
    steps: tuple[float, ...] = (1.0, 2.0)


@dataclass(frozen=True)
class Outer:
    name: str = "a"
    is_on: bool = True
    unset: float | None = None
    inner: Inner = field(default_factory=Inner)
    several: tuple[Inner, ...] = (Inner(), Inner(share=0.1))


def test_numbers_of_nested_settings():
    names = {name_of(path): value for path, value in numbers(Outer())}
    assert names["inner.steps"] == (1.0, 2.0)
    assert names["several[1].share"] == 0.1
    assert len(names) == 9


def test_settings_with_one_number_changed():
    for path, value in numbers(Outer()):
        other = changed(Outer(), path, scaled(value, 2.0))
        differing = [
            each
            for each, usual in zip(numbers(other), numbers(Outer()), strict=True)
            if each != usual
        ]
        assert differing == [(path, scaled(value, 2.0))]


def test_whole_numbers_stay_whole():
    assert [scaled(value, 0.5) for value in (1, 3, 7, 0)] == [1, 2, 4, 0]
    assert scaled((2, 5.0), 0.5) == (1, 2.5)
    assert isinstance(scaled(3, 2.0), int)


def test_held_out_groups_are_judged_by_what_is_best_on_the_others():
    usual, halved, doubled = [0.5, 0.5, 0.5], [0.5, 0.5, 0.8], [0.6, 0.6, 0.1]
    best, gains = held_out(np.array([usual, halved, doubled]), [0.5, 2.0])
    assert best == [0.5, 0.5, 2.0]
    np.testing.assert_allclose(gains, [0.0, 0.0, -0.4])


def test_settings_of_the_search_change_by_name():
    names = [name for name, _ in _primfit.segmentation_settings()]
    assert len(set(names)) == len(names) > 60
    rng = np.random.default_rng(7)
    points = rng.uniform(size=(2000, 3)) * [1, 1, 0] + rng.normal(scale=0.002, size=(2000, 3))
    assert (flat_parts(points).labels == 0).mean() > 0.95
    assert (flat_parts(points, factors=[("acceptance.evidence", 1e6)]).labels == -1).all()
    with pytest.raises(ValueError, match="growth"):
        flat_parts(points, factors=[("growth.none", 2.0)])
