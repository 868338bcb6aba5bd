"""What worlds, scans, pictures and reports make of polyhedra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from polyhedra import ELL, SHAPES, turned
from scipy.spatial.transform import Rotation

import primfit
from primfit import Polyhedron, plotting
from primfit.worlds.random_polyhedra import POLYHEDRA


class TestWorlds:
    def tilted_world(self):
        solids = [
            Polyhedron.box(0.3, 0.2, 0.1, quat_xyzw=(0.3, 0.1, 0.2, 1)).moved((0.5, 0.5, 0)),
            Polyhedron.prism(np.divide(ELL, 6), 0.1, quat_xyzw=(0.6, 0, 0, 1)).moved((1.4, 0.6, 0)),
            primfit.Prism.regular(3, 0.3, center=(1.0, 1.4)),
        ]
        return primfit.World(solids, primfit.Arena())

    def test_mesh_mask_and_bounds(self):
        world = self.tilted_world()
        vertices, triangles, index = world.to_mesh()
        for i, solid in enumerate(world.solids):
            corners = vertices[triangles[index == i]]
            volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
            expected = solid.volume if isinstance(solid, Polyhedron) else 0.2 * solid.shadow.area
            assert volume == pytest.approx(expected)
        covered = world.mask.sum() * 1e-4
        assert covered == pytest.approx(sum(solid.shadow.area for solid in world.solids), rel=0.03)
        low, high = primfit.World(world.solids[:1]).bounds
        np.testing.assert_array_equal(low, world.solids[0].vertices[:, :2].min(axis=0))
        np.testing.assert_array_equal(high, world.solids[0].vertices[:, :2].max(axis=0))

    def test_files_keep_every_digit(self, tmp_path):
        world = self.tilted_world()
        world.save(tmp_path / "world.json")
        again = primfit.World.load(tmp_path / "world.json")
        assert repr(again) == repr(world)
        for solid, other in zip(world.solids, again.solids, strict=True):
            np.testing.assert_array_equal(solid.vertices, other.vertices)
            for face, other_face in zip(solid.faces, other.faces, strict=True):
                np.testing.assert_array_equal(face, other_face)

    def test_scans(self):
        world = self.tilted_world()
        path = primfit.grid_path(world, rng=1)
        scan = primfit.scan(world, path, rng=1)
        for i, solid in enumerate(world.solids[:2]):
            points = scan.points[(scan.solid_index == i) & scan.is_return]
            assert len(points) > 500
            # Every return is on a face, and none is inside.
            over = (points[:, None] - [solid.vertices[face[0]] for face in solid.faces]) @ (
                solid.normals.T
            )[None]
            distance = np.abs(np.einsum("pff->pf", over)).min(axis=1)
            assert distance.max() < 1e-9

    def test_poses_inside_are_passed_over(self):
        world = self.tilted_world()
        box = world.solids[0]
        inside, outside = np.eye(4), np.eye(4)
        inside[:3, 3] = box.center
        outside[:3, 3] = [1.0, 1.0, 0.1]
        with pytest.warns(UserWarning, match="path has 1 of 2 poses inside a solid"):
            scan = primfit.scan(world, np.stack([inside, outside]), rng=1)
        assert set(scan.pose_index) == {1}
        # Above it, within its height and shadow but not in it, a pose is valid.
        corner = box.vertices[box.vertices[:, 2].argmax()] - [0, 0, 0.001]
        above = np.eye(4)
        above[:3, 3] = [*(2 * box.center - corner)[:2], corner[2]]
        assert box.shadow.contains(shapely.Point(above[:2, 3]))
        assert set(primfit.scan(world, above, rng=1).pose_index) == {0}

    def test_pictures(self):
        figure = plotting.new_figure(4, 4)
        ax = self.tilted_world().plot(ax=figure.add_subplot())
        assert {text.get_text() for text in ax.texts} == {"box", "prism", "triangle"}
        # The arena, three faces of the box that look up, four of the L-block, the triangle.
        assert len(ax.patches) >= 6

    @pytest.mark.parametrize("tilted", [True, False])
    def test_random_worlds(self, tilted):
        names = set()
        twin = primfit.random_world((4, 6), kinds=list(POLYHEDRA), tilted=tilted, rng=0)
        for seed in range(10):
            world = primfit.random_world((4, 6), kinds=list(POLYHEDRA), tilted=tilted, rng=seed)
            for i, solid in enumerate(world.solids):
                if seed == 0:
                    np.testing.assert_array_equal(solid.vertices, twin.solids[i].vertices)
                names.add(solid.kind)
                z = solid.vertices[:, 2]
                assert z.min() == pytest.approx(0.0, abs=1e-12)
                assert (z < 1e-9).sum() == 1 if tilted else (z < 1e-9).sum() >= 3
                low, high = solid.vertices[:, :2].min(axis=0), solid.vertices[:, :2].max(axis=0)
                assert (low >= 0.12).all()
                assert (high <= 1.88).all()
                assert not any(solid.shadow.intersects(other.shadow) for other in world.solids[:i])
                if not tilted:
                    floor = shapely.MultiPoint(solid.vertices[z < 1e-9, :2]).convex_hull
                    assert floor.contains(shapely.Point(solid.centroid[:2]))
        if tilted:
            assert names == set(POLYHEDRA)
        else:
            assert {"square", "rectangle", "wedge", "pyramid", "frustum"} <= names

    def test_random_kinds_mix(self):
        world = primfit.random_world(6, kinds=("box", "triangle"), rng=3)
        assert {solid.kind for solid in world.solids} == {"box", "triangle"}
        small = primfit.random_world(3, kinds=("cube",), sizes={"cube": (0.1, 0.1)}, rng=1)
        assert [solid.size for solid in small.solids] == pytest.approx([0.1] * 3)


FIRST_KINDS = ["rectangle", "pentagon", "square", "triangle", "triangle", "rectangle", "rectangle"]
FIRST_FOOTPRINT = [
    [1.3881091915104729, 0.9646363986861803],
    [1.6785603379357548, 0.7457416646746572],
    [1.800168523497712, 0.9071034126887028],
    [1.5097173770724301, 1.1259981467002258],
]


def test_algorithm_1_draws_what_it_always_did():
    world = primfit.random_world(rng=7)
    assert [solid.kind for solid in world.solids] == FIRST_KINDS
    np.testing.assert_array_equal(world.solids[0].footprint, FIRST_FOOTPRINT)


class TestEvaluation:
    """A polyhedron has all that a found solid needs, so that it can stand for one."""

    def report(self, found, world, *solids):
        return primfit.evaluate(replace(found, solids=solids), world)

    @pytest.mark.parametrize("name", SHAPES)
    def test_pose_error_modulo_symmetry(self, found, name):
        solid = turned(SHAPES[name][0], 9)[0]
        world = primfit.World([solid])
        arms = solid.vertices - solid.center
        rng = np.random.default_rng(1)
        for degrees in (0.0, 0.5, 5.0):
            axis = rng.normal(size=3)
            turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis))
            alike = turn.as_matrix() @ solid.symmetry[rng.integers(len(solid.symmetry))]
            moved = Polyhedron(arms @ alike.T + solid.center + [0.0, 0.003, 0.004], solid.faces)
            (row,) = self.report(found, world, moved).rows
            assert row.truth == row.found == solid.kind
            assert row.angle_error_deg == pytest.approx(degrees, abs=1e-4)
            assert row.center_error_mm == pytest.approx(5.0)
            assert row.size_error_mm == pytest.approx(0.0, abs=1e-5)

    def test_a_little_wrong_in_size_changes_no_angle(self, found):
        quat = (0.3, 0.2, 0.1, 1)
        world = primfit.World([Polyhedron.box(0.3, 0.3, 0.2, quat_xyzw=quat)])
        (row,) = self.report(found, world, Polyhedron.box(0.302, 0.299, 0.199, quat_xyzw=quat)).rows
        assert row.angle_error_deg == pytest.approx(0.0, abs=1e-6)
        assert row.size_error_mm == pytest.approx(2.0)

    def test_other_faces_have_no_angle_in_common(self, found):
        world = primfit.World([Polyhedron.box(0.3, 0.2, 0.1, quat_xyzw=(0.3, 0.2, 0.1, 1))])
        (row,) = self.report(found, world, Polyhedron.pyramid(4, 0.2, 0.2)).rows
        assert np.isnan(row.angle_error_deg)
        assert np.isnan(row.size_error_mm)

    def test_a_tilted_box_where_an_upright_one_stands(self, found):
        world = primfit.World([primfit.Prism.rectangle(0.3, 0.2, height=0.1)])
        tilt = Rotation.from_euler("x", 3, degrees=True).as_quat()
        (row,) = self.report(found, world, Polyhedron.box(0.3, 0.2, 0.1, quat_xyzw=tilt)).rows
        assert (row.truth, row.found) == ("rectangle", "box")
        assert row.angle_error_deg == pytest.approx(3.0)
        upright = primfit.World([Polyhedron.box(0.3, 0.2, 0.1)])
        assert primfit.evaluate(replace(found, solids=()), upright).n_planes_true == 4
