"""Sensors as they are: footprints, noise of range and incidence, lost returns, motion in a turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from primfit import _primfit
from primfit._check import Bools, Floats, Ints
from primfit.scans.casting import surfaces_of
from primfit.sensors.lidar import Lidar
from primfit.solids.round import Round
from primfit.worlds.world import World

RINGS, RAYS = 2, 8
"""Rays of a footprint: rings at the places of Gauss and Legendre in the square of the radius, and
rays of each. Their mean is that over the disc for polynomials of degree 7, so range and its square
on a plane are exact; an edge is met by sixteenths."""

_ASKEW = 0.25
"""Share of the angle between rays by which rings are turned, so that no two rays reach an upright
or a level edge together."""

_RAYS_AT_ONCE = 1 << 18

_LIGHT_NS = 0.299792458
"""Metres that light goes in a nanosecond."""

_FLAT = 1e-9
"""How far from a plane the ends of rays on it may be, as a share of the largest coordinate: a
million times the rounding of float64."""

Turns = Callable[[slice], Floats]
"""Of rows of poses, the true transforms (k, 1 or columns, 4, 4) of the sensor at each column."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What a sensor reads, and the truth about it; see `Scan`."""

    ranges: Floats
    solid_index: Ints
    sigma: Floats
    true_ranges: Floats
    true_points: Floats
    is_mixed: Bools


def read(
    world: World,
    lidar: Lidar,
    turns: Turns,
    n_poses: int,
    seed: int,
    n_jobs: int | None,
    tell: Callable[[int], None],
) -> Readings:
    """The readings of all beams, pose by pose.

    Noise and losses of a beam follow from the seed and its row; each has numbers of its own, so
    that the noise is the same with other losses.
    """
    mesh = _Mesh(world, n_jobs)
    beams = lidar.directions
    rays = footprint(beams, lidar.beam_divergence) if lidar.beam_divergence else None
    noise, losses = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    n_beams = beams.shape[0] * beams.shape[1]
    n_rays = n_beams * (1 if rays is None else 1 + len(rays))
    at_once = max(1, _RAYS_AT_ONCE // n_rays)
    parts = []
    for first in range(0, n_poses, at_once):
        transforms = turns(slice(first, min(first + at_once, n_poses)))[:, None]
        true_ranges, true_points, triangles, axes = mesh.hits(transforms, beams)
        if rays is None:
            told, normals = true_ranges, mesh.normals_at(triangles, true_points)
            is_mixed = np.zeros(len(told), dtype=bool)
        else:
            told, normals, is_mixed = _echo(mesh, transforms, rays, lidar.pulse_length_ns)
        incidence = _incidence(normals, axes)
        is_seen = (told >= lidar.min_range) & (told <= lidar.max_range)
        if lidar.detection_range is not None:
            is_seen &= told <= lidar.detection_range * np.sqrt(np.cos(incidence))
        is_seen &= losses.random(len(told)) >= lidar.dropout
        reach = np.where(is_seen, told, lidar.max_range)
        of_noise = lidar.noise_at(reach, np.where(is_seen, incidence, 0.0))
        readings = reach + of_noise * noise.standard_normal(len(told))
        if lidar.resolution > 0.0:
            readings = np.rint(readings / lidar.resolution) * lidar.resolution
        parts.append(
            Readings(
                ranges=np.where(is_seen, readings, np.inf),
                solid_index=mesh.names[triangles],
                sigma=np.hypot(of_noise, lidar.rounding),
                true_ranges=true_ranges,
                true_points=true_points,
                is_mixed=is_mixed & is_seen,
            )
        )
        tell(min(first + at_once, n_poses))
    return Readings(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    )


def footprint(beams: Floats, divergence: float) -> Floats:
    """Rays (k, ..., 3) that share the disc which a cone about each beam (..., 3) lights evenly.

    Parameters
    ----------
    divergence : float, radians
        Full angle of the cone.
    """
    helper = np.eye(3)[np.argmin(np.abs(beams), axis=-1)]
    across = np.cross(beams, helper)
    across /= np.sqrt((across * across).sum(axis=-1, keepdims=True))
    upward = np.cross(beams, across)
    squares = (1.0 + np.polynomial.legendre.leggauss(RINGS)[0]) / 2.0
    rays = []
    for ring, square in enumerate(squares):
        off = divergence / 2.0 * np.sqrt(square)
        for angle in 2.0 * np.pi * (np.arange(RAYS) + _ASKEW + ring / 2.0) / RAYS:
            side = np.cos(angle) * across + np.sin(angle) * upward
            rays.append(np.cos(off) * beams + np.sin(off) * side)
    return np.stack(rays)


def _echo(
    mesh: _Mesh, transforms: Floats, rays: Floats, pulse_length_ns: float
) -> tuple[Floats, Floats, Bools]:
    """The strongest echo of each footprint.

    Surfaces that the pulse tells apart, by half its length, are echoes of their own; the sensor
    reads the mean range of the one that the most rays meet, of equal ones the nearest.

    Returns
    -------
    ranges : (n,) float64, metres
        inf where no ray meets anything.
    normals : (n, 3) float64
        Of what the nearest ray of the echo meets, where it does; NaN for nothing.
    is_mixed : (n,) bool
        Whether rays of the echo meet more than one surface.
    """
    hits = [mesh.hits(transforms, of_beams) for of_beams in rays]
    ranges, ends, triangles, _ = (np.stack(each, axis=1) for each in zip(*hits, strict=True))
    order = np.argsort(ranges, axis=1, kind="stable")
    ranges = np.take_along_axis(ranges, order, axis=1)
    is_hit = np.isfinite(ranges)
    with np.errstate(invalid="ignore"):
        is_apart = np.diff(ranges, axis=1) > _LIGHT_NS * pulse_length_ns / 2.0
    echo = np.cumsum(np.insert(is_apart, 0, False, axis=1), axis=1)
    size = np.where(is_hit, (echo[:, :, None] == echo[:, None, :]).sum(axis=2), 0)
    rows, best = np.arange(len(ranges)), np.argmax(size, axis=1)
    is_in = is_hit & (echo == echo[rows, best, None])
    count = is_in.sum(axis=1)
    total = np.where(is_in, ranges, 0.0).sum(axis=1)
    told = np.where(count > 0, total / np.maximum(count, 1), np.inf)
    surface = triangles[rows, order[rows, best]]
    ends = np.take_along_axis(ends, order[:, :, None], axis=1)
    normals = mesh.normals_at(surface, ends[rows, best])
    off = mesh.distances(surface, normals, ends, best)
    is_mixed = (is_in & (np.abs(off) > _FLAT * mesh.size)).any(axis=1)
    return told, normals, is_mixed


def _incidence(normals: Floats, directions: Floats) -> Floats:
    """Angles (n,) between beams and the normals of what they meet, radians; NaN for nothing."""
    cosine = np.abs((normals * directions).sum(axis=1))
    return np.arccos(np.minimum(cosine, 1.0))


class _Mesh:
    """Triangles, then round solids of a world, ready for rays; the last row is for nothing."""

    def __init__(self, world: World, n_jobs: int | None) -> None:
        corners, rows, names, rounds = surfaces_of(world)
        self._caster = _primfit.RayCaster(
            np.ascontiguousarray(corners), np.ascontiguousarray(rows), None, rounds
        )
        self._rounds = [solid for solid in world.solids if isinstance(solid, Round)]
        self._first_round = len(rows)
        self._n_jobs = n_jobs
        self.names = np.append(names, -1)
        a, b, c = (corners[rows[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.sqrt((normals * normals).sum(axis=1, keepdims=True))
        unknown = np.full((len(self._rounds) + 1, 3), np.nan)
        self._normals = np.append(normals / lengths, unknown, axis=0)
        self.size = float(np.abs(corners).max())

    def hits(self, transforms: Floats, beams: Floats) -> tuple[Floats, Floats, Ints, Floats]:
        """Ranges (n,), ends (n, 3), triangles (n,) and directions (n, 3) of beams from poses.

        `transforms` (k, 1, 1 or columns, 4, 4), `beams` (layers, columns, 3); n is all of them.
        """
        x, y, z = np.moveaxis(beams, -1, 0)
        turned = [
            transforms[..., k, 0] * x + transforms[..., k, 1] * y + transforms[..., k, 2] * z
            for k in range(3)
        ]
        ways = np.stack(turned, axis=-1)
        starts = np.broadcast_to(transforms[..., :3, 3], ways.shape)
        ways, starts = (np.ascontiguousarray(each.reshape(-1, 3)) for each in (ways, starts))
        ranges, triangles = self._caster.cast(starts, ways, self._n_jobs)
        is_hit = np.isfinite(ranges)
        ends = starts + np.where(is_hit, ranges, np.nan)[:, None] * ways
        return ranges, ends, triangles, ways

    def normals_at(self, surfaces: Ints, points: Floats) -> Floats:
        """Normals (n, 3) of what is met at points (n, 3); NaN for nothing."""
        normals = self._normals[surfaces]
        for i, solid in enumerate(self._rounds, self._first_round):
            rows = np.flatnonzero(surfaces == i)
            distances, outward = solid.surfaces(points[rows])
            normals[rows] = outward[np.arange(len(rows)), distances.argmax(axis=1)]
        return normals

    def distances(self, surfaces: Ints, normals: Floats, ends: Floats, at: Ints) -> Floats:
        """Distances (n, k) of the ends of rays (n, k, 3) to the surface that one of them meets.

        `at` (n,) says which of them; `normals` (n, 3) are there.
        """
        rows = np.arange(len(ends))
        off: Floats = ((ends - ends[rows, at, None]) * normals[:, None]).sum(axis=2)
        for i, solid in enumerate(self._rounds, self._first_round):
            own = np.flatnonzero(surfaces == i)
            each = solid.surfaces(ends[own].reshape(-1, 3))[0].reshape(len(own), ends.shape[1], -1)
            part = each[np.arange(len(own)), at[own]].argmax(axis=1)
            off[own] = each[np.arange(len(own)), :, part]
        return off
