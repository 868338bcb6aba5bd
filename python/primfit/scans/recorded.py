"""Scans of whatever was recorded."""

from __future__ import annotations

from contextlib import suppress
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from primfit._files import as_path
from primfit.clouds.foreign import PointsLike, read_only
from primfit.scans.scan import Scan


def as_scan(
    recorded: Scan | PointsLike, origins: ArrayLike | None = None, *, copy: bool = True
) -> Scan:
    """The scan itself, that of a file that `Scan.save` wrote, or one of points.

    Without `copy` it may share the points with what was given.

    Raises
    ------
    ValueError
        When `origins` are given with a scan, which has its own.
    TypeError, OSError
        As `as_cloud` does.
    """
    scan = recorded if isinstance(recorded, Scan) else _of_file(recorded)
    if scan is None:
        return Scan.from_points(recorded if copy else read_only("points", recorded), origins)
    if origins is not None:
        raise ValueError("origins must be None for a Scan, which has its own")
    return scan


def _of_file(recorded: Any) -> Scan | None:
    if not isinstance(recorded, str | PathLike):
        return None
    path = as_path(recorded)
    if path.suffix.lower() == ".npz" and path.is_file():
        # An archive that is no scan of ours may still hold points.
        with suppress(ValueError):
            return Scan.load(path)
    return None
