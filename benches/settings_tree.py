"""Numbers within nested settings: which there are, and settings with one of them changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

Path = tuple[str | int, ...]
"""Names of fields and places in tuples, from the outside in."""


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def numbers(settings: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Each number and each tuple of numbers within a dataclass or tuple, with its path.

    Fields that are not given at all, words and switches are passed over.
    """
    if is_dataclass(settings):
        for each in fields(settings):
            yield from numbers(getattr(settings, each.name), (*path, each.name))
    elif isinstance(settings, tuple) and not (settings and all(map(is_number, settings))):
        for i, value in enumerate(settings):
            yield from numbers(value, (*path, i))
    elif is_number(settings) or isinstance(settings, tuple):
        yield path, settings


def scaled(value: Any, factor: float) -> Any:
    """A number, or each of a tuple, times a factor; whole numbers stay whole, and at least 1."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if isinstance(value, int):
        return max(1, round(factor * value)) if value > 0 else round(factor * value)
    return factor * value


def changed(settings: Any, path: Path, value: Any) -> Any:
    """The settings with another value at a path."""
    if not path:
        return value
    first, *rest = path
    if isinstance(first, int):
        inner = changed(settings[first], tuple(rest), value)
        return (*settings[:first], inner, *settings[first + 1 :])
    return replace(settings, **{first: changed(getattr(settings, first), tuple(rest), value)})


def name_of(path: Path) -> str:
    """`carving.neck`, `sampling.efforts[0].n`."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")
