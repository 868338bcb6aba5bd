"""What every solid tells of itself, and worlds of round ones."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from small_maps import in_room, scanned

import primfit
from primfit.geometry.motions import Motion
from primfit.solids.round import Round

SOLIDS = [
    primfit.Prism.rectangle(0.4, 0.2, center=(0.3, 0.2), angle=0.4, height=0.3),
    primfit.Polyhedron.wedge(0.4, 0.2, 0.1, quat_xyzw=(0.3, 0.1, 0, 1)),
    primfit.Cylinder(0.2, 0.5, (0.3, 0.2)),
    primfit.Cylinder(0.2, 0.5, (0.3, 0.2, 0.5), axis=(1, 2, -0.5)),
    primfit.Cone(0.2, 0.5, (0.3, 0.2), axis=(0, 0.3, 1)),
    primfit.Cone(0.2, 0.5, top_radius=0.15, axis=(0, 0, -1)),
    primfit.Sphere(0.3, (1.0, 0.5)),
    primfit.Torus(0.3, 0.1, (1.0, 0.5), axis=(1, 0, 1)),
    primfit.Torus(0.3, 0.1),
]


def mesh_volume(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0


@pytest.mark.parametrize("solid", SOLIDS, ids=repr)
class TestContract:
    def test_files_keep_every_number(self, solid, tmp_path):
        world = primfit.World([solid], primfit.Arena())
        for name in ("world.json", "world.xml"):
            world.save(tmp_path / name)
            (again,) = primfit.World.load(tmp_path / name).solids
            assert type(again) is type(solid)
            assert again.to_dict() == solid.to_dict()
        assert primfit.Solid.from_dict(solid.to_dict()).to_dict() == solid.to_dict()

    def test_volume_and_centroid_are_those_of_the_mesh(self, solid):
        vertices, triangles = solid.to_mesh(512) if isinstance(solid, Round) else solid.to_mesh()
        assert mesh_volume(vertices, triangles) == pytest.approx(solid.volume, rel=2e-4)
        a, b, c = (vertices[triangles[:, k]] - solid.center for k in range(3))
        parts = np.einsum("ij,ij->i", a, np.cross(b, c))
        centroid = solid.center + parts @ (a + b + c) / (4.0 * parts.sum())
        np.testing.assert_allclose(centroid, solid.centroid, atol=1e-5)

    def test_the_mesh_is_closed_and_looks_outwards(self, solid):
        vertices, triangles = solid.to_mesh()
        again = primfit.Polyhedron(vertices, tuple(triangles))
        assert again.euler_characteristic == (0 if isinstance(solid, primfit.Torus) else 2)
        edges = np.sort(np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()

    def test_bounds_are_where_the_surface_ends(self, solid):
        vertices = solid.to_mesh(512)[0] if isinstance(solid, Round) else solid.vertices
        np.testing.assert_allclose(vertices.min(axis=0), solid.bounds[0], atol=2e-4)
        np.testing.assert_allclose(vertices.max(axis=0), solid.bounds[1], atol=2e-4)
        assert (vertices.min(axis=0) >= solid.bounds[0] - 1e-12).all()

    def test_contains_as_much_as_its_volume(self, solid):
        rng = np.random.default_rng(1)
        low, high = solid.bounds
        points = rng.uniform(low, high, (40_000, 3))
        inside = solid.contains(points)
        assert inside.mean() * np.prod(high - low) == pytest.approx(solid.volume, rel=0.03)
        assert solid.contains(solid.centroid[None])[0] != isinstance(solid, primfit.Torus)
        # The shadow is what some point of it is above.
        assert shapely.contains_xy(solid.shadow.buffer(1e-4), *points[inside][:, :2].T).all()
        area = rng.uniform(low[:2], high[:2], (300, 2))
        heights = np.linspace(low[2], high[2], 400)
        columns = np.column_stack([np.repeat(area, 400, axis=0), np.tile(heights, 300)])
        is_above = solid.contains(columns).reshape(300, 400).any(axis=1)
        is_shaded = shapely.contains_xy(solid.shadow, *area.T)
        assert (is_above != is_shaded).mean() < 0.02

    def test_surface_points_are_contained(self, solid):
        if not isinstance(solid, Round):
            pytest.skip("vertices of polyhedra are neither in nor out")
        vertices = solid.vertices
        assert solid.contains(vertices).all()
        beyond = vertices + 0.02 * (vertices - solid.center)
        if not isinstance(solid, primfit.Torus):
            assert not solid.contains(beyond).any()


def test_files_are_read_by_a_process_that_made_no_solid(tmp_path):
    world = primfit.World(SOLIDS)
    world.save(tmp_path / "world.json")
    code = f"import primfit; print(primfit.World.load({str(tmp_path / 'world.json')!r}))"
    read = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert read.stdout.strip() == repr(world)


def tilted(prism):
    """A prism of the same shape, leaning."""
    turn = Rotation.from_euler("xyz", [0.4, 0.2, 1.0]).as_quat()
    return primfit.Polyhedron.prism(prism.footprint, prism.height, quat_xyzw=turn)


@pytest.mark.parametrize(
    ("prism", "kind", "dimensions"),
    [
        (primfit.Prism.rectangle(0.3, 0.2, angle=0.3, height=0.5), "box", (0.5, 0.3, 0.2)),
        (primfit.Prism.regular(4, 0.2, angle=0.2, height=0.2), "cube", (0.2, 0.2, 0.2)),
        (primfit.Prism.regular(4, 0.3, height=0.2), "box", (0.3, 0.3, 0.2)),
        (primfit.Prism.regular(3, 0.2, height=0.3), "wedge", (0.2, 0.2 * np.sqrt(0.75), 0.3)),
        (primfit.Prism.regular(6, 0.2, height=0.3), "prism", (0.4, 0.2 * np.sqrt(3), 0.3)),
        (primfit.Prism.circle(0.2, height=0.3), "cylinder", (0.4, 0.4, 0.3)),
        (primfit.Prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 0.5), "prism", None),
    ],
)
def test_kind_and_dimensions_do_not_turn_on_the_tilt(prism, kind, dimensions):
    leaning, upright = tilted(prism), primfit.Polyhedron(prism.vertices, prism.faces)
    for solid in (prism, upright, leaning):
        assert solid.solid_kind == kind
        np.testing.assert_allclose(solid.dimensions, prism.dimensions, rtol=1e-9)
    if dimensions is not None:
        np.testing.assert_allclose(prism.dimensions, dimensions, rtol=1e-9)


def test_kind_and_dimensions_of_others():
    for make, kind, dimensions in (
        (lambda **how: primfit.Polyhedron.box(0.1, 0.3, 0.2, **how), "box", (0.3, 0.2, 0.1)),
        (lambda **how: primfit.Polyhedron.pyramid(4, 0.2, 0.5, **how), "pyramid", (0.2, 0.2, 0.5)),
        (lambda **how: primfit.Polyhedron.frustum(4, 0.2, 0.1, 0.5, **how), "frustum", None),
    ):
        level, leaning = make(), make(quat_xyzw=(0.2, 0.3, 0.1, 1))
        assert level.solid_kind == leaning.solid_kind == kind
        np.testing.assert_allclose(level.dimensions, dimensions or (0.2, 0.2, 0.5))
        np.testing.assert_allclose(leaning.dimensions, level.dimensions, rtol=1e-9)
    for axis in ((0, 0, 1), (1, 1, 0.1)):
        assert primfit.Cylinder(0.1, 0.5, axis=axis).solid_kind == "cylinder"
        assert primfit.Cylinder(0.1, 0.5, axis=axis).dimensions == (0.2, 0.2, 0.5)
        assert primfit.Torus(0.3, 0.1, axis=axis).dimensions == pytest.approx((0.8, 0.8, 0.2))


def test_an_upright_cylinder_is_a_circle_as_a_prism_is():
    cylinder = primfit.Cylinder(0.2, 0.5, (1, 1))
    circle = primfit.Prism.circle(0.2, center=(1, 1), height=0.5)
    assert (cylinder.kind, cylinder.size, cylinder.angle) == ("circle", 0.2, circle.angle)
    np.testing.assert_allclose(cylinder.footprint, circle.footprint)
    np.testing.assert_allclose(cylinder.center, circle.center)
    lying = primfit.Cylinder(0.2, 0.5, (1, 1), axis=(1, 0, 0))
    assert (lying.kind, lying.size, lying.footprint) == ("cylinder", (0.2, 0.5), None)
    np.testing.assert_allclose(lying.center, [1, 1, 0.2])
    np.testing.assert_allclose(lying.normals, [[-1, 0, 0], [1, 0, 0]])


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: primfit.Cylinder(0.0, 1.0), "radius must be greater than 0, not 0.0"),
        (lambda: primfit.Cylinder(0.1, -1.0), "height must be greater than 0, not -1.0"),
        (lambda: primfit.Cylinder(0.1, 1.0, axis=(0, 0, 0)), "axis must not be zero"),
        (lambda: primfit.Cylinder(0.1, 1.0, (1, 2, 3, 4)), r"center must have shape \(3,\) or"),
        (lambda: primfit.Cylinder(0.1, 1.0, (1, np.nan)), "center must be finite"),
        (lambda: primfit.Cone(0.1, 1.0, top_radius=0.1), r"top_radius must be less than radius"),
        (lambda: primfit.Cone(0.1, 1.0, top_radius=-0.1), "top_radius must be at least 0"),
        (lambda: primfit.Sphere(np.inf), "radius must be finite"),
        (lambda: primfit.Torus(0.1, 0.1), "radius must be less than major_radius"),
        (lambda: primfit.Sphere(0.1).to_mesh(2), "segments must be at least 3, not 2"),
        (lambda: primfit.Solid.from_dict({"type": "blob"}), "must be one of cone, cylinder, poly"),
    ],
)
def test_messages(make, told):
    with pytest.raises(ValueError, match=told):
        make()


def test_equal_solids_are_equal():
    assert primfit.Sphere(0.1) == primfit.Sphere(0.1) != primfit.Sphere(0.2)
    assert len({primfit.Cylinder(0.1, 1.0), primfit.Cylinder(0.1, 1.0)}) == 1
    assert primfit.Cylinder(0.1, 1.0) != primfit.Cone(0.1, 1.0)


def test_a_very_short_or_long_axis_is_one():
    for length in (1e-300, 1e300):
        solid = primfit.Cylinder(0.1, 1.0, axis=(0, length, length))
        np.testing.assert_allclose(solid.axis, [0, np.sqrt(0.5), np.sqrt(0.5)])


class TestWorlds:
    def test_random_ones(self):
        kinds = ("cylinder", "cone", "sphere")
        world = primfit.random_world((6, 6), 3.0, kinds, rng=5)
        assert {solid.solid_kind for solid in world.solids} == set(kinds)
        for solid in world.solids:
            low, high = solid.bounds
            assert low[2] == pytest.approx(0.0, abs=1e-12)
            assert (low[:2] > 0.1).all()
            assert (high[:2] < 2.9).all()
        upright = primfit.random_world((6, 6), 3.0, kinds, rng=5, tilted=False)
        assert all(solid.axis[2] == 1.0 for solid in upright.solids)
        assert any(abs(solid.axis[2]) < 0.9 for solid in world.solids)
        with pytest.raises(ValueError, match="not \\['torus'\\]"):
            primfit.random_world(kinds=["torus"])

    def test_mask_and_clearance(self):
        solid = primfit.Cylinder(0.3, 0.5, (1, 1))
        world = primfit.World([solid], primfit.Arena())
        assert world.mask.sum() * 1e-4 == pytest.approx(np.pi * 0.09, rel=0.01)
        path = primfit.grid_path(world, 0.02, headings=1, clearance=0.1, rng=1)
        distance = np.hypot(*(path[:, :2] - 1.0).T)
        assert 0.4 - 1e-4 <= distance.min() < 0.42
        ring = primfit.World([primfit.Torus(0.5, 0.1, (1, 1))], primfit.Arena())
        assert not ring.mask[100, 100]
        assert ring.mask[100, 150]

    def test_of_an_open_floor_and_bounds(self):
        world = primfit.World([primfit.Sphere(0.5, (3, 4))])
        np.testing.assert_allclose(world.bounds, [[2.5, 3.5], [3.5, 4.5]])

    def test_warnings_of_places(self):
        pipes = [primfit.Cylinder(0.1, 2.0, (1.2, 1.2, 0.5), axis=a) for a in np.eye(3)[:2]]
        world = primfit.World(pipes, primfit.Arena((2.4, 2.4)))
        with pytest.warns(UserWarning, match="reach into each other"):
            primfit.scan(world, (0.2, 0.2, 0.0), rng=1)
        with pytest.warns(UserWarning, match="reach beyond the arena"):
            primfit.scan(primfit.World([primfit.Sphere(0.3)], primfit.Arena()), (1, 1, 0.0), rng=1)

    def test_a_robot_is_not_within(self):
        world = primfit.World([primfit.Sphere(0.3, (1, 1))], primfit.Arena())
        with pytest.raises(ValueError, match="no valid pose"):
            primfit.scan(world, (1, 1, 0.0), rng=1)

    def test_pictures(self):
        mpl.use("Agg")
        solids = [solid for solid in SOLIDS if isinstance(solid, Round)]
        world = primfit.World(solids, primfit.Arena())
        assert len(world.plot().patches) == 1 + len(solids)
        assert world.matrix.shape == (200, 200, 3)

    def test_webots_and_back(self, tmp_path):
        solids = [
            primfit.Cylinder(0.2, 0.5, (0.5, 0.5)),
            primfit.Sphere(0.2, (1.5, 0.5)),
            primfit.Cylinder(0.1, 0.5, (0.5, 1.5), axis=(1, 2, 0.3)),
            primfit.Cone(0.2, 0.4, (1.5, 1.5)),
        ]
        world = primfit.World(solids, primfit.Arena())
        world.save(tmp_path / "world.wbt")
        cylinder, ball, pipe, cone = primfit.World.load(tmp_path / "world.wbt").solids
        assert (cylinder, ball) == tuple(solids[:2])
        np.testing.assert_allclose(pipe.row, solids[2].row, atol=1e-12)
        # Bodies cannot bound themselves by cones in Webots: a mesh of 64 sides is written.
        assert (cone.kind, len(cone.faces)) == ("pyramid", 65)


class TestEvaluation:
    def test_a_column_is_found_as_a_circle(self):
        world = in_room(primfit.Cylinder(0.12, 0.2, (0.5, 0.5)))
        report = primfit.evaluate(primfit.detect(scanned(world, 0.0, 1), rng=1), world)
        assert report.all_right
        (row,) = report.rows
        assert row.center_error_mm < 0.5
        assert row.size_error_mm < 1.0
        assert np.isnan(row.angle_error_deg)
        assert report.n_planes_true == 4

    def test_found_round_solids_and_prisms_against_true_ones(self):
        found = primfit.detect(
            scanned(in_room(primfit.Prism.regular(4, 0.2, center=(0.5, 0.5))), 0.0, 1), rng=1
        )
        axis = np.array([1.0, 0.0, 0.2])
        lying = primfit.Cylinder(0.1, 0.4, (0.5, 0.5), axis)
        turned = Rotation.from_euler("z", 0.01).apply(lying.axis)
        for truth, guess, angle, size in (
            (lying, replace_axis(lying, -turned), np.cos(np.arctan(0.2)) * 0.01, 0.0),
            (primfit.Cone(0.1, 0.4, (0.5, 0.5)), primfit.Cone(0.1, 0.41, (0.5, 0.5)), 0.0, 10.0),
            (primfit.Cone(0.1, 0.4, (0.5, 0.5)), primfit.Cone(0.1, 0.4, axis=(0, 0, -1)), np.pi, 0),
            (primfit.Sphere(0.2, (0.5, 0.5)), primfit.Sphere(0.21, (0.5, 0.5)), np.nan, 10.0),
            (primfit.Sphere(0.2), primfit.Polyhedron.box(0.3, 0.3, 0.3), np.nan, np.nan),
            (primfit.Cylinder(0.1, 0.4), primfit.Prism.regular(5, 0.1), np.nan, np.nan),
            (primfit.Prism.regular(5, 0.1), primfit.Cylinder(0.1, 0.4), np.nan, np.nan),
            (primfit.Polyhedron.box(0.3, 0.3, 0.3), primfit.Sphere(0.2), np.nan, np.nan),
        ):
            detection = replace(found, solids=(guess,))
            (row,) = primfit.evaluate(detection, in_room(truth), max_distance=1.0).rows
            assert row.found == guess.kind
            np.testing.assert_allclose(np.radians(row.angle_error_deg), angle, atol=1e-5)
            np.testing.assert_allclose(row.size_error_mm, size, atol=1e-9)
        # A map that lies turned and moved is laid back, and its round solids with it.
        motion = Motion(0.1, np.array([0.02, -0.01]))
        place, end = motion.of(lying.center[:2] + np.array([[0.0, 0.0], lying.axis[:2]]))
        moved = lying.placed([*place, lying.center[2]], [*(end - place), lying.axis[2]])
        arena = replace(found.arena, footprint=motion.of(in_room(lying).arena.outline))
        detection = replace(found, solids=(moved,), arena=arena)
        (row,) = primfit.evaluate(detection, in_room(lying), frame="arena").rows
        assert row.center_error_mm < 1e-6
        assert row.angle_error_deg < 1e-5


def replace_axis(solid, axis):
    return primfit.Solid.from_dict(solid.to_dict() | {"axis": axis})
