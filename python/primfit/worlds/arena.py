"""The walls around a world: any simple polygon, seen from inside."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import Floats, as_rows, number
from primfit.geometry.footprints import clean_footprint

_DEFAULT_SIZE = (2.0, 2.0)


@dataclass(frozen=True, eq=False)
class Arena:
    """Walls around a floor: a rectangle whose corner is the origin, or any simple polygon.

    The walls have no thickness, since a sensor inside cannot see it.

    Parameters
    ----------
    size : float or (2,), metres
        Inner width (x) and depth (y) of a rectangle, whose inner faces stand at 0 and `size`. With
        an outline it is the extent of that, and need not be given.
    height : float, metres
        Height of the walls.
    outline : (m, 2) float64 or None, metres
        Corners of the inner faces, in either direction and anywhere; afterwards counter-clockwise,
        not closed, without collinear corners. None for the rectangle of `size`.

    Raises
    ------
    ValueError
        When the outline crosses itself or has no area, a size is not positive, or both are given
        and do not agree.

    Examples
    --------
    >>> import primfit
    >>> primfit.Arena((4.0, 3.0))
    Arena(4 x 3 m, height 0.3 m)
    >>> ell = [(0, 0), (4, 0), (4, 1.5), (2, 1.5), (2, 3), (0, 3)]
    >>> primfit.Arena(outline=ell, height=2.5)
    Arena(4 x 3 m, 6 walls, height 2.5 m)
    """

    size: tuple[float, float] = _DEFAULT_SIZE
    height: float = field(default=0.3, kw_only=True)
    outline: Any = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        try:
            size = (self.size, self.size) if np.ndim(self.size) == 0 else tuple(self.size)
        except TypeError:
            raise TypeError(f"size must be a number or (width, depth), not {self.size!r}") from None
        if len(size) != 2:
            raise ValueError(f"size must be a number or (width, depth), not {self.size!r}")
        width, depth = (number("size", value, above=0.0) for value in size)
        if self.outline is None:
            outline = _rectangle(width, depth)
        else:
            outline = clean_footprint(self.outline, "outline")
            extent = np.ptp(outline, axis=0)
            if (width, depth) != _DEFAULT_SIZE and not np.allclose(extent, (width, depth)):
                raise ValueError(
                    f"size must be left out or be the extent of outline, {extent[0]:g} x "
                    f"{extent[1]:g} m, not {self.size!r}"
                )
            width, depth = extent.tolist()
        object.__setattr__(self, "size", (width, depth))
        object.__setattr__(self, "height", number("height", self.height, above=0.0))
        object.__setattr__(self, "outline", outline)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (2,) of the box around the outline, metres."""
        return self.outline.min(axis=0), self.outline.max(axis=0)

    @property
    def is_rectangle_of_size(self) -> bool:
        """Whether the outline is the rectangle of `size` whose corner is the origin."""
        return np.array_equal(self.outline, _rectangle(*self.size))

    @cached_property
    def shadow(self) -> shapely.Polygon:
        """What the walls enclose, as seen from above."""
        return shapely.Polygon(self.outline)

    def clearance(self, positions: ArrayLike) -> Floats:
        """Distance (n,) of positions (n, 2) to the nearest wall, negative outside; metres."""
        xy = as_rows("positions", positions, 2)
        distance = shapely.distance(self.shadow.exterior, shapely.points(xy))
        return np.where(shapely.contains_xy(self.shadow, xy), distance, -distance)

    def to_dict(self) -> dict[str, Any]:
        """The arena as plain numbers, for JSON."""
        content: dict[str, Any] = {"size": list(self.size), "height": self.height}
        if not self.is_rectangle_of_size:
            content["outline"] = self.outline.tolist()
        return content

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Arena)
            and self.height == other.height
            and np.array_equal(self.outline, other.outline)
        )

    def __hash__(self) -> int:
        return hash((self.height, self.outline.tobytes()))

    @property
    def description(self) -> str:
        """Extent, and number of walls unless it is the rectangle of `size`."""
        walls = "" if self.is_rectangle_of_size else f", {len(self.outline)} walls"
        return "{:g} x {:g} m".format(*self.size) + walls

    def __repr__(self) -> str:
        return f"Arena({self.description}, height {self.height:g} m)"


def _rectangle(width: float, depth: float) -> Floats:
    return np.array([[0.0, 0.0], [width, 0.0], [width, depth], [0.0, depth]])
