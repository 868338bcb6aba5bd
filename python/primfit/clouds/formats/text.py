"""XYZ, PTS and TXT: a point a line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from primfit.clouds.cloud import Cloud, Field, cloud_of, columns_of, table_of

_PTS = {
    4: ["x", "y", "z", "intensity"],
    6: ["x", "y", "z", "red", "green", "blue"],
    7: ["x", "y", "z", "intensity", "red", "green", "blue"],
}
"""Columns of .pts files, by their number."""


def read(path: Path, names: Sequence[str] | None = None) -> Cloud:
    """Columns of numbers, named by `names`, a line before the points, or the custom of .pts.

    Columns without a name are "column_4" and so on. Those of whole numbers are integers.
    """
    title: list[str] = []
    count: int | None = None
    n_before = 0
    with open(path, encoding="utf-8") as stream:
        for line in stream:
            words = _words(line)
            is_comment = line.lstrip().startswith(("#", "//"))
            if not is_comment and len(words) == 1 and words[0].isdigit():
                count = int(words[0])
            elif not is_comment and len(words) >= 3 and all(map(_is_number, words[:3])):
                break
            elif words:
                title = words
            n_before += 1
        else:
            if count != 0:
                raise ValueError("it holds no point")
            return Cloud(np.zeros((0, 3)))
    rows = np.loadtxt(
        path,
        delimiter=next((mark for mark in (",", ";") if mark in line), None),
        comments=("#", "//"),
        skiprows=n_before,
        usecols=[k for k, word in enumerate(words) if _is_number(word)],
        ndmin=2,
        encoding="utf-8",
    )
    if count not in (None, len(rows)):
        raise ValueError(f"it holds {len(rows)} points where it says {count}")
    if names is None:
        names = _names(path, title, len(words))
    elif len(names) != len(words):
        raise ValueError(f"columns must name the {len(words)} of its lines, not {len(names)}")
    kept = [name for name, word in zip(names, words, strict=True) if _is_number(word)]
    return cloud_of({name: _whole(name, each) for name, each in zip(kept, rows.T, strict=True)})


def _names(path: Path, title: list[str], n_columns: int) -> list[str]:
    if len(title) == n_columns and {"x", "y", "z"} <= {name.lower() for name in title}:
        return title
    if path.suffix.lower() == ".pts" and n_columns in _PTS:
        return _PTS[n_columns]
    return ["x", "y", "z", *(f"column_{k}" for k in range(4, n_columns + 1))]


def _words(line: str) -> list[str]:
    return [word for word in re.split(r"[\s,;]+", line.strip().lstrip("#/")) if word]


def _is_number(word: str) -> bool:
    with suppress(ValueError):
        float(word)
        return True
    return False


def _whole(name: str, values: Field) -> Field:
    if name.lower() in ("x", "y", "z") or not (np.abs(values) < 2**53).all():
        return values
    whole = values.astype(np.int64)
    return whole if np.array_equal(whole, values) else values


def write(path: Path, cloud: Cloud) -> None:
    """As many digits as each number has; a line with the names where they are not custom."""
    columns = columns_of(cloud)
    custom = _PTS.get(len(columns), ["x", "y", "z"]) if path.suffix.lower() == ".pts" else [*"xyz"]
    is_custom = set(custom) == set(columns)
    columns = {name: columns[name] for name in (custom if is_custom else columns)}
    head = [] if is_custom else ["# " + " ".join(columns)]
    head += [str(len(cloud))] if path.suffix.lower() == ".pts" else []
    formats = [_format(each) for each in columns.values()]
    table = table_of(columns)
    np.savetxt(path, table, fmt=formats, header="\n".join(head), comments="", encoding="utf-8")


def _format(values: Field) -> str:
    if values.dtype.kind != "f":
        return "%d"
    return "%.17g" if values.dtype.itemsize == 8 else "%.9g"
