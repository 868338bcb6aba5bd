"""Whether solids stand where a scan of them makes sense."""

from __future__ import annotations

import warnings

import numpy as np
import shapely

from primfit.solids.prism import Prism
from primfit.solids.round import Round
from primfit.solids.solid import Solid
from primfit.worlds.world import World

_SLACK = 1e-9
"""Share of the size of the smaller solid by which two may reach into each other: rounding."""


def warn_of_places(world: World) -> None:
    """Warn of solids outside the arena, and of those inside each other, wholly or in part."""
    outside = []
    if world.arena is not None:
        inside = shapely.buffer(shapely.Polygon(world.arena.outline), _SLACK)
        outside = [i for i, solid in enumerate(world.solids) if not inside.covers(solid.shadow)]
    if outside:
        warnings.warn(
            f"solids {_listed(outside)} reach beyond the arena of {world!r}: what is outside its "
            f"walls is not seen from within",
            stacklevel=3,
        )
    tree = shapely.STRtree([solid.shadow for solid in world.solids])
    pairs = [
        (i, k)
        for i, solid in enumerate(world.solids)
        for k in tree.query(solid.shadow, "intersects").tolist()
        if i < k and _overlap(solid, world.solids[k])
    ]
    if pairs:
        warnings.warn(
            f"solids {_listed(pairs)} of {world!r} reach into each other: beams end on what is "
            f"outermost of them",
            stacklevel=3,
        )


def _overlap(one: Solid, other: Solid) -> bool:
    """Whether two solids share a volume."""
    (low, high), (other_low, other_high) = (each.bounds for each in (one, other))
    shared = np.minimum(high, other_high) - np.maximum(low, other_low)
    if (shared <= _SLACK * np.minimum(high - low, other_high - other_low)).any():
        return False
    if isinstance(one, Prism) and isinstance(other, Prism):
        area = one.shadow.intersection(other.shadow).area
        return bool(area > 1e3 * _SLACK * min(one.shadow.area, other.shadow.area))
    return _has_corner_in(one, other) or _has_corner_in(other, one)


def _has_corner_in(one: Solid, other: Solid) -> bool:
    """Whether a corner of `one`, or a point of its round surface, is inside when drawn in."""
    corners = one.surface_points() if isinstance(one, Round) else one.vertices
    drawn_in = corners + 1e-6 * (corners.mean(axis=0) - corners)
    if not isinstance(other, Prism):
        return bool(other.contains(drawn_in).any())
    low, high = other.vertices[:, 2].min(), other.vertices[:, 2].max()
    within = (drawn_in[:, 2] > low) & (drawn_in[:, 2] < high)
    return bool((within & shapely.contains_xy(other.shadow, drawn_in[:, 0], drawn_in[:, 1])).any())


def _listed(rows: list[int] | list[tuple[int, int]]) -> str:
    """The first few of them."""
    some = ", ".join(map(str, rows[:5]))
    return some if len(rows) <= 5 else f"{some} and {len(rows) - 5} more"
