"""Generated clouds with known planes, spheres, cylinders, cones and tori."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

FEWEST = 100
"""Points of a primitive that counts."""


@dataclass(frozen=True)
class Primitive:
    """A bounded surface in a frame of its own, about or across its z axis.

    `sizes` are width and length of a plane, the radius of a sphere or cylinder, the half angle of a
    cone, the radii of a torus; `limits` the ends along z (cylinder, cone), of z over the radius
    (sphere), of the angle around the tube (torus); `arc` the angle about z.
    """

    kind: str
    turn: np.ndarray
    place: np.ndarray
    sizes: tuple[float, ...]
    limits: tuple[float, float] = (0.0, 0.0)
    arc: float = 2.0 * np.pi

    @property
    def axis(self) -> np.ndarray:
        return self.turn[:, 2]

    @property
    def area(self) -> float:
        low, high = self.limits
        first, second = (*self.sizes, 0.0)[:2]
        if self.kind == "plane":
            return first * second
        if self.kind == "sphere":
            return self.arc * first**2 * (high - low)
        if self.kind == "cylinder":
            return self.arc * first * (high - low)
        if self.kind == "cone":
            return self.arc * np.tan(first) / np.cos(first) * (high**2 - low**2) / 2.0
        return self.arc * second * (first * (high - low) + second * (np.sin(high) - np.sin(low)))

    def sampled(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Points spread evenly over the surface, and normals."""
        low, high = self.limits
        u, v = rng.uniform(size=(2, n))
        around = self.arc * u
        x, y = np.cos(around), np.sin(around)
        out, up = np.column_stack([x, y, 0 * x]), np.array([0.0, 0.0, 1.0])
        first, second = (*self.sizes, 0.0)[:2]
        if self.kind == "plane":
            points = np.column_stack([(u - 0.5) * first, (v - 0.5) * second, 0 * u])
            normals = np.broadcast_to(up, points.shape)
        elif self.kind == "sphere":
            z = low + (high - low) * v
            normals = np.sqrt(1.0 - z**2)[:, None] * out + z[:, None] * up
            points = first * normals
        elif self.kind == "cylinder":
            points, normals = first * out + (low + (high - low) * v)[:, None] * up, out
        elif self.kind == "cone":
            z = np.sqrt(low**2 + (high**2 - low**2) * v)
            points = z[:, None] * (np.tan(first) * out + up)
            normals = np.cos(first) * out - np.sin(first) * up
        else:
            tube = np.linspace(low, high, 2048)
            belt = first * (tube - low) + second * (np.sin(tube) - np.sin(low))
            tube = np.interp(v * belt[-1], belt, tube)
            normals = np.cos(tube)[:, None] * out + np.sin(tube)[:, None] * up
            points = first * out + second * normals
        return points @ self.turn.T + self.place, normals @ self.turn.T

    def hit(self, origin: np.ndarray, beams: np.ndarray) -> np.ndarray:
        """Range at which each beam from a place meets the surface; infinite for none."""
        start, ways = (origin - self.place) @ self.turn, beams @ self.turn
        ranges = np.full(len(beams), np.inf)
        for far in self._crossings(start, ways):
            with np.errstate(invalid="ignore"):
                at = start + far[:, None] * ways
                met = (far > 1e-6) & (far < ranges) & self._holds(at)
            ranges[met] = far[met]
        return ranges

    def _crossings(self, start: np.ndarray, ways: np.ndarray) -> list[np.ndarray]:
        first = self.sizes[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            if self.kind == "plane":
                return [-start[2] / ways[:, 2]]
            if self.kind == "torus":
                return self._marched(start, ways)
            weights = {
                "sphere": (1, 1, 1),
                "cylinder": (1, 1, 0),
                "cone": (1, 1, -(np.tan(first) ** 2)),
            }
            w = np.array(weights[self.kind], dtype=float)
            a, b = (ways**2) @ w, ways @ (w * start)
            c = start @ (w * start) - (0.0 if self.kind == "cone" else first**2)
            root = np.sqrt(b * b - a * c)
            return [(-b - root) / a, (-b + root) / a]

    def _marched(self, start: np.ndarray, ways: np.ndarray) -> list[np.ndarray]:
        """Crossings of a torus: the signed distance changes sign between steps; then by halves."""
        major, minor = self.sizes
        middle = -(ways @ start)
        steps = middle[:, None] + np.linspace(-1.0, 1.0, 65) * 1.01 * (major + minor)

        def off(far: np.ndarray) -> np.ndarray:
            at = start + far[..., None] * (ways[:, None] if far.ndim == 2 else ways)
            ring = np.hypot(at[..., 0], at[..., 1]) - major
            return np.hypot(ring, at[..., 2]) - minor

        sign = off(steps) > 0.0
        crossings = []
        changes = sign[:, 1:] != sign[:, :-1]
        for number in range(4):
            is_there = changes.sum(axis=1) > number
            where = np.argsort(~changes, axis=1, kind="stable")[:, number]
            row = np.arange(len(ways))
            low, high = steps[row, where], steps[row, where + 1]
            inside = off(low) > 0.0
            for _ in range(45):
                half = (low + high) / 2.0
                same = (off(half) > 0.0) == inside
                low, high = np.where(same, half, low), np.where(same, high, half)
            crossings.append(np.where(is_there, low, np.nan))
        return crossings

    def _holds(self, at: np.ndarray) -> np.ndarray:
        low, high = self.limits
        first, second = (*self.sizes, 0.0)[:2]
        if self.kind == "plane":
            return (np.abs(at[:, 0]) <= first / 2) & (np.abs(at[:, 1]) <= second / 2)
        holds = np.mod(np.arctan2(at[:, 1], at[:, 0]), 2.0 * np.pi) <= self.arc
        if self.kind == "torus":
            ring = np.hypot(at[:, 0], at[:, 1]) - first
            tube = np.arctan2(at[:, 2], ring)
            tube = np.where(tube < low, tube + 2.0 * np.pi, tube)
            return holds & (tube <= high)
        z = at[:, 2] / first if self.kind == "sphere" else at[:, 2]
        return holds & (z >= low) & (z <= high)


@dataclass(frozen=True)
class SurfaceScene:
    """A cloud; truth (n,) numbers its primitives, -1 is none."""

    name: str
    points: np.ndarray
    truth: np.ndarray
    primitives: list[Primitive]
    sigma: float
    origins: np.ndarray | None = None


def _turn(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()


def random_primitive(kind: str, place: np.ndarray, rng: np.random.Generator) -> Primitive:
    """One of about half a metre, three in five of them a part of the way around."""
    turn = _turn(rng)
    arc = 2.0 * np.pi if rng.uniform() < 0.4 else rng.uniform(1.6, 5.0)
    if kind == "plane":
        return Primitive(kind, turn, place, tuple(rng.uniform(0.5, 1.0, 2)))
    if kind == "sphere":
        return Primitive(kind, turn, place, (rng.uniform(0.2, 0.5),), (-0.3, 1.0), arc)
    if kind == "cylinder":
        half = rng.uniform(0.25, 0.5)
        return Primitive(kind, turn, place, (rng.uniform(0.1, 0.3),), (-half, half), arc)
    if kind == "cone":
        angle = rng.uniform(0.2, 0.7)
        return Primitive(kind, turn, place - 0.6 * turn[:, 2], (angle,), (0.25, 0.85), arc)
    tube = rng.uniform(1.8, np.pi)
    return Primitive(
        kind, turn, place, (rng.uniform(0.3, 0.45), rng.uniform(0.08, 0.15)), (-tube, tube), arc
    )


def _spread(
    name: str,
    primitives: list[Primitive],
    n: int,
    sigma: float,
    outliers: float,
    rng: np.random.Generator,
) -> SurfaceScene:
    areas = np.array([primitive.area for primitive in primitives])
    counts = rng.multinomial(round(n * (1.0 - outliers)), areas / areas.sum())
    points = np.vstack(
        [p.sampled(count, rng)[0] for p, count in zip(primitives, counts, strict=True)]
    )
    points += rng.normal(0.0, sigma, points.shape)
    truth = np.repeat(np.arange(len(primitives)), counts)
    clutter = rng.uniform(points.min(axis=0), points.max(axis=0), (n - len(points), 3))
    mix = rng.permutation(n)
    points = np.vstack([points, clutter])[mix]
    truth = np.append(truth, np.full(len(clutter), -1))[mix]
    return SurfaceScene(name, points, truth, primitives, sigma)


KINDS = ("plane", "sphere", "cylinder", "cone", "torus")


def mixed(seed: int, n: int = 200_000) -> SurfaceScene:
    """Twenty separate primitives of all kinds; noise of 0.8 % of half a metre, 8 % outliers."""
    rng = np.random.default_rng([1, seed])
    cells = [(i, j) for i in range(5) for j in range(4)]
    primitives = [
        random_primitive(KINDS[k % 5], np.array([1.8 * i, 1.8 * j, 0.0]), rng)
        for k, (i, j) in enumerate(cells)
    ]
    return _spread(f"mixed {seed}", primitives, n, 0.004, 0.08, rng)


def crowded(seed: int, n: int = 100_000) -> SurfaceScene:
    """The same so close that they meet; noise of 1 %, 30 % outliers."""
    rng = np.random.default_rng([2, seed])
    primitives = [
        random_primitive(
            KINDS[k % 5], np.array([0.75 * (k % 5), 0.75 * (k // 5 % 2), 0.75 * (k // 10)]), rng
        )
        for k in range(20)
    ]
    return _spread(f"crowded {seed}", primitives, n, 0.005, 0.3, rng)


def flat(seed: int, n: int = 60_000) -> SurfaceScene:
    """Eight planes or patches that rise by less than half of sigma, four that rise by 8 to 20."""
    rng = np.random.default_rng([3, seed])
    sigma, primitives = 0.003, []
    for k in range(12):
        place = np.array([1.5 * (k % 4), 1.5 * (k // 4), 0.0])
        if k < 5:
            primitives.append(
                Primitive("plane", _turn(rng), place, tuple(rng.uniform(0.6, 1.0, 2)))
            )
            continue
        rise = sigma * (rng.uniform(0.1, 0.5) if k < 8 else rng.uniform(8.0, 20.0))
        half = 0.4
        radius = half**2 / (2.0 * rise)
        turn = _turn(rng)
        if k % 2:
            low = np.sqrt(1.0 - (half / radius) ** 2)
            primitives.append(
                Primitive("sphere", turn, place - radius * turn[:, 2], (radius,), (low, 1.0))
            )
        else:
            arc = 2.0 * half / radius
            out = np.array([np.cos(arc / 2), np.sin(arc / 2), 0.0])
            primitives.append(
                Primitive(
                    "cylinder", turn, place - radius * turn @ out, (radius,), (-0.4, 0.4), arc
                )
            )
    scene = _spread(f"flat {seed}", primitives, n, sigma, 0.0, rng)
    for k in range(5, 8):
        bent = primitives[k]
        primitives[k] = Primitive("plane", bent.turn, bent.place, (0.0, 0.0))
    return scene


def _along(direction: np.ndarray) -> np.ndarray:
    """A turn whose z axis points there."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _cast(
    primitives: list[Primitive], origin: np.ndarray, beams: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    ranges = np.array([primitive.hit(origin, beams) for primitive in primitives])
    return ranges.min(axis=0), ranges.argmin(axis=0)


def rack(seed: int) -> SurfaceScene:
    """Pipes of 5 to 30 cm with elbows, walls and a dome, from four stations of a LiDAR (3 mm)."""
    rng = np.random.default_rng([4, seed])
    primitives = [
        Primitive("plane", np.eye(3), np.array([4.0, 2.0, 0.0]), (9.0, 6.0)),
        Primitive(
            "plane", _along(np.array([0.0, 1.0, 0.0])), np.array([4.0, 5.0, 1.5]), (3.0, 9.0)
        ),
    ]
    for k in range(8):
        radius = rng.uniform(0.025, 0.15)
        bend = radius * rng.uniform(2.5, 4.0)
        x, y, z = 0.6 + 0.95 * k, rng.uniform(2.6, 3.4), rng.uniform(1.2, 2.2)
        # Upright, an elbow, then away along y.
        upright = np.array([x, y, z / 2.0])
        primitives.append(Primitive("cylinder", np.eye(3), upright, (radius,), (-z / 2, z / 2)))
        center = np.array([x, y + bend, z])
        axes = np.column_stack([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
        primitives.append(
            Primitive("torus", axes, center, (bend, radius), (-np.pi, np.pi), np.pi / 2.0)
        )
        half = (4.9 - y - bend) / 2.0
        away = np.array([x, y + bend + half, z + bend])
        primitives.append(
            Primitive("cylinder", _along(np.array([0.0, 1.0, 0.0])), away, (radius,), (-half, half))
        )
    primitives.append(
        Primitive(
            "sphere", np.eye(3), np.array([4.0, 1.0, 0.0]), (rng.uniform(0.4, 0.7),), (0.0, 1.0)
        )
    )
    sigma, points, truth, origins = 0.003, [], [], []
    for x, y in ((-1.0, 0.0), (2.5, -1.0), (5.5, -1.0), (9.0, 0.0)):
        origin = np.array([x, y, 1.6]) + rng.uniform(-0.2, 0.2, 3)
        ahead = np.arctan2(3.0 - y, 4.0 - x)
        across, up = np.meshgrid(np.linspace(-1.0, 1.0, 420), np.linspace(-0.7, 0.55, 190))
        beams = np.column_stack(
            [
                (np.cos(up) * np.cos(across + ahead)).ravel(),
                (np.cos(up) * np.sin(across + ahead)).ravel(),
                np.sin(up).ravel(),
            ]
        )
        ranges, hit = _cast(primitives, origin, beams)
        met = np.isfinite(ranges) & (ranges < 12.0)
        far = ranges[met] + rng.normal(0.0, sigma, met.sum())
        points.append(origin + far[:, None] * beams[met])
        truth.append(hit[met])
        origins.append(np.broadcast_to(origin, (met.sum(), 3)))
    return SurfaceScene(
        f"rack {seed}",
        np.vstack(points),
        np.concatenate(truth),
        primitives,
        sigma,
        np.vstack(origins),
    )


def table(seed: int) -> SurfaceScene:
    """Box, can, bottle, ball and bowl on a table before a depth camera whose pixels err alike."""
    rng = np.random.default_rng([5, seed])
    up = np.eye(3)
    primitives = [Primitive("plane", up, np.zeros(3), (1.6, 1.0))]
    spots = rng.permutation(
        [[-0.5, -0.15], [-0.25, 0.18], [0.0, -0.2], [0.25, 0.18], [0.5, -0.15], [0.0, 0.25]]
    ) + rng.uniform(-0.03, 0.03, (6, 2))
    at = [np.array([x, y, 0.0]) for x, y in spots]
    turn = Rotation.from_euler("z", rng.uniform(0.3, 1.2)).as_matrix()
    wide, deep, tall = rng.uniform([0.12, 0.1, 0.1], [0.2, 0.15, 0.2])
    for way, far, size in (
        (turn[:, 0], wide / 2, (tall, deep)),
        (-turn[:, 0], wide / 2, (tall, deep)),
        (turn[:, 1], deep / 2, (wide, tall)),
        (-turn[:, 1], deep / 2, (wide, tall)),
    ):
        frame = np.column_stack([[0, 0, 1.0], np.cross(way, [0, 0, 1.0]), way])
        if size[1] == tall:
            frame = np.column_stack([np.cross([0, 0, 1.0], way), [0, 0, 1.0], way])
        primitives.append(Primitive("plane", frame, at[0] + far * way + [0, 0, tall / 2], size))
    primitives.append(Primitive("plane", turn, at[0] + [0, 0, tall], (wide, deep)))
    for k in (1, 2):
        radius, height = rng.uniform([0.03, 0.1], [0.05, 0.18])
        primitives.append(Primitive("cylinder", up, at[k], (radius,), (0.0, height)))
    # A bottle: a cylinder with a cone on it.
    radius, height, angle = rng.uniform([0.035, 0.1, 0.35], [0.045, 0.15, 0.5])
    primitives.append(Primitive("cylinder", up, at[3], (radius,), (0.0, height)))
    top = radius / np.tan(angle)
    down = np.diag([1.0, -1.0, -1.0])
    primitives.append(
        Primitive("cone", down, at[3] + [0, 0, height + top], (angle,), (0.3 * top, top))
    )
    radius = rng.uniform(0.05, 0.09)
    primitives.append(Primitive("sphere", up, at[4] + [0, 0, radius], (radius,), (-1.0, 1.0)))
    radius = rng.uniform(0.07, 0.1)
    primitives.append(Primitive("sphere", up, at[5] + [0, 0, radius], (radius,), (-1.0, 0.0)))
    origin = np.array([rng.uniform(-0.1, 0.1), -0.95, 0.65])
    v, u = np.mgrid[0:480, 0:640]
    forward = np.array([0.0, 0.05, 0.05]) - origin
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    rays = ((u - 319.5) / 540.0)[..., None] * x + ((v - 239.5) / 540.0)[..., None] * y + z
    rays = rays.reshape(-1, 3)
    lengths = np.linalg.norm(rays, axis=1)
    ranges, hit = _cast(primitives, origin, rays / lengths[:, None])
    noise = ndimage.gaussian_filter(rng.normal(size=v.shape), 1.0).ravel()
    met = np.isfinite(ranges)
    depth = np.where(met, ranges / lengths, 0.0)
    depth += 0.0015 * depth**2 * noise / noise.std()
    return SurfaceScene(
        f"table {seed}",
        origin + depth[met, None] * rays[met],
        hit[met],
        primitives,
        float(0.0015 * np.median(depth[met]) ** 2),
        np.broadcast_to(origin, (met.sum(), 3)),
    )


SCENES: dict[str, Callable[[int], SurfaceScene]] = {
    "mixed": mixed,
    "crowded": crowded,
    "rack": rack,
    "table": table,
    "flat": flat,
}
