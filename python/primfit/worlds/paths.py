"""Paths: the poses (x, y, yaw) from which a world is scanned, in order."""

from __future__ import annotations

import math
import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import Bools, Floats, Ints, as_rows, generator, instance, integer, number
from primfit.worlds.world import World

_MOST_HEADINGS = 3600
"""Headings at a position: a tenth of a degree apart."""

_MOST_POSITIONS = 1_000_000
"""Positions of a grid: with four headings of the paper's sensor, readings of 128 GB."""


def grid_path(
    world: World,
    spacing: float = 0.25,
    *,
    headings: int = 4,
    clearance: float = 0.045,
    margin: float = 0.5,
    rng: Any = None,
) -> Floats:
    """Poses on a grid, each position with several headings; only valid poses are kept.

    The positions are the centres of square cells of side `spacing`. The headings of a position
    are equally spaced from a random start, so that a sensor with a narrow field of view sees the
    faces on all sides.

    Parameters
    ----------
    world : World
    spacing : float, metres
        Distance between neighbouring positions.
    headings : int
        Headings at each position.
    clearance : float, metres
        Least distance of a position to solids and walls; the default is the e-puck's radius of
        0.037 m and some air.
    margin : float, metres
        How far the grid reaches beyond the solids where there is no arena.
    rng : None, int or numpy.random.Generator

    Returns
    -------
    path : (n, 3) float64
        x, y in metres and yaw in radians.

    Raises
    ------
    ValueError
        When no pose is valid, or there are more than a million positions.

    Examples
    --------
    >>> import primfit
    >>> path = primfit.grid_path(primfit.random_world(rng=7), rng=7)
    >>> path.shape[1]
    3
    """
    instance("world", world, World)
    spacing = number("spacing", spacing, above=0.0)
    headings = integer("headings", headings, low=1, high=_MOST_HEADINGS)
    low, high = world.bounds
    if world.arena is None:
        margin = number("margin", margin, low=0.0)
        low, high = low - margin, high + margin
    counts = np.maximum(counts_along(high - low, spacing), 1)
    x, y = (low[k] + (np.arange(counts[k]) + 0.5) * (high[k] - low[k]) / counts[k] for k in (0, 1))
    positions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    positions = positions[is_free(world, positions, clearance)]
    if not len(positions):
        raise ValueError(
            f"the path has no valid pose: no position of a grid with spacing={spacing:g} m is at "
            f"least clearance={clearance:g} m from the solids and walls of {world!r}"
        )
    start = generator(rng).uniform(0.0, 2 * np.pi, len(positions))
    yaws = start[:, None] + 2 * np.pi * np.arange(headings) / headings
    return np.column_stack(
        [np.repeat(positions, headings, axis=0), np.mod(yaws, 2 * np.pi).ravel()]
    )


def waypoints(
    world: World,
    points: ArrayLike,
    spacing: float = 0.05,
    *,
    headings: int = 1,
    clearance: float = 0.045,
) -> Floats:
    """Poses along straight lines between waypoints; only valid poses are kept.

    Parameters
    ----------
    world : World
    points : (k, 2) float64, metres
        The waypoints; one gives a single position.
    spacing : float, metres
        Largest distance between neighbouring poses.
    headings : int
        1 looks along the way; more add equally spaced headings to it.
    clearance : float, metres
        Least distance of a position to solids and walls.

    Returns
    -------
    path : (n, 3) float64
        x, y in metres and yaw in radians.

    Raises
    ------
    ValueError
        When no pose is valid.

    Warns
    -----
    UserWarning
        When some are not, and left out.

    Examples
    --------
    >>> import primfit
    >>> primfit.waypoints(primfit.World(), [(0, 0), (1, 0)], spacing=0.5)
    array([[0. , 0. , 0. ],
           [0.5, 0. , 0. ],
           [1. , 0. , 0. ]])
    """
    instance("world", world, World)
    corners = as_rows("points", points, 2)
    if not len(corners):
        raise ValueError("points must hold at least one waypoint")
    spacing = number("spacing", spacing, above=0.0)
    headings = integer("headings", headings, low=1, high=_MOST_HEADINGS)
    length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    if length > _MOST_POSITIONS * spacing:
        raise ValueError(
            f"spacing must leave at most {_MOST_POSITIONS} positions, not {spacing:g} m along "
            f"{length:g} m"
        )
    legs = [np.empty((0, 3))]
    yaw = 0.0
    for start, end in pairwise(corners):
        step = end - start
        if not step.any():
            continue
        yaw = float(np.arctan2(step[1], step[0]))
        along = np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(step) / spacing)) + 1)[:-1, None]
        legs.append(np.column_stack([start + along * step, np.full(len(along), yaw)]))
    path = np.concatenate([*legs, [[*corners[-1], yaw]]])
    n_before = len(path)
    path = path[is_free(world, path[:, :2], clearance)]
    if 0 < len(path) < n_before:
        warnings.warn(
            f"points lead through solids or out of the arena: {n_before - len(path)} of {n_before} "
            f"positions are nearer than clearance={clearance:g} m to them, and left out",
            stacklevel=2,
        )
    if not len(path):
        raise ValueError(
            f"the path has no valid pose: none of its positions is at least clearance="
            f"{clearance:g} m from the solids and walls of {world!r}"
        )
    poses = np.repeat(path, headings, axis=0)
    poses[:, 2] += np.tile(2 * np.pi * np.arange(headings) / headings, len(path))
    poses[poses[:, 2] > 2 * np.pi, 2] -= 2 * np.pi
    return poses


def counts_along(extent: Floats, spacing: float) -> Ints:
    """How many positions a grid has along x and y, when it is not too fine."""
    counts = np.rint(extent / spacing)
    if math.prod(counts.tolist()) > _MOST_POSITIONS:
        raise ValueError(
            f"spacing must leave at most {_MOST_POSITIONS} positions, not {spacing:g} m with "
            f"{counts[0]:.10g} x {counts[1]:.10g}"
        )
    return counts.astype(int)


def is_free(world: World, positions: ArrayLike, clearance: float = 0.0) -> Bools:
    """Which positions (n, 2) are inside the arena, outside every solid, and `clearance` from both.

    Parameters
    ----------
    world : World
    positions : (n, 2) float64, metres
    clearance : float, metres

    Returns
    -------
    free : (n,) bool
    """
    xy = as_rows("positions", positions, 2)
    clearance = number("clearance", clearance, low=0.0)
    points = shapely.points(xy)
    free = np.ones(len(xy), dtype=bool)
    if world.arena is not None:
        distance = world.arena.clearance(xy)
        free &= (distance > 0.0) & (distance >= clearance)
    for solid in world.solids:
        distance = shapely.distance(solid.shadow, points)
        free &= (distance > 0.0) & (distance >= clearance)
    return free
