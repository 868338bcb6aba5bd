"""Noise that grows where beams graze: a beam is spread over more range the more its surface slants.

At an angle t from the normal, a reading from a distance r deviates by ``r * d / 4 * tan(t)``, where
d is the divergence of the beam (Lichti, Gordon: Error Propagation in Directly Georeferenced
Terrestrial Laser Scanner Point Clouds, FIG 2004), besides what it does head-on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from primfit._check import Bools, Floats
from primfit.likelihood.beam_model import BeamModel
from primfit.likelihood.scene import Recording, Scene
from primfit.worlds.world import FLOOR

_STEEPEST = 5.0
"""Largest tangent of incidence, 79 degrees, that counts: beyond it the end of a wall is as near as
what a beam is spread over."""

_STEPS = 50
"""Of the regression at most; it takes about five."""

_PARTS = 16
"""Parts whose medians begin it: more than its two unknowns, of many beams each."""

_PER_DIVERGENCE = 0.25
"""Standard deviation of where in its cone of light a beam returns from, in its divergence."""


@dataclass(frozen=True)
class Divergence:
    """What the residuals say of the divergence of the beams.

    Attributes
    ----------
    value, sigma : float, radians
        Full angle of the cone of light, and its standard deviation.
    """

    value: float
    sigma: float


def slants(scene: Scene) -> tuple[Floats, Floats]:
    """Range that the scene foresees for each beam, and tangent of its incidence there.

    Returns
    -------
    expected : (n,) float64, metres
        inf where nothing is met.
    tangent : (n,) float64
        NaN there, and on tops.
    """
    expected, parts, faces = scene.first_hits()
    cosine = np.where(parts == FLOOR, np.abs(scene.scan.directions[:, 2]), np.nan)
    for part, obstacle in enumerate(scene.obstacles):
        corners = obstacle.footprint
        along = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([along[:, 1], -along[:, 0]])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        rows = np.flatnonzero((parts == part) & (faces < len(corners)))
        directions = scene.scan.directions[rows, :2]
        cosine[rows] = np.abs(np.einsum("ij,ij->i", directions, normals[faces[rows]]))
    with np.errstate(divide="ignore"):
        return expected, np.sqrt(np.maximum(1.0 / cosine**2 - 1.0, 0.0))


def with_divergence(scene: Scene, measure_sigma: bool) -> tuple[BeamModel, Divergence]:
    """The noise of each beam, and the divergence that explains the residuals best.

    Variances are those of the model, or one that is sought too, plus those of the slant. Beams that
    may return from two faces at once are left out, once it is known how wide they are.
    """
    scan, model = scene.scan, scene.model
    expected, tangent = slants(scene)
    slant = expected * np.minimum(tangent, _STEEPEST)
    is_clear = scan.is_return & np.isfinite(slant) & (tangent < _STEEPEST)
    slant = np.where(np.isfinite(slant), slant, 0.0)
    squares = np.where(is_clear, scan.ranges, 0.0) - np.where(is_clear, expected, 0.0)
    squares **= 2
    given = None if measure_sigma else model.sigma**2
    factors, covariance = _regression(squares, slant**2, given, is_clear, model)
    divergence = np.sqrt(factors[0]) / _PER_DIVERGENCE
    if divergence > 0.0:
        is_clear &= _is_on_one_face(scene, divergence / 2)
        factors, covariance = _regression(squares, slant**2, given, is_clear, model)
    value, spread = float(np.sqrt(factors[0])), float(np.sqrt(covariance[0, 0]))
    # Of the root of a variance that is told to `spread`, also where that is 0.
    sigma = spread / max(2.0 * value, np.sqrt(spread))
    head_on = np.sqrt(factors[1]) if measure_sigma else model.sigma
    own = np.maximum(np.hypot(head_on, value * slant), model.least_sigma)
    told = Divergence(value / _PER_DIVERGENCE, float(sigma) / _PER_DIVERGENCE)
    return replace(model, sigma=own), told


def _regression(
    squares: Floats, grown: Floats, given: Floats | None, some: Bools, model: BeamModel
) -> tuple[Floats, Floats]:
    """Factors of the terms of the variance of Gaussian residuals, and their covariance.

    The likelihood is largest where the regression of the squares ends that is weighted by the
    variances; it begins with medians over parts of the terms, which outliers do not move, and
    leaves out what the model holds for these. The covariance is that of squares as they spread
    (Huber: The Behavior of Maximum Likelihood Estimates under Nonstandard Conditions, 1967).
    """
    rows = np.flatnonzero(some)
    rows = rows[np.argsort(grown[rows], kind="stable")]
    squares, terms = squares[rows], grown[rows, None]
    offset = np.zeros(len(rows)) if given is None else given[rows]
    if given is None:
        terms = np.column_stack([terms, np.ones(len(rows))])
    parts = [part for part in np.array_split(np.arange(len(rows)), _PARTS) if len(part)]
    medians = np.array([np.median(squares[part]) * 1.4826**2 for part in parts])
    of_parts = np.array([terms[part].mean(axis=0) for part in parts])
    weights = 1.0 / np.maximum(medians, model.least_sigma**2)
    off = medians - np.array([offset[part].mean() for part in parts])
    factors, *_ = np.linalg.lstsq(of_parts * weights[:, None], off * weights, rcond=None)
    factors = np.maximum(factors, 0.0)
    most = model.settings.contamination_sigmas**2
    for _ in range(_STEPS):
        variance = np.maximum(offset + terms @ factors, model.least_sigma**2)
        near = squares < most * variance
        weighted = terms[near] / variance[near, None] ** 2
        inverse = np.linalg.inv(weighted.T @ terms[near])
        before, factors = factors, inverse @ (weighted.T @ (squares - offset)[near])
        factors = np.maximum(factors, 0.0)
        if np.allclose(factors, before, rtol=1e-6, atol=0.0):
            break
    scores = weighted * (squares - offset - terms @ factors)[near, None]
    return factors, inverse @ (scores.T @ scores) @ inverse


def _is_on_one_face(scene: Scene, angle: float) -> Bools:
    """Whether beams tilted by so much to four sides meet the same face."""
    scan = scene.scan
    _, *own = scene.first_hits()
    aside = np.cross(scan.directions, [0.0, 0.0, 1.0])
    aside /= np.maximum(np.linalg.norm(aside, axis=1), 1e-9)[:, None]
    above = np.cross(aside, scan.directions)
    is_same = np.ones(len(scan), dtype=bool)
    for side in (aside, -aside, above, -above):
        directions = np.cos(angle) * scan.directions + np.sin(angle) * side
        tilted = replace(scan, directions=directions)
        _, *other = replace(scene, recording=Recording.of(tilted)).first_hits()
        is_same &= (own[0] == other[0]) & (own[1] == other[1])
    return is_same
