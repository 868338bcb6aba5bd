"""Whether planes come back when a few of the points are missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from primfit._check import Bools, Floats, Ints

LEFT_OUT = 20
"""One in so many points is left out: a sensor that stood a little elsewhere would change more."""

N_TRIALS = 3
"""Times that others are left out: a plane that comes back by chance in one half of the trials does
in all with a chance of 1 in 8."""


@dataclass(frozen=True, eq=False)
class Firmness:
    """How firm the planes of a cloud are, by finding them again without some of the points.

    The Jaccard similarity of each plane to the part that is most like it, in the mean over the
    trials (Hennig: Cluster-wise assessment of cluster stability, Computational Statistics & Data
    Analysis 52, 2007, by subsets). From 0.85 on a cluster counts as firm there; below 0.6 it is
    not to be trusted.

    Attributes
    ----------
    labels : (n,) int64
        Plane of each point, -1 for none.
    n_planes : int
    order : (m,) int64
        Points that are searched, by place: which are left out does not depend on the order of rows.
    parts : callable
        Labels (n,) of the parts that are found in the points of a mask (n,).

    Examples
    --------
    >>> import numpy as np
    >>> from primfit.planes.firmness import Firmness
    >>> labels = np.repeat([0, 1], 50)
    >>> halves = Firmness(labels, 2, np.arange(100), lambda mask: np.where(mask, labels // 2, -1))
    >>> halves().round(1).tolist()
    [0.5, 0.5]
    """

    labels: Ints
    n_planes: int
    order: Ints
    parts: Callable[[Bools], Ints]

    def __call__(self) -> Floats:
        """The firmness (k,) of each plane, from 0 to 1."""
        total = np.zeros(self.n_planes)
        for trial in range(N_TRIALS):
            mask = np.zeros(len(self.labels), dtype=bool)
            mask[self.order] = True
            mask[self.order[trial::LEFT_OUT]] = False
            total += similarity(self.labels[mask], self.parts(mask)[mask], self.n_planes)
        firmness: Floats = total / N_TRIALS
        return firmness


def similarity(labels: Ints, others: Ints, n_planes: int) -> Floats:
    """Most that the points of each label (k,) share with those of another's, over all of both."""
    n_others = int(others.max(initial=-1)) + 1
    both = (labels >= 0) & (others >= 0)
    shared = np.bincount(labels[both] * n_others + others[both], minlength=n_planes * n_others)
    shared = shared.reshape(n_planes, n_others)
    sizes = np.bincount(labels[labels >= 0], minlength=n_planes)
    of_all = sizes[:, None] + np.bincount(others[others >= 0], minlength=n_others) - shared
    best: Floats = (shared / np.maximum(of_all, 1)).max(axis=1, initial=0.0)
    return best
