"""Density-based clusters of points."""

from __future__ import annotations

import numpy as np

from primfit import _primfit
from primfit._check import Ints, as_rows, integer, number
from primfit.clouds.foreign import PointsLike, points_of


def dbscan(points: PointsLike, eps: float, min_samples: int = 1) -> Ints:
    """Cluster labels, equal to scikit-learn's `DBSCAN`, with memory proportional to the points.

    A point is core when at least `min_samples` points, itself included, are within `eps` of it.
    Core points within `eps` of each other share a cluster. With ``min_samples=1``, as in the
    paper's Algorithm 4, clusters are the connected components at distance `eps`.

    Parameters
    ----------
    points : (n, 3) or (n, 2) float64, metres, or whatever `as_cloud` takes
        Takes at most 96 bytes a point beyond the input, labels included.
    eps : float, metres
    min_samples : int

    Returns
    -------
    labels : (n,) int64
        Clusters are numbered by their first core point; a border point joins the lowest-numbered
        cluster within reach; -1 is noise.

    Raises
    ------
    ValueError
        When points are not finite, or lie so far apart that `eps` is below their rounding: more
        than 1e12 times `eps`.

    Notes
    -----
    The time is about proportional to the number of points, also where cells of the underlying
    grid are crowded. What remains slower is `min_samples` near the number of points within reach,
    where those are very many.

    References
    ----------
    Ester, Kriegel, Sander, Xu: A density-based algorithm for discovering clusters in large
    spatial databases with noise, KDD 1996.

    Examples
    --------
    >>> import primfit
    >>> primfit.dbscan([[0, 0, 0], [0.05, 0, 0], [1, 0, 0]], eps=0.1, min_samples=2)
    array([ 0,  0, -1])
    """
    if _is_flat(points):
        flat = as_rows("points", points, 2)
        rows = np.column_stack([flat, np.zeros(len(flat))])
    else:
        rows = points_of("points", points)
    eps = number("eps", eps, above=0.0)
    min_samples = integer("min_samples", min_samples, low=1)
    return _primfit.dbscan(np.ascontiguousarray(rows), eps, min_samples)


def _is_flat(points: PointsLike) -> bool:
    shape = getattr(points, "shape", None)
    if shape is None and isinstance(points, list | tuple):
        shape = np.shape(points)
    return shape is not None and len(shape) == 2 and shape[1] == 2
