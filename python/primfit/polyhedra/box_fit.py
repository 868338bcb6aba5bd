"""One box fitted to planes that are its faces only nearly, and how well it fits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from primfit._check import Floats, Ints, check_within
from primfit.clouds.foreign import PointsLike, points_of
from primfit.geometry.products import dots, lengths_of, product, solved, turned_by
from primfit.planes.plane import Plane, planes_of
from primfit.polyhedra.adjacency import clear_of
from primfit.polyhedra.ends import end_of
from primfit.solids.polyhedron import Polyhedron

_BLUR = 1.5
"""Greatest deviation of points along a face over that across it: of a sensor whose errors are along
its beams, up to an incidence of 56 degrees."""

_EDGE = 3.0
"""Deviations from the plane of another face within which points are not fitted: one in 400 of its
points lies beyond. The turns of a box of 0.6 x 0.4 x 0.3 m with 10 mm of noise had deviations of
3.91, 3.18 and 3.35 mrad with 4, of 3.55, 3.13 and 3.06 with 3, and no less with 2."""

_STEPS = 100
"""Most steps to the best turn; ten are enough but where faces are as thick as they are wide."""


@dataclass(frozen=True, eq=False)
class BoxFit:
    """A box, and how well it fits.

    Attributes
    ----------
    box : Polyhedron
    faces : tuple of int
        Face of each plane: 0 and 1 for the lower and upper end of the box's first axis, 2 and 3
        of its second, 4 and 5 of its third.
    rms : float, metres
        Root mean square distance of the points of all planes to their faces.
    face_rms : (k,) float64, metres
        The same for each plane.
    tilts : (k,) float64, radians
        Angle between each plane, as it was found alone, and its face.
    angles : (k, k) float64, radians
        Angle between each two planes, as they were found alone, where their faces are at right
        angles; NaN where they are parallel.
    observed : tuple of bool
        Which of the six faces have a plane. Others are where the planes across them end: the points
        there are taken to be as dense as elsewhere near the end, which has no bias then, as the
        outermost point has. What is hidden of a face is not known of.
    end_sigmas : (2, 3) float64, metres
        Standard deviation of the lower and upper end of each axis: where a face was observed, from
        the noise of its points, else from how far its neighbours tell their end.
    """

    box: Polyhedron
    faces: tuple[int, ...]
    rms: float
    face_rms: Floats
    tilts: Floats
    angles: Floats
    observed: tuple[bool, ...]
    end_sigmas: Floats

    def __repr__(self) -> str:
        off = np.degrees(np.nanmax(np.abs(self.angles - np.pi / 2)))
        size = " x ".join(f"{each:.4f}" for each in np.atleast_1d(self.box.size))
        return (
            f"BoxFit({size} m, {sum(self.observed)} of 6 faces observed, rms "
            f"{1e3 * self.rms:.2f} mm, right angles off by up to {off:.2f} deg)"
        )


def fit_box(planes: Iterable[Plane], points: PointsLike) -> BoxFit:
    """The box of least squares whose faces the planes are.

    All faces are turned together, each to its nearest axis, so that the sum of the squared
    distances of all points to their faces is least. The planes need not be at right angles: what
    a sensor that bends them costs is reported.

    Parameters
    ----------
    planes : iterable of Plane
        Two to six, at least two of them nearly at right angles; at most one for each face. Three
        that meet, as in `Detection.shells`, tell the whole box; without opposite planes it ends
        where their outlines do.
    points : (n, 3) float64, metres, or whatever `as_cloud` takes
        The cloud of whose rows `inliers` are.

    Returns
    -------
    BoxFit

    Raises
    ------
    ValueError
        When the planes are fewer, all parallel, or two would be one face.

    Notes
    -----
    Sizes are along the box's own axes. Its turn is told by the distances of points to their faces
    alone. Rims of length L, with d**-2 points a square metre, tell the turn about a face's normal
    only to about 7 d**2 / L**2, even where they are sharp: less than the planes do, unless the
    noise is more than twice the spacing d. Along other axes than its own the box is longer by what
    it is turned too far, whichever way: of 0.6 x 0.4 x 0.3 m, three faces, 2000 points a m2 and
    10 mm of noise, by 2 to 3 mm.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> size, face = np.array([3.0, 2.0, 1.0]), np.arange(3000) % 3
    >>> points = size * np.random.default_rng(1).random((3000, 3))
    >>> points[np.arange(3000), face] = 0.0
    >>> fit = primfit.fit_box(primfit.detect_planes(points), points)
    >>> np.round(fit.box.vertices.max(axis=0), 1).tolist(), sum(fit.observed)
    ([3.0, 2.0, 1.0], 3)
    """
    cloud = points_of("points", points, finite=False)
    check_within("points", cloud)
    chosen = planes_of(planes, len(cloud))
    if not 2 <= len(chosen) <= 6:
        raise ValueError(f"planes must be 2 to 6, the faces of a box, not {len(chosen)}")
    normals = np.array([plane.equation[:3] for plane in chosen])
    clouds = [cloud[plane.inliers] for plane in chosen]
    if not all(np.isfinite(own).all() for own in clouds):
        raise ValueError("points must be finite where planes have their inliers")
    try:
        frame, faces, ends, sigmas = box_through(normals, clouds)
    except FloatingPointError as error:
        raise ValueError(f"planes and points tell no box: {error}") from None
    axes = faces // 2
    squares = [
        (dots(own, frame[axis]) - end) ** 2
        for axis, own, end in zip(axes, clouds, ends[faces % 2, axes], strict=True)
    ]
    cosines = np.clip(np.abs(product(normals, normals.T)), 0.0, 1.0)
    box = Polyhedron.box(
        *(ends[1] - ends[0]),
        center=product(ends.mean(axis=0)[None], frame)[0],
        quat_xyzw=Rotation.from_matrix(frame.T).as_quat(),
    )
    return BoxFit(
        box=box,
        faces=tuple(faces.tolist()),
        rms=float(np.sqrt(np.concatenate(squares).mean())),
        face_rms=np.sqrt([each.mean() for each in squares]),
        tilts=np.arccos(np.clip(np.abs(np.einsum("ki,ki->k", normals, frame[axes])), 0.0, 1.0)),
        angles=np.where(axes[:, None] == axes, np.nan, np.arccos(cosines)),
        observed=tuple(face in faces for face in range(6)),
        end_sigmas=sigmas,
    )


def box_through(normals: Floats, clouds: list[Floats]) -> tuple[Floats, Ints, Floats, Floats]:
    """The box of least squares of the points (n, 3) on each face, whose planes have these normals.

    Returns
    -------
    frame : (3, 3) float64
        Its axes, in rows.
    faces : (k,) int64
        Which of its faces each is, as `BoxFit.faces`.
    ends, sigmas : (2, 3) float64, metres
        Of the box along its axes, and their standard deviations.

    Raises
    ------
    ValueError
        When all are parallel, or two are one face.
    FloatingPointError
        When the points of all faces are on a line.
    """
    frame = _start(normals, np.array([len(each) for each in clouds]))
    axes = np.abs(product(normals, frame.T)).argmax(axis=1)
    inner = _clear(normals, clouds)
    # A plane's best offset is its points' mean, so that only their scatter tells the turn.
    middles = np.array([each.mean(axis=0) for each in inner])
    scatters = np.zeros((3, 3, 3))
    for axis, own, middle in zip(axes, inner, middles, strict=True):
        scatters[axis] += np.einsum("ni,nj->ij", own - middle, own - middle)
    frame = _turned(frame, scatters)

    widths = [float(dots(own, frame[axis]).std()) for own, axis in zip(inner, axes, strict=True)]
    places = [product(own, frame.T) for own in clouds]
    told = [[_end(places, axes, widths, k, sign) for k in range(3)] for sign in (-1.0, 1.0)]
    ends, sigmas = np.moveaxis(np.array(told), 2, 0)
    along = np.einsum("ki,ki->k", middles, frame[axes])
    is_upper = (along > ends.mean(axis=0)[axes]).astype(int)
    ends[is_upper, axes] = along
    sigmas[is_upper, axes] = [
        width / np.sqrt(len(own)) for width, own in zip(widths, inner, strict=True)
    ]
    faces = 2 * axes + is_upper
    if len(set(faces.tolist())) < len(faces) or (ends[0] >= ends[1]).any():
        raise ValueError("planes must be different faces of one box, but two are the same")
    return frame, faces, ends, sigmas


def _clear(normals: Floats, clouds: list[Floats]) -> list[Floats]:
    """The points of each face away from the others."""
    offsets = [dots(own, normal) for normal, own in zip(normals, clouds, strict=True)]
    equations = np.column_stack([normals, [-float(each.mean()) for each in offsets]])
    rms = np.array([float(each.std()) for each in offsets])
    others = ~np.eye(len(clouds), dtype=bool)
    return [
        clear_of(own, equations[other], rms[other], _EDGE)
        for own, other in zip(clouds, others, strict=True)
    ]


def _turned(frame: Floats, scatters: Floats) -> Floats:
    """Axes, in rows, near others, along which the scatters (3, 3, 3) of each are least in all."""
    scatters = scatters / np.trace(scatters.sum(axis=0))

    def spread(axes: Floats) -> float:
        return float(np.einsum("ai,aij,aj", axes, scatters, axes))

    least = spread(frame)
    for _ in range(_STEPS):
        # By Gauss and Newton: an axis f moves by the turn's cross product with it.
        pulls = np.einsum("aij,aj->ai", scatters, frame)
        slope = np.cross(frame, pulls).sum(axis=0)
        crosses = np.cross(np.eye(3)[None], frame[:, None])
        information = np.einsum("aki,aij,alj->kl", crosses, scatters, crosses)
        step = -solved(information, slope)
        if not np.isfinite(step).all():
            raise FloatingPointError("all points are on a line")
        turned = product(frame, turned_by(step).T)
        after = spread(turned)
        if not after < least:
            break
        frame, least = turned, after
    return frame


def _end(
    places: list[Floats], axes: Ints, widths: list[float], k: int, sign: float
) -> tuple[float, float]:
    """Where the faces across the others end along an axis, or against it; standard deviation.

    Where they differ by more than their deviations tell, these grow (Birge, The calculation of
    errors by the method of least squares, 1932).
    """
    told = [
        end_of(sign * own[:, k], own[:, 3 - axis - k], _BLUR * width)
        for own, axis, width in zip(places, axes, widths, strict=True)
        if axis != k
    ]
    ends, sigmas = np.array(told).T
    sigmas = np.maximum(sigmas, np.finfo(float).eps * np.abs(ends) + np.finfo(float).tiny)
    weights = sigmas.min() ** 2 / sigmas**2
    end = float((weights * ends).sum() / weights.sum())
    misfit = float((weights * (ends - end) ** 2).sum()) / sigmas.min() ** 2
    sigma = float(sigmas.min() / np.sqrt(weights.sum()))
    return sign * end, sigma * max(1.0, np.sqrt(misfit / max(1, len(told) - 1)))


def _start(normals: Floats, n_points: Floats) -> Floats:
    """Right-handed orthonormal rows (3, 3) near the normals, the one with most points first."""
    first = normals[n_points.argmax()]
    cosines = dots(normals, first)
    across = np.flatnonzero(np.abs(cosines) < np.sqrt(0.5))
    if not len(across):
        raise ValueError("planes must be at right angles, nearly, but all are parallel")
    other = across[n_points[across].argmax()]
    second = normals[other] - cosines[other] * first
    second /= lengths_of(second)
    return np.stack([first, second, np.cross(first, second)])
