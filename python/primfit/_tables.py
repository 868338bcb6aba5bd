"""Results as tables that notebooks show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from primfit.planes.plane import Plane


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    """A table of text cells."""
    lines = [f"<table><caption>{escape(caption)}</caption>"]
    lines.append("<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>")
    for row in rows:
        lines.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>")
    return "\n".join(lines) + "\n</table>"


PLANES = ("plane", "inliers", "area m2", "rms mm", "normal and offset")
"""Columns of `plane_row`."""

MOST_ROWS = 100
"""Rows of a table in a notebook."""


def plane_row(i: int, plane: Plane) -> tuple[str, ...]:
    """What is told of a plane, as text."""
    a, b, c, d = plane.equation
    return (
        str(i),
        str(len(plane.inliers)),
        f"{plane.area:.4f}",
        f"{1000 * plane.rms:.3f}",
        f"{a:+.4f} {b:+.4f} {c:+.4f} {d:+.4f}",
    )


def planes_html(planes: Sequence[Plane], caption: str) -> str:
    """The planes with the most inliers first, numbered as they are in pictures."""
    order = np.argsort([-len(plane.inliers) for plane in planes], kind="stable")[:MOST_ROWS]
    if len(planes) > MOST_ROWS:
        caption += f"; the {MOST_ROWS} with the most inliers"
    return html_table(PLANES, [plane_row(int(i), planes[int(i)]) for i in order], caption)
