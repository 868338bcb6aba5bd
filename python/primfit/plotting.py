"""Pictures like the paper's figures; matplotlib is in the extra ``plot``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from primfit._check import Floats
from primfit._files import replacing
from primfit.geometry.shells import area_vectors
from primfit.results import Detection
from primfit.scans.scan import Scan
from primfit.solids.round import Round
from primfit.solids.solid import Solid
from primfit.worlds.world import COLORS, OTHER_COLOR, World

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNLABELLED = "0.75"
_MOST_NUMBERS = 60
"""Planes that get their number in a picture: more cannot be read."""

_MOST_POINTS = 40_000
"""Points that a picture shows: more only make the file larger."""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, in inches, that no display needs."""
    with _explained():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@contextmanager
def _explained() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "pictures need matplotlib: install it with pip install 'primfit[plot]'"
        ) from None


def _from_above(ax: Axes | None, title: str) -> Axes:
    if ax is None:
        with _explained():
            import matplotlib.pyplot as plt
        ax = plt.subplots(figsize=(6, 6), layout="constrained")[1]
    ax.set_aspect("equal")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    ax.set_title(title)
    return ax


def kind_color(kind: str) -> tuple[int, int, int]:
    """The colour of a kind of solid: red, green, blue up to 255."""
    return COLORS.get(kind, OTHER_COLOR)


def _color(kind: str) -> tuple[float, ...]:
    return tuple(value / 255 for value in kind_color(kind))


def plot_world(world: World, ax: Axes | None = None) -> Axes:
    """The map from above: each solid in the colour of its kind, with its name."""
    ax = _from_above(ax, "map")
    if world.arena is not None:
        ax.fill(*world.arena.outline.T, facecolor="0.97", edgecolor="0.2", linewidth=2)
    for solid in world.solids:
        for outline in _tops(solid):
            ax.fill(*outline.T, facecolor=_color(solid.kind), edgecolor="0.2", alpha=0.9)
        x, y, _ = solid.center
        ax.annotate(solid.kind, (x, y), ha="center", va="center", fontsize=7)
    return ax


def _tops(solid: Solid) -> list[Floats]:
    """Outlines (m, 2) of the faces that look upwards."""
    if solid.footprint is not None:
        return [solid.footprint]
    if isinstance(solid, Round):
        # One outline, so that what is within the hole of a ring is seen.
        rings = [solid.shadow.exterior, *solid.shadow.interiors]
        return [np.concatenate([np.array(ring.coords) for ring in rings])]
    up = area_vectors(solid.vertices, solid.faces)[:, 2] > 0.0
    return [solid.vertices[face, :2] for face, is_up in zip(solid.faces, up, strict=True) if is_up]


def plot_scan(scan: Scan, ax: Axes | None = None) -> Axes:
    """The returns from above, coloured by height."""
    ax = _from_above(ax, "point cloud")
    points = _thinned(scan.points[scan.is_return])
    x, y, z = points.T
    shown = ax.scatter(x, y, c=z, s=0.3, cmap="viridis", rasterized=True)
    ax.figure.colorbar(shown, ax=ax, label="z [m]", shrink=0.8)
    return ax


def plot_detection(found: Detection, world: World | None = None, ax: Axes | None = None) -> Axes:
    """Points coloured by plane, solids and arena found, and the truth dashed below them."""
    ax = _from_above(ax, f"found ({found.method})")
    colors = plane_colors(len(found.planes))
    shown = found.scan.is_return
    if found.floor is not None:
        shown = shown.copy()
        shown[found.floor.inliers] = False
    rows = _thinned(np.flatnonzero(shown))
    labels = found.labels[rows]
    color = np.where(labels[:, None] >= 0, colors[labels], 190) / 255
    x, y, _ = found.scan.points[rows].T
    ax.scatter(x, y, c=color, s=0.3, rasterized=True)
    if world is not None:
        truth = [each for solid in world.solids for each in _tops(solid)]
        truth += [] if world.arena is None else [world.arena.outline]
        for k, outline in enumerate(truth):
            name = None if k else "truth"
            ax.fill(
                *outline.T, fill=False, edgecolor="0.1", linestyle="--", linewidth=0.8, label=name
            )
    for found_solid in found.solids:
        shade = _color(found_solid.kind)
        footprint = found_solid.footprint
        for outline in _tops(found_solid.solid) if footprint is None else [footprint]:
            ax.fill(*outline.T, facecolor=shade, alpha=0.45)
            ax.plot(*np.vstack([outline, outline[:1]]).T, color=shade, linewidth=1.2)
        x, y, _ = found_solid.center
        name = "center" if found_solid is found.solids[0] else None
        ax.plot(x, y, marker="+", color="black", markersize=5, linestyle="", label=name)
        ax.annotate(
            found_solid.kind,
            (x, y),
            xytext=(0, 6),
            textcoords="offset points",
            ha="center",
            fontsize=7,
        )
    if found.arena is not None:
        outline = found.arena.footprint
        ax.plot(*np.vstack([outline, outline[:1]]).T, color="0.2", linewidth=1.2, label="arena")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper right", fontsize=7)
    return ax


def plot_planes(scan: Scan, found: Detection, ax: Any) -> None:
    """Points in space, coloured by plane, with the boundary of each (a 3D axes)."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    rows = _thinned(np.flatnonzero(scan.is_return))
    colors = plane_colors(len(found.planes))
    labels = found.labels[rows]
    shade = np.where(labels[:, None] >= 0, colors[labels], 190) / 255
    points = scan.points[rows]
    ax.scatter(*points.T, c=shade, s=0.4, rasterized=True, depthshade=False)
    low, high = _extent(found, points)
    drawn = [k for k, plane in enumerate(found.planes) if len(plane.boundary)]
    outlines = [np.vstack([found.planes[k].boundary, found.planes[k].boundary[:1]]) for k in drawn]
    lines = Line3DCollection(outlines, colors=colors[drawn] / 255, linewidths=1.0)
    ax.add_collection3d(lines, autolim=False)
    for k in drawn[:_MOST_NUMBERS]:
        ax.text(*found.planes[k].center, str(k), fontsize=7, ha="center", va="center")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    ax.set_zlabel("z [m]")
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_zlim(low[2], high[2])
    ax.set_box_aspect(np.maximum(high - low, 0.05 * (high - low).max()))
    ax.set_title(f"{len(found.planes)} planes")


def _extent(found: Detection, points: Floats) -> tuple[Floats, Floats]:
    """Corners (3,) of a box around nearly all points, and around all outlines."""
    low, high = np.quantile(points, [0.01, 0.99], axis=0)
    for plane in found.planes:
        if len(plane.boundary):
            low = np.minimum(low, plane.boundary.min(axis=0))
            high = np.maximum(high, plane.boundary.max(axis=0))
    return low, high


def plane_colors(n: int) -> np.ndarray:
    """n colours (n + 1, 3) uint8 that neighbours in the list tell apart; the last is grey."""
    hue = (np.arange(n) * 0.61803398875) % 1.0
    wheel = np.abs((hue[:, None] * 6 + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1
    colors = np.clip(wheel, 0.0, 1.0) * 0.75 + 0.1
    return np.vstack([np.rint(255 * colors), [190, 190, 190]]).astype(np.uint8)


def save_demo(file: Any, world: World, scan: Scan, found: Detection, verdict: str) -> None:
    """Map, cloud and result side by side, as a picture file, with the verdict above it."""
    figure = new_figure(16, 5.4)
    axes = figure.subplots(1, 3)
    plot_world(world, axes[0])
    plot_scan(scan, axes[1])
    plot_detection(found, world, axes[2])
    sigma = 1000.0 * float(np.max(scan.sigma if scan.sigma is not None else found.sigma))
    figure.suptitle(f"{verdict} (noise {sigma:.3g} mm)")
    with replacing(file) as part:
        figure.savefig(part, dpi=130)


def save_detection(file: Any, found: Detection) -> None:
    """Planes in space and the view from above, as a picture file."""
    figure = new_figure(13, 6)
    plot_planes(found.scan, found, figure.add_subplot(1, 2, 1, projection="3d"))
    ax = plot_detection(found, None, figure.add_subplot(1, 2, 2))
    low, high = _extent(found, found.scan.points[found.scan.is_return])
    margin = 0.05 * (high - low)[:2].max()
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)
    figure.suptitle(f"{found!r}, numbered as in the table")
    with replacing(file) as part:
        figure.savefig(part, dpi=130)


def _thinned(rows: Any) -> Floats:
    return rows[:: max(1, -(-len(rows) // _MOST_POINTS))]
