"""Where the points of a face end, as far as they tell."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from primfit._check import Floats

_STRAY = 2e-3
"""Density of points beyond the end, over that before it: one that lies some spacings beyond all
others does not move the end."""

_FEWEST, _MOST = 200, 400
"""Points of the stretch before the end that tell its density, and that are looked at: the end is
told to a few thousandths of the stretch."""

_WIDTHS = 8.0
"""Length of that stretch, at the least, in the greatest blur: the inner half shows none of it."""

_BLURS = 8
"""Blurs that are tried, from a tenth of a spacing on: some to each factor of two or three."""

_CERTAIN = 8.0
"""Deviations before an end at which a point has no chance to lie beyond it, to rounding."""

_PLACES, _ZOOMS = 32, 4
"""Ends that are tried at once, and how often closer to each other."""


def end_of(along: Floats, across: Floats, blur: float) -> tuple[float, float]:
    """Upper end of a stretch with evenly distributed points (n,), and its standard deviation.

    The highest point lies before the end by a spacing on average, or beyond it by some deviations
    of its error. Of a density that falls to nothing there, blurred by errors of which only a bound
    is known, all ends are weighed by their likelihood: their mean is the estimator without bias
    (Pitman, The estimation of the location and scale parameters of a continuous population of any
    given form, 1939).

    Parameters
    ----------
    along : (n,) float64, metres
    across : (n,) float64, metres
        Along the end, which is straight: of very many points some, alike distributed, are taken.
    blur : float, metres
        The greatest standard deviation of errors of `along`.
    """
    rising = np.sort(along)
    few = rising[-min(_FEWEST, len(rising) // 2 + 1)]
    # Where there are few points, their density is that of the upper half, and seldom of the whole.
    start = max(min(float(few), float(rising[-1]) - _WIDTHS * blur), float(np.median(rising)))
    order = np.lexsort((along, across))
    upper = along[order][along[order] > start]
    if not len(upper):
        return start, 0.0
    far = upper[:: -(-len(upper) // _MOST)] - start
    reach, n = float(far.max()), len(far)
    least = 0.1 * reach / n
    blurs = np.geomspace(least, max(min(blur, reach / 4), least), _BLURS)
    low, high = float(np.median(far)), reach * (1.0 + 12.0 / n)
    for _ in range(_ZOOMS):
        ends = np.linspace(low, high, _PLACES)
        told = np.stack([_within(ends, far, blur) for blur in blurs], axis=1)
        told -= n * np.log((1.0 - _STRAY) * ends + _STRAY * reach)[:, None]
        weight = np.exp(told - told.max()).sum(axis=1)
        weight /= weight.sum()
        end = float((weight * ends).sum())
        deviation = float(np.sqrt((weight * (ends - end) ** 2).sum()))
        step = (high - low) / (_PLACES - 1)
        if deviation > 3.0 * step:
            break
        around = max(deviation, step)
        low, high = max(end - 8.0 * around, low), end + 10.0 * around
    return start + end, max(deviation, step / np.sqrt(12.0))


def _within(ends: Floats, far: Floats, blur: float) -> Floats:
    """Log-likelihood of all points where they are, for each end (m,), but for its norm."""
    # Others are certainly before every end.
    near = far[far > ends[0] - _CERTAIN * blur]
    within = (1.0 - _STRAY) * ndtr((ends[:, None] - near) / blur) + _STRAY
    told: Floats = np.log(within).sum(axis=1)
    return told
