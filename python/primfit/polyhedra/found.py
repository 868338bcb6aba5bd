"""What bounded planes make."""

from __future__ import annotations

from dataclasses import dataclass

from primfit._check import Ints
from primfit.solids.found import FoundSolid


@dataclass(frozen=True, eq=False)
class Polyhedra:
    """What planes make.

    Attributes
    ----------
    solids : tuple of FoundSolid
    shells : tuple of tuple of int
        Planes that meet without closing, and are in no solid.
    edges : (e, 2) int64
        Pairs of planes that meet in an edge.
    """

    solids: tuple[FoundSolid, ...]
    shells: tuple[tuple[int, ...], ...]
    edges: Ints

    def __repr__(self) -> str:
        kinds = ", ".join(solid.title for solid in self.solids) or "none"
        return (
            f"Polyhedra({len(self.solids)} solid{'s' * (len(self.solids) != 1)}: {kinds}; "
            f"{len(self.shells)} open shell{'s' * (len(self.shells) != 1)}; "
            f"{len(self.edges)} edges)"
        )
