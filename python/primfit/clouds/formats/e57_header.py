"""Headers and descriptions of E57 files, looked at before a library reads them.

The library goes down into nested elements by recursion, until the stack and with it the process
ends, and looks through the children of a structure one by one.
"""

from __future__ import annotations

import struct
from pathlib import Path
from xml.parsers import expat

_HEADER = struct.Struct("<8sII4Q")
"""Mark, version, size of the file, place and length of its description, size of its pages."""

_PAGE, _CHECKSUM = 1024, 4
"""Bytes of a page, and of the checksum at its end."""

_MOST_POINTS = 8
"""Points that a byte may stand for: each takes a bit at least, unless all are the same."""

_DEEPEST = 64
"""Elements within each other; those of the standard are a dozen."""

_WIDEST = 1000
"""Elements of a structure; points have a few dozen fields."""

_MOST_CHILDREN = 100_000
"""Elements of a vector, such as the scans of a file."""


def check_file(path: Path) -> None:
    """Refuse what is no E57 file, or says what the file cannot hold.

    Raises
    ------
    ValueError
        When it does.
    """
    size = path.stat().st_size
    with open(path, "rb") as stream:
        header = stream.read(_HEADER.size)
        if len(header) < _HEADER.size:
            raise ValueError(f"it has {len(header)} of the {_HEADER.size} bytes of its header")
        mark, _, _, physical, at, length, page = _HEADER.unpack(header)
        if mark != b"ASTM-E57":
            raise ValueError("it does not begin with 'ASTM-E57'")
        if physical != size:
            raise ValueError(f"it has {size} of {physical} bytes: it may be cut short")
        if page != _PAGE or not _HEADER.size <= at <= size or length > size - at:
            raise ValueError(
                f"its description of {length} bytes begins at byte {at} of {size}; pages of {page}"
            )
        first = at // _PAGE * _PAGE
        stream.seek(first)
        pages = stream.read(size - first)
    used = _PAGE - _CHECKSUM
    content = b"".join(pages[k : k + used] for k in range(0, len(pages), _PAGE))
    check_description(content[at - first :][:length], size)


def check_description(content: bytes, size: int) -> None:
    """Refuse a description of a file of `size` bytes that is too deep or wide, or claims too much.

    Raises
    ------
    ValueError
        When it does.
    """
    # Of each open element, how many it has and may have within it.
    open_elements: list[list[int]] = []

    def begin(name: str, attributes: dict[str, str]) -> None:
        if open_elements:
            open_elements[-1][0] += 1
            if open_elements[-1][0] > open_elements[-1][1]:
                raise ValueError(f"its description has too many {name[:40]!r} side by side")
        if len(open_elements) >= _DEEPEST:
            raise ValueError(f"its description is more than {_DEEPEST} elements deep")
        kind = attributes.get("type")
        open_elements.append([0, _MOST_CHILDREN if kind == "Vector" else _WIDEST])
        if kind == "CompressedVector":
            _check_points(attributes, size)

    def end(_: str) -> None:
        open_elements.pop()

    def refuse(*_: object) -> None:
        raise ValueError("its description defines entities, which E57 does not know")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise ValueError(f"its description is no XML: {error}") from None


def _check_points(attributes: dict[str, str], size: int) -> None:
    for name, most in (("recordCount", _MOST_POINTS * size), ("fileOffset", size)):
        value = attributes.get(name, "0")
        if not value.isdecimal() or int(value) > most:
            raise ValueError(f"its {name} is {value[:40]!r} in a file of {size} bytes")
