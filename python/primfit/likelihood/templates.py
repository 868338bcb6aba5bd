"""Kinds of solids as vectors of parameters: what is fitted to the beams.

A shape turns parameters into corners, and says how the corners change with them. A `Template` has
x, y, angle and one or two sizes; a `FreePolygon` has the corners themselves. Parameters may have
more entries behind these, which a shape does not look at.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from primfit import _primfit
from primfit._check import Bools, Floats
from primfit.geometry import footprints
from primfit.geometry.footprints import regular_name

_ORIGIN = np.zeros(2)

_FLAT = 0.03
"""How far a corner that may be none is off the line of its neighbours, as a share of the size."""

_SHALLOW = 0.85
"""Depth of notches, in that of the shallowest ones, from which a star is nearly regular."""

_NEARLY = 1.3
"""Sides of a rectangle that is nearly a square, the one over the other, at the most."""


class Shape(ABC):
    """What a footprint may be."""

    kind: str
    """Its class name."""

    @property
    @abstractmethod
    def family(self) -> _primfit.Family:
        """What turns parameters into corners."""

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """How many parameters it looks at."""

    @abstractmethod
    def log_prior(self, scale: float) -> float:
        """Logarithm of the density of parameters beforehand, with sizes up to `scale`, metres."""

    def footprints(self, parameters: Floats) -> Floats:
        """Corners (n, m, 2) for parameters (n, n_parameters or more)."""
        return self.family.footprints(np.ascontiguousarray(parameters))

    def frame(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Corners (m, 2) for one set of parameters, and how they change with each (2m, d)."""
        return self.family.frame(np.ascontiguousarray(parameters))

    def is_proper(self, parameters: Floats) -> Bools:
        """Which parameters (n, d) are of this kind."""
        return self.family.is_proper(np.ascontiguousarray(parameters))


@dataclass(frozen=True, eq=False)
class Template(Shape):
    """A kind of footprint with one or two sizes, which are positive.

    A star whose notches are shallower than `slimmest` is no star. Either side of a rectangle may be
    the longer one, lest nearly square ones cannot move.

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

    @cached_property
    def family(self) -> _primfit.Family:
        """What turns parameters into corners."""
        axes = self.axes.view(np.float64).reshape(*self.axes.shape, 2)
        return _primfit.Family.template(axes, self.slimmest)

    @property
    def n_parameters(self) -> int:
        """x, y, angle and the sizes."""
        return 3 + self.n_sizes

    def log_prior(self, scale: float) -> float:
        """Uniform in place, angle and sizes."""
        return -float(np.log(self.period) + (2 + self.n_sizes) * np.log(scale))


@dataclass(frozen=True)
class FreePolygon(Shape):
    """Any polygon that does not touch itself: its parameters are the x and y of its corners."""

    n_corners: int
    kind: str = "polygon"

    @cached_property
    def family(self) -> _primfit.Family:
        """What turns parameters into corners."""
        return _primfit.Family.polygon(self.n_corners)

    @property
    def n_parameters(self) -> int:
        """Two a corner."""
        return 2 * self.n_corners

    def log_prior(self, scale: float) -> float:
        """Uniform in the place of each corner; any of them may be the first."""
        return -float(self.n_parameters * np.log(scale) - np.log(self.n_corners))


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
            (float(np.sqrt(area * ratio)), float(np.sqrt(area / ratio)))
            for ratio in (1.2, 1.8, 3.0, 6.0)
        ],
        slimmest=np.inf,
    )


def _star(n: int) -> Template:
    outer = _complex(footprints.star_footprint(n, 1.0, 0.0, _ORIGIN, 0.0))
    inner = _complex(footprints.star_footprint(n, 0.0, 1.0, _ORIGIN, 0.0))
    # With notches deeper than this it is concave; with shallower ones a polygon of 2n corners.
    concave = float(np.cos(np.pi / n))

    def sizes(area: float) -> list[tuple[float, ...]]:
        ratios = (0.55 * concave, 0.8 * concave)
        outers = [(float(np.sqrt(area / (n * np.sin(np.pi / n) * r))), r) for r in ratios]
        return [(size, ratio * size) for size, ratio in outers]

    return Template(
        "star", 2, 2 * np.pi / n, np.stack([outer, inner]), sizes, slimmest=0.95 * concave
    )


RECTANGLE, SQUARE = _rectangle(), _regular(4)

REGULAR = {n: SQUARE if n == 4 else _regular(n) for n in range(3, 9)}
"""Regular polygons by their number of corners."""

STARS = {n: _star(n) for n in (4, 5, 6)}
"""Stars by their number of tips."""

TEMPLATES = (*REGULAR.values(), RECTANGLE, *STARS.values())
"""Kinds that are tried."""


def kin(shape: Shape, parameters: Floats) -> list[tuple[Shape, Floats]]:
    """What a shape may be instead, with where to start.

    A rectangle may be a square and the other way round, a star with shallow notches a regular
    polygon, a polygon one with a corner less, a regular one or a rectangle.
    """
    place, sizes = parameters[:3], parameters[3:]
    if shape is SQUARE:
        return [(RECTANGLE, np.append(place, [sizes[0], sizes[0]]))]
    if shape is RECTANGLE and sizes[0] < _NEARLY * sizes[1]:
        return [(SQUARE, np.append(place, np.sqrt(sizes[0] * sizes[1])))]
    if isinstance(shape, Template) and shape.kind == "star":
        regular = REGULAR[shape.axes.shape[1] // 2]
        if sizes[1] > _SHALLOW * shape.slimmest * sizes[0]:
            tip = sizes[0] * shape.axes[0, 0] / regular.axes[0, 0]
            return [(regular, np.array([*place[:2], place[2] + np.angle(tip), np.abs(tip)]))]
    if isinstance(shape, FreePolygon):
        footprint = shape.footprints(parameters[None])[0]
        simpler = without_flattest(footprint)
        starts = [] if simpler is None else [(FreePolygon(len(simpler)), simpler.ravel())]
        return starts + _named(footprint)
    return []


def _named(footprint: Floats) -> list[tuple[Shape, Floats]]:
    """Kinds with as many corners as a polygon, where they come nearest to it."""
    m = len(footprint)
    if m not in REGULAR:
        return []
    center = footprint.mean(axis=0)
    arms = _complex(footprint - center)
    axis = REGULAR[m].axes[0]
    size = np.vdot(axis, arms) / np.vdot(axis, axis)
    starts: list[tuple[Shape, Floats]] = [
        (REGULAR[m], np.array([*center, np.angle(size), np.abs(size)]))
    ]
    if m == 4:
        along = (arms[1] - arms[0] + arms[2] - arms[3]) / 2
        across = (arms[2] - arms[1] + arms[3] - arms[0]) / 2
        sizes = np.abs([along, across])
        starts.append((RECTANGLE, np.array([*center, np.angle(along), *sizes])))
    return starts


def without_flattest(footprint: Floats) -> Floats | None:
    """A polygon without the corner nearest to the line of its neighbours; None if that is far."""
    before, after = np.roll(footprint, 1, axis=0), np.roll(footprint, -1, axis=0)
    along, to_corner = after - before, footprint - before
    off = np.abs(along[:, 0] * to_corner[:, 1] - along[:, 1] * to_corner[:, 0])
    off /= np.linalg.norm(along, axis=1)
    k = int(np.argmin(off))
    size = float(np.ptp(footprint, axis=0).max())
    return np.delete(footprint, k, axis=0) if len(off) > 3 and off[k] < _FLAT * size else None
