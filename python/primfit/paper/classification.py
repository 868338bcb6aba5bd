"""From a closed outline to kind, centre, size and angle, with uncertainty."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from primfit._check import Floats
from primfit.geometry import footprints
from primfit.geometry.decompositions import inverse_of, root_of
from primfit.geometry.footprints import regular_name, sides
from primfit.geometry.outlines import Outline, free_polygon
from primfit.geometry.products import dot, dots, product
from primfit.paper.topology import Cycle

_Template = Callable[[Floats], Floats]


def classify(cycle: Cycle, slack: float = 0.0) -> Outline:
    """The kind that explains an outline with the fewest parameters.

    Regular polygon, rectangle, star and free polygon compete by the Bayesian information
    criterion; their vertices are fitted to those of the outline with the covariance that the
    planes give them, and `slack` metres more.
    """
    vertices = cycle.vertices
    covariance = vertex_covariance(cycle) + slack**2 * np.eye(2 * len(cycle.vertices))
    n_points = sum(len(wall.patch.inliers) for wall in cycle.walls)
    n = len(vertices)
    # Correlated vertices become independent residuals; rounding sets the least deviation.
    rounding = (1e-9 * np.ptp(vertices, axis=0).max()) ** 2
    whiten = inverse_of(root_of(covariance + rounding * np.eye(2 * n)))
    best: Outline | None = None
    best_cost = 2.0 * n * np.log(n_points)
    for kind, template, start in _templates(vertices):

        def residuals(p: Floats, template: _Template = template) -> Floats:
            return dots(whiten, (template(p) - vertices).ravel())

        solution = least_squares(residuals, start, x_scale="jac", method="lm")
        cost = dot(solution.fun, solution.fun) + len(start) * np.log(n_points)
        if cost < best_cost:
            best_cost = cost
            footprint = footprints.clean_footprint(template(solution.x))
            size = solution.x[3:]
            best = Outline(
                kind=kind,
                footprint=footprint,
                angle=footprints.angle_of(footprint, kind),
                size=float(size[0]) if len(size) == 1 else (float(size[0]), float(size[1])),
                covariance=inverse_of(product(solution.jac.T, solution.jac)),
            )
    return best or free_polygon(vertices, covariance)


def _templates(vertices: Floats) -> list[tuple[str, _Template, Floats]]:
    """Kinds that n vertices may be: name, vertices of parameters, parameters to start from.

    The vertices of a template are in the order of the given ones.
    """
    n = len(vertices)
    center = vertices.mean(axis=0)
    arms = vertices - center
    z = arms[:, 0] + 1j * arms[:, 1]

    def turn(local: Floats) -> float:
        """Angle of `vertices` to a template at angle zero."""
        return float(np.angle(((local[:, 0] - 1j * local[:, 1]) * z).sum()))

    lengths = np.linalg.norm(sides(vertices), axis=1)
    origin = np.zeros(2)
    kinds: list[tuple[str, _Template, Floats]] = []

    if n < footprints.FEWEST_ROUND_VERTICES:
        regular = footprints.regular_footprint(n, 1.0, origin, 0.0)
        kinds.append(
            (
                regular_name(n),
                lambda p: footprints.regular_footprint(n, p[3], p[:2], p[2]),
                np.array([*center, turn(regular), lengths.mean()]),
            )
        )
    if n == 4:
        pairs = (lengths[:2] + lengths[2:]) / 2
        shift = int(pairs[0] < pairs[1])

        def rectangle(p: Floats) -> Floats:
            return np.roll(footprints.rectangle_footprint(p[3], p[4], p[:2], p[2]), shift, axis=0)

        sized = rectangle(np.array([0.0, 0.0, 0.0, pairs.max(), pairs.min()]))
        kinds.append(
            ("rectangle", rectangle, np.array([*center, turn(sized), pairs.max(), pairs.min()]))
        )
    if n >= 6 and n % 2 == 0:
        radii = np.linalg.norm(arms.reshape(-1, 2, 2), axis=2).mean(axis=0)
        tip = int(radii[1] > radii[0])

        def star(p: Floats) -> Floats:
            outline = footprints.star_footprint(n // 2, p[3], p[4], p[:2], p[2])
            return np.roll(outline, tip, axis=0)

        sized = star(np.array([0.0, 0.0, 0.0, radii.max(), radii.min()]))
        kinds.append(("star", star, np.array([*center, turn(sized), radii.max(), radii.min()])))
    return kinds


def vertex_covariance(cycle: Cycle) -> Floats:
    """Covariance (2m, 2m) of the vertices of a cycle, from that of its planes.

    Neighbouring vertices share a wall, so they are correlated.
    """
    n = len(cycle.walls)
    jacobian = np.zeros((2 * n, 3 * n))
    planes = np.zeros((3 * n, 3 * n))
    for k, wall in enumerate(cycle.walls):
        model = wall.patch.model
        horizontal = np.ix_([0, 1, 3], [0, 1, 3])
        scale = float(np.hypot(*model.equation[:2]))
        planes[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = model.covariance[horizontal] / scale**2
    for k, vertex in enumerate(cycle.vertices):
        lines = (k - 1) % n, k
        inverse = inverse_of(np.array([cycle.walls[line].line[:2] for line in lines]))
        for row, line in enumerate(lines):
            change = cycle.walls[line].side * np.outer(inverse[:, row], [*vertex, 1.0])
            jacobian[2 * k : 2 * k + 2, 3 * line : 3 * line + 3] -= change
    return product(product(jacobian, planes), jacobian.T)


def classify_by_sides(vertices: Floats, tolerance: float) -> Outline:
    """The paper's rules for kind, centre and angle (sections 3.3 and 3.4, equations 8 and 9).

    Sides are equal when they differ by less than `tolerance` of the mean; the paper gives none.
    The angle is that of the two lowest vertices, modulo 60, 90, 180 and 72 degrees for triangle,
    square, rectangle and pentagon.
    """
    n = len(vertices)
    lengths = np.linalg.norm(sides(vertices), axis=1)

    def equal(values: Floats) -> bool:
        return bool(np.ptp(values) <= tolerance * values.mean())

    kind = "polygon"
    if n <= 5 and equal(lengths):
        kind = regular_name(n)
    elif n == 4 and equal(lengths[::2]) and equal(lengths[1::2]):
        kind = "rectangle"
    low = vertices[np.argsort(vertices[:, 1], kind="stable")[:2]]
    x, y = low[1] - low[0]
    period = {"triangle": 60.0, "square": 90.0, "rectangle": 180.0, "pentagon": 72.0}
    return Outline(
        kind=kind,
        footprint=vertices,
        angle=float(np.arctan2(y, x) % np.radians(period.get(kind, 360.0))),
        size=footprints.size_of(vertices, kind),
        covariance=np.full((5, 5) if kind in ("rectangle", "polygon") else (4, 4), np.nan),
    )
