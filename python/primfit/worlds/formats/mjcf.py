"""MJCF, the format of MuJoCo: every solid a mesh, and floor and walls of the arena as well.

The world itself is kept beside them as text, from which it is read again.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from primfit._check import Floats, Ints
from primfit.solids.prism import Prism
from primfit.worlds.formats.plain import text_of, world_of
from primfit.worlds.world import COLORS, OTHER_COLOR, World

_THICKNESS = 0.01
"""Of walls, outwards, and of the floor, downwards, metres: as Webots has those of an arena."""

_NAME = "primfit"


def write(path: Path, world: World) -> None:
    """A model whose static geoms are called "solid-0", "wall-0" and "floor"."""
    root = ElementTree.Element("mujoco", model="primfit world")
    # Meshes are where their vertices are, and need no mass.
    ElementTree.SubElement(root, "compiler", boundmass="1e-9", boundinertia="1e-12")
    custom = ElementTree.SubElement(root, "custom")
    ElementTree.SubElement(custom, "text", name=_NAME, data=text_of(world))
    assets = ElementTree.SubElement(root, "asset")
    body = ElementTree.SubElement(root, "worldbody")
    for name, (vertices, triangles), color in _parts(world):
        ElementTree.SubElement(
            assets, "mesh", name=name, vertex=_numbers(vertices), face=_numbers(triangles)
        )
        rgba = _numbers(np.append(np.array(color) / 255.0, 1.0))
        ElementTree.SubElement(body, "geom", name=name, type="mesh", mesh=name, rgba=rgba)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _parts(world: World) -> list[tuple[str, tuple[Floats, Ints], tuple[int, int, int]]]:
    parts = [
        (f"solid-{i}", solid.to_mesh(), COLORS.get(solid.kind, OTHER_COLOR))
        for i, solid in enumerate(world.solids)
    ]
    low, high = world.bounds
    floor = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    if world.arena is None:
        floor += 100.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    else:
        floor = world.arena.outline
        for i, (start, end) in enumerate(zip(floor, np.roll(floor, -1, axis=0), strict=True)):
            along = (end - start) / np.linalg.norm(end - start)
            out = _THICKNESS * np.array([along[1], -along[0]])
            wall = Prism(np.array([start, start + out, end + out, end]), world.arena.height)
            parts.append((f"wall-{i}", wall.to_mesh(), OTHER_COLOR))
    slab = Prism(floor, _THICKNESS, base=-_THICKNESS)
    parts.append(("floor", slab.to_mesh(), (200, 200, 200)))
    return parts


def _numbers(values: Floats | Ints) -> str:
    return " ".join(map(repr, np.ravel(values).tolist()))


def read(path: Path) -> World:
    """A world that `write` wrote."""
    for text in ElementTree.parse(path).iterfind("custom/text"):
        if text.get("name") == _NAME:
            return world_of(text.get("data", ""))
    raise ValueError("it has no text of the name primfit: MJCF of others is not read")
