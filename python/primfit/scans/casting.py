"""Exact ray casting: the first surface that each ray meets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import Floats, Ints, as_rows, check_finite, n_jobs_or_none
from primfit._progress import Progress, reporting
from primfit.sensors.sensor import RangeGate
from primfit.solids.round import Round
from primfit.worlds.world import World

if TYPE_CHECKING:
    Mesh = tuple[ArrayLike, ArrayLike]


_RAYS_AT_ONCE = 1 << 20
"""Rays between two words on the progress."""


class RayCaster:
    """A world or a triangle mesh made ready for rays; built once, cast often.

    The decision on a triangle is that of Woop, Benthin and Wald (JCGT 2013) in float64: a ray at
    an edge or corner between two triangles hits one of them, always. Both sides of a triangle are
    hit; a ray that starts on a surface hits it at range 0, one that starts inside a solid hits it
    from within; a ray within the plane of a triangle passes it. Of equally near triangles the
    first counts. Results are the same bits in any order of rays, on any number of threads and on
    any instruction set.

    Round solids of a world are no triangles: cylinder, cone, sphere and torus are met where the
    closed form says, in float64. The flat ends of a cylinder or cone leave no gap at the rim.

    Which triangles come to a decision is found in a tree of float32 boxes, eight to a node, all of
    whose tests err on the side of a hit (after Wald, Benthin and Boulos: Getting Rid of Packets,
    IRT 2008, and Wald: Fast Construction of SAH-based Bounding Volume Hierarchies, RT 2007). Rays
    that share their origin and are neighbours in direction and in the arrays, as the beams of a
    lidar are, go through it together and are several times as fast. A mesh of a million triangles
    takes about 180 MB, and 212 MB while it is made ready.

    Parameters
    ----------
    mesh_or_world : World or (vertices, triangles)
        Vertices (v, 3) float64 in metres and triangles (t, 3) of their rows.

    Raises
    ------
    ValueError
        When vertices are not finite or a triangle names a vertex that does not exist.

    Examples
    --------
    >>> import primfit
    >>> caster = primfit.RayCaster(primfit.World(arena=primfit.Arena((2, 2))))
    >>> caster.cast([[0.5, 1, 0.1]], [[1, 0, 0]])
    (array([1.5]), array([-2]))
    """

    def __init__(self, mesh_or_world: World | Mesh) -> None:
        if isinstance(mesh_or_world, World):
            corners, rows, names, rounds = surfaces_of(mesh_or_world)
        else:
            try:
                vertices, triangles = mesh_or_world
            except (TypeError, ValueError):
                raise TypeError(
                    "mesh_or_world must be a World or (vertices, triangles), two arrays, not "
                    f"{type(mesh_or_world).__name__} of other content"
                ) from None
            corners, rows = as_rows("vertices", vertices, 3), _as_triangles(triangles)
            names, rounds = None, None
        self._core = _primfit.RayCaster(
            np.ascontiguousarray(corners), np.ascontiguousarray(rows), names, rounds
        )
        self._n_rounds = 0 if rounds is None else len(rounds)

    def __reduce__(self) -> tuple[Any, ...]:
        return _caster_of, self._core.parts()

    def cast(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        n_jobs: int | None = None,
        *,
        progress: Progress = False,
    ) -> tuple[Floats, Ints]:
        """The range of each ray and what it hits.

        Parameters
        ----------
        origins : (n, 3) float64, metres
        directions : (n, 3) float64
            Of any length but zero.
        n_jobs : int or None
            Threads; None for all. The result does not depend on it.
        progress : bool or callable
            True shows a bar; a callable gets the number of rays done and in all.

        Returns
        -------
        ranges : (n,) float64, metres
            Along the normalised direction; inf for nothing.
        ids : (n,) int64
            World: row of the solid, -1 nothing, -2 arena, -3 floor. Mesh: row of the triangle,
            -1 nothing.

        Raises
        ------
        ValueError
            When the arrays differ in length, are not finite, or a direction is zero.
        """
        origins = as_rows("origins", origins, 3, finite=False)
        directions = as_rows("directions", directions, 3, finite=False)
        if len(origins) != len(directions):
            raise ValueError(
                f"directions must have as many rows as origins ({len(origins)}), "
                f"not {len(directions)}"
            )
        n_jobs, n = n_jobs_or_none(n_jobs), len(origins)
        if progress is False:
            return self._core.cast(origins, directions, n_jobs)
        # The core would count bad rows from the first of its share.
        check_finite("origins", origins)
        check_finite("directions", directions)
        _largest_components("directions", directions)
        ranges, ids = np.empty(n), np.empty(n, dtype=np.int64)
        with reporting(progress, n, "ray") as tell:
            for first in range(0, n, _RAYS_AT_ONCE):
                some = slice(first, first + _RAYS_AT_ONCE)
                ranges[some], ids[some] = self._core.cast(origins[some], directions[some], n_jobs)
                tell(min(some.stop, n))
        return ranges, ids

    def cast_beams(
        self, poses: ArrayLike, beams: ArrayLike, n_jobs: int | None = None
    ) -> tuple[Floats, Floats, Ints]:
        """The directions in the world, ranges and hits of one sensor's beams from many poses.

        Parameters
        ----------
        poses : (p, 4, 4) float64
            Rigid transforms ``T_world_sensor``.
        beams : (m, 3) float64
            Directions in the sensor's frame, of any length but zero. Neighbours in the array
            should be neighbours in direction, row by row: they are cast together.
        n_jobs : int or None
            Threads; None for all. The result does not depend on it.

        Returns
        -------
        directions : (p * m, 3) float64
            Unit vectors, pose by pose.
        ranges, ids : (p * m,)
            As from `cast`.

        Raises
        ------
        ValueError
            When arrays have other shapes, are not finite, or a beam is zero.

        Examples
        --------
        >>> import numpy as np
        >>> import primfit
        >>> pose = np.eye(4)
        >>> pose[:3, 3] = 0.5, 1, 0.1
        >>> caster = primfit.RayCaster(primfit.World(arena=primfit.Arena((2, 2))))
        >>> caster.cast_beams([pose], [[1, 0, 0], [0, 0, -1]])[1:]
        (array([1.5, 0.1]), array([-2, -3]))
        """
        transforms = np.asarray(poses)
        if transforms.ndim != 3 or transforms.shape[1:] != (4, 4):
            raise ValueError(f"poses must have shape (p, 4, 4), not {transforms.shape}")
        rows, beams = as_rows("poses", transforms.reshape(-1, 16), 16), as_rows("beams", beams, 3)
        n = len(rows) * len(beams)
        out = np.empty((n, 3)), np.empty(n), np.empty(n, dtype=np.int64)
        self._core.scan(rows, beams, RangeGate(), (0, 0), *out, n_jobs_or_none(n_jobs))
        return _primfit.turned(rows, beams), *out[1:]

    def __repr__(self) -> str:
        n_rounds = self._n_rounds
        rounds = f", {n_rounds} round solid{'s' * (n_rounds != 1)}" if n_rounds else ""
        return f"RayCaster({len(self._core) - n_rounds} triangles{rounds})"


def surfaces_of(world: World) -> tuple[Floats, Ints, Ints, Floats | None]:
    """What beams meet in a world.

    Returns
    -------
    vertices : (v, 3) float64, metres
    triangles : (t, 3) int64
        Those of what is flat.
    names : (t + r,) int64
        What each triangle, and then each round solid belongs to (see `World.to_mesh`).
    rounds : (r, 10) float64 or None
        The numbers of the round solids; None when there are none.
    """
    vertices, triangles, names = world.to_mesh()
    rounds = [i for i, solid in enumerate(world.solids) if isinstance(solid, Round)]
    if not rounds:
        return vertices, triangles, names, None
    is_flat = ~np.isin(names, rounds)
    rows = np.stack([solid.row for solid in world.solids if isinstance(solid, Round)])
    return vertices, triangles[is_flat], np.concatenate([names[is_flat], rounds]), rows


def _caster_of(corners: Floats, names: Ints | None, rounds: Floats) -> RayCaster:
    """The caster of triangles whose corners (3t, 3) follow each other, names and round solids."""
    caster = object.__new__(RayCaster)
    rows = np.arange(len(corners)).reshape(-1, 3)
    caster._core = _primfit.RayCaster(corners, rows, names, rounds)
    caster._n_rounds = len(rounds)
    return caster


def unit_rows(name: str, values: ArrayLike) -> Floats:
    """``values`` as (n, 3) unit vectors; a zero vector is an error."""
    vectors = as_rows(name, values, 3, most=np.inf)
    # Scaled first: squares of very long or short vectors leave the range of float64.
    vectors = vectors / _largest_components(name, vectors)
    norms = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.ascontiguousarray(vectors / norms)


def _largest_components(name: str, vectors: Floats) -> Floats:
    """The largest component of each vector (n, 1), without its sign; 0 is an error."""
    largest: Floats = np.abs(vectors).max(axis=1, initial=0.0, keepdims=True)
    if (largest == 0.0).any():
        raise ValueError(f"{name} must not be zero, but row {int(np.argmin(largest))} is")
    return largest


def _as_triangles(triangles: ArrayLike) -> Ints:
    array = np.asarray(triangles)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"triangles must have shape (t, 3), not {array.shape}")
    if array.dtype.kind not in "iu":
        raise TypeError(f"triangles must be integers, not {array.dtype}")
    return array.astype(np.int64)
