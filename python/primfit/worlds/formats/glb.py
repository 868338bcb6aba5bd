"""glTF in one file, through trimesh: to be shown, and taken by other programs."""

from __future__ import annotations

from pathlib import Path

from primfit.worlds.world import World


def write(path: Path, world: World) -> None:
    """Every solid a mesh of its own, "solid-0" and so on, in metres and with z up."""
    path.write_bytes(world.to_scene().export(file_type="glb"))
