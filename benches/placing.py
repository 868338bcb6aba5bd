"""Solids put at random on a floor of any shape, and the sensor of most scenes of `scenes.py`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

import primfit

KINDS = ("triangle", "square", "rectangle", "pentagon")
ATTEMPTS = 3000
"""Positions to try for all solids of a scene: a crowded one holds fewer than were asked for."""


def furniture(
    sizes: tuple[float, float], heights: tuple[float, float]
) -> Callable[[np.random.Generator], primfit.Prism]:
    """What draws a prism about the origin: sides (the long one of a rectangle) and heights, metres."""

    def draw(rng: np.random.Generator) -> primfit.Prism:
        kind = rng.choice(KINDS)
        place = {"angle": rng.uniform(0.0, 2 * np.pi), "height": rng.uniform(*heights)}
        side = rng.uniform(*sizes)
        if kind == "rectangle":
            return primfit.Prism.rectangle(side, rng.uniform(0.35, 0.75) * side, **place)
        return primfit.Prism.regular(
            {"triangle": 3, "square": 4, "pentagon": 5}[kind], side, **place
        )

    return draw


def placed(
    rng: np.random.Generator,
    n: int,
    floor: shapely.Polygon,
    draw: Callable[[np.random.Generator], primfit.Prism],
    *,
    gap: float,
    border: float,
    keep_off: shapely.Geometry | None = None,
) -> list[primfit.Prism]:
    """At most `n` solids on a floor.

    They stand `gap` apart, `border` from the walls, and `gap` from what they shall keep off; metres.
    """
    solids: list[primfit.Prism] = []
    taken = keep_off or shapely.Point()
    inside = floor.buffer(-border)
    low, high = np.array(floor.bounds).reshape(2, 2)
    for _ in range(ATTEMPTS):
        if len(solids) == n:
            break
        loose = draw(rng)
        solid = primfit.Prism(loose.footprint + rng.uniform(low, high), loose.height)
        # The distance to nothing is NaN.
        if inside.contains(solid.shadow) and not taken.distance(solid.shadow) <= gap:
            solids.append(solid)
            taken = taken.union(solid.shadow)
    return solids


def spinning(mount: float, sigma: float, max_range: float) -> primfit.Lidar:
    """A sensor of 16 layers over 30 degrees and 360 columns, `mount` above the floor; metres."""
    return primfit.Lidar(
        number_of_layers=16,
        vertical_field_of_view=np.radians(30.0),
        horizontal_resolution=360,
        field_of_view=2 * np.pi,
        min_range=0.2,
        max_range=max_range,
        noise=sigma / max_range,
        mount=(0.0, 0.0, mount),
    )
