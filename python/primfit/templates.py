"""Kinds of solids as vectors of parameters: x, y, angle, and one or two sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from primfit import footprints
from primfit._check import Floats
from primfit.footprints import regular_name

_ORIGIN = np.zeros(2)


@dataclass(frozen=True)
class Template:
    """A kind of footprint.

    Attributes
    ----------
    kind : str
    n_sizes : int
        1, or 2 for rectangle and star.
    period : float, radians
        The turn that lays it onto itself.
    axes : (n_sizes, m) complex128
        Corners at angle zero for a unit of each size; they add.
    sizes_of_area : callable
        Sizes to start from, for an area.
    slimmest : float
        Greatest second size over the first.
    """

    kind: str
    n_sizes: int
    period: float
    axes: np.ndarray
    sizes_of_area: Callable[[float], list[tuple[float, ...]]]
    slimmest: float = 1.0

    def footprints(self, parameters: Floats) -> Floats:
        """Corners (n, m, 2) for parameters (n, 3 + n_sizes or more)."""
        x, y, angle = parameters[:, :3].T
        corners = parameters[:, 3 : 3 + self.n_sizes] @ self.axes
        corners = corners * np.exp(1j * angle)[:, None] + (x + 1j * y)[:, None]
        return np.stack([corners.real, corners.imag], axis=-1)

    def is_proper(self, parameters: Floats) -> np.ndarray:
        """Which parameters (n, d) are of this kind: positive sizes, the larger first.

        A star whose notches are shallower than `slimmest` is no star.
        """
        sizes = parameters[:, 3 : 3 + self.n_sizes]
        return (sizes > 0.0).all(axis=1) & (sizes[:, -1] <= self.slimmest * sizes[:, 0])


def _complex(outline: Floats) -> np.ndarray:
    return outline[:, 0] + 1j * outline[:, 1]


def _regular(n: int) -> Template:
    unit = footprints.regular_footprint(n, 1.0, _ORIGIN, 0.0)
    unit_area = footprints.signed_area(unit)
    return Template(
        regular_name(n),
        1,
        2 * np.pi / n,
        _complex(unit)[None],
        lambda area: [(float(np.sqrt(area / unit_area)),)],
    )


def _rectangle() -> Template:
    long = _complex(footprints.rectangle_footprint(1.0, 0.0, _ORIGIN, 0.0))
    short = _complex(footprints.rectangle_footprint(0.0, 1.0, _ORIGIN, 0.0))
    return Template(
        "rectangle",
        2,
        np.pi,
        np.stack([long, short]),
        lambda area: [
            (float(np.sqrt(area * ratio)), float(np.sqrt(area / ratio))) for ratio in (1.3, 2.0)
        ],
    )


def _star(n: int) -> Template:
    outer = _complex(footprints.star_footprint(n, 1.0, 0.0, _ORIGIN, 0.0))
    inner = _complex(footprints.star_footprint(n, 0.0, 1.0, _ORIGIN, 0.0))

    def sizes(area: float) -> list[tuple[float, ...]]:
        outers = [(float(np.sqrt(area / (n * np.sin(np.pi / n) * r))), r) for r in (0.4, 0.6)]
        return [(size, ratio * size) for size, ratio in outers]

    return Template("star", 2, 2 * np.pi / n, np.stack([outer, inner]), sizes, slimmest=0.75)


TEMPLATES = (_regular(3), _regular(4), _rectangle(), _regular(5), _regular(6), _star(5))
"""Kinds that are tried."""
