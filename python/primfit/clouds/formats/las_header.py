"""Headers of LAS and LAZ files, held against the file before a library believes them."""

from __future__ import annotations

import struct
from dataclasses import dataclass

_LEAST_SIZE = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
"""Bytes of a header, by the minor version."""

_FORMAT_SIZES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Bytes of a point without extra ones, by the number of its format."""

_VLR, _EVLR = 54, 60
"""Bytes before the content of a variable-length record, and of an extended one."""

_LASZIP = (b"laszip encoded", 22204)
"""User and number of the record that says how points are compressed."""

_ITEM_SIZES = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}
"""Bytes of the parts of a point that LAZ compresses, by their type; 0 and 14 are extra bytes."""

_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
"""Layers of a part in a chunk of layers; extra bytes have one each."""

_EXTRA = (0, 14)

POINT_WISE, CHUNKED, LAYERED = 1, 2, 3
"""How LAZ is arranged: point after point, chunks of such, chunks of layers."""

VARIABLE = 2**32 - 1
"""Size of chunks that have sizes of their own."""


@dataclass(frozen=True)
class Compression:
    """How the points of a LAZ file are compressed.

    Attributes
    ----------
    record : bytes
        The record that says it.
    kind : int
        `POINT_WISE`, `CHUNKED` or `LAYERED`.
    chunk_size : int
        Points of a chunk, or `VARIABLE`.
    n_layers : int
        Layers of a chunk of layers.
    """

    record: bytes
    kind: int
    chunk_size: int
    n_layers: int


@dataclass(frozen=True)
class LasHeader:
    """What a header says, when the file can hold it.

    Attributes
    ----------
    n_points : int
    point_size : int
        Bytes of a point.
    start, end : int
        Where the points begin, and where they must have ended: at records that follow, or at the
        end of the file.
    scales, offsets : tuple of float
        Of the three coordinates, metres.
    compression : Compression or None
    """

    n_points: int
    point_size: int
    start: int
    end: int
    scales: tuple[float, ...]
    offsets: tuple[float, ...]
    compression: Compression | None


def read_header(content: memoryview) -> LasHeader:
    """The header of a LAS or LAZ file.

    Raises
    ------
    ValueError
        When it says what the file cannot hold.
    """
    size = len(content)
    if size < _LEAST_SIZE[0] or bytes(content[:4]) != b"LASF":
        raise ValueError("it does not begin with the header of a LAS file")
    major, minor = content[24], content[25]
    if major != 1 or minor not in _LEAST_SIZE:
        raise ValueError(f"its version is {major}.{minor}, not 1.0 to 1.5")
    header_size, start, n_records = struct.unpack_from("<HII", content, 94)
    kind, point_size, n_points = struct.unpack_from("<BHI", content, 104)
    numbers = struct.unpack_from("<6d", content, 131)
    scales, offsets = numbers[:3], numbers[3:]
    if not _LEAST_SIZE[minor] <= header_size <= start <= size:
        raise ValueError(
            f"its header takes {header_size} bytes and its points begin at byte {start} of {size}"
        )
    first_record, n_extended = 0, 0
    if minor >= 4:
        first_record, n_extended, n_points = struct.unpack_from("<QIQ", content, 235)
    if not all(0.0 < abs(scale) < float("inf") for scale in scales):
        raise ValueError(f"its scales must be finite and not 0, not {scales}")
    if not all(abs(offset) < float("inf") for offset in offsets):
        raise ValueError(f"its offsets must be finite, not {offsets}")
    is_compressed, kind = kind >= 128, kind % 64
    if kind >= len(_FORMAT_SIZES) or point_size < _FORMAT_SIZES[kind]:
        raise ValueError(f"its points are of format {kind} and {point_size} bytes")
    records = _records(content, header_size, start, n_records)
    end = _end_of_points(content, start, first_record, n_extended)
    compression = None
    if is_compressed:
        if _LASZIP not in records:
            raise ValueError("its points are compressed, but no record says how")
        compression = _compression(records[_LASZIP], point_size)
    elif n_points * point_size > end - start:
        raise ValueError(
            f"it holds {(end - start) // point_size} of {n_points} points: it may be cut short"
        )
    elif not n_points and end - start >= point_size:
        raise ValueError(
            f"its header says 0 points, but {end - start} bytes of them follow: it may be cut short"
        )
    return LasHeader(n_points, point_size, start, end, scales, offsets, compression)


def _records(
    content: memoryview, at: int, end: int, n_records: int
) -> dict[tuple[bytes, int], bytes]:
    """The variable-length records, which are between the header and the points."""
    if n_records * _VLR > end - at:
        raise ValueError(
            f"it is said to have {n_records} records before its points, in {end - at} bytes"
        )
    records: dict[tuple[bytes, int], bytes] = {}
    for k in range(n_records):
        user, number, length = struct.unpack_from("<2x16sHH", content, at)
        at += _VLR
        if length > end - at:
            raise ValueError(f"record {k} takes {length} bytes, where {end - at} follow")
        records.setdefault((user.split(b"\0")[0], number), bytes(content[at : at + length]))
        at += length
        if end - at < _VLR * (n_records - k - 1):
            raise ValueError(f"its records before the points end after {k + 1} of {n_records}")
    return records


def _end_of_points(content: memoryview, start: int, first: int, n_records: int) -> int:
    """Where the points have ended: at the extended records that follow, if there are any."""
    size = len(content)
    if not n_records:
        return size
    if first < start or n_records * _EVLR > size - first:
        raise ValueError(
            f"it is said to have {n_records} records from byte {first} on, but has {size} bytes"
        )
    at = first
    for k in range(n_records):
        if size - at < _EVLR:
            raise ValueError(f"its records after the points end after {k} of {n_records}")
        (length,) = struct.unpack_from("<Q", content, at + 20)
        if length > size - at - _EVLR:
            raise ValueError(f"record {k} after the points takes {length} bytes: too many")
        at += _EVLR + length
    return first


def _compression(record: bytes, point_size: int) -> Compression:
    if len(record) < 34:
        raise ValueError(f"the record on its compression has {len(record)} bytes, not 34 or more")
    kind, coder, chunk_size, n_items = struct.unpack_from("<HH8xI16xH", record)
    if kind not in (POINT_WISE, CHUNKED, LAYERED) or coder != 0:
        raise ValueError(f"its compression is of kind {kind}, coder {coder}: not known")
    if len(record) < 34 + 6 * n_items or not n_items:
        raise ValueError(f"its compression is told in {len(record)} bytes for {n_items} items")
    n_layers, total = 0, 0
    for item in range(n_items):
        item_kind, size, _ = struct.unpack_from("<HHH", record, 34 + 6 * item)
        if size != _ITEM_SIZES.get(item_kind, size if item_kind in _EXTRA and size else None):
            raise ValueError(f"its compression has an item of kind {item_kind}, {size} bytes")
        is_of_layers = item_kind in _LAYERS or item_kind == 14
        if is_of_layers != (kind == LAYERED):
            raise ValueError(f"its compression of kind {kind} has an item of kind {item_kind}")
        n_layers += _LAYERS.get(item_kind, size)
        total += size
    if total != point_size:
        raise ValueError(f"its points are of {point_size} bytes, compressed ones of {total}")
    if not chunk_size and kind != POINT_WISE:
        raise ValueError("its chunks are of 0 points")
    return Compression(record, kind, chunk_size, n_layers)
