"""The search for flat parts of a cloud, by its image where it has one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from primfit._check import Bools, Floats, Ints
from primfit.planes.organised import image_parts
from primfit.planes.surfaces import FlatParts, flat_parts


@dataclass(frozen=True, eq=False)
class Search:
    """What is needed to search a cloud, or some of its points.

    Attributes
    ----------
    cloud : (n, 3) float64, metres
    image : (h, w) int64 or None
        Row of each pixel, -1 for none.
    noise : (n,) float64 or None, metres
        Across the surfaces; None is estimated.
    n_jobs : int or None
        Threads; the result does not depend on them.
    """

    cloud: Floats
    image: Ints | None
    noise: Floats | None
    n_jobs: int | None

    def __call__(self, mask: Bools) -> FlatParts:
        """Flat parts of the points of a mask (n,), all of which must be finite."""
        cloud, noise = self.cloud, self.noise
        if self.image is not None:
            if np.isfinite(cloud[~mask, 0]).any():
                cloud = np.where(mask[:, None], cloud, np.nan)
            return image_parts(cloud, self.image, noise, self.n_jobs)
        if mask.all():
            return flat_parts(cloud, noise, self.n_jobs)
        own = None if noise is None else noise[mask]
        return flat_parts(cloud[mask], own, self.n_jobs).among(mask)

    def labels(self, mask: Bools) -> Ints:
        """Part of each point (n,), -1 for none."""
        return self(mask).labels
