"""Footprint models: kinds of solids as vectors of parameters, which are fitted to the beams.

A model turns parameters into corners, and says how the corners change with them. A `Template` has
x, y, angle and one or two sizes; a `FreePolygon` has the corners themselves. Parameters may have
more entries behind these, which a model does not look at. Beams meet circles and ellipses in closed
form; polygons stand for them elsewhere.
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
from primfit.geometry.motions import Motion
from primfit.likelihood.settings import ModelSettings

_ORIGIN = np.zeros(2)

_ROUND = 64
"""Corners that stand for a circle, of whose radius they are off by 0.08 %."""


class FootprintModel(ABC):
    """What a footprint may be."""

    kind: str
    """Its class name."""

    is_round: bool = False
    """Whether it is an ellipse."""

    @property
    @abstractmethod
    def family(self) -> _primfit.Family:
        """What turns parameters into corners, or into the ends of the axes of an ellipse."""

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """How many parameters it looks at."""

    @abstractmethod
    def log_prior(self, scale: float) -> float:
        """Logarithm of the density of parameters beforehand, with sizes up to `scale`, metres."""

    def points(self, parameters: Floats) -> Floats:
        """Corners, or ends of axes, (n, k, 2) for parameters (n, n_parameters or more)."""
        return self.family.footprints(np.ascontiguousarray(parameters))

    def footprints(self, parameters: Floats) -> Floats:
        """Corners (n, m, 2) for parameters (n, n_parameters or more)."""
        points = self.points(parameters)
        return np.einsum("mk,nki->nmi", _OUTLINE, points) if self.is_round else points

    def frame(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Corners (m, 2) for one set of parameters, and how they change with each (2m, d)."""
        points, changes = self.family.frame(np.ascontiguousarray(parameters))
        if not self.is_round:
            return points, changes
        ends = changes.reshape(4, 2, -1)
        corners = np.einsum("mk,kij->mij", _OUTLINE, ends).reshape(2 * _ROUND, -1)
        return np.einsum("mk,ki->mi", _OUTLINE, points), corners

    def is_proper(self, parameters: Floats) -> Bools:
        """Which parameters (n, d) are of this kind."""
        return self.family.is_proper(np.ascontiguousarray(parameters))

    @abstractmethod
    def moved(self, parameters: Floats, motion: Motion) -> Floats:
        """Parameters of the same footprint after a rigid motion."""


@dataclass(frozen=True, eq=False)
class Template(FootprintModel):
    """A kind of footprint with one or two sizes, which are positive; a circle has no angle.

    A star whose notches are shallower than `slimmest` is no star. Either side of a rectangle may be
    the longer one, lest nearly square ones cannot move.

    Attributes
    ----------
    kind : str
    n_sizes : int
        1, or 2 for rectangle and star.
    period : float, radians
        The turn that lays it onto itself; zero where any does.
    axes : (n_sizes, m) complex128
        Corners, or ends of axes, at angle zero for a unit of each size; they add.
    sizes_of_area : callable
        Sizes to start from, for an area.
    slimmest : float
        Greatest second size over the first.
    is_round : bool
        Whether it is an ellipse, and its corners are the ends of the axes.
    """

    kind: str
    n_sizes: int
    period: float
    axes: np.ndarray
    sizes_of_area: Callable[[float], list[tuple[float, ...]]]
    slimmest: float = 1.0
    is_round: bool = False

    @cached_property
    def family(self) -> _primfit.Family:
        """What turns parameters into corners, or into the ends of axes."""
        axes = self.axes.view(np.float64).reshape(*self.axes.shape, 2)
        return _primfit.Family.template(axes, self.slimmest, self.is_round, self.has_angle)

    @property
    def has_angle(self) -> bool:
        """Whether a turn changes it."""
        return self.period > 0.0

    @property
    def n_parameters(self) -> int:
        """x, y, angle if it has one, and the sizes."""
        return 2 + self.has_angle + self.n_sizes

    def apart(self, parameters: Floats) -> tuple[Floats, Floats]:
        """x, y and angle (3,), zero where it has none, and the sizes."""
        if self.has_angle:
            return parameters[:3], parameters[3 : self.n_parameters]
        return np.append(parameters[:2], 0.0), parameters[2 : self.n_parameters]

    def together(self, place: Floats, sizes: Floats) -> Floats:
        """Parameters for x, y and angle (3,) and the sizes."""
        return np.append(place if self.has_angle else place[:2], sizes)

    def moved(self, parameters: Floats, motion: Motion) -> Floats:
        """Place and angle change, sizes do not."""
        place = motion.of(parameters[None, :2])[0]
        if not self.has_angle:
            return np.array([*place, *parameters[2:]])
        return np.array([*place, parameters[2] + motion.turn, *parameters[3:]])

    def log_prior(self, scale: float) -> float:
        """Uniform in place, angle and sizes."""
        angle = np.log(self.period) if self.has_angle else 0.0
        return -float(angle + (2 + self.n_sizes) * np.log(scale))


@dataclass(frozen=True)
class FreePolygon(FootprintModel):
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

    def moved(self, parameters: Floats, motion: Motion) -> Floats:
        """Each corner goes along."""
        return motion.of(parameters.reshape(-1, 2)).ravel()

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


def _outline(n: int) -> Floats:
    """Corners of a polygon with an ellipse's area, as weights (n, 4) of the ends of its axes."""
    scale = np.sqrt(2 * np.pi / (n * np.sin(2 * np.pi / n)))
    angles = 2 * np.pi * np.arange(n) / n
    arms = 0.5 * scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    weights: Floats = 0.25 + np.concatenate([arms, -arms], axis=1)
    return weights


_OUTLINE = _outline(_ROUND)


def _circle() -> Template:
    return Template(
        "circle",
        1,
        0.0,
        np.array([[1, 1j, -1, -1j]]),
        lambda area: [(float(np.sqrt(area / np.pi)),)],
        is_round=True,
    )


def _ellipse() -> Template:
    return Template(
        "ellipse",
        2,
        np.pi,
        np.array([[1, 0, -1, 0], [0, 1j, 0, -1j]]),
        lambda area: [
            (float(np.sqrt(area * ratio / np.pi)), float(np.sqrt(area / ratio / np.pi)))
            for ratio in (1.3, 2.0)
        ],
        slimmest=np.inf,
        is_round=True,
    )


RECTANGLE, SQUARE = _rectangle(), _regular(4)
CIRCLE, ELLIPSE = _circle(), _ellipse()

NESTED: dict[Template, Template] = {RECTANGLE: SQUARE, ELLIPSE: CIRCLE}
"""Kinds of two sizes, and what they are when these are equal."""

REGULAR = {n: SQUARE if n == 4 else _regular(n) for n in range(3, 9)}
"""Regular polygons by their number of corners."""

STARS = {n: _star(n) for n in (4, 5, 6)}
"""Stars by their number of tips."""

TEMPLATES = (*REGULAR.values(), RECTANGLE, *STARS.values(), CIRCLE)
"""Kinds that are tried; an ellipse is tried beside rectangle and circle."""


def n_sizes(model: FootprintModel) -> int:
    """How many lengths a kind has besides its place: the fewer, the simpler.

    A circle has one number less than a regular polygon: no angle.
    """
    return model.n_parameters - 3 if isinstance(model, Template) else model.n_parameters


def related(
    model: FootprintModel, parameters: Floats, how: ModelSettings
) -> list[tuple[FootprintModel, Floats]]:
    """What a footprint may be instead, with where to start: nested models and their parents.

    A rectangle may be a square and the other way round, an ellipse a circle, a star with shallow
    notches a regular polygon, one of many corners a circle, a free polygon one with a corner less,
    a regular one, a rectangle, a circle or an ellipse.
    """
    if not isinstance(model, Template):
        footprint = model.footprints(parameters[None])[0]
        simpler = without_flattest(footprint, how.flat)
        starts = [] if simpler is None else [(FreePolygon(len(simpler)), simpler.ravel())]
        return starts + _named(footprint) + _round(footprint, how.round_corners)
    place, sizes = model.apart(parameters)
    found: list[tuple[FootprintModel, Floats]] = []
    if model is RECTANGLE:
        found.append((ELLIPSE, ELLIPSE.together(place, sizes / np.sqrt(3.0))))
    for two, one in NESTED.items():
        if model is one:
            found.append((two, two.together(place, np.repeat(sizes, 2))))
        if model is two and max(sizes) < how.nearly * min(sizes):
            found.append((one, one.together(place, np.sqrt(sizes[:1] * sizes[1:]))))
    if found:
        return found
    if model.kind == "star":
        regular = REGULAR[model.axes.shape[1] // 2]
        if sizes[1] > how.shallow * model.slimmest * sizes[0]:
            tip = sizes[0] * model.axes[0, 0] / regular.axes[0, 0]
            return [(regular, np.array([*place[:2], place[2] + np.angle(tip), np.abs(tip)]))]
    if model.kind not in ("star", "rectangle", "ellipse"):
        return _round(model.footprints(parameters[None])[0], how.round_corners)
    return []


def half_seen(
    model: FootprintModel, parameters: Floats, sigmas: Floats, how: ModelSettings
) -> list[tuple[FootprintModel, Floats]]:
    """What a footprint may be of which one size is not known, with where to start.

    A rectangle of which one side was seen may be a square on that side, or the same behind it.
    """
    if model is not RECTANGLE:
        return []
    known, unknown = (3, 4) if sigmas[3] < sigmas[4] else (4, 3)
    if sigmas[unknown] < how.unknown_size * parameters[unknown]:
        return []
    side, turn = parameters[known], parameters[2] + (0.0 if unknown == 3 else np.pi / 2)
    move = 0.5 * (parameters[unknown] - side) * np.array([np.cos(turn), np.sin(turn)])
    return [
        (SQUARE, np.array([*(parameters[:2] + sign * move), parameters[2], side]))
        for sign in (1.0, -1.0)
    ]


def _round(footprint: Floats, least: int) -> list[tuple[FootprintModel, Floats]]:
    """Circle and ellipse with the moments of a polygon that has many corners."""
    if len(footprint) < least:
        return []
    center = footprints.area_centroid(footprint)
    fit = footprints.fit_ellipse(footprint)
    radius = np.sqrt(fit.long * fit.short)
    return [
        (CIRCLE, np.array([*center, radius])),
        (ELLIPSE, np.array([*center, fit.angle, fit.long, fit.short])),
    ]


def _named(footprint: Floats) -> list[tuple[FootprintModel, Floats]]:
    """Kinds with as many corners as a polygon, where they come nearest to it."""
    m = len(footprint)
    if m not in REGULAR:
        return []
    center = footprint.mean(axis=0)
    arms = _complex(footprint - center)
    axis = REGULAR[m].axes[0]
    size = np.vdot(axis, arms) / np.vdot(axis, axis)
    starts: list[tuple[FootprintModel, Floats]] = [
        (REGULAR[m], np.array([*center, np.angle(size), np.abs(size)]))
    ]
    if m == 4:
        along = (arms[1] - arms[0] + arms[2] - arms[3]) / 2
        across = (arms[2] - arms[1] + arms[3] - arms[0]) / 2
        sizes = np.abs([along, across])
        starts.append((RECTANGLE, np.array([*center, np.angle(along), *sizes])))
    return starts


def without_flattest(footprint: Floats, flat: float) -> Floats | None:
    """A polygon without the corner nearest to the line of its neighbours; None if that is far."""
    before, after = np.roll(footprint, 1, axis=0), np.roll(footprint, -1, axis=0)
    along, to_corner = after - before, footprint - before
    off = np.abs(along[:, 0] * to_corner[:, 1] - along[:, 1] * to_corner[:, 0])
    off /= np.linalg.norm(along, axis=1)
    k = int(np.argmin(off))
    size = float(np.ptp(footprint, axis=0).max())
    return np.delete(footprint, k, axis=0) if len(off) > 3 and off[k] < flat * size else None
