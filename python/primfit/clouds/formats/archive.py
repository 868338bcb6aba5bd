"""Arrays in NPY and NPZ files; headers are held against the file before they are believed."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np

from primfit.clouds.cloud import Field

_MOST_PACKED = 1032
"""Bytes that deflation makes of one at most."""

_ENCRYPTED = 1
"""Flag of a member of an archive."""


def read_array(path: Path) -> Field:
    """The array of an NPY file.

    Raises
    ------
    ValueError
        When it is none, or holds objects, or less than its header says.
    """
    with open(path, "rb") as stream:
        _shape_of(stream, path.stat().st_size)
        stream.seek(0)
        return np.lib.format.read_array(stream, allow_pickle=False)


class Archive(Mapping[str, Field]):
    """The arrays of an NPZ file, read when they are asked for.

    Raises
    ------
    ValueError, OSError
        When it is no archive; when an array is asked for that is damaged, or is said to be larger
        than its compressed bytes can be.
    """

    def __init__(self, path: Path) -> None:
        self._zip = zipfile.ZipFile(path)
        self._members = {
            name.removesuffix(".npy"): self._zip.getinfo(name)
            for name in self._zip.namelist()
            if name.endswith(".npy")
        }

    def __enter__(self) -> Archive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._zip.close()

    def __getitem__(self, name: str) -> Field:
        self.shape(name)
        with self._zip.open(self._members[name]) as stream:
            array = np.lib.format.read_array(stream, allow_pickle=False)
            if stream.read(1):
                raise ValueError(f"its array {name!r} is longer than its header says")
        return array

    def __iter__(self) -> Any:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of an array, which is not read for it."""
        member = self._members[name]
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"its array {name!r} is compressed in a way that NumPy does not write")
        if member.flag_bits & _ENCRYPTED:
            raise ValueError(f"its array {name!r} is encrypted")
        if member.file_size > _MOST_PACKED * member.compress_size:
            raise ValueError(
                f"its array {name!r} is said to be {member.file_size} bytes, which "
                f"{member.compress_size} compressed bytes cannot hold"
            )
        with self._zip.open(member) as stream:
            return _shape_of(stream, member.file_size)


def _shape_of(stream: IO[bytes], size: int) -> tuple[int, ...]:
    """The shape that the header of an array gives, when its `size` in bytes allows it."""
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        header = np.lib.format.read_array_header_1_0(stream)
    else:
        # Version 3 has other letters in names, which do not matter here.
        header = np.lib.format.read_array_header_2_0(stream)
    shape, _, kind = header
    if kind.hasobject:
        raise ValueError("it holds Python objects, which are not read")
    n_bytes = math.prod(shape) * kind.itemsize
    left = size - stream.tell()
    if min(shape, default=0) < 0 or n_bytes > left:
        raise ValueError(
            f"its header says {kind} {shape}, which takes {n_bytes} bytes, where {left} follow"
        )
    return shape
