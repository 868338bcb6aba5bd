"""One plane by RANSAC: hypotheses, their support, the cluster, the refit (Algorithm 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import Bools, Floats, Ints, as_vector, number, turn
from primfit.clouds.clustering import dbscan
from primfit.geometry.products import dot, dots
from primfit.planes.plane import axes_of

_Z = np.array([0.0, 0.0, 1.0])
_MAX_REFITS = 12
"""Refits after which a plane is taken as it is; two or three are usual."""

_GRAZING = 0.1
"""Sine of the angle between beam and plane below which a beam counts as along the plane."""

_HYPOTHESES_AT_ONCE = 128
_MISS = 0.001
"""Chance to miss a plane with the best one's share of the points, at which drawing stops."""

_LOCAL_LUCK = 0.3
"""Chance, assumed low, that the neighbours of a point on a plane are on it too."""


@dataclass(frozen=True)
class Orientation:
    """Which planes are wanted.

    Made by `Orientation.of`. A plane is admitted when the angle between its normal and `axis` is
    between `low` and `high`, radians.
    """

    axis: Floats
    low: float
    high: float

    @classmethod
    def of(cls, orientation: Any, max_angle: float | None = None) -> Orientation:
        """From "vertical", "horizontal", "any", or the axis (3,) of the normal.

        Parameters
        ----------
        orientation : str, (3,) or Orientation
            "vertical" planes contain the z axis, the normal of "horizontal" ones is the z axis.
        max_angle : float or None, radians
            How far the normal may be off; None for 0.

        Raises
        ------
        ValueError
            When it is neither, or the axis is zero.
        """
        if isinstance(orientation, Orientation):
            return orientation
        off = 0.0 if max_angle is None else number("max_angle", max_angle, low=0.0)
        turn("max_angle", off)
        if isinstance(orientation, str):
            names = {
                "vertical": cls(_Z, np.pi / 2 - off, np.pi / 2),
                "horizontal": cls(_Z, 0.0, off),
                "any": cls(_Z, 0.0, np.pi / 2),
            }
            if orientation not in names:
                raise ValueError(
                    f'orientation must be "vertical", "horizontal", "any" or an axis (3,), '
                    f"not {orientation!r}"
                )
            return names[orientation]
        axis = as_vector("orientation", orientation, 3)
        if not axis.any():
            raise ValueError("orientation must not be a zero axis")
        return cls(axis / math.sqrt(dot(axis, axis)), 0.0, off)

    @property
    def is_upright(self) -> bool:
        """Whether only planes that contain the axis, or nearly so, are wanted."""
        return self.low > 0.0

    @cached_property
    def normal_space(self) -> Floats:
        """Orthonormal rows that span the normals: 1 for a given one, 2 for planes along an axis."""
        if self.high == 0.0:
            return self.axis[None]
        return axes_of(self.axis) if self.low == np.pi / 2 else np.eye(3)

    def admits(self, normals: ArrayLike) -> Bools:
        """Which of the unit normals (k, 3) are wanted."""
        cosine = np.abs((np.asarray(normals) * self.axis).sum(axis=-1))
        # Rounding must not refuse a plane of exactly the wanted direction.
        return (cosine >= np.cos(self.high) - 1e-12) & (cosine <= np.cos(self.low) + 1e-12)


@dataclass(frozen=True, eq=False)
class NoisyPoints:
    """Points as plane detection looks at them.

    Attributes
    ----------
    points : (n, 3) float64, metres
    directions : (n, 3) float64 or None
        Unit directions of the beams; None when distances shall be perpendicular.
    sigma : (n,) float64, metres
        Standard deviation of the distances; positive.
    limit : (n,) float64, metres
        Greatest distance of an inlier.
    """

    points: Floats
    directions: Floats | None
    sigma: Floats
    limit: Floats

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: Ints) -> NoisyPoints:
        """Some of the points."""
        directions = None if self.directions is None else self.directions.take(rows, axis=0)
        return NoisyPoints(
            self.points.take(rows, axis=0), directions, self.sigma.take(rows), self.limit.take(rows)
        )

    @cached_property
    def typical_sigma(self) -> float:
        """Median of `sigma`, metres."""
        return float(np.median(self.sigma))

    @cached_property
    def typical_limit(self) -> float:
        """Median of `limit`, metres."""
        return float(np.median(self.limit))

    @cached_property
    def stretched_beams(self) -> Floats | None:
        """Directions in lengths of `limit` (n, 3): so a limit for each point is one for all."""
        return None if self.directions is None else self.directions * self.limit[:, None]

    def residuals(self, equation: Floats) -> Floats:
        """Distance of each point to a plane (n,): along its beam, or perpendicular without beams.

        A plane that the beam meets from behind, or never, is infinitely far.
        """
        return _primfit.residuals(self.points, self.directions, equation)

    def feet(self, equation: Floats) -> Floats:
        """Where each beam meets a plane, or the foot of the perpendicular without beams (n, 3).

        NaN where the residual is infinite.
        """
        distance = self.residuals(equation)[:, None]
        if self.directions is None:
            return self.points - distance * equation[:3]
        return self.points + np.where(np.isfinite(distance), distance, np.nan) * self.directions


@dataclass(frozen=True, eq=False)
class PlaneModel:
    """A plane as it was fitted.

    Attributes
    ----------
    equation : (4,) float64
        ``[a, b, c, d]`` with a unit normal, towards the sensor where that is known.
    covariance : (4, 4) float64
        Of the equation; rank 3, or less for a constrained orientation.
    rms : float, metres
        Of the residuals of its inliers.
    """

    equation: Floats
    covariance: Floats
    rms: float


@dataclass(frozen=True, eq=False)
class Nearby:
    """Where the further points of a local sample come from.

    Attributes
    ----------
    points : (n, 3) float64, metres
    tree : PointTree
        Of these points.
    low, high : float, metres
        Least and greatest distance from the first point at which one is looked for.
    """

    points: Floats
    tree: _primfit.PointTree
    low: float
    high: float


def draw_hypotheses(
    cloud: NoisyPoints,
    n: int,
    orientation: Orientation,
    rng: np.random.Generator,
    near: Nearby | None = None,
) -> Floats:
    """Plane equations (<= n, 4) through random points; degenerate samples are skipped.

    A sample is three points, two for planes along an axis and one for a given normal. With `near`
    it is local: each further point is the nearest to a random place around the first, at a
    distance drawn log-uniformly. Without, all are drawn from the whole cloud.
    """
    first = cloud.points[rng.integers(len(cloud), size=n)]
    others = []
    for _ in range(len(orientation.normal_space) - 1):
        if near is None:
            others.append(cloud.points[rng.integers(len(cloud), size=n)])
            continue
        way = rng.normal(size=(n, 3))
        way *= np.exp(rng.uniform(np.log(near.low), np.log(near.high), (n, 1))) / np.linalg.norm(
            way, axis=1, keepdims=True
        )
        others.append(near.points[near.tree.neighbors(first + way, 1)[0][:, 0]])
    if not others:
        normals = np.broadcast_to(orientation.axis, (n, 3))
    else:
        spans = [other - first for other in others]
        normals = np.cross(spans[0], spans[1] if len(spans) == 2 else orientation.axis)
    lengths = np.linalg.norm(normals, axis=1)
    proper = lengths > 0.0
    normals = normals[proper] / lengths[proper, None]
    offsets = -np.einsum("ij,ij->i", normals, first[proper])
    admitted = orientation.admits(normals)
    return np.ascontiguousarray(np.column_stack([normals, offsets])[admitted])


def best_hypothesis(
    cloud: NoisyPoints, equations: Floats, *, msac: bool, n_jobs: int | None
) -> tuple[Floats, float]:
    """The plane (4,) with the highest score, oriented, and its score; ties to the first.

    With beams, both sides of each plane are tried.
    """
    beams = cloud.stretched_beams
    limit = cloud.typical_limit if beams is None else 1.0
    scores = _primfit.score_planes(cloud.points, equations, limit, beams, msac, n_jobs)
    best = int(np.argmax(scores))
    side = 1.0 if best < len(equations) else -1.0
    return side * equations[best % len(equations)], float(scores[best])


def fit(cloud: NoisyPoints, equation: Floats, orientation: Orientation) -> PlaneModel | None:
    """Least-squares plane of a cloud: along the beams where they are known, else perpendicular.

    It starts from `equation` and keeps its side. Beams nearly along the plane are left out when
    they are the lesser part: they would weigh most, and are often those of a neighbour. None when
    the points do not tell a plane, or tell one that `orientation` does not admit or that most
    beams meet from behind.
    """
    space = orientation.normal_space
    if cloud.directions is not None:
        steep = np.abs(dots(cloud.directions, equation[:3])) > _GRAZING
        if 2 * steep.sum() > len(cloud):
            cloud = cloud.take(np.flatnonzero(steep))
    if cloud.directions is None:
        fitted = _primfit.fit_plane(cloud.points, 1.0 / cloud.sigma**2, space)
    else:
        fitted = _primfit.fit_plane_to_ranges(
            cloud.points, cloud.directions, cloud.sigma, equation, space
        )
    if fitted is None or not orientation.admits(fitted[0][:3]):
        return None
    model, covariance, rms = fitted
    model = np.copysign(1.0, dot(model[:3], equation[:3])) * model
    if 2 * np.isfinite(cloud.residuals(model)).sum() < len(cloud):
        return None
    return PlaneModel(model, covariance, rms)


def find_plane(
    cloud: NoisyPoints,
    orientation: Orientation,
    rng: np.random.Generator,
    *,
    near: Nearby | None,
    eps: float,
    min_points: int,
    max_trials: int,
    msac: bool = True,
    refit: bool = True,
    n_jobs: int | None = None,
) -> tuple[PlaneModel, Ints] | None:
    """The best plane of a cloud and its inliers: the largest cluster near it (Algorithm 4).

    Hypotheses are drawn and scored until a plane with the best one's share of the points would
    have been drawn almost surely, `max_trials` at most. With `refit`, the plane is
    fitted to its cluster and the cluster found anew, until neither changes.

    Returns
    -------
    model, inliers : PlaneModel and (m,) int64, or None
        None when no plane has `min_points` inliers.
    """
    best, best_score, n_trials, n_wanted = np.zeros(4), 0.0, 0, float(max_trials)
    n_more = len(orientation.normal_space) - 1
    while n_trials < min(n_wanted, max_trials):
        n = min(_HYPOTHESES_AT_ONCE, max_trials - n_trials)
        equations = draw_hypotheses(cloud, n, orientation, rng, near)
        n_trials += n
        if not len(equations):
            continue
        equation, score = best_hypothesis(cloud, equations, msac=msac, n_jobs=n_jobs)
        if score > best_score:
            best, best_score = equation, score
        share = min(best_score / len(cloud), 1.0 - 1e-9)
        luck = share * (share**n_more if near is None else _LOCAL_LUCK**n_more)
        n_wanted = np.log(_MISS) / np.log1p(-luck) if luck else max_trials
    if not best_score:
        return None
    return settle(cloud, best, orientation, eps, min_points, n_refits=_MAX_REFITS if refit else 0)


def settle(
    cloud: NoisyPoints,
    equation: Floats,
    orientation: Orientation,
    eps: float,
    min_points: int,
    n_refits: int,
) -> tuple[PlaneModel, Ints] | None:
    """The plane that is left when fit and largest cluster have settled, with its inliers."""
    inliers = _largest_cluster(cloud, equation, eps)
    model: PlaneModel | None = None
    for _ in range(n_refits):
        model = fit(cloud.take(inliers), equation, orientation)
        if model is None:
            return None
        equation, before = model.equation, inliers
        inliers = _largest_cluster(cloud, equation, eps)
        if np.array_equal(inliers, before):
            break
    if len(inliers) < max(min_points, 1):
        return None
    if model is None:
        rms = float(np.sqrt(np.mean(cloud.take(inliers).residuals(equation) ** 2)))
        model = PlaneModel(equation, np.full((4, 4), np.nan), rms)
    return model, inliers


def _largest_cluster(cloud: NoisyPoints, equation: Floats, eps: float) -> Ints:
    inliers = np.flatnonzero(np.abs(cloud.residuals(equation)) <= cloud.limit)
    if not len(inliers):
        return inliers
    labels = dbscan(cloud.points[inliers], eps, min_samples=1)
    return inliers[labels == np.bincount(labels).argmax()]
