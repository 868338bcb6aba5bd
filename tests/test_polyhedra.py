"""Polyhedra: construction, names, poses, surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from polyhedra import CUBE, CUBE_FACES, ELL, SHAPES, turned
from scipy.spatial.transform import Rotation

import primfit
from primfit import Polyhedron

seeds = st.integers(0, 10**9)


def angle_modulo(turn, symmetry):
    """Angle of a turn (3, 3) when turns that look alike count as none."""
    return Rotation.from_matrix(turn @ symmetry).magnitude().min()


class TestConstruction:
    def test_faces_are_turned_outwards(self):
        right = Polyhedron(CUBE, CUBE_FACES)
        rng = np.random.default_rng(1)
        for _ in range(20):
            faces = [face[:: rng.choice([-1, 1])] for face in CUBE_FACES]
            cube = Polyhedron(CUBE, faces)
            np.testing.assert_array_equal(cube.normals, right.normals)
            assert cube.volume == pytest.approx(1.0)

    @pytest.mark.parametrize("name", SHAPES)
    def test_triangles_become_the_faces_again(self, name):
        solid = turned(SHAPES[name][0], 3)[0]
        again = Polyhedron(*solid.to_mesh())
        assert len(again.faces) == len(solid.faces)
        assert again.kind == solid.kind
        np.testing.assert_array_equal(again.vertices, solid.vertices)

    def test_vertices_in_the_middle_of_edges_go(self):
        vertices = np.vstack([CUBE, [0.5, 0, 0]])
        faces = [(0, 2, 3, 1, 8), *CUBE_FACES[1:2], (0, 8, 1, 5, 4), *CUBE_FACES[3:]]
        cube = Polyhedron(vertices, faces)
        assert cube.vertices.shape == (8, 3)
        assert cube.kind == "square"

    def test_faces_around_a_hole_stay_apart(self):
        ring = [(0, 0), (3, 0), (3, 3), (0, 3)], [(1, 1), (2, 1), (2, 2), (1, 2)]
        flat = np.array(ring, dtype=float).reshape(8, 2)
        vertices = np.vstack([np.column_stack([flat, np.full(8, z)]) for z in (0.0, 1.0)])
        faces = []
        for k in range(4):
            j = (k + 1) % 4
            faces += [(k, j, j + 8, k + 8), (k + 4, j + 4, j + 12, k + 12)]
            faces += [(k, j, j + 4, k + 4), (k + 8, j + 8, j + 12, k + 12)]
        frame = Polyhedron(vertices, faces)
        assert frame.euler_characteristic == 0
        assert frame.volume == pytest.approx(8.0)
        assert frame.kind == "polyhedron"
        assert frame.shadow.area == pytest.approx(8.0)
        assert frame.contains([[1.5, 1.5, 0.5], [0.5, 1.5, 0.5]]).tolist() == [False, True]

    @pytest.mark.parametrize(
        ("vertices", "faces", "error", "message"),
        [
            (CUBE, CUBE_FACES[:5], ValueError, r"faces must close, but the edge \(0, 2\) is in 1"),
            (CUBE, [*CUBE_FACES, (0, 1, 7)], ValueError, "faces must meet in pairs, but the edge"),
            (CUBE, CUBE_FACES[:3], ValueError, "faces must be at least 4, not 3"),
            (CUBE, [*CUBE_FACES, (0, 1)], ValueError, r"faces\[6\] must have 3 or more different"),
            (
                CUBE,
                [*CUBE_FACES, (0, 1, 1)],
                ValueError,
                r"faces\[6\] must have 3 or more different",
            ),
            (
                CUBE,
                [*CUBE_FACES, (0, 1, 8)],
                ValueError,
                r"faces\[6\] must name rows of 8 vertices",
            ),
            (CUBE, [*CUBE_FACES, (0, -1, 2)], ValueError, r"faces\[6\] must name rows"),
            (CUBE, [*CUBE_FACES, (0.0, 1.0, 2.0)], TypeError, r"faces\[6\] must be a sequence"),
            (CUBE, 5, TypeError, "faces must be sequences of vertex numbers, not 5"),
            (np.vstack([CUBE, [9, 9, 9]]), CUBE_FACES, ValueError, "row 8 is in none"),
            (CUBE[:, :2], CUBE_FACES, ValueError, r"vertices must have shape \(n, 3\)"),
            (np.where(CUBE > 0, np.nan, 0), CUBE_FACES, ValueError, "vertices must be finite"),
            (CUBE * [1, 1, 0], CUBE_FACES, ValueError, r"faces\[2\] must have an area"),
            (CUBE + (CUBE.sum(axis=1) == 3)[:, None], CUBE_FACES, ValueError, "must be flat"),
        ],
    )
    def test_bad_surfaces(self, vertices, faces, error, message):
        with pytest.raises(error, match=message):
            Polyhedron(vertices, faces)

    def test_surfaces_that_are_several_or_touch(self):
        apart = [*CUBE_FACES, *(tuple(i + 8 for i in face) for face in CUBE_FACES)]
        with pytest.raises(ValueError, match="must be one surface, but 6 of them are apart"):
            Polyhedron(np.vstack([CUBE, CUBE + 5]), apart)
        # Two cubes that share the corner (1, 1, 1) only.
        rows = [7, *range(8, 15)]
        touching = [*CUBE_FACES, *(tuple(rows[i] for i in face) for face in CUBE_FACES)]
        with pytest.raises(ValueError, match="must be one surface"):
            Polyhedron(np.vstack([CUBE, (CUBE + 1)[1:]]), touching)

    def test_a_pit_that_touches_the_bottom(self):
        vertices = np.vstack([CUBE, [0.5, 0.5, 0.0]])
        sides = CUBE_FACES[2:]
        pit = [(4, 5, 8), (5, 7, 8), (7, 6, 8), (6, 4, 8)]
        bottom = [(1, 0, 8), (3, 1, 8), (2, 3, 8), (0, 2, 8)]
        with pytest.raises(ValueError, match="some only touch at vertex 8"):
            Polyhedron(vertices, [*sides, *pit, *bottom])
        above = np.vstack([vertices, [0.5, 0.5, 0.3]])
        deep = [tuple(9 if i == 8 else i for i in face) for face in pit]
        solid = Polyhedron(above, [*sides, *deep, *bottom])
        assert solid.volume == pytest.approx(1 - 0.7 / 3)
        assert len(solid.faces) == 9

    def test_one_sided_surface(self):
        # The projective plane of six vertices: every edge in two triangles, no outside.
        faces = [
            (0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (0, 5, 1),
            (1, 2, 4), (2, 3, 5), (3, 4, 1), (4, 5, 2), (5, 1, 3),
        ]  # fmt: skip
        vertices = np.random.default_rng(1).normal(size=(6, 3))
        with pytest.raises(ValueError, match="one-sided"):
            Polyhedron(vertices, faces)

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: Polyhedron.box(1, 0, 1), "width must be greater than 0, not 0"),
            (lambda: Polyhedron.pyramid(2, 1, 1), "n must be at least 3, not 2"),
            (lambda: Polyhedron.wedge(1, 1, np.inf), "height must be finite"),
            (lambda: Polyhedron.box(1, 1, 1, quat_xyzw=(0, 0, 0, 0)), "quat_xyzw must not be zero"),
            (lambda: Polyhedron.box(1, 1, 1, center=(0, 0)), r"center must have shape \(3,\)"),
            (lambda: Polyhedron.prism([(0, 0), (1, 0)], 1), "at least 3 distinct vertices"),
        ],
    )
    def test_bad_arguments(self, call, message):
        with pytest.raises(ValueError, match=message):
            call()


class TestShape:
    @pytest.mark.parametrize("name", SHAPES)
    @settings(max_examples=6, deadline=None)
    @given(
        seed=seeds, place=st.sampled_from([0.0, 10.0, 5e6]), scale=st.sampled_from([1.0, 1e-2, 1e2])
    )
    def test_name_size_and_symmetry_do_not_depend_on_the_pose(self, name, seed, place, scale):
        solid, kind, order, volume = SHAPES[name]
        first, turn = turned(solid, seed)
        second, other_turn = turned(solid, seed + 1, place if scale > 0.1 else 0.0, scale)
        assert first.kind == second.kind == kind
        assert len(first.symmetry) == len(second.symmetry) == order
        np.testing.assert_allclose(np.multiply(scale, first.size), second.size, rtol=2e-6)
        if volume is not None:
            assert second.volume == pytest.approx(scale**3 * volume, rel=1e-6)
        # The own axes turn with the solid, but for its symmetry.
        own = [Rotation.from_quat(each.quat_xyzw).as_matrix() for each in (first, second)]
        between = own[1] @ own[0].T
        assert angle_modulo(between.T @ other_turn @ turn.T, first.symmetry) < 1e-5

    @pytest.mark.parametrize("name", SHAPES)
    def test_symmetry_lays_the_solid_onto_itself(self, name):
        solid = turned(SHAPES[name][0], 5)[0]
        arms = solid.vertices - solid.center
        np.testing.assert_allclose(solid.symmetry[0], np.eye(3), atol=1e-12)
        for turn in solid.symmetry:
            distance = np.abs((arms @ turn.T)[:, None] - arms).max(axis=-1)
            np.testing.assert_allclose(distance.min(axis=1), 0.0, atol=1e-9)
            assert sorted(distance.argmin(axis=1)) == list(range(len(arms)))

    def test_upright_prisms_keep_their_names(self):
        for prism in primfit.random_world(
            8, 4.0, ["triangle", "square", "rectangle", "pentagon", "star", "polygon"], rng=2
        ).solids:
            solid = Polyhedron(prism.vertices, prism.faces)
            assert solid.kind == prism.kind
            assert solid.size == pytest.approx(prism.size)
            assert solid.angle == pytest.approx(prism.angle)
            np.testing.assert_allclose(solid.center, prism.center, atol=1e-12)
            np.testing.assert_allclose(solid.centroid, prism.centroid, atol=1e-12)
            assert (solid.base, solid.height) == (prism.base, pytest.approx(prism.height))
            assert shapely.equals_exact(
                shapely.normalize(solid.shadow), shapely.normalize(prism.shadow), 1e-12
            )
        tilted = Polyhedron.prism(prism.footprint, 1.0, quat_xyzw=(0.1, 0, 0, 1))
        assert tilted.footprint is None
        assert np.isnan(tilted.angle)

    def test_conventions_of_size_and_orientation(self):
        for sides in ((3, 2, 1), (1, 2, 3), (2, 3, 1)):
            assert Polyhedron.box(*sides, quat_xyzw=(0.1, 0.2, 0.3, 1)).size == pytest.approx(
                (3, 2, 1)
            )
        assert Polyhedron.box(2, 2, 2, quat_xyzw=(0.1, 0, 0, 1)).size == pytest.approx(2.0)
        assert Polyhedron.wedge(4, 3, 2).size == pytest.approx((4, 3, 2))
        assert Polyhedron.pyramid(4, 2, 5).size == pytest.approx((5, 2, 2))
        quat = Rotation.from_euler("xyz", [0.3, -0.2, 0.4]).as_quat(canonical=True)
        for make, sides in ((Polyhedron.box, (3, 2, 1)), (Polyhedron.pyramid, (4, 2, 5))):
            np.testing.assert_allclose(make(*sides, quat_xyzw=quat).quat_xyzw, quat, atol=1e-12)
        # A yaw of 100 degrees of a box looks like one of -80.
        yaw = Polyhedron.box(
            3, 2, 1, quat_xyzw=Rotation.from_euler("z", 100, degrees=True).as_quat()
        )
        euler = Rotation.from_quat(yaw.quat_xyzw).as_euler("zyx", degrees=True)
        np.testing.assert_allclose(euler, [-80, 0, 0], atol=1e-9)

    def test_center_and_standing(self):
        box = Polyhedron.box(3, 2, 1, quat_xyzw=(0.3, 0.2, 0.1, 1))
        assert box.base == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_allclose(box.center[:2], 0.0, atol=1e-12)
        placed = Polyhedron.box(3, 2, 1, center=(1, 2, 3), quat_xyzw=(0.3, 0.2, 0.1, 1))
        np.testing.assert_allclose(placed.center, [1, 2, 3])
        np.testing.assert_allclose(box.moved([1, 1, 1]).center, box.center + 1)

    def test_centroids(self):
        np.testing.assert_allclose(Polyhedron.pyramid(5, 1, 4).centroid, [0, 0, 1], atol=1e-12)
        wedge = Polyhedron.wedge(3, 1, 1.5)
        np.testing.assert_allclose(wedge.centroid, [0, 0, 0.5], atol=1e-12)
        solid, turn = turned(Polyhedron.prism(ELL, 1), 4, 100.0)
        arm = solid.centroid - solid.center
        np.testing.assert_allclose(turn.T @ arm, [5 / 6 - 1, 5 / 6 - 1, 0], atol=1e-12)


class TestSurface:
    @pytest.mark.parametrize("name", SHAPES)
    def test_mesh_is_closed_and_its_own_size(self, name):
        import trimesh

        solid = turned(SHAPES[name][0], 6)[0]
        mesh = trimesh.Trimesh(*solid.to_mesh(), process=False)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(solid.volume)
        np.testing.assert_allclose(mesh.center_mass, solid.centroid, atol=1e-9)
        areas = [
            mesh.area_faces[np.abs(mesh.face_normals @ normal - 1) < 1e-9].sum()
            for normal in solid.normals
        ]
        assert mesh.area == pytest.approx(
            sum(
                np.linalg.norm(v)
                for v in primfit.geometry.shells.area_vectors(solid.vertices, solid.faces)
            )
        )
        assert min(areas) > 0
        assert len(solid.vertices) - len(solid.edges) + len(solid.faces) == 2

    @pytest.mark.parametrize("name", SHAPES)
    def test_contains(self, name):
        solid, turn = turned(SHAPES[name][0], 7)
        upright = SHAPES[name][0]
        points = np.random.default_rng(1).uniform(-3, 5, (4000, 3))
        inside = solid.contains(points @ turn.T)
        np.testing.assert_array_equal(inside, upright.contains(points))
        share = inside.mean() * 8.0**3
        assert share == pytest.approx(solid.volume, abs=4 * 8**1.5 * np.sqrt(solid.volume / 4000))

    def test_contains_a_box_by_its_closed_form(self):
        box, turn = turned(Polyhedron.box(3, 2, 1), 8, 5.0)
        points = box.center + np.random.default_rng(2).uniform(-2, 2, (5000, 3))
        local = np.abs((points - box.center) @ turn)
        np.testing.assert_array_equal(box.contains(points), (local <= [1.5, 1, 0.5]).all(axis=1))

    @settings(max_examples=25, deadline=None)
    @given(seeds)
    def test_rays_meet_a_box_where_the_slabs_say(self, seed):
        rng = np.random.default_rng(seed)
        box, turn = turned(Polyhedron.box(*rng.uniform(0.1, 2, 3)), seed)
        origins = box.center + rng.uniform(-4, 4, (200, 3))
        directions = box.center + rng.uniform(-1, 1, (200, 3)) - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        half = np.ptp(box.vertices @ turn, axis=0) / 2
        start, way = (origins - box.center) @ turn, directions @ turn
        with np.errstate(divide="ignore"):
            times = np.stack([(-half - start) / way, (half - start) / way])
        enter, leave = times.min(axis=0).max(axis=1), times.max(axis=0).min(axis=1)
        expected = np.where(enter > leave, np.inf, np.where(enter >= 0, enter, leave))
        expected[expected < 0] = np.inf
        ranges, ids = primfit.RayCaster(box.to_mesh()).cast(origins, directions)
        near_edge = np.abs(enter - leave) < 1e-9
        np.testing.assert_allclose(ranges[~near_edge], expected[~near_edge], atol=1e-9)
        assert ((ids >= 0) == np.isfinite(ranges)).all()
