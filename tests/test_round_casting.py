"""Rays against round solids: slow twins in other formulas, beams aimed at rims, other ways in."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit

EXACT = np.longdouble
"""Of 80 bits where there are any, so that the twin is no worse than what it checks."""


def solid_of(kind, rng):
    """A random solid of a kind, near the origin, in any position."""
    center, axis = rng.normal(size=3), rng.normal(size=3)
    if rng.random() < 0.3:
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    radius, height = rng.uniform(0.1, 2.0, 2)
    if kind == "sphere":
        return primfit.Sphere(radius, center)
    if kind == "cylinder":
        return primfit.Cylinder(radius, height, center, axis)
    if kind == "cone":
        return primfit.Cone(radius, height, center, axis)
    if kind == "frustum":
        return primfit.Cone(radius, height, center, axis, top_radius=radius * rng.uniform(0, 0.99))
    return primfit.Torus(radius, radius * rng.uniform(0.02, 0.98), center, axis)


KINDS = ("sphere", "cylinder", "cone", "frustum", "torus")


def beams_at(solid, rng, n):
    """Origins all over and within, and unit directions towards the solid."""
    origins = solid.center + rng.normal(size=(n, 3)) * rng.choice([0.5, 3.0, 30.0], (n, 1))
    ends = solid.center + rng.normal(size=(n, 3)) * 0.2 * np.array(solid.dimensions).max()
    ways = ends - origins
    return origins, ways / np.linalg.norm(ways, axis=1, keepdims=True)


def nearest(ranges, allowed):
    return np.where(allowed & (ranges >= 0), ranges, np.inf).min(axis=0)


def slow_sphere(solid, origins, ways):
    """The textbook: both roots of |o + s d - c|^2 = r^2 from the origin itself."""
    arms = origins - solid.center
    a, b, c = (ways**2).sum(1), (arms * ways).sum(1), (arms**2).sum(1) - EXACT(solid.radius) ** 2
    root = np.sqrt(np.where(b * b >= a * c, b * b - a * c, np.nan))
    ranges = np.stack([(-b - root) / a, (-b + root) / a])
    return nearest(ranges, np.isfinite(ranges))


def slow_frustum(solid, origins, ways):
    """Side and ends each by themselves; of what lies on the solid the nearest."""
    (low, base), (high, top) = solid.circles
    slope = EXACT(top - base) / EXACT(high - low)
    axis, arms = solid.axis.astype(EXACT), origins - solid.center
    z, dz = arms @ axis, ways @ axis
    across, step = arms - z[:, None] * axis, ways - dz[:, None] * axis
    radius = base + slope * (z - low)
    a = (step**2).sum(1) - (slope * dz) ** 2
    b = (across * step).sum(1) - radius * slope * dz
    c = (across**2).sum(1) - radius**2
    root = np.sqrt(np.where(b * b >= a * c, b * b - a * c, np.nan))
    ranges, allowed = [], []
    with np.errstate(divide="ignore", invalid="ignore"):
        for s in ((-b - root) / a, (-b + root) / a):
            ranges.append(s)
            allowed.append((z + s * dz >= low) & (z + s * dz <= high))
        for height, of_end in solid.circles:
            s = (height - z) / dz
            place = across + s[:, None] * step
            ranges.append(s)
            allowed.append((place**2).sum(1) <= EXACT(of_end) ** 2)
    return nearest(np.stack(ranges), np.stack(allowed))


def slow_torus(solid, origins, ways):
    """Roots of the quartic as eigenvalues (numpy.roots), polished on the distance."""
    axis = solid.axis.astype(EXACT)
    major, minor = EXACT(solid.major_radius), EXACT(solid.radius)
    found = np.full(len(origins), np.inf)
    for i, (origin, way) in enumerate(zip(origins, ways, strict=True)):
        arm = origin - solid.center
        start = -(arm @ way)
        arm = arm + start * way
        z, dz = arm @ axis, way @ axis
        across, step = arm - z * axis, way - dz * axis
        inner = np.array([way @ way, 2 * (arm @ way), arm @ arm + major**2 - minor**2])
        quartic = np.polymul(inner, inner)
        quartic[-3:] -= 4 * major**2 * np.array([step @ step, 2 * (across @ step), across @ across])
        roots = np.roots(quartic.astype(float))
        for s in roots[np.abs(roots.imag) < 1e-4].real.astype(EXACT):
            for _ in range(8):
                place = across + s * step
                distance, height = np.sqrt(place @ place), z + s * dz
                off = np.sqrt((distance - major) ** 2 + height**2)
                slope = ((distance - major) * (place @ step) / distance + height * dz) / off
                s = s - (off - minor) / slope
            if abs(off - minor) < 1e-12 and 0 <= s + start < found[i]:
                found[i] = s + start
    return found


def slow(solid, origins, ways):
    """Ranges (n,) by other formulas, in the longest float there is."""
    way = {"sphere": slow_sphere, "torus": slow_torus}.get(solid.solid_kind, slow_frustum)
    return way(solid, origins.astype(EXACT), ways.astype(EXACT)).astype(float)


def caster_of(solid, lift=1000.0):
    """Of a solid so high above the floor that this is in no beam's way, and the solid there."""
    lifted = solid.moved([0, 0, lift - solid.bounds[0][2]])
    return primfit.RayCaster(primfit.World([lifted])), lifted


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_ranges_are_those_of_the_closed_form(kind, seed):
    rng = np.random.default_rng(seed)
    caster, solid = caster_of(solid_of(kind, rng))
    origins, ways = beams_at(solid, rng, 60 if kind == "torus" else 20_000)
    ranges, ids = caster.cast(origins, ways)
    is_met = ids == 0
    expected = slow(solid, origins, ways)
    assert is_met.sum() > 0.05 * len(ways)
    np.testing.assert_array_equal(is_met, np.isfinite(expected))
    assert np.abs(ranges[is_met] - expected[is_met]).max() < 1e-9


@settings(max_examples=100, deadline=None)
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1), far=st.sampled_from([1, 1e3]))
def test_ranges_end_on_the_surface(kind, seed, far):
    rng = np.random.default_rng(seed)
    caster, solid = caster_of(solid_of(kind, rng))
    _, ways = beams_at(solid, rng, 500)
    origins = solid.center + 0.5 * rng.normal(size=(500, 3)) - far * ways
    ranges, ids = caster.cast(origins, ways)
    ends = (origins + ranges[:, None] * ways)[ids == 0]
    off = solid.surfaces(ends)[0].max(axis=1)
    assert np.abs(off).max(initial=0.0) < 1e-12 * (1000.0 + far)


def rims(solid, rng, n):
    """Points (n, 3) on the edges of a cylinder or cone."""
    height, radius = np.array(solid.circles)[rng.integers(0, 2, n)].T
    helper = np.cross(solid.axis, rng.normal(size=(n, 3)))
    out = helper / np.linalg.norm(helper, axis=1, keepdims=True)
    return solid.center + height[:, None] * solid.axis + radius[:, None] * out


@settings(max_examples=100, deadline=None)
@given(
    kind=st.sampled_from(["cylinder", "cone", "frustum"]),
    seed=st.integers(0, 2**32 - 1),
    scale=st.sampled_from([1e-3, 1.0, 30.0]),
)
def test_no_beam_aimed_at_a_rim_leaks(kind, seed, scale):
    rng = np.random.default_rng(seed)
    solid = solid_of(kind, rng)
    values = solid.to_dict() | {"height": solid.height * scale, "radius": solid.radius * scale}
    if kind == "frustum":
        values["top_radius"] = solid.top_radius * scale
    caster, solid = caster_of(primfit.Solid.from_dict(values), 1000.0 * scale)
    targets = rims(solid, rng, 2000)
    low, high = solid.circles[0][0], solid.circles[1][0]
    within = solid.center + rng.uniform(0.99 * low, 0.9 * high, (2000, 1)) * solid.axis
    ways = targets - within
    lengths = np.linalg.norm(ways, axis=1)
    ranges, ids = caster.cast(within, ways)
    assert (ids == 0).all()
    # Grazing a side multiplies the rounding of places.
    np.testing.assert_allclose(ranges, lengths, rtol=1e-8, atol=1e-11)
    # From outside, towards a point behind the rim by a billionth: in through the cap or the side.
    inner = targets + 1e-9 * (solid.center - targets)
    sides = rng.normal(size=(2000, 3))
    origins = inner + 8.0 * scale * sides / np.linalg.norm(sides, axis=1, keepdims=True)
    ranges, ids = caster.cast(origins, inner - origins)
    assert (ids == 0).all()
    assert (ranges <= np.linalg.norm(inner - origins, axis=1) + 1e-9 * scale).all()


def test_no_beam_leaves_a_room_with_round_solids():
    rng = np.random.default_rng(3)
    solids = [
        primfit.Cylinder(0.2, 0.5, (0.5, 0.5)),
        primfit.Cone(0.3, 0.6, (1.5, 0.5)),
        primfit.Torus(0.25, 0.08, (0.5, 1.5)),
        primfit.Sphere(0.25, (1.5, 1.5)),
    ]
    world = primfit.World(solids, primfit.Arena((2, 2), height=1.0))
    origins = np.tile([1.0, 1.0, 0.4], (20_000, 1))
    targets = np.concatenate([rims(solid, rng, 5000) for solid in solids[:2]])
    targets = np.concatenate([targets, rng.uniform(0, 2, (10_000, 3)) * [1, 1, 0]])
    ranges, ids = primfit.RayCaster(world).cast(origins, targets - origins)
    assert np.isfinite(ranges).all()
    # What is at the floor is met there at the latest.
    assert (ranges <= np.linalg.norm(targets - origins, axis=1) * (1 + 1e-9))[10_000:].all()
    assert set(ids) == {-3, -2, 0, 1, 2, 3}


@pytest.mark.parametrize(
    ("solid", "origin", "way", "expected"),
    [
        (primfit.Cylinder(0.5, 2.0, (0, 0, 5)), (0, 0, 8), (0, 0, -1), 2.0),
        (primfit.Cylinder(0.5, 2.0, (0, 0, 5)), (0.5, 0, 8), (0, 0, -1), 2.0),
        (primfit.Cylinder(0.5, 2.0, (0, 0, 5)), (-2, 0, 6), (1, 0, 0), 1.5),
        (primfit.Cylinder(0.5, 2.0, (0, 0, 5)), (0, 0, 5), (3, 0, 0), 0.5),
        (primfit.Cylinder(0.5, 2.0, (0, 0, 5)), (-0.5, 0, 5), (1, 0, 0), 0.0),
        (primfit.Cone(1.0, 1.0, (0, 0, 5)), (0, 0, 9), (0, 0, -1), 3.5),
        (primfit.Cone(1.0, 1.0, (0, 0, 5)), (-3, 0, 5), (1, 0, 0), 2.5),
        # Along the side of the cone, and parallel to it within.
        (primfit.Cone(1.0, 1.0, (0, 0, 5)), (-2, 0, 3.5), (1, 0, 1), np.sqrt(2)),
        (primfit.Cone(1.0, 1.0, (0, 0, 5)), (0, 0, 4.75), (1, 0, 1), 0.375 * np.sqrt(2)),
        (primfit.Sphere(1.0, (0, 0, 5)), (0, 0, 5), (0, 1, 0), 1.0),
        (primfit.Sphere(1.0, (0, 0, 5)), (-4, 0, 5), (2, 0, 0), 3.0),
        (primfit.Torus(1.0, 0.25, (0, 0, 5)), (-4, 0, 5), (1, 0, 0), 2.75),
        (primfit.Torus(1.0, 0.25, (0, 0, 5)), (0, 0, 5), (1, 0, 0), 0.75),
        (primfit.Torus(1.0, 0.25, (0, 0, 5)), (1, 0, 5), (0, 0, 1), 0.25),
        (primfit.Torus(1.0, 0.25, (0, 0, 5)), (0, 0, 9), (0, 0, -1), 9.0),
    ],
)
def test_by_hand(solid, origin, way, expected):
    ranges, _ = primfit.RayCaster(primfit.World([solid])).cast([origin], [way])
    assert ranges[0] == pytest.approx(expected, abs=1e-12)


def test_a_mesh_of_many_sides_is_nearly_the_same():
    rng = np.random.default_rng(5)
    for kind in KINDS:
        solid = solid_of(kind, rng)
        solid = solid.moved([0, 0, -solid.bounds[0][2]])
        mesh = primfit.RayCaster(solid.to_mesh(1024))
        origins = solid.center + 5.0 * rng.normal(size=(3000, 3))
        ways = solid.vertices[rng.integers(0, len(solid.vertices), 3000)] - origins
        ways = ways + 0.3 * (solid.center - origins - ways)
        mine, ids = primfit.RayCaster(primfit.World([solid])).cast(origins, ways)
        theirs, _ = mesh.cast(origins, ways)
        both = (ids == 0) & np.isfinite(theirs)
        assert both.sum() > 500
        assert np.median(np.abs(mine - theirs)[both]) < 2e-4


def test_same_bits_in_any_order_and_on_any_threads():
    rng = np.random.default_rng(7)
    solids = [solid_of(KINDS[i % 5], rng).moved(5 * rng.normal(size=3)) for i in range(60)]
    boxes = [primfit.Polyhedron.box(0.3, 0.2, 0.1, center=rng.normal(size=3)) for _ in range(60)]
    world = primfit.World([*solids, *boxes])
    caster = primfit.RayCaster(world)
    lidar = primfit.Lidar(64, 0.6, 256, 0.6)
    pose = np.eye(4)
    pose[:3, 3] = -20.0, 0.1, 0.2
    ways, ranges, ids = caster.cast_beams([pose], lidar.directions.reshape(-1, 3))
    origins = np.tile(pose[:3, 3], (len(ways), 1))
    order = rng.permutation(len(ways))
    for n_jobs in (1, 2):
        alone = pickle.loads(pickle.dumps(caster)).cast(origins[order], ways[order], n_jobs)
        np.testing.assert_array_equal(alone[0], ranges[order])
        np.testing.assert_array_equal(alone[1], ids[order])
    assert repr(pickle.loads(pickle.dumps(caster))) == repr(caster)
    assert repr(caster) == "RayCaster(722 triangles, 60 round solids)"
    # Each solid by itself, the nearest of all.
    each = np.stack(
        [primfit.RayCaster(primfit.World([solid])).cast(origins, ways) for solid in world.solids]
    )
    is_own = each[:, 1] == 0
    np.testing.assert_array_equal(
        np.where(is_own, each[:, 0], np.inf).min(axis=0)[ids >= 0], ranges[ids >= 0]
    )
    assert len(set(ids[ids >= 0])) > 20


def test_a_scan_knows_what_it_met():
    world = primfit.World(
        [primfit.Cylinder(0.2, 0.3, (0.5, 0.5)), primfit.Prism.regular(4, 0.3, center=(1.5, 1.5))],
        primfit.Arena((2, 2)),
    )
    scan = primfit.scan(world, primfit.grid_path(world, 0.5, rng=1), rng=1)
    assert set(scan.solid_index) == {-3, -2, -1, 0, 1}
    own = scan.points[(scan.solid_index == 0) & scan.is_return]
    distance = np.hypot(*(own[:, :2] - [0.5, 0.5]).T)
    np.testing.assert_allclose(distance, 0.2, atol=1e-12)


def test_incidence_on_a_round_solid_widens_the_noise():
    world = primfit.World([primfit.Cylinder(0.5, 2.0, (0, 0))])
    lidar = primfit.Lidar(
        1, 0.1, 401, 0.4, max_range=20.0, beam_divergence=0.001, mount=(0, 0, 1), detection_range=20
    )
    scan = primfit.scan(world, (-3.0, 0.0, 0.0), lidar, rng=1)
    own = (scan.solid_index == 0) & scan.is_return
    bearing = np.arctan2(scan.directions[own, 1], scan.directions[own, 0])
    # sin(incidence) over 3 m is sin(bearing) over the radius.
    incidence = np.arcsin(3.0 * np.abs(np.sin(bearing)) / 0.5)
    expected = lidar.noise_at(scan.true_ranges[own], incidence)
    clear = ~scan.is_mixed[own] & (incidence < 1.0)
    assert clear.sum() > 50
    np.testing.assert_allclose(scan.sigma[own][clear], expected[clear], rtol=0.01, atol=2e-5)
    assert not scan.is_mixed[own][incidence < 1.0].any()
