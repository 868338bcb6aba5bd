"""JSON: every number survives exactly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from primfit.solids.solid import Solid
from primfit.worlds.arena import Arena
from primfit.worlds.world import World


def text_of(world: World, indent: int | None = None) -> str:
    """The world as JSON text."""
    return json.dumps({"primfit": "world", **world.to_dict()}, indent=indent)


def world_of(text: str | bytes) -> World:
    """The world that the text tells of."""
    content: Any = json.loads(text)
    if content["primfit"] != "world":
        raise ValueError("its 'primfit' does not say that it is a world")
    arena = content["arena"] and Arena(**content["arena"])
    return World([Solid.from_dict(solid) for solid in content["solids"]], arena)


def write(path: Path, world: World) -> None:
    """The world as JSON."""
    path.write_text(text_of(world, indent=1))


def read(path: Path) -> World:
    """A world that `write` wrote."""
    return world_of(path.read_bytes())
