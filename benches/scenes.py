"""Scenes of many kinds, each a function of a seed, made by the public interface alone.

A scene is the world to compare with, a scan, and facts about both that the judge of
`scenes_accuracy.py` asks for or that tell scenes apart. `sigma` is the noise of ranges in metres
everywhere; the paper states a share of the 3 m that its sensor sees, so its 0.01 is 0.03 here.
Same seed, same scene; options change nothing that they do not name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely
from placing import furniture, placed, spinning
from shapely import affinity

import primfit


class Scene(NamedTuple):
    """What was there, and what a sensor saw of it."""

    world: primfit.World
    scan: primfit.Scan
    facts: dict[str, Any]


def reference(seed: int, sigma: float = 0.05) -> Scene:
    """Our reference: 5 to 7 solids of 14 to 40 cm in 2 x 2 m, a sensor that sees 1 m."""
    world = primfit.random_world((5, 7), 2.0, rng=seed)
    return _seen_from_a_grid(world, world, seed, sigma)


def rough(seed: int, sigma: float = 0.01, most: float = 0.015) -> Scene:
    """The reference with solids as they are built: corners off by up to `most` of the size."""
    rng = np.random.default_rng(seed)
    world = primfit.random_world((5, 7), 2.0, rng=seed)
    built = []
    for solid in world.solids:
        outline = solid.footprint
        off = most * np.ptp(outline, axis=0).max() * rng.uniform(-1.0, 1.0, outline.shape)
        built.append(primfit.Prism(outline + off, solid.height))
    return _seen_from_a_grid(world, primfit.World(built, world.arena), seed, sigma)


def round_solids(seed: int, sigma: float | None = None) -> Scene:
    """The reference with circles, among them pillars of 8 cm, and ellipses between the prisms.

    Without `sigma` the noise is none, 2, 10 or 50 mm.
    """
    rng = np.random.default_rng(seed)
    kinds = (
        "circle",
        "circle",
        "ellipse",
        "ellipse",
        "triangle",
        "square",
        "rectangle",
        "pentagon",
    )
    world = primfit.random_world((5, 7), 2.0, kinds, rng, sizes={"circle": (0.04, 0.17)})
    drawn = float(rng.choice([0.0, 0.002, 0.01, 0.05]))
    return _seen_from_a_grid(world, world, seed, drawn if sigma is None else sigma)


def _seen_from_a_grid(world: primfit.World, built: primfit.World, seed: int, sigma: float) -> Scene:
    """A scene as the reference has it, of a world that stands as `built`."""
    path = primfit.grid_path(built, 0.25, rng=seed)
    scan = primfit.scan(built, path, primfit.Lidar(noise=sigma), rng=seed)
    return Scene(world, scan, {"sigma": sigma})


def paper(seed: int, sigma: float = 0.03, spacing: float = 0.4) -> Scene:
    """A random map of the paper's kind, built of walls, from every second position each way.

    10 x 10 m, solids of 0.8 to 1.1 m, all walls 5 cm high, a sensor at 3 cm that sees 3 m.
    """
    world = primfit.paper_world(rng=seed)
    lidar = primfit.Lidar.paper(noise=sigma / 3.0)
    built = primfit.built_of_walls(world)
    scan = primfit.scan(built, primfit.paper_path(built, spacing), lidar, rng=seed)
    return Scene(world, scan, {"sigma": sigma})


def room(
    seed: int, sigma: float = 0.01, max_range: float = 100.0, spacing: float | None = None
) -> Scene:
    """Furniture of 0.3 to 1.5 m in a room of 5 to 12 m, lower and higher than the sensor.

    The sensor stands at 0.3 to 0.6 m and could see `max_range`, far beyond the walls. Without
    `spacing`, metres, positions are 0.9 to 1.5 m apart.
    """
    rng = np.random.default_rng(seed)
    arena = primfit.Arena(tuple(rng.uniform(5.0, 12.0, 2)), height=2.5)
    draw = furniture((0.3, 1.5), (0.15, 1.9))
    solids = placed(rng, rng.integers(3, 9), arena.shadow, draw, gap=0.4, border=0.3)
    mount, drawn = rng.uniform(0.3, 0.6), rng.uniform(0.9, 1.5)
    return _walked_about(
        primfit.World(solids, arena), seed, spinning(mount, sigma, max_range), spacing or drawn
    )


def low_walls(seed: int, sigma: float = 0.01) -> Scene:
    """A room of 3 to 6 m whose walls are from a fifth to six fifths as high as the sensor."""
    rng = np.random.default_rng(seed)
    mount = rng.uniform(0.3, 0.5)
    arena = primfit.Arena(tuple(rng.uniform(3.0, 6.0, 2)), height=mount * rng.uniform(0.2, 1.2))
    draw = furniture((0.3, 0.8), (0.5 * mount, 3.0 * mount))
    solids = placed(rng, rng.integers(2, 6), arena.shadow, draw, gap=0.4, border=0.3)
    return _walked_about(primfit.World(solids, arena), seed, spinning(mount, sigma, 30.0), 0.7)


def ell_rooms(seed: int, sigma: float = 0.01) -> Scene:
    """An L-shaped room of 4 to 8 m or a bent corridor, turned anyhow, with solids in it."""
    rng = np.random.default_rng(seed)
    shape, outline = ("ell", _ell(rng)) if rng.random() < 0.5 else ("corridor", _corridor(rng))
    outline = affinity.rotate(outline, rng.uniform(0.0, 360.0), origin=(0.0, 0.0))
    outline = affinity.translate(outline, *rng.uniform(-5.0, 5.0, 2))
    arena = primfit.Arena(outline=shapely.get_coordinates(outline.exterior)[:-1], height=2.5)
    draw = furniture((0.3, 0.7), (0.2, 1.5))
    solids = placed(rng, rng.integers(2, 6), outline, draw, gap=0.5, border=0.3)
    lidar = spinning(rng.uniform(0.3, 0.5), sigma, 30.0)
    scene = _walked_about(primfit.World(solids, arena), seed, lidar, 0.8)
    return scene._replace(facts=scene.facts | {"shape": shape})


def _ell(rng: np.random.Generator) -> shapely.Polygon:
    """A rectangle that lacks a corner."""
    (width, depth), share = rng.uniform(4.0, 8.0, 2), rng.uniform(0.35, 0.65, 2)
    corner = shapely.box(share[0] * width, share[1] * depth, 2 * width, 2 * depth)
    return shapely.box(0.0, 0.0, width, depth).difference(corner)


def _corridor(rng: np.random.Generator) -> shapely.Polygon:
    """Two or three legs of 4 to 7 m at right angles, 1.8 to 2.6 m wide."""
    a, b, c = rng.uniform(4.0, 7.0, 3)
    middle = [(0.0, 0.0), (a, 0.0), (a, b), (a + c, b)][: rng.integers(3, 5)]
    width = rng.uniform(1.8, 2.6)
    return shapely.LineString(middle).buffer(width / 2, cap_style="flat", join_style="mitre")


def _walked_about(world: primfit.World, seed: int, lidar: primfit.Lidar, spacing: float) -> Scene:
    """A scene that a spinning sensor saw from a grid of positions."""
    path = primfit.grid_path(world, spacing, headings=1, clearance=0.25, rng=seed)
    facts = {"sigma": lidar.sigma, "mount": float(lidar.mount[2, 3]), "walls": world.arena.height}
    return Scene(world, primfit.scan(world, path, lidar, rng=seed), facts)


def one_sided(seed: int, sigma: float = 0.01) -> Scene:
    """A path along one side of a room only: most solids are seen from one side.

    The sensor sees 0.8 to 1.5 of the depth of the room, so that the opposite wall may have no
    return at all, and is often in the shadow of solids.
    """
    rng = np.random.default_rng(seed)
    width, depth = rng.uniform((5.0, 4.0), (8.0, 6.0))
    arena = primfit.Arena((width, depth), height=2.5)
    line = shapely.LineString([(0.4, 0.5), (width - 0.4, 0.5)])
    draw = furniture((0.3, 1.0), (0.2, 1.5))
    solids = placed(
        rng, rng.integers(3, 7), arena.shadow, draw, gap=0.35, border=0.3, keep_off=line
    )
    world = primfit.World(solids, arena)
    path = primfit.waypoints(world, line.coords, 0.3)
    reach = depth * rng.uniform(0.8, 1.5)
    lidar = spinning(rng.uniform(0.3, 0.5), sigma, reach)
    return Scene(
        world, primfit.scan(world, path, lidar, rng=seed), {"sigma": sigma, "reach": float(reach)}
    )


def moved(seed: int, sigma: float = 0.01, static: bool = False) -> Scene:
    """A room of 4 to 6 m in which one solid moves, goes or comes half way along the path.

    The path goes through the room row by row or, in half of the scenes, twice, at every second
    position each time. The world to compare with lacks the solid that changed; where it stood is
    in the facts, with the number of beams that the change concerns, in the half of the path that
    has fewer. `static` is the twin in which nothing changes, and that solid is in the world.
    """
    rng = np.random.default_rng(seed)
    arena = primfit.Arena(tuple(rng.uniform(4.0, 6.0, 2)), height=2.5)
    draw = furniture((0.3, 0.9), (0.3, 1.5))
    first, *others = placed(rng, rng.integers(3, 6), arena.shadow, draw, gap=0.5, border=0.3)
    standing = shapely.union_all([solid.shadow for solid in (first, *others)])
    second = placed(
        rng, 1, arena.shadow, lambda _: _centered(first), gap=0.3, border=0.3, keep_off=standing
    )
    change = str(rng.choice(["moves", "goes", "comes"]))
    if change == "moves" and not second:
        change = "goes"
    before = [] if change == "comes" else [first]
    after = {"moves": second, "goes": [], "comes": [first]}[change]
    if static:
        change, before, after = "none", [first], [first]
    path = primfit.grid_path(
        primfit.World([first, *second, *others], arena), 0.7, headings=1, clearance=0.25, rng=seed
    )
    if rng.random() < 0.5:
        path = np.concatenate([path[::2], path[1::2]])
    half = len(path) // 2
    worlds = [primfit.World([*others, *changed], arena) for changed in (before, after)]
    lidar = spinning(rng.uniform(0.3, 0.5), sigma, 15.0)
    scan = joined(
        primfit.scan(worlds[0], path[:half], lidar, rng=[seed, 0]),
        primfit.scan(worlds[1], path[half:], lidar, rng=[seed, 1]),
    )
    # The path has valid poses only, so those of the second half begin at `half`.
    poses = _told_apart(scan, worlds)
    facts = {
        "sigma": sigma,
        "change": change,
        "changed": [] if static else [*before, *after],
        "contradictions": int(min((poses < half).sum(), (poses >= half).sum())),
    }
    return Scene(worlds[0] if static else primfit.World(others, arena), scan, facts)


def _centered(solid: primfit.Prism) -> primfit.Prism:
    return primfit.Prism(solid.footprint - solid.center[:2], solid.height)


def _told_apart(scan: primfit.Scan, worlds: list[primfit.World]) -> np.ndarray:
    """Poses of the beams that two worlds send back from places more than 10 cm apart."""
    ranges = [
        primfit.RayCaster(world).cast(np.array(scan.origins), np.array(scan.directions))[0]
        for world in worlds
    ]
    near, far = np.sort(np.minimum(ranges, scan.max_range), axis=0)
    return scan.pose_index[far - near > 0.1]


def joined(first: primfit.Scan, second: primfit.Scan) -> primfit.Scan:
    """Two scans by one sensor as one: poses of the second follow those of the first."""
    names = ("origins", "directions", "ranges", "layer", "column", "solid_index")
    both = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in names}
    following = second.pose_index + first.pose_index.max() + 1
    return primfit.Scan.from_rays(
        **both,
        sigma=first.sigma,
        min_range=first.min_range,
        max_range=first.max_range,
        pose_index=np.concatenate([first.pose_index, following]),
    )


SCENES: dict[str, Callable[..., Scene]] = {
    make.__name__: make
    for make in (
        reference,
        paper,
        room,
        round_solids,
        ell_rooms,
        one_sided,
        moved,
        low_walls,
        rough,
    )
}
