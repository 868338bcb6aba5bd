"""What a closed outline turned out to be, with uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from primfit._check import Floats
from primfit.geometry import footprints
from primfit.geometry.products import product

_EQUAL = 0.02
"""Relative difference of sides of a noisy polygon that still counts as equal."""


@dataclass(frozen=True, eq=False)
class Outline:
    """What an outline turned out to be.

    Attributes
    ----------
    kind : str
    footprint : (m, 2) float64, metres
        Of exactly that kind, where it has a template.
    angle : float, radians
    size : float or (float, float), metres
    covariance : (k, k) float64
        Of center x, center y, angle and the one or two sizes.
    """

    kind: str
    footprint: Floats
    angle: float
    size: float | tuple[float, float]
    covariance: Floats


def free_polygon(vertices: Floats, covariance: Floats) -> Outline:
    """Vertices (m, 2) with their covariance (2m, 2m) as an outline of no known kind."""
    footprint = footprints.clean_footprint(vertices)
    n = len(vertices)
    order = footprints.symmetry(footprint, _EQUAL)[1]
    angle = footprints.angle_of(footprint, "polygon", _EQUAL)

    def parameters(outline: Floats) -> Floats:
        turned = footprints.angle_of(outline, "polygon", _EQUAL) - angle
        period = 2 * np.pi / order
        turned = (turned + period / 2) % period - period / 2
        size = np.atleast_1d(footprints.size_of(outline, "polygon"))
        return np.concatenate([outline.mean(axis=0), [turned], size])

    step = 1e-7 * np.ptp(vertices, axis=0).max()
    steps = step * np.eye(2 * n).reshape(2 * n, n, 2)
    columns = [(parameters(vertices + d) - parameters(vertices - d)) / (2 * step) for d in steps]
    jacobian = np.stack(columns, axis=1)
    return Outline(
        kind="polygon",
        footprint=footprint,
        angle=angle,
        size=footprints.size_of(footprint, "polygon"),
        covariance=product(product(jacobian, covariance), jacobian.T),
    )
