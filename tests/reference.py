"""Slow NumPy twins of the Rust kernels: float64, vectorised in blocks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from primfit import _primfit
from primfit.sensors.sensor import DepthGate

PAIRS_AT_ONCE = 1 << 15


class RayCaster:
    """Every ray against every triangle (Moeller and Trumbore, 1997)."""

    def __init__(self, vertices, triangles, names=None):
        self.corners = vertices[triangles]
        # A miss is triangle -1: the last entry.
        self.names = np.append(np.arange(len(triangles)) if names is None else names, -1)

    def __len__(self):
        return len(self.corners)

    def cast(self, origins, directions, n_jobs=None):
        a, b, c = np.moveaxis(self.corners, 1, 0)
        edge1, edge2 = b - a, c - a
        ranges = np.full(len(origins), np.inf)
        ids = np.full(len(origins), -1)
        step = max(1, PAIRS_AT_ONCE // max(1, len(a)))
        for i in range(0, len(origins), step):
            o, d = origins[i : i + step, None], directions[i : i + step, None]
            p = np.cross(d, edge2)
            determinant = (p * edge1).sum(-1)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = o - a
                u = (t * p).sum(-1) / determinant
                q = np.cross(t, edge1)
                v = (q * d).sum(-1) / determinant
                depth = (q * edge2).sum(-1) / determinant
                hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth >= 0)
            depth = np.where(hit, depth, np.inf)
            if depth.shape[1]:
                nearest = depth.argmin(axis=1)
                ranges[i : i + step] = depth[np.arange(len(depth)), nearest]
                ids[i : i + step] = np.where(np.isfinite(ranges[i : i + step]), nearest, -1)
        return ranges, self.names[ids]

    def scan(self, poses, beams, gate, noise, points, ranges, ids, n_jobs=None):
        directions = turned(poses, beams)
        origins = np.repeat(poses[:, [3, 7, 11]], len(beams), axis=0)
        true, ids[:] = self.cast(origins, directions)
        # As normal, but other numbers.
        normal = np.random.default_rng(noise).standard_normal(len(true))
        if isinstance(gate, DepthGate):
            cosines = np.tile(beams[:, 2], len(poses))
            shape = (-1, gate.width)
            rows = depth_readings((true * cosines).reshape(shape), gate, normal.reshape(shape))
            ranges[:] = rows.ravel() / cosines
        else:
            measured = true + gate.sigma * normal
            if gate.resolution > 0:
                measured = np.rint(measured / gate.resolution) * gate.resolution
            is_within = (true >= gate.min_range) & (true <= gate.max_range)
            ranges[:] = np.where(is_within, measured, np.inf)
        points[:] = origins + directions * np.where(ranges < np.inf, ranges, np.nan)[:, None]


def depth_readings(true, gate, normal):
    """What rows of pixels (n, width) read of true depths, with standard normal numbers."""
    a, b, c = gate.sigma
    sigma = a + b * (true - c) ** 2
    if gate.disparity:
        sigma = np.hypot(sigma, gate.disparity_noise * true**2 / gate.disparity)
    is_seen = (true >= gate.min_depth) & (true <= gate.max_depth)
    if gate.disparity:
        column = np.arange(gate.width)
        place = column - gate.disparity / true
        if gate.stereo:
            is_seen &= (place >= -0.5) & (place <= gate.width - 0.5)
        if gate.shadow:
            # Something farther towards the eye that the eye sees farther from it, or as far.
            towards = np.sign(gate.disparity) * (column[None] - column[:, None]) > 0
            ahead = np.sign(gate.disparity) * (place[:, None] - place[:, :, None]) <= 0
            is_seen &= ~(towards & ahead).any(axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        z = true + np.where(sigma > 0, sigma * normal, 0.0)
        if gate.disparity and gate.disparity_step > 0:
            steps = np.rint(abs(gate.disparity) / z / gate.disparity_step)
            z = np.where(steps > 0, abs(gate.disparity) / (steps * gate.disparity_step), np.inf)
        if gate.resolution > 0:
            z = np.rint(z / gate.resolution) * gate.resolution
    missing = np.nan if gate.disparity and (gate.shadow or gate.stereo) else np.inf
    return np.where(is_seen & (z > 0) & np.isfinite(z), z, missing)


def turned(poses, beams):
    rotations = poses.reshape(-1, 4, 4)[:, :3, :3]
    return np.einsum("pij,bj->pbi", rotations, beams).reshape(-1, 3)


def score_planes(points, equations, threshold, directions=None, msac=False, n_jobs=None):
    sides = 1 if directions is None else 2
    scores = np.zeros((sides, len(equations)))
    normals, offsets = equations[:, :3].T, equations[:, 3]
    for i in range(0, len(points), 2048):
        distance = points[i : i + 2048] @ normals + offsets
        limit = threshold
        if directions is not None:
            limit = -threshold * (directions[i : i + 2048] @ normals)
        if msac:
            with np.errstate(divide="ignore", invalid="ignore"):
                gain = np.rint((1 - (distance / limit) ** 2) * 32768) / 32768
        for score, limit_of_side in zip(scores, (limit, -limit), strict=False):
            inside = np.abs(distance) <= limit_of_side
            score += np.where(inside, gain, 0.0).sum(axis=0) if msac else inside.sum(axis=0)
    return scores.ravel()


def dbscan(points, eps, min_samples):
    """Breadth-first search, the frontier against all points left, block by block."""

    def near(rows, others):
        step = max(1, (1 << 20) // max(1, len(others)))
        for i in range(0, len(rows), step):
            difference = points[rows[i : i + step], None] - points[others]
            yield i, (difference * difference).sum(-1) <= eps * eps

    everything = np.arange(len(points))
    if min_samples > 1:
        counts = [within.sum(axis=1) for _, within in near(everything, everything)]
        core = np.concatenate(counts) >= min_samples if counts else np.zeros(0, bool)
    else:
        core = np.ones(len(points), dtype=bool)
    labels = np.full(len(points), -1)
    left = everything[core]
    n_clusters = 0
    while len(left):
        frontier, left = left[:1], left[1:]
        labels[frontier] = n_clusters
        while len(frontier) and len(left):
            reached = np.zeros(len(left), dtype=bool)
            for _, within in near(frontier, left):
                reached |= within.any(axis=0)
            frontier, left = left[reached], left[~reached]
            labels[frontier] = n_clusters
        n_clusters += 1
    border = everything[~core]
    cores = everything[core]
    for i, within in near(border, cores):
        candidates = np.where(within, labels[cores], np.iinfo(np.int64).max)
        lowest = candidates.min(axis=1, initial=np.iinfo(np.int64).max)
        found = lowest < np.iinfo(np.int64).max
        labels[border[i : i + len(within)][found]] = lowest[found]
    return labels


def fit_plane(points, weights, normal_space):
    total = weights.sum()
    if not len(points) or not total > 0:
        return None
    mean = points[0] + weights @ (points - points[0]) / total
    local = points - mean
    scatter = (weights[:, None] * local).T @ local
    values, vectors = np.linalg.eigh(normal_space @ scatter @ normal_space.T)
    vectors = normal_space.T @ vectors
    normal = vectors[:, 0]
    if (values[1:] <= 1e-14 * values.max()).any():
        return None
    change = np.array([[0.0, 0.0, 0.0, 1.0]])
    covariance = change.T @ change / total
    for value, vector in zip(values[1:], vectors.T[1:], strict=True):
        change = np.append(vector, -vector @ mean)
        covariance += np.outer(change, change) / value
    rms = np.sqrt(weights @ (local @ normal) ** 2 / total)
    return np.append(normal, -normal @ mean), covariance, rms


def fit_plane_to_ranges(points, directions, sigmas, equation, normal_space):
    origin = points[0] + (points - points[0]).mean(axis=0)
    local = points - origin
    equation = np.asarray(equation)
    normal, offset = equation[:3], equation[3] + equation[:3] @ origin

    def linearise(normal, offset):
        free = normal_space - np.outer(normal_space @ normal, normal)
        axes = np.linalg.svd(free)[2][: len(normal_space) - 1]
        approach = directions @ normal
        residual = (local @ normal + offset) / approach
        crossing = local - residual[:, None] * directions
        rows = np.column_stack([crossing @ axes.T, np.ones(len(local))])
        rows /= (approach * sigmas)[:, None]
        residual = residual / sigmas
        return axes, rows, residual, residual @ residual

    axes, rows, residual, cost = linearise(normal, offset)
    share = 1.0
    for _ in range(30):
        step = -np.linalg.solve(rows.T @ rows, rows.T @ residual)
        if step @ (rows.T @ rows) @ step <= 1e-9 * cost or share < 1e-3:
            break
        moved = normal + share * step[:-1] @ axes
        moved /= np.linalg.norm(moved)
        after = linearise(moved, offset + share * step[-1])
        if after[3] < cost:
            normal, offset = moved, offset + share * step[-1]
            (axes, rows, residual, cost), share = after, 1.0
        else:
            share /= 2
    to_equation = np.vstack([np.column_stack([axes, -axes @ origin]), [0.0, 0.0, 0.0, 1.0]]).T
    covariance = to_equation @ np.linalg.inv(rows.T @ rows) @ to_equation.T
    rms = np.sqrt(cost / (1 / sigmas**2).sum())
    return np.append(normal, offset - normal @ origin), covariance, rms


def residuals(points, directions, equation):
    distance = points @ equation[:3] + equation[3]
    if directions is None:
        return distance
    approach = -(directions @ equation[:3])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(approach > 0.0, distance / approach, np.inf)


def passages(origins, directions, lengths, equation, axes, clear):
    approach = -(directions @ equation[:3])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = (origins @ equation[:3] + equation[3]) / approach
        passed = (approach > 0.0) & (crossing > 0.0) & (lengths > crossing + clear)
    return (origins[passed] + crossing[passed, None] * directions[passed]) @ axes.T


@contextmanager
def instead_of_rust() -> Iterator[None]:
    """Let the whole library run on the twins."""
    twins = [
        RayCaster,
        turned,
        score_planes,
        dbscan,
        fit_plane,
        fit_plane_to_ranges,
        residuals,
        passages,
    ]
    rust = {twin.__name__: getattr(_primfit, twin.__name__) for twin in twins}
    try:
        for twin in twins:
            setattr(_primfit, twin.__name__, twin)
        yield
    finally:
        for name, kernel in rust.items():
            setattr(_primfit, name, kernel)


def neighbors(points, queries, k):
    squared = ((queries[:, None] - points) ** 2)[..., ::-1]
    squared = squared[..., 2] + squared[..., 1] + squared[..., 0]
    rows = np.broadcast_to(np.arange(len(points)), squared.shape)
    order = np.lexsort((rows, squared))[:, :k]
    return order, np.sqrt(np.take_along_axis(squared, order, axis=1))


def local_planes(points, rows, sigma=None):
    """Planes around some points, at the first size that is flat."""
    sizes = (12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)
    planes = []
    for row in rows:
        nearest = points[neighbors(points, points[row : row + 1], 384)[0][0]]
        candidates = []
        for few, largest in ((True, 24), (False, 384)):
            window = nearest[: 96 if few else 384]
            candidates = []
            for k in dict.fromkeys(min(size, len(window)) for size in sizes if size <= largest):
                local = window[:k] - window[:k].mean(axis=0)
                values, vectors = np.linalg.eigh(local.T @ local / k)
                variance, least = values[0] * k / (k - 3), max(6.0, 288.0 / k)
                if sigma is not None and variance <= (1 + 4 * np.sqrt(2 / k)) * sigma**2:
                    variance, least = sigma**2, 6.0
                flatness = values[1] / variance
                distance = (window[: 4 * k] - window[:k].mean(axis=0)) @ vectors[:, 0]
                supported = np.mean(np.abs(distance) <= 3 * np.sqrt(variance)) >= 0.4
                flat = bool(flatness > least and values[1] > 0.06 * values[2] and supported)
                plane = (vectors[:, 0], np.sqrt(variance), flatness, k, flat)
                candidates.append(((flat, supported, flatness / least, -k), plane))
                if flat:
                    break
            if candidates[-1][1][4]:
                break
        planes.append(max(candidates, key=lambda c: c[0])[1])
    return [np.array(column) for column in zip(*planes, strict=True)]
