"""Footprints of no known kind: polygons that gain, lose and move corners."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from primfit._check import Floats
from primfit.geometry.footprints import signed_area
from primfit.likelihood.beam_model import Beams
from primfit.likelihood.fitting import Fit, climb, coarse_to_fine
from primfit.likelihood.footprint_models import FreePolygon, without_flattest


def fit_polygon(beams: Beams, outlines: list[Floats], top: float, size: float) -> Fit | None:
    """The polygon that explains the beams best for its number of corners.

    From simplified outlines, corners are dropped and inserted, each time with a fit of all of
    them to some of the beams, as long as that lowers the Bayesian information criterion. Few beams
    may tell of a corner that is none, so at last the flattest ones are left out with all beams.

    Parameters
    ----------
    beams : Beams
    outlines : list of (m, 2) float64, metres
        To start from.
    top : float, metres
    size : float, metres

    Returns
    -------
    fit : Fit or None
        None when no outline is a polygon.
    """
    how = beams.settings.polygons
    some = beams.thinned(how.stride, 0.0)
    price = 0.5 * np.log(max(len(beams), 2))

    def score(fit: Fit) -> float:
        return fit.cost + price * fit.shape.n_parameters

    def fitted(outline: Floats) -> Fit:
        shape = FreePolygon(len(outline))
        return coarse_to_fine(some, shape, outline.ravel(), top, size)

    starts = [
        simple
        for outline in outlines
        for tolerance in how.simplifications
        if (simple := _simplified(outline, tolerance * size)) is not None
    ]
    if not starts:
        return None
    best = min((fitted(start) for start in starts), key=score)
    tried, improved = 0, True
    while improved and tried < how.most_moves:
        improved = False
        for outline in _changed(best.footprint, how.bulge):
            tried += 1
            shape = FreePolygon(len(outline))
            if not shape.is_proper(outline.reshape(1, -1))[0]:
                continue
            fit = climb(some, shape, outline.ravel(), top)
            if score(fit) < score(best):
                best, improved = fit, True
                break
    fits = [climb(beams, best.shape, best.parameters, top)]
    while (simpler := without_flattest(fits[-1].footprint, beams.settings.models.flat)) is not None:
        fits.append(climb(beams, FreePolygon(len(simpler)), simpler.ravel(), top))
    return min(fits, key=score)


def _changed(footprint: Floats, bulge: float) -> Iterator[Floats]:
    """A polygon without each of its corners, and with one more in each of its edges."""
    m = len(footprint)
    if m > 3:
        for k in range(m):
            yield np.delete(footprint, k, axis=0)
    for k in range(m):
        a, b = footprint[k], footprint[(k + 1) % m]
        out = np.array([b[1] - a[1], a[0] - b[0]])
        for out_by in (bulge, -bulge):
            yield np.insert(footprint, k + 1, (a + b) / 2 + out_by * out, axis=0)


def _simplified(outline: Floats, tolerance: float) -> Floats | None:
    """An outline with fewer corners, counter-clockwise; None when nothing is left of it."""
    simple = shapely.Polygon(outline).simplify(tolerance)
    if simple.geom_type != "Polygon" or simple.is_empty:
        return None
    corners: Floats = shapely.get_coordinates(simple.exterior)[:-1]
    if len(corners) < 3:
        return None
    return corners if signed_area(corners) > 0.0 else corners[::-1]
