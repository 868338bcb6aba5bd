"""Worlds in files of other programs, and another simulator as a judge of the beams."""

from __future__ import annotations

import numpy as np
import pytest

import primfit
from primfit.worlds.world import ARENA, FLOOR, NOTHING


def worlds():
    """Prisms, stars, rooms of any outline, tilted polyhedra, with and without an arena."""
    tilted = [
        primfit.Polyhedron.box(0.4, 0.3, 0.2, center=(0.6, 0.6, 0.4), quat_xyzw=(0.2, 0.1, 0, 1)),
        primfit.Polyhedron.wedge(0.4, 0.3, 0.2, center=(1.4, 0.7, 0.3), quat_xyzw=(0, 0.3, 0.1, 1)),
        primfit.Polyhedron.pyramid(5, 0.2, 0.4, center=(1, 1.4, 0.3), quat_xyzw=(0.1, 0, 0.2, 1)),
    ]
    ell = [(0, 0), (4, 0), (4, 1.5), (2, 1.5), (2, 3), (0, 3)]
    yield "map", primfit.random_world(rng=7)
    yield "stars", primfit.random_world(kinds=["star", "pentagon", "circle"], rng=8)
    yield "tilted", primfit.World(tilted, primfit.Arena((2, 2), height=1.0))
    yield "open", primfit.World(tilted)
    yield (
        "ell",
        primfit.World(
            [primfit.Prism.star(5, 0.4, 0.2, center=(1, 1), height=0.5)],
            primfit.Arena(outline=ell, height=2.5),
        ),
    )


WORLDS = dict(worlds())


@pytest.mark.parametrize("suffix", [".json", ".wbt", ".xml"])
@pytest.mark.parametrize("name", WORLDS)
def test_round_trips_give_the_same_ranges(name, suffix, tmp_path):
    world = WORLDS[name]
    world.save(tmp_path / f"world{suffix}")
    again = primfit.World.load(tmp_path / f"world{suffix}")
    assert repr(again) == repr(world)
    assert not again.left_out
    poses = np.eye(4)[None].repeat(3, axis=0)
    poses[:, :3, 3] = [[0.9, 0.05, 0.05], [0.25, 0.3, 0.2], [0.1, 1.4, 0.15]]
    lidar = primfit.Lidar(field_of_view=2 * np.pi, horizontal_resolution=200, max_range=9.0)
    own, read = (primfit.scan(each, poses, lidar, rng=1) for each in (world, again))
    assert own.ranges.tobytes() == read.ranges.tobytes()


def test_other_suffixes_are_refused(tmp_path):
    world = WORLDS["map"]
    for name in ("world.foo", "world.wbo", "world"):
        with pytest.raises(
            ValueError, match=r"file must end in one of \.json, \.wbt, \.xml, \.glb"
        ):
            world.save(tmp_path / name)
    assert not list(tmp_path.iterdir())
    (tmp_path / "model.xml").write_text("<mujoco/>")
    with pytest.raises(
        ValueError, match=r"model\.xml is not a world .* MJCF of others is not read"
    ):
        primfit.World.load(tmp_path / "model.xml")
    (tmp_path / "world.glb").write_bytes(b"")
    with pytest.raises(ValueError, match=r"\.glb is only written"):
        primfit.World.load(tmp_path / "world.glb")


def test_glb_has_the_volumes(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    world = WORLDS["tilted"]
    world.save(tmp_path / "world.glb")
    scene = trimesh.load_scene(tmp_path / "world.glb")
    for i, solid in enumerate(world.solids):
        assert scene.geometry[f"solid-{i}"].volume == pytest.approx(solid.volume, rel=1e-5)


ENU = """#VRML_SIM R2023b utf8
EXTERNPROTO "https://a/RectangleArena.proto"
IMPORTABLE EXTERNPROTO "E-puck.proto"
WorldInfo { info [ "a # in \\"words\\"" ] basicTimeStep 16 }
Viewpoint { }
TexturedBackground { }
RectangleArena { translation 1 1.5 0.05 floorSize 4 3 wallHeight 0.4 }
# Boxes of each kind, standing on the floor.
Wall { translation 2 2 0.05 rotation 0 0 1 1.5707963267948966 size 0.1 0.6 0.3 }
CardboardBox { translation 0 1 0.35 }
DEF CRATE WoodenBox { translation 0 2.2 0.2 size 0.3 0.3 0.3 }
SolidBox { translation 2.5 0.5 0.15 size 0.4 0.2 0.2 }
DEF LEANING Solid {
  translation 1 0.5 0.35
  rotation 1 0 0 0.5
  hidden translation_1 9 9 9
  children [
    DEF SHAPE Shape { appearance PBRAppearance { } geometry Box { size 0.2 0.3 0.4 } }
    Pose { translation 0 0 0.5 children [ USE SHAPE ] }
    Transform { translation 0 0.9 0 scale 2 1 1 children Group { children [ USE SHAPE ] } }
  ]
}
Solid { translation 1.5 1 0.15, children [ Shape { geometry Cylinder { radius 0.1 height 0.2 } } ] }
Solid { children [ Shape { geometry IndexedFaceSet {
  coord Coordinate { point [ 0 0 0.05, 0.2 0 0.05, 0 0.2 0.05, 0 0 0.3, 0 0 0.05 ] }
  coordIndex [ 0 2 1 -1 4 1 3 -1 1 2 3 -1 2 4 3 -1 ] } } ] }
Solid { children [ Shape { geometry IndexedFaceSet {
  coord Coordinate { point [ 0 0 0, 1 0 0, 0 1 0 ] } coordIndex [ 0 1 2 -1 ] } } ] }
Solid { translation -0.5 1 0.15 children [ Shape { geometry Sphere { radius 0.1 } } ] }
Transform { translation -0.5 2 0.25 rotation 0 1 0 0.5 scale 2 2 2 children [
  Shape { geometry Cone { bottomRadius 0.1 height 0.2 } }
  Shape { geometry Cone { } } ] }
Transform { translation 0 1.6 0.25 scale 1 1 2 children Shape {
  geometry Cylinder { radius 0.1 height 0.2 } } }
E-puck { turretSlot [ Lidar { numberOfLayers 8 } ] }
"""


class TestWebots:
    def test_every_node(self, tmp_path):
        (tmp_path / "world.wbt").write_text(ENU)
        world = primfit.World.load(tmp_path / "world.wbt")
        assert world.left_out == {"Shape": 2, "E-puck": 1}
        np.testing.assert_allclose(world.arena.bounds, [[-1, 0], [3, 3]])
        assert world.arena.height == pytest.approx(0.4)
        wall, cardboard, crate, box, leaning, above, wide, cylinder, tetrahedron = world.solids[:9]
        np.testing.assert_allclose(wall.center, [2, 2, 0.15])
        np.testing.assert_allclose(np.ptp(wall.footprint, axis=0), [0.6, 0.1])
        assert (wall.kind, wall.base) == ("rectangle", pytest.approx(0.0))
        np.testing.assert_allclose([cardboard.height, crate.height, box.height], [0.6, 0.3, 0.2])
        np.testing.assert_allclose([cardboard.base, crate.base, box.base], 0.0, atol=1e-12)
        np.testing.assert_allclose(box.center, [2.5, 0.5, 0.1])
        assert (leaning.kind, above.kind, wide.kind) == ("box",) * 3
        assert leaning.volume == pytest.approx(0.2 * 0.3 * 0.4)
        np.testing.assert_allclose(leaning.center, [1, 0.5, 0.3])
        up = np.array([0, -np.sin(0.5), np.cos(0.5)])
        np.testing.assert_allclose(above.center - leaning.center, 0.5 * up, atol=1e-12)
        assert wide.volume == pytest.approx(2 * leaning.volume)
        assert (cylinder.kind, cylinder.size) == ("circle", 0.1)
        ball, cone, stretched = world.solids[9:]
        assert (ball.kind, ball.size) == ("sphere", 0.1)
        np.testing.assert_allclose(ball.center, [-0.5, 1, 0.1])
        assert (cone.kind, cone.size) == ("cone", pytest.approx((0.2, 0.0, 0.4)))
        np.testing.assert_allclose(cone.axis, [np.sin(0.5), 0, np.cos(0.5)])
        assert (stretched.kind, stretched.height) == ("circle", pytest.approx(0.4))
        assert tetrahedron.volume == pytest.approx(0.2 * 0.2 * 0.25 / 6)

    def test_walls_of_lego(self, tmp_path):
        """Boxes of 16 x 50 x 96 mm, y up in their own frame, whatever the frame of the world."""
        (tmp_path / "old.wbt").write_text(
            """#VRML_SIM R2020a utf8
            RectangleArena { translation 0.5 0 0.5 }
            LegoWall { }
            LegoWall { translation 0.3 0.025 0.4 rotation 0 1 0 1.5707963267948966 name "b" }"""
        )
        (tmp_path / "new.wbt").write_text(
            """#VRML_SIM R2023b utf8
            LegoWall { translation 0.4 0.3 0.025 rotation -0.57735 -0.57735 -0.57735 -2.0943951 }
            LegoWall { name "b" }"""
        )
        old, new = (primfit.World.load(tmp_path / name) for name in ("old.wbt", "new.wbt"))
        assert old.left_out == new.left_out == {}
        for wall, at, size in zip(
            (*old.solids, *new.solids),
            ((0, 0), (0.4, 0.3), (0.4, 0.3), (0, 0)),
            ((0.096, 0.016), (0.016, 0.096), (0.096, 0.016), (0.096, 0.016)),
            strict=True,
        ):
            assert (wall.kind, wall.base) == ("rectangle", pytest.approx(0.0, abs=1e-8))
            assert wall.height == pytest.approx(0.05)
            np.testing.assert_allclose(wall.center[:2], at, atol=1e-8)
            np.testing.assert_allclose(np.ptp(wall.footprint, axis=0), size, atol=1e-6)

    def test_y_up(self, tmp_path):
        """Before R2022a x is north, y up and z east."""
        (tmp_path / "old.wbt").write_text(
            """#VRML_SIM R2021b utf8
            RectangleArena { translation 1.5 0 2 floorSize 3 4 wallHeight 0.2 }
            Wall { translation 1 0 0.5 size 0.6 0.3 0.1 }
            Solid { translation 2 0.1 3 children [ Shape {
              geometry Cylinder { radius 0.3 height 0.2 } } ] }
            SolidBox { translation 2 0.25 1 rotation 0 1 0 0.3 size 0.2 0.5 0.4 }"""
        )
        world = primfit.World.load(tmp_path / "old.wbt")
        assert world.arena == primfit.Arena((4, 3), height=0.2)
        wall, cylinder, box = world.solids
        np.testing.assert_allclose(wall.center, [0.5, 1, 0.15])
        np.testing.assert_allclose(np.ptp(wall.footprint, axis=0), [0.1, 0.6])
        np.testing.assert_allclose(cylinder.center, [3, 2, 0.1])
        np.testing.assert_allclose(box.center, [1, 2, 0.25])
        # About up, north turns towards west.
        edges = np.diff(np.vstack([box.footprint, box.footprint[:1]]), axis=0)
        long = edges[np.linalg.norm(edges, axis=1).argmax()]
        assert np.arctan2(long[1], long[0]) % np.pi == pytest.approx(0.3)
        assert not world.left_out

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            ("", "its first line does not begin with #VRML_SIM"),
            ("#VRML_SIM R2023b utf8\nSolid { children [", "it ends within a node"),
            ('#VRML_SIM R2023b utf8\nSolid { name "a', "a string in line 2 does not end"),
            ("#VRML_SIM R2023b utf8\nUSE A", "USE A is of no name"),
            ("#VRML_SIM R2023b utf8\nSolid translation", "Solid must be followed by {"),
            ("#VRML_SIM R2023b utf8\n" + "Solid { a " * 300, "more than 200 deep"),
            ('#VRML_SIM R2023b utf8\nWorldInfo { coordinateSystem "EUN" }', "'EUN', not ENU"),
        ],
    )
    def test_damaged_files(self, text, told, tmp_path):
        (tmp_path / "world.wbt").write_text(text)
        with pytest.raises(ValueError, match=f"world.wbt is not a world .*{told}"):
            primfit.World.load(tmp_path / "world.wbt")


class TestOtherSurfaces:
    def test_what_was_found_is_scanned_again(self, world, scan, found):
        """Without noise, what is found in the world of what was found is the world."""
        copy = primfit.World(found.solids, world.arena)
        path = primfit.grid_path(copy, rng=7)
        again = primfit.detect(primfit.scan(copy, path, rng=7), "paper", rng=7)
        assert primfit.evaluate(again, world).all_right

    def test_found_polyhedra(self):
        rng = np.random.default_rng(1)
        points = np.array([0.3, 0.2, 0.1]) * rng.random((6000, 3))
        face = np.arange(6000) % 6
        points[np.arange(6000), face // 2] = face % 2 * np.array([0.3, 0.2, 0.1])[face // 2]
        world = primfit.World(primfit.detect(points, "planes", rng=1).solids)
        assert world.solids[0].volume == pytest.approx(0.006, rel=1e-6)

    def test_meshes(self):
        trimesh = pytest.importorskip("trimesh")
        box, ball = trimesh.creation.box((0.3, 0.2, 0.1)), trimesh.creation.icosphere(1, 0.1)
        ball.apply_translation([1, 0, 0])
        world = primfit.World([box, ball])
        assert world.solids[0].kind == "rectangle"
        assert world.solids[1].volume == pytest.approx(ball.volume)
        joined = trimesh.util.concatenate([box, ball])
        split = trimesh.Trimesh(
            joined.triangles.reshape(-1, 3),
            np.arange(3 * len(joined.faces)).reshape(-1, 3),
            process=False,
        )
        for mesh in (joined, split, (joined.vertices, joined.faces)):
            again = primfit.World.from_mesh(mesh, primfit.Arena())
            assert [len(s.faces) for s in again.solids] == [6, 80]
            np.testing.assert_allclose(again.solids[1].center, [1, 0, 0], atol=1e-12)
        assert not primfit.World.from_mesh((np.zeros((0, 3)), np.zeros((0, 3), int))).solids

    @pytest.mark.parametrize(
        ("mesh", "kind", "told"),
        [
            (3, TypeError, "mesh must be"),
            ((np.eye(3), [[0, 1, 3]]), ValueError, "triangles must be rows of 3 vertices"),
            ((np.eye(3), [[0.0, 1, 2]]), ValueError, "triangles must be integers"),
            ((np.eye(3), [[0, 1, 2]]), ValueError, "mesh has a part of 1 triangles"),
        ],
    )
    def test_what_is_no_solid(self, mesh, kind, told):
        with pytest.raises(kind, match=told):
            primfit.World.from_mesh(mesh)


NEAR_EDGE = 1e-5
"""Metres to an edge within which single precision may decide otherwise."""


@pytest.mark.parametrize("name", WORLDS)
def test_mujoco_casts_the_same_beams(name, tmp_path):
    """An independent simulator, by other people, sees what `RayCaster` sees."""
    mujoco = pytest.importorskip("mujoco")
    world = WORLDS[name]
    world.save(tmp_path / "world.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "world.xml"))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    ids = {"solid": lambda k: k, "wall": lambda _: ARENA, "floor": lambda _: FLOOR}
    told = []
    for geom in range(model.ngeom):
        kind, _, k = model.geom(geom).name.partition("-")
        told.append(ids[kind](int(k or 0)))
    told = np.array([*told, NOTHING])
    rng = np.random.default_rng(5)
    caster = primfit.RayCaster(world)
    height = 0.3 if world.arena is None else 0.9 * world.arena.height
    low, high = world.bounds
    n_cast, n = 0, 20_000
    while n_cast < 10 * n:
        origin = np.append(rng.uniform(low, high), rng.uniform(0.02, height))
        if any(solid.contains(origin[None])[0] for solid in world.solids):
            continue
        if world.arena is not None and world.arena.clearance(origin[None, :2])[0] <= 0.02:
            continue
        rays = rng.normal(size=(n, 3))
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        ranges, hits = caster.cast(np.broadcast_to(origin, (n, 3)), rays)
        geoms, distances = np.zeros(n, np.int32), np.zeros(n)
        mujoco.mj_multiRay(
            model, state, origin, rays.ravel(), None, True, -1, geoms, distances, None, n, 1e9
        )
        own = told[geoms]
        differs = own != hits
        near = np.zeros(n, bool)
        for row in np.flatnonzero(differs):
            near[row] = is_at_an_edge(caster, origin, rays[row], hits[row])
        assert not (differs & ~near).any(), (origin, rays[differs & ~near][:3])
        both = np.isfinite(ranges) & (distances >= 0.0) & ~differs
        assert both.sum() > n / 4
        np.testing.assert_allclose(distances[both], ranges[both], atol=5e-6, rtol=2e-6)
        n_cast += n


def is_at_an_edge(caster, origin, ray, hit):
    """Whether a beam beside this one, by `NEAR_EDGE` at a metre, meets something else."""
    turn = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
    across = np.linalg.svd(ray[None])[2][1:]
    beside = ray + NEAR_EDGE * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ across
    _, hits = caster.cast(np.broadcast_to(origin, (16, 3)), beside)
    return (hits != hit).any()
