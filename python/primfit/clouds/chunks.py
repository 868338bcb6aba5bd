"""Points of files that need not fit into memory."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike

from primfit._check import Floats
from primfit._files import as_path
from primfit.clouds.files import explained, read_points
from primfit.clouds.formats import las

_IN_PARTS = {".las": las, ".laz": las}
"""Formats that are read some points at a time."""


def read_parts(file: str | PathLike[str]) -> Iterator[Floats]:
    """The points (n, 3) of a file, metres, some at a time and in order.

    LAS and LAZ files, COPC among them, are never held whole; of other formats there is one part.

    Raises
    ------
    OSError, ValueError, ModuleNotFoundError
        As `read_points` does.

    Examples
    --------
    >>> import primfit, tempfile, os
    >>> from primfit.clouds.chunks import read_parts
    >>> file = os.path.join(tempfile.mkdtemp(), "cloud.las")
    >>> primfit.write_points(file, [[1, 2, 3], [4, 5, 6]])
    >>> [len(part) for part in read_parts(file)]
    [2]
    """
    path = as_path(file)
    kind = _IN_PARTS.get(path.suffix.lower())
    if kind is None or not path.is_file():
        yield read_points(path)
        return
    with explained(path, path.suffix.lower()):
        yield from kind.read_parts(path)
