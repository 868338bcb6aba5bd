"""Lines before the points of a text file: which of them names the columns, and how."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress

_UNIT = re.compile(r"\s{0,4}[\[(][^\[\]()]{0,40}[\])]")
"""What stands in brackets after a name, as in "X [m]"; short, so that searching takes no time."""

_PART_OF_POINTS = re.compile(r"points(?:_m_xyz)?[:_]([012])", re.IGNORECASE)
"""How VTK and VeloView call coordinates."""

_MISSING = r"#(n/a|div/0!|num!|value!|ref!|name\?|null!)"
"""What spreadsheets write where a number is missing, which is no remark."""

_SPOILT = re.compile(
    rf"[-+.]?(\d.*|nan\b.*|inf\b.*|n/?a|null|none|{_MISSING}.*|1\.?#.*|\?+|-+)", re.IGNORECASE
)
"""What stands where a number is meant, such as 1.0D+00, -nan(ind), NA, #N/A."""


def is_remark(line: str) -> bool:
    """Whether a line begins with the mark of a remark."""
    is_marked = line.startswith(("#", "//"))
    return is_marked and not re.match(_MISSING, line, re.IGNORECASE)


def words_of(line: str) -> tuple[list[str], str | None]:
    """The words of a line, without quotes, and what parts them: ";" , "," or None, white space."""
    separator = next((mark for mark in ";," if mark in line), None)
    return split(line, separator), separator


def split(line: str, separator: str | None) -> list[str]:
    """The words of a line; those in quotes may hold what parts the others."""
    if separator is None:
        return [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', line)]
    row = next(csv.reader([line.replace("\0", " ")], delimiter=separator, skipinitialspace=True))
    return [word.strip() for word in row]


def is_number(word: str) -> bool:
    """Whether it reads as a float."""
    with suppress(ValueError):
        float(word)
        return True
    return False


def is_meant_as_number(word: str) -> bool:
    """Whether a number is meant, if only it could be read."""
    return is_number(word) or _SPOILT.fullmatch(word) is not None


def is_point(words: Sequence[str]) -> bool:
    """Whether a line is a point, or is meant as one."""
    return len(words) >= 3 and any(map(is_meant_as_number, words))


def names_in(
    lines: Sequence[str], separator: str | None, n_columns: int | None
) -> list[str] | None:
    """The names of `n_columns` columns, as the last line that has x, y and z among its names says.

    None when no line does, and all are remarks.

    Raises
    ------
    ValueError
        When a line that is no remark is not understood, or a remark names the coordinates in
        another order than x, y, z, but not all columns.
    """
    for line in reversed(lines):
        names = _names_of(line, separator, n_columns)
        if names is not None:
            return names
    for line in lines:
        if not is_remark(line):
            raise ValueError(
                f"its line {line[:60]!r} is neither a point nor a title of {n_columns} columns "
                f"with x, y and z; name them, for example columns=('id', 'x', 'y', 'z')"
            )
        words = [_plain(word) for word in split(_UNIT.sub("", line.lstrip("#/ ")), separator)]
        named = [word for word in words if word in ("x", "y", "z")]
        is_default = named == ["x", "y", "z"] and (words[:3] == named or n_columns == 3)
        if {"x", "y", "z"} <= {*named} and not is_default:
            raise ValueError(
                f"its line {line[:60]!r} names x, y and z, but {len(words)} of {n_columns} "
                f"columns; name them, for example columns=('id', 'x', 'y', 'z')"
            )
    return None


def _names_of(line: str, separator: str | None, n_columns: int | None) -> list[str] | None:
    """The names in a line, when they are as many as the columns and x, y and z are among them."""
    text = line.lstrip("#/ ")
    for mark in dict.fromkeys((separator, *";,", None)):
        for without_units in (text, _UNIT.sub("", text)):
            with suppress(csv.Error):
                words = split(without_units, mark)
                names = [_plain(word) or f"column_{k}" for k, word in enumerate(words, 1)]
                first = dict(reversed([(name, k) for k, name in enumerate(names)]))
                names = [
                    name if first[name] == k else f"{name}_{k + 1}" for k, name in enumerate(names)
                ]
                if n_columns in (None, len(names)) and {"x", "y", "z"} <= {*names}:
                    return names
    return None


def _plain(word: str) -> str:
    """A name without quotes and unit; x, y and z in small letters."""
    name = _UNIT.sub("", word.strip().strip("'\"")).strip()
    if part := _PART_OF_POINTS.fullmatch(name):
        return "xyz"[int(part[1])]
    return name.lower() if name.lower() in ("x", "y", "z") else name
