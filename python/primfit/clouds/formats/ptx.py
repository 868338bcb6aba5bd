"""PTX, the text of Leica: grids of points, each with where its scanner stood."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from primfit import _primfit
from primfit._check import Floats
from primfit.clouds.cloud import Cloud, Columns, cloud_of
from primfit.clouds.formats.text import content_of, whole

_HEAD = 10
"""Lines before the points of a scan: columns, rows, where the scanner stood and its three axes, and
the four rows of the matrix that moves row vectors to the frame of the file."""

_NAMES = ("x", "y", "z", "intensity", "red", "green", "blue")


def read(path: Path) -> Cloud:
    """All scans, in the frame of the file; pixels without a point, which are 0 0 0 there, are NaN.

    "origin" is where the scanner stood; of several scans, "scan" is the number. A single scan is
    organised: a row of it is a column of the scanner, as they follow each other in the file.
    """
    content = content_of(path).rstrip() + b"\n"
    ends = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n")) + 1
    starts = np.append(0, ends)
    scans: list[Columns] = []
    shape, line = (0, 0), 0
    while line < len(ends):
        if len(ends) < line + _HEAD:
            raise ValueError(f"it ends within the {_HEAD} lines before scan {len(scans)}")
        shape = (_size(content, starts, line), _size(content, starts, line + 1))
        matrix = _numbers(content, starts, line + 6, 4, 4)
        if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-9:
            raise ValueError(f"scan {len(scans)} has a matrix that moves no points")
        line, n = line + _HEAD, shape[0] * shape[1]
        if n > len(ends) - line:
            raise ValueError(f"it ends after {len(ends) - line} of {n} points of a scan")
        scans.append(_scan(content, starts, line, n, matrix))
        line += n
    if not scans:
        raise ValueError("it holds no scan")
    if len(scans) == 1:
        return cloud_of(scans[0], shape)
    for i, scan in enumerate(scans):
        scan["scan"] = np.full(len(scan["x"]), i)
    names = [name for name in scans[0] if all(name in scan for scan in scans)]
    return cloud_of({name: np.concatenate([scan[name] for scan in scans]) for name in names})


def _scan(content: bytes, starts: Floats, line: int, n: int, matrix: Floats) -> Columns:
    n_columns = len(content[starts[line] : starts[line + 1]].split()) if n else 3
    if n_columns not in (3, 4, 6, 7):
        raise ValueError(f"line {line + 1} has {n_columns} columns, not 3, 4, 6 or 7")
    table = _numbers(content, starts, line, n, n_columns)
    is_point = (table[:, :3] != 0.0).any(axis=1)
    points = np.where(is_point[:, None], table[:, :3] @ matrix[:3, :3] + matrix[3, :3], np.nan)
    names = _NAMES if n_columns != 6 else (*"xyz", "red", "green", "blue")
    columns: Columns = dict(zip("xyz", points.T, strict=True))
    columns |= {name: whole(name, table[:, k]) for k, name in enumerate(names[:n_columns]) if k > 2}
    return columns | {f"origin_{axis}": np.full(n, matrix[3, k]) for k, axis in enumerate("xyz")}


def _size(content: bytes, starts: Floats, line: int) -> int:
    text = content[starts[line] : starts[line + 1]].strip()
    if not text.isdigit():
        raise ValueError(f"line {line + 1} must be a number of columns or rows, not {text[:40]!r}")
    return int(text)


def _numbers(content: bytes, starts: Floats, line: int, n: int, n_columns: int) -> Floats:
    """The numbers (n, n_columns) of `n` lines."""
    part = content[starts[line] : starts[line + n]]
    table = _primfit.parse_rows(part, 0, line + 1, n_columns, list(range(n_columns)))
    if len(table) != n:
        raise ValueError(f"lines {line + 1} to {line + n} hold {len(table)} rows: some are empty")
    return table
