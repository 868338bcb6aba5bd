"""A scan: every beam, returned or not, with its origin, direction and range."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from primfit._check import (
    MOST_COORDINATE,
    Bools,
    Floats,
    Ints,
    as_column,
    as_rows,
    check_within,
    number,
)
from primfit._later import Later, replaced
from primfit.clouds.cloud import warn_of_millimetres
from primfit.clouds.foreign import PointsLike, borrowed
from primfit.geometry.extents import half_extent, is_amid
from primfit.scans.archives import load_arrays, save_arrays
from primfit.scans.casting import unit_rows
from primfit.scans.columns import as_sigma, indices, one_or_each, path_of, range_limits
from primfit.viewing.shown import Shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from primfit.sensors.sensor import Sensor

_ARRAYS = ("points", "origins", "directions", "ranges")
_INDICES = ("layer", "column", "pose_index", "solid_index")
_OPTIONAL = ("depths", "true_ranges", "true_points", "is_mixed")
_NUMBERS = ("sigma", "min_range", "max_range")
_PATHS = ("path", "true_path")
TRUTHS = ("true_ranges", "true_points", "is_mixed")

_FAR = 400.0
"""How many times farther points are from the origin than half of them from their middle, when they
are moved there: nearly three digits of the sixteen of float64 go to the place."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan(Shown):
    """All beams of a path, one row a beam, in any order.

    Made by `primfit.scan`, `Scan.from_rays` or `Scan.from_points`.

    Attributes
    ----------
    points : (n, 3) float64, metres
        Where the beam ended; NaN where nothing came back.
    origins : (n, 3) float64, metres
        Where the beam began; NaN when that is not known.
    directions : (n, 3) float64
        Unit direction of the beam; NaN when the origin is not known.
    ranges : (n,) float64, metres
        Measured range, noise included; inf for no return, NaN when the origin is not known, or
        where that nothing came back tells nothing (see `DepthCamera`).
    layer, column, pose_index : (n,) int64 or None
        Place of the beam in the sensor and of its pose in the path.
    solid_index : (n,) int64 or None
        The truth, where it is known: what the beam meets, within range or not: row of the solid,
        -1 nothing, -2 arena, -3 floor.
    sigma : float, (n,) float64 or None, metres
        Standard deviation of the ranges; 0 is exact, None is not known.
    min_range, max_range : float, (n,) float64 or None, metres
        Nearer than the first, and beyond the second, the sensor gets no return; None is not known.
        Those of each beam where they differ, as those of a camera's pixels do.
    depths : (n,) float64 or None, metres
        Of a camera: measured distance along its optical axis; inf or NaN where the range is.
    path : (p, 3) float64 or None
        Poses of the robot as it believes them: x, y in metres and yaw in radians, row by
        `pose_index`; None where the sensor did not move in the plane, or they are not known.
    true_path : (p, 3) float64 or None
        The truth, where it is known: it differs from `path` where `primfit.scan` was told so.
    true_ranges : (n,) float64 or None, metres
        The truth of a sensor with imperfections (see `Lidar`): how far the axis of the beam goes to
        what it meets, within range or not; inf for nothing.
    true_points : (n, 3) float64 or None, metres
        Where it meets that, wherever the robot believes to be; NaN for nothing.
    is_mixed : (n,) bool or None
        Whether the light that was read came from more than one plane: a mixed pixel.

    Notes
    -----
    The arrays are the scan's own, or shared with scans that were made of it. They may be written
    to, as other libraries ask, but what was derived from them does not change with them.
    """

    points: Floats
    origins: Later[Floats] = Later()  # noqa: RUF009
    directions: Later[Floats] = Later()  # noqa: RUF009
    ranges: Floats
    layer: Later[Ints | None] = Later(None)  # noqa: RUF009
    column: Later[Ints | None] = Later(None)  # noqa: RUF009
    pose_index: Later[Ints | None] = Later(None)  # noqa: RUF009
    solid_index: Ints | None = None
    sigma: Later[float | Floats | None] = Later(None)  # noqa: RUF009
    min_range: Later[float | Floats | None] = Later(None)  # noqa: RUF009
    max_range: Later[float | Floats | None] = Later(None)  # noqa: RUF009
    depths: Later[Floats | None] = Later(None)  # noqa: RUF009
    path: Floats | None = None
    true_path: Floats | None = None
    true_ranges: Floats | None = None
    true_points: Floats | None = None
    is_mixed: Bools | None = None

    def __post_init__(self) -> None:
        for name in (*_ARRAYS, *_INDICES):
            array = vars(self)[name]
            if not callable(array) and array is not None:
                object.__setattr__(self, name, np.asarray(array))

    @classmethod
    def from_rays(
        cls,
        origins: ArrayLike,
        directions: ArrayLike,
        ranges: ArrayLike,
        sigma: ArrayLike | None = None,
        *,
        min_range: ArrayLike | None = None,
        max_range: ArrayLike | None = None,
        layer: ArrayLike | None = None,
        column: ArrayLike | None = None,
        pose_index: ArrayLike | None = None,
        solid_index: ArrayLike | None = None,
        path: ArrayLike | None = None,
    ) -> Scan:
        """A scan from recorded beams.

        Parameters
        ----------
        origins : (n, 3) or (3,) float64, metres
        directions : (n, 3) float64
            Of any length but zero.
        ranges : (n,) float64, metres
            inf for no return. A finite range may be negative or above `max_range`, since noise
            comes after the sensor's gate.
        sigma : float or (n,) or None, metres
            Standard deviation of the ranges; None is not known.
        min_range, max_range : float or (n,) or None, metres
            Range limits of the sensor, or of each beam; None is not known.
        layer, column, pose_index, solid_index : (n,) int or None
        path : (p, 3) float64 or None
            Poses of the robot as it believes them: x, y in metres and yaw in radians, to which
            `pose_index` refers. Origins and directions are as seen from there.

        Raises
        ------
        ValueError
            When shapes do not match, a range is NaN or minus infinity, a direction is zero,
            `min_range` is not below `max_range`, or `pose_index` is none of the path.

        Examples
        --------
        >>> import primfit
        >>> scan = primfit.Scan.from_rays((0, 0, 0), [[1, 0, 0], [0, 1, 0]], [2.0, float("inf")])
        >>> scan
        Scan(2 beams, 1 return)
        """
        unit = unit_rows("directions", directions)
        n = len(unit)
        starts = np.array(one_or_each("origins", origins, n))
        lengths = np.array(as_column("ranges", ranges, n))
        if np.ndim(ranges) == 0 and n != 1:
            raise ValueError(f"ranges must have shape ({n},), not ()")
        bad = np.isnan(lengths) | np.isneginf(lengths)
        if bad.any():
            raise ValueError(
                f"ranges must be finite, or inf for no return, but {int(bad.sum())} of {n} are NaN "
                f"or minus infinity (the first is row {int(np.argmax(bad))})"
            )
        is_return = np.isfinite(lengths)
        if (np.abs(lengths[is_return]) > MOST_COORDINATE).any():
            row = int(np.argmax(is_return & (np.abs(lengths) > MOST_COORDINATE)))
            raise ValueError(
                f"ranges must be within {MOST_COORDINATE:g} m, or inf for no return, but row {row} "
                f"is {lengths[row]}"
            )
        points = np.full((n, 3), np.nan)
        points[is_return] = starts[is_return] + lengths[is_return, None] * unit[is_return]
        nearest, farthest = range_limits(min_range, max_range, n)
        poses = indices("pose_index", pose_index, n)
        return cls(
            points=points,
            origins=starts,
            directions=unit,
            ranges=lengths,
            layer=indices("layer", layer, n),
            column=indices("column", column, n),
            pose_index=poses,
            solid_index=indices("solid_index", solid_index, n),
            sigma=as_sigma(sigma, n),
            min_range=nearest,
            max_range=farthest,
            path=None if path is None else path_of(path, poses),
        )

    @classmethod
    def from_points(
        cls,
        points: PointsLike,
        origins: ArrayLike | None = None,
        sigma: ArrayLike | None = None,
        *,
        min_range: ArrayLike | None = None,
        max_range: ArrayLike | None = None,
    ) -> Scan:
        """A scan from a recorded cloud.

        Parameters
        ----------
        points : (n, 3) or (h, w, 3) float64, metres, or whatever `as_cloud` takes
            An organised cloud, (h, w, 3) or with a shape, is taken row by row; row and column of
            each pixel become `layer` and `column`. Rows that are not finite are no returns. Nor are
            those of exactly 0 0 0 of an organised cloud, and of one with a single origin: so do
            sensors write that nothing came back.
        origins : (n, 3), (3,) or None, metres
            Where the sensor was, for each point or for all; None is not known.
        sigma : float or (n,) or None, metres
            Standard deviation of the ranges; None is not known.
        min_range, max_range : float or (n,) or None, metres
            Range limits of the sensor, or of each beam; None is not known.

        Raises
        ------
        ValueError
            When shapes do not match, a point is at its origin or farther than float64 can
            compute with, or `min_range` is not below `max_range`.

        Examples
        --------
        >>> import primfit
        >>> primfit.Scan.from_points([[1, 0, 0], [2, 0, 0]], origins=(0, 0, 0)).ranges
        array([1., 2.])
        """
        given = borrowed("points", points)
        shape = given.shape
        cloud = as_rows("points", given.points, 3, finite=False)
        # Column by column, which NumPy does many times as fast as row by row.
        x, y, z = cloud.T
        is_point = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
        if shape is not None or (origins is not None and np.shape(origins) == (3,)):
            is_point &= (x != 0.0) | (y != 0.0) | (z != 0.0)
        n = len(cloud)
        if not is_point.all():
            cloud = np.array(cloud)
            cloud[~is_point] = np.nan
        elif cloud.flags.writeable:
            # What nobody can write to need not be copied.
            cloud = np.array(cloud)
        check_within("points", cloud)
        warn_of_millimetres(cloud)
        nearest, farthest = range_limits(min_range, max_range, n)
        if origins is None:
            unknown = np.broadcast_to(np.nan, (n, 3))
            return cls(
                points=cloud,
                origins=unknown,
                directions=unknown,
                ranges=unknown[:, 0],
                **_places(shape),
                sigma=as_sigma(sigma, n),
                min_range=nearest,
                max_range=farthest,
            )
        starts = np.array(one_or_each("origins", origins, n))
        ranges = np.linalg.norm(cloud - starts, axis=1)
        if (ranges == 0.0).any():
            raise ValueError(
                f"origins must differ from points, but row {int(np.argmin(ranges))} does not"
            )
        return cls(
            points=cloud,
            origins=starts,
            directions=(cloud - starts) / ranges[:, None],
            ranges=ranges,
            **_places(shape),
            sigma=as_sigma(sigma, n),
            min_range=nearest,
            max_range=farthest,
        )

    @classmethod
    def from_readings(
        cls, path: ArrayLike, lidar: Sensor, ranges: ArrayLike, sigma: ArrayLike | None = None
    ) -> Scan:
        """A scan from the ranges that a sensor has logged, pose by pose.

        Parameters
        ----------
        path : (n, 3) or (3,) or (n, 4, 4) or (4, 4) float64
            Poses, as in `primfit.scan`.
        lidar : Sensor
            Where its beams go, how far it sees, and where it is mounted. Depth images are for
            `DepthCamera.scan`.
        ranges : (n, layers, columns) float64, metres
            As the sensor of Webots gives them: layers from top to bottom, columns from left to
            right; also flat, for each pose or altogether. inf for no return; beams of NaN or minus
            infinity tell nothing and are left out.
        sigma : float or None, metres
            Standard deviation of the ranges; None is that of the sensor, and where this is 0, it is
            to be estimated.

        Raises
        ------
        ValueError
            When the shape is another.

        Examples
        --------
        >>> import numpy as np, primfit
        >>> lidar = primfit.Lidar(number_of_layers=1, horizontal_resolution=4, max_range=5.0)
        >>> path = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
        >>> primfit.Scan.from_readings(path, lidar, [[[2, 2, 2, np.inf]], [[1, 1, 1, 1]]])
        Scan(8 beams from 2 poses, 7 returns)
        """
        from primfit.scans.readings import scan_of_readings

        return scan_of_readings(path, lidar, ranges, sigma)

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def is_return(self) -> Bools:
        """Which beams came back (n,)."""
        return ~np.isnan(self.points[:, 0])

    @property
    def is_blank(self) -> Bools:
        """Which rows tell nothing (n,): no return, and not that there is nothing to return from."""
        return ~self.is_return & np.isnan(self.ranges)

    @property
    def has_origins(self) -> bool:
        """Whether it is known where the beams began."""
        # One for all, or unknown, needs one look.
        is_same = not self.origins.strides[0]
        return bool(np.isfinite(self.origins[:1] if is_same else self.origins).all())

    def select(self, rows: ArrayLike) -> Scan:
        """The scan of some beams only, by mask or by row numbers.

        Raises
        ------
        TypeError, ValueError
            When `rows` is neither a mask (n,) nor rows of the scan.
        """
        index = np.asarray(rows)
        n = len(self)
        if index.dtype.kind == "b" and index.shape != (n,):
            raise ValueError(f"rows must be a mask of shape ({n},), not {index.shape}")
        if index.ndim != 1 or (index.dtype.kind not in "biu" and index.size):
            raise TypeError(f"rows must be a mask or row numbers, not {index.dtype} {index.shape}")
        if index.dtype.kind != "b":
            index = index.astype(np.int64)
            if index.size and not (-n <= index.min() and index.max() < n):
                raise ValueError(f"rows must be below {n}, not {index.min()} to {index.max()}")
        changes: dict[str, Any] = {name: getattr(self, name)[index] for name in _ARRAYS}
        for name in (*_INDICES, *_OPTIONAL):
            array = getattr(self, name)
            changes[name] = None if array is None else array[index]
        for name in _NUMBERS:
            value = getattr(self, name)
            changes[name] = value[index] if isinstance(value, np.ndarray) else value
        changes |= {name: getattr(self, name) for name in _PATHS}
        return Scan(**changes)

    def moved(self, offset: Floats) -> Scan:
        """The scan moved by a vector (3,), metres."""
        if not offset.any():
            return self
        paths = {name: getattr(self, name) for name in _PATHS}
        step = np.append(offset[:2], 0.0)
        paths = {name: None if path is None else path + step for name, path in paths.items()}
        truth = None if self.true_points is None else self.true_points + offset
        return replaced(
            self,
            points=self.points + offset,
            origins=self.origins + offset,
            true_points=truth,
            **paths,
        )

    @property
    def far_offset(self) -> Floats:
        """A round place (3,) amid the returns when these are far from the origin, else zero.

        Moved there, squares of coordinates keep their digits. Few points far from all others do not
        matter.
        """
        is_return = self.is_return
        if is_amid(self.points, int(np.count_nonzero(is_return)), _FAR):
            return np.zeros(3)
        points = self.points if is_return.all() else self.points[is_return]
        if not len(points):
            return np.zeros(3)
        middle = np.array([np.median(column) for column in points.T])
        if np.abs(middle).max() <= _FAR * half_extent(points, middle):
            return np.zeros(3)
        return np.round(middle)

    def filter_z(self, low: float = -np.inf, high: float = np.inf) -> Scan:
        """The returns whose z is within [low, high], metres (the paper's z filter)."""
        for name, value in (("low", low), ("high", high)):
            if not isinstance(value, float) or np.isfinite(value):
                number(name, value)
        with np.errstate(invalid="ignore"):
            return self.select((self.points[:, 2] >= low) & (self.points[:, 2] <= high))

    def save(self, file: str | PathLike[str]) -> None:
        """Write the scan as a NumPy archive (.npz); every number survives exactly."""
        names = (*_ARRAYS, *_INDICES, *_NUMBERS, *_PATHS, *_OPTIONAL)
        save_arrays(file, {name: getattr(self, name) for name in names})

    @classmethod
    def load(cls, file: str | PathLike[str]) -> Scan:
        """Read a scan that `save` wrote.

        Raises
        ------
        OSError
            When the file cannot be opened.
        ValueError
            When it is no such scan.
        MemoryError
            When the memory is too small for it.
        """
        return cls(**load_arrays(file, _ARRAYS, _INDICES, _NUMBERS, _PATHS, _OPTIONAL))

    def image(self, of: str = "depth") -> NDArray[Any]:
        """What the pixels of a camera measured, or the beams of each layer of a lidar.

        Parameters
        ----------
        of : str
            "depth", "range", "sigma", "points" or "solid_index".

        Returns
        -------
        images : (p, h, w) or (p, h, w, 3) array
            Pose by pose, layer by layer, column by column; as many of these as there are beams of.
            No return is inf, or NaN where that tells nothing, of points NaN. Where the scan has no
            beam, NaN; of `solid_index` -1.

        Raises
        ------
        ValueError
            When it is not known where the beams are in the sensor, or that of which images are
            wanted is not, or two beams are in one place.

        Examples
        --------
        >>> import primfit
        >>> camera = primfit.DepthCamera.range_finder(max_range=3.0)
        >>> world = primfit.World(arena=primfit.Arena((2, 2)))
        >>> scan = primfit.scan(world, [(0.5, 1, 0), (1.5, 1, 0)], camera)
        >>> scan.image("depth")[:, 32, 32]
        array([1.5, 0.5])
        """
        from primfit.scans.images import images_of

        return images_of(self, of)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw the returns from above; needs matplotlib."""
        from primfit import plotting

        return plotting.plot_scan(self, ax)

    def __repr__(self) -> str:
        n = int(self.is_return.sum())
        poses = ""
        if self.pose_index is not None:
            n_poses = len(np.unique(self.pose_index))
            poses = f" from {n_poses} pose{'s' * (n_poses != 1)}"
        sigma = ""
        if self.sigma is not None:
            sigma = f", sigma {float(np.max(self.sigma, initial=0.0)) * 1000:g} mm"
        beams = f"{len(self)} beam{'s' * (len(self) != 1)}"
        return f"Scan({beams}{poses}, {n} return{'s' * (n != 1)}{sigma})"


def _places(shape: tuple[int, int] | None) -> dict[str, Any]:
    """Layer and column of each pixel of an image; nothing for other clouds."""
    if shape is None or min(shape) < 2:
        return {}
    height, width = shape
    return {
        "layer": lambda: np.repeat(np.arange(height), width),
        "column": lambda: np.tile(np.arange(width), height),
    }
