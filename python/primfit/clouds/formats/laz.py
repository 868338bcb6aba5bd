"""Points of LAZ files, through lazrs, chunk by chunk.

lazrs takes the memory that sizes in the file ask for, and a lack of it ends the process; so all
sizes are held against the bytes that there are before it sees them.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator

from primfit.clouds.formats.las_header import LAYERED, POINT_WISE, VARIABLE, Compression, LasHeader

_MOST_POINTS = 1000
"""Points that a byte may stand for; those of real clouds take a byte and more each."""

_AT_ONCE = 1 << 26
"""Bytes of points that are decompressed at once, or those of one chunk."""


def decompressed(
    content: memoryview, header: LasHeader, compression: Compression
) -> Iterator[bytearray]:
    """The points of a LAZ file as they are in a LAS file, in parts one after the other.

    Raises
    ------
    ValueError
        When they are damaged, or not all there.
    """
    data = content[header.start : header.end]
    try:
        if compression.kind == POINT_WISE:
            yield from _point_wise(data, header, compression)
        else:
            yield from _chunk_wise(data, content, header, compression)
    except (ValueError, MemoryError, GeneratorExit):
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise ValueError(f"its compressed points are damaged: {error}") from None


def _chunk_wise(
    data: memoryview, content: memoryview, header: LasHeader, compression: Compression
) -> Iterator[bytearray]:
    import lazrs

    table = _chunks(data, content, header, compression)
    at, first = 8, 0
    while first < len(table):
        last, n_bytes, n_points = first, 0, 0
        while last < len(table) and (
            last == first or (n_points + table[last][0]) * header.point_size <= _AT_ONCE
        ):
            _check_chunk(data, at + n_bytes, table[last], header, compression)
            n_points += table[last][0]
            n_bytes += table[last][1]
            last += 1
        part = bytearray(n_points * header.point_size)
        lazrs.decompress_points_with_chunk_table(
            bytes(data[at : at + n_bytes]), compression.record, part, table[first:last]
        )
        yield part
        at, first = at + n_bytes, last


def _point_wise(
    data: memoryview, header: LasHeader, compression: Compression
) -> Iterator[bytearray]:
    import lazrs

    if header.n_points > _MOST_POINTS * len(data):
        raise ValueError(f"it has {len(data)} bytes for {header.n_points} points")
    if not header.n_points:
        return
    decompressor = lazrs.LasZipDecompressor(io.BytesIO(data), compression.record)
    at_once = max(1, _AT_ONCE // header.point_size)
    for first in range(0, header.n_points, at_once):
        part = bytearray(min(at_once, header.n_points - first) * header.point_size)
        decompressor.decompress_many(part)
        yield part


def _chunks(
    data: memoryview, content: memoryview, header: LasHeader, compression: Compression
) -> list[tuple[int, int]]:
    """Points and bytes of each chunk; together those of the file."""
    import lazrs

    if len(data) < 8:
        raise ValueError("it ends before its compressed points: it may be cut short")
    (at,) = struct.unpack_from("<q", data)
    if at < header.start and len(content) >= 8:
        # Where the writer could not go back, the place of the table is at the end of the file.
        (at,) = struct.unpack_from("<q", content, len(content) - 8)
    at -= header.start
    if not 8 <= at <= len(data) - 8:
        raise ValueError("it has no table of its chunks: it may be cut short")
    (n_chunks,) = struct.unpack_from("<I", data, at + 4)
    if n_chunks * header.point_size > at:
        raise ValueError(f"it has {at - 8} bytes for {n_chunks} chunks of points")
    size = compression.chunk_size
    if size != VARIABLE and n_chunks != -(-header.n_points // size):
        raise ValueError(
            f"it has {n_chunks} chunks of {size}, where its header says {header.n_points} points"
        )
    if not n_chunks:
        if header.n_points:
            raise ValueError(f"it has no chunk, where its header says {header.n_points} points")
        return []
    vlr = lazrs.LazVlr(compression.record)
    source = io.BytesIO(data[at:])
    table = [(int(points), int(size)) for points, size in lazrs.read_chunk_table_only(source, vlr)]
    if size != VARIABLE:
        counts = [size] * (n_chunks - 1) + [header.n_points - size * (n_chunks - 1)]
        table = [(count, n_bytes) for count, (_, n_bytes) in zip(counts, table, strict=True)]
    n_points, n_bytes = sum(each[0] for each in table), sum(each[1] for each in table)
    if n_points != header.n_points or n_bytes != at - 8:
        raise ValueError(
            f"its chunks hold {n_points} points in {n_bytes} bytes, where its header says "
            f"{header.n_points}, and {at - 8} bytes are there"
        )
    return table


def _check_chunk(
    data: memoryview, at: int, chunk: tuple[int, int], header: LasHeader, compression: Compression
) -> None:
    """Refuse a chunk that says more than its bytes hold."""
    n_points, n_bytes = chunk
    n_sizes = 1 + compression.n_layers if compression.kind == LAYERED else 1
    least = header.point_size + 4 * n_sizes
    if n_bytes < (least if n_points > 1 or compression.kind == LAYERED else header.point_size):
        raise ValueError(f"it has a chunk of {n_bytes} bytes for {n_points} points")
    if not 0 < n_points <= _MOST_POINTS * n_bytes:
        raise ValueError(f"it has a chunk of {n_points} points in {n_bytes} bytes")
    if compression.kind == LAYERED:
        sizes = struct.unpack_from(f"<{n_sizes}I", data, at + header.point_size)
        if sizes[0] != n_points or sum(sizes[1:]) != n_bytes - least:
            raise ValueError(
                f"it has a chunk of {sizes[0]} points in layers of {sum(sizes[1:])} bytes, where "
                f"{n_points} points and {n_bytes - least} bytes are meant"
            )
