"""Normals of the surface that points lie on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import Floats, integer, n_jobs_or_none
from primfit.clouds.foreign import PointsLike, points_of
from primfit.scans.columns import one_or_each


def estimate_normals(
    points: PointsLike,
    k: int = 16,
    origins: ArrayLike | None = None,
    *,
    n_jobs: int | None = None,
) -> Floats:
    """Unit normals (n, 3) of the planes through the nearest points of each point.

    Parameters
    ----------
    points : (n, 3) float64, metres, or whatever `as_cloud` takes
        At least 3.
    k : int
        How many nearest points, itself included, tell the normal of a point; at least 3.
    origins : (n, 3), (3,) or None, metres
        Where the sensor was; normals point to it. Else the largest component of each is positive.
    n_jobs : int or None
        Threads; None for all. The result does not depend on them.

    Returns
    -------
    normals : (n, 3) float64

    Raises
    ------
    ValueError
        When points are not finite or fewer than 3, or `origins` are neither one nor as many.

    References
    ----------
    Hoppe, DeRose, Duchamp, McDonald, Stuetzle: Surface reconstruction from unorganized points,
    SIGGRAPH 1992.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> xy = np.random.default_rng(1).uniform(size=(100, 2))
    >>> primfit.estimate_normals(np.column_stack([xy, np.ones(100)]), origins=[0, 0, 0])[0]
    array([-0., -0., -1.])
    """
    rows = np.ascontiguousarray(points_of("points", points))
    k = integer("k", k, low=3)
    if len(rows) < 3:
        raise ValueError(f"points must be at least 3, since a plane needs as many, not {len(rows)}")
    starts = None if origins is None else one_or_each("origins", origins, len(rows))
    threads = n_jobs_or_none(n_jobs)
    normals = _primfit.PointTree(rows, threads).normals(k, threads)
    if starts is None:
        facing = np.take_along_axis(normals, np.abs(normals).argmax(axis=1)[:, None], axis=1)
    else:
        facing = np.einsum("ij,ij->i", normals, starts - rows)[:, None]
    return np.copysign(1.0, facing) * normals
