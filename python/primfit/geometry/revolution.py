"""Surfaces of revolution as meshes, and frames about an axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from primfit._check import Floats, Ints


def frame_about(axis: Floats) -> Floats:
    """A right-handed frame (3, 3) by rows whose third is the unit vector `axis`."""
    k = 0 if abs(axis[0]) < 0.9 else 1
    x = np.eye(3)[k] - axis[k] * axis
    x /= np.sqrt((x * x).sum())
    return np.stack([x, np.cross(axis, x), axis])


def circle_points(n: int) -> Floats:
    """Points (n, 2) of the unit circle, counter-clockwise from (1, 0)."""
    bearings = 2.0 * np.pi * np.arange(n) / n
    return np.stack([np.cos(bearings), np.sin(bearings)], axis=1)


def revolved(profile: Floats, n: int, *, closed: bool = False) -> tuple[Floats, list[Ints]]:
    """Vertices (v, 3) and outward faces of a profile turned about the z axis in `n` steps.

    Parameters
    ----------
    profile : (k, 2) float64
        Distance from the axis and height, from the bottom upwards as seen with the solid on the
        left. Where it is on the axis it is one vertex; where it ends off the axis there is a cap.
    closed : bool
        Whether the last point is followed by the first.
    """
    circle = circle_points(n)
    rings: list[Ints] = []
    parts = []
    count = 0
    for radius, height in profile:
        ring = radius * circle if radius > 0.0 else np.zeros((1, 2))
        parts.append(np.column_stack([ring, np.full(len(ring), height)]))
        rings.append(count + np.arange(len(ring)))
        count += len(ring)
    faces: list[Ints] = []
    following = [*rings[1:], rings[0]] if closed else rings[1:]
    for low, high in zip(rings, following, strict=False):
        faces += _band(low, high)
    if not closed:
        faces += [rings[0][::-1]] if len(rings[0]) > 1 else []
        faces += [rings[-1]] if len(rings[-1]) > 1 else []
    return np.concatenate(parts), faces


def _band(low: Ints, high: Ints) -> list[Ints]:
    """Faces between two rings, of which one may be a single vertex."""
    if len(low) == 1:
        return list(np.stack([np.full(len(high), low[0]), np.roll(high, -1), high], axis=1))
    after = np.roll(low, -1)
    if len(high) == 1:
        return list(np.stack([low, after, np.full(len(low), high[0])], axis=1))
    return list(np.stack([low, after, np.roll(high, -1), high], axis=1))


def fans(faces: Sequence[Ints]) -> Ints:
    """Triangles (t, 3) of convex faces."""
    return np.concatenate(
        [np.column_stack([np.full(len(f) - 2, f[0]), f[1:-1], f[2:]]) for f in faces]
    )
