"""A town of houses with gabled roofs on flat ground, as a scanner in the air sees it."""

from __future__ import annotations

import numpy as np

PITCH = 25.0
"""Distance of houses, metres."""


def town(n_side: int, density: float, rng, noise: float = 0.02):
    """Points (n, 3), and the plane of each: 0 is the ground, each house has two roofs."""
    numbers = np.random.default_rng(rng)
    side = n_side * PITCH
    xy = numbers.uniform(0.0, side, (int(density * side * side), 2))
    house = np.floor(xy / PITCH).astype(int)
    size = numbers.uniform(8.0, 12.0, (n_side, n_side, 2))[house[:, 0], house[:, 1]]
    angle = numbers.uniform(0.0, np.pi, (n_side, n_side))[house[:, 0], house[:, 1]]
    eaves = numbers.uniform(3.0, 6.0, (n_side, n_side))[house[:, 0], house[:, 1]]
    slope = numbers.uniform(0.5, 1.0, (n_side, n_side))[house[:, 0], house[:, 1]]
    local = xy - (house + 0.5) * PITCH
    along = local[:, 0] * np.cos(angle) + local[:, 1] * np.sin(angle)
    across = local[:, 1] * np.cos(angle) - local[:, 0] * np.sin(angle)
    on_roof = (abs(along) < size[:, 0] / 2) & (abs(across) < size[:, 1] / 2)
    z = np.where(on_roof, eaves + slope * (size[:, 1] / 2 - abs(across)), 0.0)
    points = np.column_stack([xy, z]) + noise * numbers.normal(size=(len(xy), 3))
    number = 1 + 2 * (house[:, 0] * n_side + house[:, 1]) + (across > 0.0)
    return points, np.where(on_roof, number, 0)


def share_alike(labels, others, least=0.9):
    """Share of the labels whose points have a label of the others, with IoU above `least`."""
    both = (labels >= 0) & (others >= 0)
    pairs, shared = np.unique(np.stack([labels, others])[:, both], axis=1, return_counts=True)
    n_a, n_b = np.bincount(labels[labels >= 0]), np.bincount(others[others >= 0])
    iou = shared / (n_a[pairs[0]] + n_b[pairs[1]] - shared)
    return np.count_nonzero(iou > least) / np.count_nonzero(n_a)
