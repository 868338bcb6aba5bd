"""XYZ, ASC, TXT, CSV and PTS: a point a line."""

from __future__ import annotations

import gzip
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from primfit import _primfit
from primfit.clouds.cloud import Cloud, Columns, Field, cloud_of, columns_of
from primfit.clouds.formats import titles

_PTS = {
    4: ["x", "y", "z", "intensity"],
    6: ["x", "y", "z", "red", "green", "blue"],
    7: ["x", "y", "z", "intensity", "red", "green", "blue"],
}
"""Columns of .pts files, by their number."""

_EXACT = 2.0**53
"""Whole numbers from here on are not all floats."""

_FEW = 8
"""Columns of large numbers that are looked at one by one."""

_AT_ONCE = 100_000
"""Rows that are put into text at once."""


@dataclass(frozen=True)
class Head:
    """What comes before the points.

    Attributes
    ----------
    lines : list of str
        Those that are not empty and no number of points.
    count : int or None
        Number of points, where a line says it.
    start, first_line : int
        Where the points begin: byte, and number of the line.
    words : list of str
        Those of the first point; empty when there is none.
    separator : str or None
        What parts its words; None is any white space.
    """

    lines: list[str]
    count: int | None
    start: int
    first_line: int
    words: list[str]
    separator: str | None


def read(path: Path, names: Sequence[str] | None = None) -> Cloud:
    """Columns of numbers, named by `names`, a line before the points, or the custom of .pts.

    Columns without a name are "column_4" and so on. Those of whole numbers are integers.
    """
    content = content_of(path)
    head = _head_of(content)
    if not head.words:
        if head.count != 0:
            raise ValueError("it holds no point")
        title = titles.names_in(head.lines, None, None) or [*"xyz"]
        return cloud_of({name: whole(name, np.zeros(0)) for name in title})
    n_columns = len(head.words)
    if names is None:
        names = titles.names_in(head.lines, head.separator, n_columns)
    elif len(names) != n_columns:
        raise ValueError(f"columns must name the {n_columns} of its lines, not {len(names)}")
    elif len({*names}) < n_columns:
        raise ValueError(f"columns must differ from each other, not be {', '.join(names)}")
    if names is None:
        is_pts = path.name.lower().removesuffix(".gz").endswith(".pts")
        unnamed = [*"xyz", *(f"column_{k}" for k in range(4, n_columns + 1))]
        names = _PTS.get(n_columns, unnamed) if is_pts else unnamed
    place = {"x", "y", "z"}
    kept = [
        k
        for k, word in enumerate(head.words)
        if titles.is_meant_as_number(word) or names[k].lower() in place
    ]
    columns = numbers_of(content, head, kept)
    n = len(columns[0]) if columns else 0
    if head.count not in (None, n):
        raise ValueError(f"it holds {n} points where it says {head.count}")
    return cloud_of({names[k]: whole(names[k], x) for k, x in zip(kept, columns, strict=True)})


def content_of(path: Path) -> bytes:
    """The bytes of a text file: out of .gz, in UTF-8, without a byte-order mark."""
    content = path.read_bytes()
    if path.suffix.lower() == ".gz":
        content = gzip.decompress(content)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        content = content.decode("utf-16").encode()
    return content.removeprefix(b"\xef\xbb\xbf")


def _head_of(content: bytes) -> Head:
    lines: list[str] = []
    count = None
    for number, start, text in _lines_of(content):
        is_remark = titles.is_remark(text)
        words, separator = titles.words_of(text)
        if not is_remark and len(words) == 1 and words[0].isdecimal():
            count = int(words[0])
        elif not is_remark and titles.is_point(words):
            return Head(lines, count, start, number, words, separator)
        elif text:
            lines.append(text)
    return Head(lines, count, len(content), 0, [], None)


def _lines_of(content: bytes) -> Iterator[tuple[int, int, str]]:
    """Number, place and text of each line."""
    start, number = 0, 1
    while start < len(content):
        end = content.find(b"\n", start)
        end = len(content) if end < 0 else end
        yield number, start, content[start:end].decode("utf-8", "replace").strip()
        start, number = end + 1, number + 1


def numbers_of(content: bytes, head: Head, kept: list[int]) -> list[Field]:
    """Some columns of the points; those of large whole numbers as integers, which are exact."""

    def parsed(columns: list[int], kind: str) -> Field:
        separator = None if head.separator is None else ord(head.separator)
        n = len(head.words)
        table = _primfit.parse_rows(
            content, head.start, head.first_line, n, columns, kind, separator, True
        )
        return np.ascontiguousarray(table.T)

    found = list(parsed(kept, "f"))
    large = [k for k, values in enumerate(found) if (np.abs(values) >= _EXACT).any()]
    # Each by itself, since one may be no whole number; many at once, which takes less time.
    for some in [[k] for k in large] if len(large) <= _FEW else [large]:
        for kind in ("i", "u"):
            with suppress(ValueError):
                exact = parsed([kept[k] for k in some], kind)
                for k, values in zip(some, exact, strict=True):
                    found[k] = values
                break
    return found


def whole(name: str, values: Field) -> Field:
    """The values as integers, where they are whole and no coordinates."""
    if name.lower() in ("x", "y", "z") or values.dtype.kind != "f":
        return values
    if not (np.abs(values) < _EXACT).all():
        return values
    integers = values.astype(np.int64)
    return integers if np.array_equal(integers, values) else values


def write(path: Path, cloud: Cloud) -> None:
    """As many digits as each number has; a line with the names where they are not custom."""
    suffix = Path(path.name.lower().removesuffix(".gz")).suffix
    columns = columns_of(cloud)
    custom = _PTS.get(len(columns), ["x", "y", "z"]) if suffix == ".pts" else [*"xyz"]
    is_custom = set(custom) == set(columns) and suffix != ".csv"
    columns = {name: columns[name] for name in (custom if is_custom else columns)}
    separator, mark = (",", "") if suffix == ".csv" else (" ", "# ")
    head = "" if is_custom else f"{mark}{separator.join(columns)}\n"
    head += f"{len(cloud)}\n" if suffix == ".pts" else ""
    with open(path, "wb") as file:
        if path.suffix.lower() == ".gz":
            # The same cloud makes the same file: without its name and the time.
            with gzip.GzipFile("", "wb", 6, file, 0) as stream:
                _write_rows(stream, head, columns, separator)
        else:
            _write_rows(file, head, columns, separator)


def _write_rows(
    stream: IO[bytes] | gzip.GzipFile, head: str, columns: Columns, separator: str
) -> None:
    stream.write(head.encode())
    for start in range(0, len(columns["x"]), _AT_ONCE):
        part = [_plain(values[start : start + _AT_ONCE]) for values in columns.values()]
        stream.write(_primfit.format_rows(part, ord(separator)))


def _plain(values: Field) -> Field:
    """The numbers in one of the types that are put into text."""
    if values.dtype.kind in "iu":
        values = values.astype(np.int64 if values.dtype.kind == "i" else np.uint64)
    return np.ascontiguousarray(values)
