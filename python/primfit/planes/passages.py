"""Beams that pass a plane: what an extent or a gap in it looks like to the sensor."""

from __future__ import annotations

import numpy as np

from primfit import _primfit
from primfit._check import Floats
from primfit.scans.scan import Scan

_CLEAR = 4.0
"""Standard deviations by which a beam must outrun a plane to have passed it."""

MOST_PASSING = 2
"""Beams that may seem to pass by their noise alone."""


def passages(scan: Scan, equation: Floats, axes: Floats, sigma: float) -> Floats:
    """Where beams met a plane from its free side and went on.

    The place is exact however noisy the range is: only whether the beam ended there or went on
    is measured. A beam without return went as far as the sensor sees, which is the longest range
    of the scan where it is not known; one that tells nothing goes nowhere.

    Parameters
    ----------
    scan : Scan
        All its beams, those without return too; its origins must be known.
    equation : (4,) float64
    axes : (2, 3) float64
        Directions within the plane.
    sigma : float, metres
        Of the ranges.

    Returns
    -------
    places : (k, 2) float64, metres
        Along the axes.
    """
    is_return = np.isfinite(scan.ranges)
    farthest = scan.max_range
    if farthest is None:
        farthest = float(scan.ranges[is_return].max(initial=0.0))
    lengths = np.where(is_return, scan.ranges, farthest)
    lengths[scan.is_blank] = 0.0
    return _primfit.passages(scan.origins, scan.directions, lengths, equation, axes, _CLEAR * sigma)
