"""One box fitted to planes that are its faces only nearly, and how well it fits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from primfit._check import Floats, Ints, as_rows, check_within
from primfit.planes.plane import Plane, planes_of
from primfit.worlds.polyhedron import Polyhedron

_STRIPS = 24
"""Into how many a face is cut, at most, each of which tells where it ends."""


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
        Which of the six faces have a plane. Where both faces of an axis have none, or one, the box
        ends where the outlines of the planes do.
    """

    box: Polyhedron
    faces: tuple[int, ...]
    rms: float
    face_rms: Floats
    tilts: Floats
    angles: Floats
    observed: tuple[bool, ...]

    def __repr__(self) -> str:
        off = np.degrees(np.nanmax(np.abs(self.angles - np.pi / 2)))
        size = " x ".join(f"{each:.4f}" for each in np.atleast_1d(self.box.size))
        return (
            f"BoxFit({size} m, {sum(self.observed)} of 6 faces observed, rms "
            f"{1e3 * self.rms:.2f} mm, right angles off by up to {off:.2f} deg)"
        )


def fit_box(planes: Iterable[Plane], points: ArrayLike) -> BoxFit:
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
    points : (n, 3) float64, metres
        The cloud of whose rows `inliers` are.

    Returns
    -------
    BoxFit

    Raises
    ------
    ValueError
        When the planes are fewer, all parallel, or two would be one face.

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
    cloud = as_rows("points", points, 3, finite=False)
    check_within("points", cloud)
    chosen = planes_of(planes, len(cloud))
    if not 2 <= len(chosen) <= 6:
        raise ValueError(f"planes must be 2 to 6, the faces of a box, not {len(chosen)}")
    normals = np.array([plane.equation[:3] for plane in chosen])
    clouds = [cloud[plane.inliers] for plane in chosen]
    if not all(np.isfinite(own).all() for own in clouds):
        raise ValueError("points must be finite where planes have their inliers")
    try:
        frame, faces, ends = box_through(normals, clouds)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"planes and points tell no box: {error}") from None
    axes = faces // 2
    squares = [
        (own @ frame[axis] - end) ** 2
        for axis, own, end in zip(axes, clouds, ends[faces % 2, axes], strict=True)
    ]
    cosines = np.clip(np.abs(normals @ normals.T), 0.0, 1.0)
    box = Polyhedron.box(
        *(ends[1] - ends[0]),
        center=ends.mean(axis=0) @ frame,
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
    )


def box_through(normals: Floats, clouds: list[Floats]) -> tuple[Floats, Ints, Floats]:
    """The box of least squares of the points (n, 3) on each face, whose planes have these normals.

    Returns
    -------
    frame : (3, 3) float64
        Its axes, in rows.
    faces : (k,) int64
        Which of its faces each is, as `BoxFit.faces`.
    ends : (2, 3) float64, metres
        Of the box along its axes; where there is no face, those of the points.

    Raises
    ------
    ValueError
        When all are parallel, or two are one face.
    """
    frame = _start(normals, np.array([len(each) for each in clouds]))
    axes = np.abs(normals @ frame.T).argmax(axis=1)
    # A plane's best offset is its points' mean, so that only their scatter tells the turn.
    middles = np.array([each.mean(axis=0) for each in clouds])
    scatters = np.zeros((3, 3, 3))
    for axis, own, middle in zip(axes, clouds, middles, strict=True):
        scatters[axis] += (own - middle).T @ (own - middle)
    scatters /= np.trace(scatters.sum(axis=0))
    values, vectors = np.linalg.eigh(scatters)
    roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2)

    def residuals(turn: Floats) -> Floats:
        turned = frame @ Rotation.from_rotvec(turn).as_matrix().T
        return np.einsum("aij,aj->ai", roots, turned).ravel()

    solution = least_squares(residuals, np.zeros(3), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    frame = frame @ Rotation.from_rotvec(solution.x).as_matrix().T

    places = [own @ frame.T for own in clouds]
    ends = np.stack([_end(places, axes, k) for k in range(3)], axis=1)
    along = np.einsum("ki,ki->k", middles, frame[axes])
    is_upper = along > ends.mean(axis=0)[axes]
    ends[is_upper.astype(int), axes] = along
    faces = 2 * axes + is_upper
    if len(set(faces.tolist())) < len(faces) or (ends[0] >= ends[1]).any():
        raise ValueError("planes must be different faces of one box, but two are the same")
    return frame, faces, ends


def _end(places: list[Floats], axes: Ints, k: int) -> Floats:
    """Lower and upper end along an axis of the faces across the others: medians of strips."""
    ends = []
    for own, axis in zip(places, axes, strict=True):
        if axis != k:
            across = np.argsort(own[:, 3 - axis - k], kind="stable")
            for strip in np.array_split(across, int(np.clip(np.sqrt(len(own)) / 3, 1, _STRIPS))):
                ends.append([own[strip, k].min(), own[strip, k].max()])
    return np.median(ends, axis=0)


def _start(normals: Floats, n_points: Floats) -> Floats:
    """Right-handed orthonormal rows (3, 3) near the normals, the one with most points first."""
    first = normals[n_points.argmax()]
    cosines = np.abs(normals @ first)
    across = np.flatnonzero(cosines < np.sqrt(0.5))
    if not len(across):
        raise ValueError("planes must be at right angles, nearly, but all are parallel")
    second = normals[across[n_points[across].argmax()]]
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])
