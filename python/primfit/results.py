"""What a detection found."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from primfit._check import Floats, Ints, writable
from primfit._files import replacing
from primfit.geometry.extrusions import prism_faces, prism_triangles, prism_vertices
from primfit.geometry.footprints import area_centroid
from primfit.planes.plane import Plane
from primfit.polyhedra.found import FoundPolyhedron
from primfit.scans.scan import Scan
from primfit.viewing.shown import Shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from primfit.worlds.world import World


@dataclass(frozen=True, eq=False)
class FoundSolid:
    """An upright solid that was found.

    Attributes
    ----------
    kind : str
        "triangle", "square", "rectangle", "pentagon", ..., "star" or "polygon".
    footprint : (m, 2) float64, metres
        Counter-clockwise.
    base, top : float, metres
        z of the floor, and of the upper end; where the height is not known, of the highest beam
        that ended on the solid.
    angle : float, radians
        Yaw of the footprint, from zero up to its symmetry.
    size : float or (float, float), metres
        Side; (long, short) of a rectangle; (outer, inner) radius of a star.
    covariance : (k, k) float64
        Of center x, center y, angle and the one or two sizes; NaN when nothing was fitted. The
        angle of a circle is zero by definition, and so are its row and column.
    planes : tuple of int
        Its walls among the planes found.
    observed : tuple of bool
        Which of `faces` returned beams.
    height_sigma : float, metres
        Standard deviation of the height; NaN where no beam tells the height.
    tolerance_sigma : float, metres
        Standard deviation of x and y of the center that the shape's own inexactness adds to
        `covariance`, which is that of the noise alone: walls of a real solid may be off its kind by
        as much as the tolerance, unless the beams say less.
    """

    kind: str
    footprint: Floats
    base: float
    top: float
    angle: float
    size: float | tuple[float, float]
    covariance: Floats
    planes: tuple[int, ...]
    observed: tuple[bool, ...]
    height_sigma: float = np.nan
    tolerance_sigma: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "footprint", np.array(self.footprint))

    @property
    def height(self) -> float:
        """From base to top, metres; NaN where no beam tells."""
        return self.top - self.base if np.isfinite(self.height_sigma) else np.nan

    @property
    def center(self) -> Floats:
        """Mean of the vertices (3,), metres; z is NaN where the height is."""
        return np.append(self.footprint.mean(axis=0), self.base + self.height / 2)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres; z is NaN where the height is."""
        return np.append(area_centroid(self.footprint), self.base + self.height / 2)

    def moved(self, offset: Floats) -> FoundSolid:
        """The solid moved by a vector (3,), metres."""
        z = float(offset[2])
        return replace(
            self, footprint=self.footprint + offset[:2], base=self.base + z, top=self.top + z
        )

    @property
    def vertices(self) -> Floats:
        """Vertices (2m, 3), metres: the bottom, then the top."""
        return prism_vertices(self.footprint, self.base, self.top)

    @property
    def faces(self) -> tuple[Ints, ...]:
        """Rows of `vertices` around each face, seen from outside: m walls, bottom, top."""
        return prism_faces(len(self.footprint))

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by name: metres, and radians for the angle."""
        names = ["center_x", "center_y", "angle", "size", "size_2"]
        return {
            name: float(np.sqrt(variance))
            for name, variance in zip(names, np.diag(self.covariance), strict=False)
        } | {"height": self.height_sigma}

    def to_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (2m, 3) and triangles (t, 3), counter-clockwise from outside."""
        return self.vertices, prism_triangles(self.footprint)

    def to_dict(self) -> dict[str, Any]:
        """The solid as plain numbers, for JSON."""
        return {
            "kind": self.kind,
            "center": _plain(self.center),
            "centroid": _plain(self.centroid),
            "angle": self.angle,
            "size": self.size,
            "height": self.height if np.isfinite(self.height) else None,
            "footprint": self.footprint.tolist(),
            "sigmas": _without_nan(self.sigmas),
            "tolerance_sigma": self.tolerance_sigma,
            "planes": list(self.planes),
            "observed": list(self.observed),
        }

    def __repr__(self) -> str:
        x, y, _ = self.center
        size = ", ".join(f"{value:.4f}" for value in np.atleast_1d(self.size))
        return (
            f"FoundSolid({self.kind}, center=({x:.4f}, {y:.4f}), size={size} m, "
            f"angle={np.degrees(self.angle):.2f} deg)"
        )


@dataclass(frozen=True, eq=False)
class FoundArena:
    """Walls around the scene, seen from inside.

    Attributes
    ----------
    footprint : (m, 2) float64, metres
        Counter-clockwise.
    planes : tuple of int
        The walls among the planes found.
    observed : tuple of bool
        Which of the walls, from corner i to the next, returned beams; where none did, the wall is
        only known not to be nearer. Empty where the method does not tell.
    height : float, metres
        Of the walls; NaN where no beam tells.
    """

    footprint: Floats
    planes: tuple[int, ...]
    observed: tuple[bool, ...] = ()
    height: float = np.nan

    def __post_init__(self) -> None:
        object.__setattr__(self, "footprint", np.array(self.footprint))

    def moved(self, offset: Floats) -> FoundArena:
        """The arena moved by a vector (3,), metres."""
        return replace(self, footprint=self.footprint + offset[:2])

    def __repr__(self) -> str:
        return "FoundArena({:.3f} x {:.3f} m, {} walls)".format(*self.size, len(self.footprint))

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and y, metres."""
        width, depth = np.ptp(self.footprint, axis=0)
        return float(width), float(depth)

    def to_dict(self) -> dict[str, Any]:
        """The arena as plain numbers, for JSON."""
        return {
            "footprint": self.footprint.tolist(),
            "planes": list(self.planes),
            "observed": list(self.observed),
            "height": self.height if np.isfinite(self.height) else None,
        }


@dataclass(frozen=True, eq=False)
class Contradiction:
    """A place where something stood for a part of the time only.

    Attributes
    ----------
    center : (2,) float64, metres
    footprint : (m, 2) float64, metres
        Outline of where beams ended, roughly.
    pose : int
        First pose after the change, by the scan's `pose_index`, or else the row.
    shares : (float, float)
        Of the beams through its middle, those that ended there before and from then on.
    """

    center: Floats
    footprint: Floats
    pose: int
    shares: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", writable(np.array(self.center)))
        object.__setattr__(self, "footprint", writable(np.array(self.footprint)))

    def moved(self, offset: Floats) -> Contradiction:
        """The place moved by a vector (3,), metres."""
        shift = offset[:2]
        return replace(self, center=self.center + shift, footprint=self.footprint + shift)

    def to_dict(self) -> dict[str, Any]:
        """The place as plain numbers, for JSON."""
        return {
            "center": self.center.tolist(),
            "footprint": self.footprint.tolist(),
            "pose": self.pose,
            "shares": list(self.shares),
        }


@dataclass(frozen=True, eq=False)
class Detection(Shown):
    """Planes and solids of a scan.

    Attributes
    ----------
    scan : Scan
        What was looked at.
    method : str
    planes : tuple of Plane
        Without the floor.
    labels : (n,) int64
        Plane of each row of the scan, -1 for none.
    solids : tuple of FoundSolid, or of FoundPolyhedron by the method "planes"
        Without the arena.
    arena : FoundArena or None
    floor : Plane or None
    sigma : float, metres
        Standard deviation of the ranges, given or estimated.
    settings : dict
        What the method used, given or derived, lengths in metres; and, as "method_reason", why it
        was this method.
    shells : tuple of tuple of int
        Planes that meet without closing, and are in no solid; by the method "planes" only.
    contradictions : tuple of Contradiction
        Places where something stood for a part of the time only; by the method "likelihood" only.
    path : (p, 3) float64 or None
        Poses as they were found, x, y in metres and yaw in radians, row by `pose_index`; None where
        they were taken as exact. `scan` is then as it was found to be, with beams from there.
    path_covariance : (p, 3, 3) float64 or None
        Of each, with the map unknown; NaN for poses without beams.
    lost_poses : tuple of int
        Poses whose beams fit much worse than those of the others, and were left out.
    calibration : dict
        What was estimated of "bias", "mount_x", "mount_y", metres, "mount_yaw" and "divergence",
        the full angle of the beams' cone of light, radians, and
        the standard deviation of each as "bias_sigma" and so on.
    """

    scan: Scan
    method: str
    planes: tuple[Plane, ...]
    labels: Ints
    solids: tuple[FoundSolid | FoundPolyhedron, ...]
    arena: FoundArena | None
    floor: Plane | None
    sigma: float
    settings: dict[str, Any]
    shells: tuple[tuple[int, ...], ...] = ()
    contradictions: tuple[Contradiction, ...] = ()
    path: Floats | None = None
    path_covariance: Floats | None = None
    lost_poses: tuple[int, ...] = ()
    calibration: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", writable(self.labels))

    def moved(self, offset: Floats, scan: Scan) -> Detection:
        """The detection moved by a vector (3,), metres, as that of another scan."""
        return replace(
            self,
            scan=scan,
            planes=tuple(plane.moved(offset) for plane in self.planes),
            solids=tuple(solid.moved(offset) for solid in self.solids),
            arena=self.arena and self.arena.moved(offset),
            floor=self.floor and self.floor.moved(offset),
            contradictions=tuple(each.moved(offset) for each in self.contradictions),
            path=None if self.path is None else self.path + np.append(offset[:2], 0.0),
        )

    def plot(self, *, world: World | None = None, ax: Axes | None = None) -> Axes:
        """Draw planes and solids over the truth, if given; needs matplotlib."""
        from primfit import plotting

        return plotting.plot_detection(self, world, ax)

    def to_mesh(self) -> tuple[Floats, Ints, Ints]:
        """The solids as triangles.

        Returns
        -------
        vertices : (v, 3) float64, metres
        triangles : (t, 3) int64
        solid_index : (t,) int64
            Row of `solids` of each triangle.
        """
        vertices, triangles, index = [np.empty((0, 3))], [np.empty((0, 3), int)], [np.empty(0, int)]
        for i, solid in enumerate(self.solids):
            corners, rows = solid.to_mesh()
            triangles.append(rows + sum(map(len, vertices)))
            vertices.append(corners)
            index.append(np.full(len(triangles[-1]), i))
        return np.concatenate(vertices), np.concatenate(triangles), np.concatenate(index)

    def to_dict(self) -> dict[str, Any]:
        """The detection as plain numbers, without labels and inliers."""
        planes = [
            {
                "equation": plane.equation.tolist(),
                "n_inliers": len(plane.inliers),
                "area": plane.area,
                "rms": plane.rms,
                "boundary": plane.boundary.tolist(),
            }
            for plane in ((self.floor, *self.planes) if self.floor else self.planes)
        ]
        return {
            "primfit": "detection",
            "method": self.method,
            "sigma": self.sigma,
            "settings": _without_nan(self.settings),
            "solids": [solid.to_dict() for solid in self.solids],
            "arena": self.arena and self.arena.to_dict(),
            "floor": planes.pop(0) if self.floor else None,
            "planes": planes,
            "shells": [list(shell) for shell in self.shells],
            "contradictions": [each.to_dict() for each in self.contradictions],
        } | self._poses_to_dict()

    def _poses_to_dict(self) -> dict[str, Any]:
        """What was found of the poses, if they were not exact."""
        if self.path is None or self.path_covariance is None:
            return {}
        sigmas = np.sqrt(np.einsum("pii->pi", self.path_covariance))
        return {
            "path": self.path.tolist(),
            "path_sigmas": [_plain(row) for row in sigmas],
            "lost_poses": list(self.lost_poses),
            "calibration": self.calibration,
        }

    def to_json(self, file: str | PathLike[str] | None = None) -> str:
        """The detection as JSON text, written to `file` too if given."""
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
        if file is not None:
            with replacing(file) as part:
                part.write_text(text)
        return text

    def to_csv(self, file: str | PathLike[str]) -> None:
        """Write the solids as a table: kind, center, angle, sizes, height, number of corners.

        The corners are those of the footprint, or all where there is none.
        """
        with replacing(file) as part, open(part, "w", newline="") as stream:
            table = csv.writer(stream)
            table.writerow(
                [
                    "kind",
                    "x_m",
                    "y_m",
                    "z_m",
                    "angle_rad",
                    "size_m",
                    "size_2_m",
                    "size_3_m",
                    "height_m",
                    "corners",
                ]
            )
            for solid in self.solids:
                corners = solid.vertices if solid.footprint is None else solid.footprint
                sizes = [*np.atleast_1d(solid.size).tolist(), "", ""][:3]
                table.writerow(
                    [
                        solid.kind,
                        *solid.center.tolist(),
                        solid.angle,
                        *sizes,
                        solid.height,
                        len(corners),
                    ]
                )

    def save_mesh(self, file: str | PathLike[str]) -> None:
        """Write the solids as a mesh in the format of the suffix: .ply, .obj or .stl."""
        from primfit.clouds import files

        files.write_mesh(file, *self.to_mesh()[:2])

    def _repr_html_(self) -> str:
        from primfit._tables import html_table, planes_html

        rows = [
            (
                str(j),
                solid.kind,
                ", ".join(f"{x:.4f}" for x in solid.center),
                ", ".join(f"{x:.4f}" for x in np.atleast_1d(solid.size)),
                f"{np.degrees(solid.angle):.2f}",
            )
            for j, solid in enumerate(self.solids)
        ]
        head = ("solid", "kind", "center m", "size m", "angle deg")
        solids = html_table(head, rows, repr(self)) if rows else ""
        return solids + planes_html(self.planes, f"{len(self.planes)} planes")

    def __repr__(self) -> str:
        kinds = ", ".join(solid.kind for solid in self.solids) or "none"
        arena = "an arena" if self.arena else "no arena"
        return (
            f"Detection({len(self.solids)} solid{'s' * (len(self.solids) != 1)}: {kinds}; {arena}; "
            f"{len(self.planes)} planes; "
            f"sigma {self.sigma * 1000:.3g} mm)"
        )


def _plain(values: Floats) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _without_nan(values: dict[str, Any]) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and not np.isfinite(value) else value
        for key, value in values.items()
    }
