"""Round solids of bare clouds and scans: found among the flat ones, and not where none are."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import primfit
from primfit.polyhedra.detection import PlaneSettings
from primfit.surfaces.round_solids import round_solids

SOLIDS = {
    "can": primfit.Cylinder(0.15, 0.5, (0.0, 0.0)),
    "pipe": primfit.Cylinder(0.1, 0.6, (1.2, 0.3, 0.8), axis=(1.0, 0.3, 0.5)),
    "ball": primfit.Sphere(0.25, (0.2, 1.3)),
    "cone": primfit.Cone(0.3, 0.5, (-1.2, 0.2)),
    "bucket": primfit.Cone(0.3, 0.4, (-1.0, 1.5), top_radius=0.15),
    "box": primfit.Polyhedron.box(0.5, 0.4, 0.3, center=(1.5, 1.6, 0.15), quat_xyzw=(0, 0, 0.2, 1)),
    "ring": primfit.Torus(0.3, 0.08, (2.6, 0.6)),
}
LIDAR = primfit.Lidar(64, 0.9, 400, 1.5, max_range=30.0, noise=1e-4, mount=(0.0, 0.0, 0.0))
"""The noise is a share of the range: 3 mm."""


def looking_at(middle, distance, n, height=1.5):
    """Poses around a place, looking down at it."""
    bearings = 2 * np.pi * np.arange(n) / n
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler(
        "ZY", np.column_stack([bearings + np.pi, np.full(n, 0.3)])
    ).as_matrix()
    poses[:, :2, 3] = middle + distance * np.column_stack([np.cos(bearings), np.sin(bearings)])
    poses[:, 2, 3] = height
    return poses


@pytest.fixture(scope="module")
def seen():
    world = primfit.World(list(SOLIDS.values()))
    scan = primfit.scan(world, looking_at((0.5, 0.7), 3.2, 8), LIDAR, rng=1)
    return world, scan, primfit.detect(scan, method="planes", rng=1)


def test_all_are_found_beside_flat_ones(seen):
    world, _, found = seen
    report = primfit.evaluate(found, world, max_distance=0.3)
    assert not report.missed
    assert not report.spurious
    for row in report.rows:
        truth, solid = world.solids[row.solid], found.solids[row.detection]
        assert solid.solid_kind == truth.solid_kind
        assert row.center_error_mm < 1.0
        if truth.solid_kind != "box":
            np.testing.assert_allclose(solid.dimensions, truth.dimensions, atol=2e-3)
            assert np.isnan(row.angle_error_deg) or row.angle_error_deg < 0.2
            assert solid.surfaces
            assert not solid.planes or len(solid.planes) == 2


def test_errors_are_within_their_own_deviations(seen):
    world, _, found = seen
    deviations = []
    for seed in (None, 2, 3):
        if seed:
            scan = primfit.scan(world, looking_at((0.5, 0.7), 3.2, 8), LIDAR, rng=seed)
            found = primfit.detect(scan, method="planes", rng=1)
        deviations += deviations_of(found, world)
    assert len(deviations) > 75
    assert np.sqrt(np.mean(np.square(deviations))) < 1.3
    assert abs(np.mean(deviations)) < 0.3


def deviations_of(found, world):
    """Errors of all round solids over their own standard deviations."""
    deviations = []
    for row in primfit.evaluate(found, world, max_distance=0.3).rows:
        truth, solid = world.solids[row.solid], found.solids[row.detection]
        if isinstance(truth, primfit.Polyhedron):
            continue
        assert row.detection >= 0
        sigmas = solid.sigmas
        assert list(sigmas) == list(solid.parameters)
        off = solid.solid.center - truth.center
        deviations += [off[k] / sigmas[f"center_{axis}"] for k, axis in enumerate("xyz")]
        for name in ("radius", "height", "major_radius", "top_radius"):
            if name in sigmas:
                off = getattr(solid.solid, name) - getattr(truth, name)
                deviations.append(off / sigmas[name])
        np.testing.assert_allclose(solid.covariance, solid.covariance.T, rtol=1e-6, atol=1e-12)
    return deviations


def test_what_stands_upright_is_a_circle_from_above(seen):
    world, _, found = seen
    rows = primfit.evaluate(found, world, max_distance=0.3).rows
    can = found.solids[rows[list(SOLIDS).index("can")].detection]
    assert (can.kind, can.solid_kind) == ("circle", "cylinder")
    assert can.size == pytest.approx(0.15, abs=1e-3)
    assert len(can.footprint) == 64
    assert all(can.observed)
    pipe = found.solids[rows[list(SOLIDS).index("pipe")].detection]
    assert (pipe.kind, pipe.footprint) == ("cylinder", None)


def test_flat_ends_are_planes_of_the_solid(seen):
    world, _, found = seen
    rows = primfit.evaluate(found, world, max_distance=0.3).rows
    can = found.solids[rows[list(SOLIDS).index("can")].detection]
    bottom, top = (found.planes[k] for k in can.planes)
    assert abs(bottom.equation[2]) > 0.99
    assert top.equation[3] == pytest.approx(-0.5 * top.equation[2], abs=2e-3)


def test_no_flat_part_tiles_a_round_solid(seen):
    _, _, found = seen
    on_round = np.zeros(len(found.labels), dtype=bool)
    for solid in found.solids:
        for number in solid.surfaces:
            on_round[found.surfaces[number].inliers] = True
    for number, plane in enumerate(found.planes):
        np.testing.assert_array_equal(np.flatnonzero(found.labels == number), plane.inliers)
        assert on_round[plane.inliers].mean() <= 0.5


def test_where_only_planes_are_wanted(seen):
    _, scan, found = seen
    flat = primfit.detect(scan, PlaneSettings(kinds=("plane",)), rng=1)
    assert flat.surfaces == ()
    assert not any(solid.surfaces for solid in flat.solids)
    assert len(flat.planes) >= len(found.planes)


def test_the_cloud_alone_tells_as_much(seen):
    world, scan, _ = seen
    found = primfit.detect(scan.points[scan.is_return] + (4e5, 5e6, 100.0), rng=1)
    titles = sorted(solid.title for solid in found.solids)
    assert titles == ["box", "cone", "cone", "cylinder", "cylinder", "sphere", "torus"]
    report = primfit.evaluate(
        dataclasses.replace(found, solids=tuple(s.moved(np.array([-4e5, -5e6, -100.0])) for s in found.solids)),
        world, max_distance=0.3,
    )  # fmt: skip
    assert not report.missed


def cloud_of(points, noise=0.002, seed=1):
    return points + np.random.default_rng(seed).normal(0.0, noise, points.shape)


def on_cylinder(radius, length, arc, n, seed=1):
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(-arc / 2, arc / 2, n), rng.uniform(0.0, length, n)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


class TestNoSolid:
    def found(self, points, origins=None):
        scan = primfit.Scan.from_points(cloud_of(points), origins)
        return primfit.detect(scan, method="planes", rng=1)

    def test_a_vault_seen_from_inside(self):
        inside = on_cylinder(2.0, 6.0, np.pi, 8000)
        found = self.found(inside, np.array([0.3, 0.0, 3.0]))
        assert len(found.surfaces) == 1
        assert found.solids == ()

    def test_a_rounded_edge(self):
        found = self.found(on_cylinder(0.3, 1.0, np.pi / 2, 4000))
        assert len(found.surfaces) == 1
        assert found.solids == ()

    def test_a_half_column_at_a_wall(self):
        half = on_cylinder(0.3, 2.0, np.pi, 6000)
        rng = np.random.default_rng(2)
        wall = np.column_stack([np.zeros(8000), rng.uniform(-2, 2, 8000), rng.uniform(0, 2, 8000)])
        wall = wall[np.abs(wall[:, 1]) > 0.3]
        found = self.found(np.vstack([half, wall]), np.array([5.0, 0.0, 1.0]))
        assert any(each.kind == "cylinder" for each in found.surfaces)
        assert not any(solid.surfaces for solid in found.solids)

    def test_a_dome_on_the_ground(self):
        rng = np.random.default_rng(3)
        points = rng.normal(size=(20000, 3))
        points *= 1.0 / np.linalg.norm(points, axis=1)[:, None]
        ground = np.column_stack([rng.uniform(-3, 3, (20000, 2)), np.zeros(20000)])
        ground = ground[np.linalg.norm(ground, axis=1) > 1.0]
        found = self.found(np.vstack([points[points[:, 2] > 0], ground]))
        assert any(each.kind == "sphere" for each in found.surfaces)
        assert not any(solid.surfaces for solid in found.solids)

    def test_a_bowl_of_which_both_sides_are_seen(self):
        outer = on_cylinder(0.30, 0.5, 2 * np.pi, 8000)
        inner = on_cylinder(0.26, 0.5, 2 * np.pi, 8000, seed=2)
        found = self.found(np.vstack([outer, inner]))
        assert len(found.surfaces) == 2
        wide = max(found.surfaces, key=lambda each: each.radius)
        assert round_solids([wide], found.planes, found.scan.points) == []


def test_what_is_flat_stays_flat():
    rng = np.random.default_rng(4)
    prism = primfit.Prism.regular(7, 0.3, height=0.8)
    vertices, triangles = prism.to_mesh()
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    which = rng.choice(len(areas), 12000, p=areas / areas.sum())
    u, v = np.sort(rng.random((2, len(which))), axis=0)
    points = a[which] + u[:, None] * (b - a)[which] + (v - u)[:, None] * (c - a)[which]
    found = primfit.detect(cloud_of(points), method="planes", rng=1)
    (solid,) = found.solids
    assert (solid.kind, len(found.planes)) == ("heptagon", 9)


def test_a_pyramid_is_no_cone():
    rng = np.random.default_rng(5)
    vertices, triangles = primfit.Polyhedron.pyramid(6, 0.12, 0.15).to_mesh()
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    areas[np.abs(np.cross(b - a, c - a)[:, :2]).max(axis=1) < 1e-12] = 0.0
    which = rng.choice(len(areas), 600, p=areas / areas.sum())
    u, v = np.sort(rng.random((2, len(which))), axis=0)
    points = a[which] + u[:, None] * (b - a)[which] + (v - u)[:, None] * (c - a)[which]
    found = primfit.detect(cloud_of(points, 0.003), method="planes", sigma=0.003, rng=1)
    assert not any(solid.surfaces for solid in found.solids)


def test_noise_may_be_a_function_of_the_points(seen):
    _, scan, _ = seen
    cloud = scan.points[scan.is_return][::3]
    found = primfit.detect(cloud, sigma=lambda points: np.full(len(points), 0.003), rng=1)
    again = primfit.detect(cloud, sigma=0.003, rng=1)
    assert repr(found) == repr(again)
    assert any(solid.surfaces for solid in found.solids)


@pytest.mark.parametrize("copies", [1, 2])
@pytest.mark.parametrize("radius", [0.02, 0.2])
def test_a_pipe_without_ends_is_no_polygon(radius, copies):
    pipe = np.tile(cloud_of(on_cylinder(radius, 1.0, 2 * np.pi, 4000), 0.0005), (copies, 1))
    found = primfit.detect(pipe, rng=1)
    assert (found.method, [solid.title for solid in found.solids]) == ("planes", ["cylinder"])
    assert found.solids[0].solid.radius == pytest.approx(radius, abs=2e-4)


def test_settings_name_their_method(seen):
    _, scan, _ = seen
    with pytest.raises(ValueError, match=r"kinds must hold 'plane', not sphere"):
        PlaneSettings(kinds="sphere")
    with pytest.raises(ValueError, match="kinds"):
        PlaneSettings(kinds=("plane", "cube"))
    with pytest.raises(ValueError, match=r"kinds must hold 'plane', not none"):
        PlaneSettings(kinds=())
    with pytest.raises(TypeError, match=r"kinds must be names out of plane, .*; not None"):
        PlaneSettings(kinds=None)
    with pytest.raises(TypeError, match="settings must not be given twice"):
        primfit.detect(scan, PlaneSettings(), settings=PlaneSettings())
    with pytest.raises(
        TypeError, match="method must be a name, None, or one of LikelihoodSettings"
    ):
        primfit.detect(scan, 3)
    with pytest.raises(TypeError, match="settings must be a PlaneSettings"):
        primfit.detect(scan, "planes", settings=primfit.PaperSettings())
