"""The sensor: where a LiDAR's beams go, and how well it measures."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, fields
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, as_floats, as_vector, integer, number

E_PUCK_TURRET = (-0.0095, 0.0, 0.0486)
"""Turret slot of the e-puck in the robot's frame, metres (Webots R2022b documentation)."""

_MOST_BEAMS = 100_000
"""Layers, or columns, of a sensor."""

_WIDEST = 0.5
"""Full angle of a cone of light, radians: wider ones are no beams, and the mean of a few rays does
not stand for them."""


@dataclass(frozen=True, eq=False)
class Lidar:
    """A LiDAR in the terms of the Webots `Lidar` node.

    The defaults are the sensor of the reference on which primfit is measured; `Lidar.paper` is the
    paper's own, `Lidar.vlp16` a real one.

    Beams leave one point. Layers run from top to bottom, with both ends of the vertical field of
    view; columns run from left to right, at the middle of equal shares of the field of view.

    Parameters
    ----------
    number_of_layers : int
        Layers; a single one is level.
    vertical_field_of_view : float, radians
        From the first layer to the last.
    horizontal_resolution : int
        Columns.
    field_of_view : float, radians
        Horizontal; ``2 * pi`` for a spinning sensor.
    min_range, max_range : float, metres
        A true range outside gives no return.
    noise : float
        Standard deviation along the beam as a fraction of `max_range`, from 0 to 1.
    resolution : float, metres
        Step to which ranges are rounded; -1 for none.
    mount : (3,) or (4, 4) or "e-puck"
        Where the sensor sits in the robot's frame: a translation in metres, a rigid transform
        ``T_robot_sensor``, or the e-puck's turret slot.
    beams : (layers, columns, 3) float64 or None
        Directions in the sensor's frame, for a sensor whose beams are no grid of angles: layers
        that are not evenly apart, or a rosette. They replace the layers, columns and fields of
        view, which are read off them.
    noise_per_metre : float, metres per metre
        Standard deviation along the beam that grows with the range; its variance adds to that of
        `noise`.
    beam_divergence : float, radians
        Full angle of the cone of light; 0 for a line. The reading is the mean range over the
        footprint, so that at an edge it may lie between two surfaces (a mixed pixel). It also adds
        noise at slanting incidence: which part of the footprint returns is as uncertain as a
        quarter of the divergence (Lichti, Gordon: Error Propagation in Directly Georeferenced
        Terrestrial Laser Scanner Point Clouds, FIG 2004), thus the range r, at an angle t from the
        normal, as ``r * beam_divergence / 4 * tan(t)``.
    pulse_length_ns : float, nanoseconds
        Surfaces in one footprint farther apart than half of the way of light in this time are told
        apart: the sensor reads the one that fills more of it. The default, 0.75 m apart, is that of
        the usual lasers of 5 ns; inf for phase-based sensors, which mix all. Without effect when
        `beam_divergence` is 0.
    dropout : float
        Share of returns that are lost at random, from 0 to 1.
    detection_range : float or None, metres
        How far a surface is seen that is met head-on. At an angle t from its normal, a diffuse
        surface returns less light and is seen no farther than ``detection_range * sqrt(cos(t))``
        (lidar range equation). None for no such loss.
    motion_distortion : float
        Share of the step to the next pose that the robot goes while the sensor makes one turn,
        from 0 to 1, column by column: 0 where it stops at each pose, 1 where turns follow without
        a pause. The last pose goes on as the one before. The scan believes that all beams of a
        turn were taken from where it began.

    Raises
    ------
    ValueError
        When such a lidar cannot exist.

    Warns
    -----
    UserWarning
        When it is outside the domain that Webots documents for `Lidar`:
        ``number_of_layers < vertical_field_of_view * horizontal_resolution / field_of_view``.

    Examples
    --------
    >>> import primfit
    >>> lidar = primfit.Lidar(noise=0.01)
    >>> lidar.sigma, lidar.directions.shape
    (0.01, (8, 100, 3))
    """

    number_of_layers: int = 8
    vertical_field_of_view: float = 0.4
    horizontal_resolution: int = 100
    field_of_view: float = 1.5708
    min_range: float = 0.01
    max_range: float = 1.0
    noise: float = 0.0
    resolution: float = -1.0
    mount: Any = field(default=(0.0, 0.0, 0.06), repr=False)
    beams: Any = field(default=None, repr=False)
    noise_per_metre: float = 0.0
    beam_divergence: float = 0.0
    pulse_length_ns: float = 5.0
    dropout: float = 0.0
    detection_range: float | None = None
    motion_distortion: float = 0.0

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        if self.beams is not None:
            self._measure_beams()
        for name in ("number_of_layers", "horizontal_resolution"):
            set_field(self, name, integer(name, getattr(self, name), low=1, high=_MOST_BEAMS))
        vertical = number("vertical_field_of_view", self.vertical_field_of_view, low=0.0)
        horizontal = number("field_of_view", self.field_of_view, above=0.0)
        if vertical >= np.pi:
            raise ValueError(
                f"vertical_field_of_view must be less than pi radians, not {vertical!r}"
            )
        if horizontal > 2 * np.pi + 1e-9:
            raise ValueError(f"field_of_view must be at most 2 pi radians, not {horizontal!r}")
        if self.number_of_layers > 1 and vertical == 0.0 and self.beams is None:
            raise ValueError(
                f"vertical_field_of_view must be greater than 0 for number_of_layers="
                f"{self.number_of_layers}: the layers would coincide"
            )
        min_range = number("min_range", self.min_range, low=0.0)
        max_range = number("max_range", self.max_range, above=0.0)
        if min_range >= max_range:
            raise ValueError(
                f"min_range must be less than max_range={max_range:g}, not {min_range!r}"
            )
        resolution = number("resolution", self.resolution)
        if resolution != -1.0 and resolution <= 0.0:
            raise ValueError(f"resolution must be positive, or -1 for none, not {resolution!r}")
        set_field(self, "vertical_field_of_view", vertical)
        set_field(self, "field_of_view", horizontal)
        set_field(self, "min_range", min_range)
        set_field(self, "max_range", max_range)
        noise = number("noise", self.noise, low=0.0)
        if noise > 1.0:
            raise ValueError(
                f"noise must be at most 1, a fraction of max_range, not {self.noise!r}"
            )
        set_field(self, "noise", noise)
        set_field(self, "resolution", resolution)
        set_field(self, "mount", _as_transform(self.mount))
        self._check_imperfections()
        if self.number_of_layers > 1 and self.beams is None:
            most = vertical * self.horizontal_resolution / horizontal
            if self.number_of_layers >= most:
                warnings.warn(
                    f"number_of_layers={self.number_of_layers} is outside the domain that Webots "
                    f"documents: less than vertical_field_of_view * horizontal_resolution / "
                    f"field_of_view = {most:.3g}",
                    stacklevel=3,
                )

    def _check_imperfections(self) -> None:
        for name, most, unit in (
            ("noise_per_metre", 1.0, "metre per metre"),
            ("beam_divergence", _WIDEST, "radians, a full angle"),
            ("dropout", 1.0, "a share of the returns"),
            ("motion_distortion", 1.0, "a share of the step to the next pose"),
        ):
            value = number(name, getattr(self, name), low=0.0)
            if value > most:
                raise ValueError(f"{name} must be at most {most:g} {unit}, not {value!r}")
            object.__setattr__(self, name, value)
        if self.pulse_length_ns != np.inf:
            pulse = number("pulse_length_ns", self.pulse_length_ns, low=0.0)
            object.__setattr__(self, "pulse_length_ns", pulse)
        if self.detection_range is not None:
            reach = number("detection_range", self.detection_range, above=0.0)
            object.__setattr__(self, "detection_range", reach)

    def _measure_beams(self) -> None:
        """Check the directions, and set layers, columns and fields of view to theirs."""
        beams = np.array(as_floats("beams", self.beams))
        if beams.ndim != 3 or beams.shape[-1] != 3 or not beams.size:
            raise ValueError(f"beams must have shape (layers, columns, 3), not {beams.shape}")
        lengths = np.linalg.norm(beams, axis=-1, keepdims=True)
        if not (np.isfinite(lengths) & (lengths > 0.0)).all():
            raise ValueError("beams must be finite directions of a length greater than 0")
        beams /= lengths
        elevation = np.arcsin(np.clip(beams[..., 2], -1.0, 1.0))
        azimuth = np.arctan2(beams[..., 1], beams[..., 0])
        for name, value in (
            ("beams", beams),
            ("number_of_layers", beams.shape[0]),
            ("horizontal_resolution", beams.shape[1]),
            ("vertical_field_of_view", float(np.ptp(elevation))),
            ("field_of_view", float(np.ptp(azimuth)) or 2.0 * np.pi),
        ):
            object.__setattr__(self, name, value)

    def _key(self) -> tuple[Any, ...]:
        arrays = ("mount", "beams")
        plain = (getattr(self, each.name) for each in fields(self) if each.name not in arrays)
        beams = None if self.beams is None else self.beams.tobytes()
        return (*plain, self.mount.tobytes(), beams)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lidar) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    @classmethod
    def from_webots(cls, file: str | PathLike[str]) -> Lidar:
        """The first lidar of a world of Webots (.wbt), with its mount in the frame of its robot.

        Parameters
        ----------
        file : path
            Of R2022a or later, where z is up. In the turret of an e-puck the mount is that of its
            slot, and what the node adds.

        Raises
        ------
        OSError
            When the file cannot be opened.
        ValueError
            When it is no such world, or has no `Lidar`.
        """
        from primfit.scans.webots import lidar_of_webots

        return lidar_of_webots(file)

    @classmethod
    def paper(cls, **changes: Any) -> Lidar:
        """The sensor of the paper's experiment: 8 layers over 0.4 rad, all around, 3 m.

        0.03 m above the floor, 100 columns a turn, nothing nearer than 0.04 m; `noise` is a
        fraction of 3 m, so the paper's 0.01 to 0.06 are 30 to 180 mm. It is outside the domain that
        Webots documents, but is what the authors ran: here, changed or not, it does not warn.

        Parameters
        ----------
        **changes
            Parameters of `Lidar` that differ, such as `noise`.

        Examples
        --------
        >>> import primfit
        >>> lidar = primfit.Lidar.paper(noise=0.01)
        >>> lidar.sigma, lidar.max_range, lidar.directions.shape
        (0.03, 3.0, (8, 100, 3))
        """
        setting: dict[str, Any] = {
            "number_of_layers": 8,
            "vertical_field_of_view": 0.4,
            "horizontal_resolution": 100,
            "field_of_view": 2 * np.pi,
            "min_range": 0.04,
            "max_range": 3.0,
            "mount": (0.0, 0.0, 0.03),
        }
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="number_of_layers=")
            return cls(**(setting | changes))

    @classmethod
    def vlp16(cls, *, mount: ArrayLike, **changes: Any) -> Lidar:
        """A Velodyne VLP-16: 16 layers over 30 degrees, 1800 columns a turn.

        Its data sheet: 0.5 to 100 m, 3 cm (taken as the standard deviation), steps of 2 mm.

        Parameters
        ----------
        mount : (3,) or (4, 4)
            Where the sensor sits in the robot's frame, as everywhere.
        **changes
            Parameters of `Lidar` that differ. The noise stays 3 cm when `max_range` changes.

        Examples
        --------
        >>> import primfit
        >>> lidar = primfit.Lidar.vlp16(mount=(0, 0, 0.5), max_range=20.0)
        >>> round(lidar.sigma, 3), lidar.directions.shape
        (0.03, (16, 1800, 3))
        """
        grid = {"number_of_layers": 16, "vertical_field_of_view": np.radians(30.0)}
        grid |= {"horizontal_resolution": 1800, "field_of_view": 2 * np.pi}
        return cls._of_sheet(mount, 0.5, 100.0, 0.03, 0.002, grid, changes)

    @classmethod
    def hdl32e(cls, *, mount: ArrayLike, **changes: Any) -> Lidar:
        """A Velodyne HDL-32E: 32 layers from +10.67 to -30.67 degrees, 2170 columns a turn.

        Its manual (63-9113): 0.05 to 100 m, steps of 2 mm, 700,000 beams a second at 10 turns a
        second. Its 2 cm, taken as the standard deviation, were not checked against it.

        Parameters
        ----------
        mount, **changes
            As of `Lidar.vlp16`.

        Examples
        --------
        >>> import primfit
        >>> primfit.Lidar.hdl32e(mount=(0, 0, 1.8)).directions.shape
        (32, 2170, 3)
        """
        elevations = np.radians(np.linspace(10.67, -30.67, 32))
        grid = {"beams": _turn_of_layers(elevations, 2170)}
        return cls._of_sheet(mount, 0.05, 100.0, 0.02, 0.002, grid, changes)

    @classmethod
    def os1_64(cls, *, mount: ArrayLike, **changes: Any) -> Lidar:
        """An Ouster OS1-64 (first generation): 64 layers over 33.2 degrees, 1024 columns a turn.

        Its data sheet: 0.8 to 120 m, steps of 12 mm, and a standard deviation of 1.5 to 10 cm by
        how much light returns; here 3 cm, that of its middle.

        Parameters
        ----------
        mount, **changes
            As of `Lidar.vlp16`.

        Examples
        --------
        >>> import primfit
        >>> primfit.Lidar.os1_64(mount=(0, 0, 1.8)).directions.shape
        (64, 1024, 3)
        """
        grid = {"number_of_layers": 64, "vertical_field_of_view": np.radians(33.2)}
        grid |= {"horizontal_resolution": 1024, "field_of_view": 2 * np.pi}
        with warnings.catch_warnings():
            # Its layers are denser than its columns, which is all that Webots' domain forbids.
            warnings.filterwarnings("ignore", message="number_of_layers=")
            return cls._of_sheet(mount, 0.8, 120.0, 0.03, 0.012, grid, changes)

    @classmethod
    def rplidar_a1(cls, *, mount: ArrayLike, **changes: Any) -> Lidar:
        """A Slamtec RPLIDAR A1M8: one level layer of 360 beams a turn.

        Its data sheet: 0.15 to 12 m, 1 degree at 5.5 turns a second. It gives no standard
        deviation, but a resolution that grows to 1 % of the distance: here 2 cm, which is that at
        2 m. Give `noise` for rooms of another size.

        Parameters
        ----------
        mount, **changes
            As of `Lidar.vlp16`.

        Examples
        --------
        >>> import primfit
        >>> primfit.Lidar.rplidar_a1(mount=(0, 0, 0.2)).directions.shape
        (1, 360, 3)
        """
        grid = {"number_of_layers": 1, "horizontal_resolution": 360, "field_of_view": 2 * np.pi}
        return cls._of_sheet(mount, 0.15, 12.0, 0.02, -1.0, grid, changes)

    @classmethod
    def rosette(cls, *, mount: ArrayLike, seconds: float = 0.1, **changes: Any) -> Lidar:
        """A sensor like the Livox Mid-40: a rosette of two turning prisms over 38.4 degrees.

        The prisms turn beams by equal angles at 7294 and -4664 turns a minute; 100,000 beams a
        second, 1 to 130 m, 2 cm. The true sensor goes on where it stopped; here each pose
        sees the same part of the rosette, of so many seconds. The numbers are those published of
        the Mid-40, cited from memory and not checked against its sheet.

        Parameters
        ----------
        seconds : float
            For which the sensor measures at each pose.
        mount, **changes
            As of `Lidar.vlp16`.

        Examples
        --------
        >>> import primfit
        >>> primfit.Lidar.rosette(mount=(0, 0, 1.0)).directions.shape
        (1, 10000, 3)
        """
        seconds = number("seconds", seconds, above=0.0)
        time = np.arange(max(1, round(1e5 * seconds))) / 1e5
        turns = 2 * np.pi * time[:, None] * np.array([7294.0, -4664.0]) / 60.0
        tilt = np.radians(38.4 / 4)
        y, z = tilt * np.cos(turns).sum(axis=1), tilt * np.sin(turns).sum(axis=1)
        off = np.hypot(y, z)
        across = np.sinc(off / np.pi)
        grid = {"beams": np.stack([np.cos(off), across * y, across * z], axis=1)[None]}
        return cls._of_sheet(mount, 1.0, 130.0, 0.02, -1.0, grid, changes)

    @classmethod
    def _of_sheet(
        cls,
        mount: ArrayLike,
        min_range: float,
        max_range: float,
        sigma: float,
        resolution: float,
        grid: dict[str, Any],
        changes: dict[str, Any],
    ) -> Lidar:
        sheet = {"min_range": min_range, "max_range": max_range, "resolution": resolution}
        settings = sheet | grid | {"mount": mount} | changes
        if "noise" not in changes:
            farthest = number("max_range", settings["max_range"], above=0.0)
            settings["noise"] = sigma / farthest
        return cls(**settings)

    @property
    def directions(self) -> Floats:
        """Unit directions (layers, columns, 3) in the sensor's frame: x forward, y left, z up."""
        if self.beams is not None:
            return np.array(self.beams)
        n = self.horizontal_resolution
        azimuth = -((np.arange(n) + 0.5) / n - 0.5) * self.field_of_view
        half = self.vertical_field_of_view / 2
        layers = self.number_of_layers
        elevation = np.linspace(half, -half, layers)[:, None] if layers > 1 else np.zeros((1, 1))
        return np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.broadcast_to(np.sin(elevation), (layers, n)),
            ],
            axis=-1,
        )

    @property
    def is_perfect(self) -> bool:
        """Whether beams are lines from a sensor at rest, with one noise and no losses."""
        return not (
            self.noise_per_metre
            or self.beam_divergence
            or self.dropout
            or self.motion_distortion
            or self.detection_range is not None
        )

    @property
    def rounding(self) -> float:
        """Standard deviation of the rounding to `resolution`, metres."""
        return float(max(self.resolution, 0.0) / np.sqrt(12.0))

    @property
    def sigma(self) -> float:
        """Standard deviation of a range, metres: noise and rounding together.

        Of the part that all ranges share; `sigma_at` has that of each.
        """
        return float(np.hypot(self.noise * self.max_range, self.rounding))

    def sigma_at(self, ranges: ArrayLike, incidence: ArrayLike = 0.0) -> Floats:
        """Standard deviations of ranges, metres: noise and rounding together.

        Parameters
        ----------
        ranges : (...) float64, metres
            inf, for no return, is taken as `max_range`.
        incidence : (...) float64, radians
            Between beam and normal of the surface; 0 is head-on.

        Examples
        --------
        >>> import primfit
        >>> primfit.Lidar(noise=0.01, max_range=3.0, noise_per_metre=0.02).sigma_at([0.0, 2.0])
        array([0.03, 0.05])
        """
        reach = np.minimum(as_floats("ranges", ranges), self.max_range)
        sigma: Floats = np.hypot(
            self.noise_at(reach, as_floats("incidence", incidence)), self.rounding
        )
        return sigma

    def noise_at(self, ranges: Floats, incidence: Floats) -> Floats:
        """As `sigma_at`, of the noise alone and for finite ranges."""
        grown = self.noise_per_metre * ranges
        # Half the footprint misses a plane that is closer to the beam than half its divergence.
        slope = np.tan(np.minimum(incidence, np.pi / 2 - self.beam_divergence / 2))
        slanted = self.beam_divergence / 4 * ranges * slope
        noise: Floats = np.sqrt((self.noise * self.max_range) ** 2 + grown**2 + slanted**2)
        return noise


def _turn_of_layers(elevations: Floats, columns: int) -> Floats:
    """Directions (layers, columns, 3) of a whole turn, at elevations (layers,)."""
    azimuth = -((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi
    level, height = np.cos(elevations)[:, None], np.sin(elevations)[:, None]
    parts = [level * np.cos(azimuth), level * np.sin(azimuth), height + np.zeros(columns)]
    return np.stack(parts, axis=-1)


def _as_transform(mount: Any) -> Floats:
    if isinstance(mount, str):
        if mount != "e-puck":
            raise ValueError(f'mount must be (3,), (4, 4) or "e-puck", not {mount!r}')
        mount = E_PUCK_TURRET
    if np.shape(mount) == (3,):
        transform = np.eye(4)
        transform[:3, 3] = as_vector("mount", mount, 3)
        return transform
    return check_transforms("mount", mount, np.shape(mount))[()]


def check_transforms(name: str, transforms: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """``transforms`` as finite float64 rigid transforms (..., 4, 4)."""
    try:
        array = np.asarray(transforms, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None
    if array.shape[-2:] != (4, 4):
        raise ValueError(f"{name} must be rigid transforms (..., 4, 4), not shape {shape}")
    rotation = array[..., :3, :3]
    rigid = np.isfinite(array).all(axis=(-2, -1))
    rigid &= np.isclose(np.swapaxes(rotation, -1, -2) @ rotation, np.eye(3), atol=1e-6).all(
        (-2, -1)
    )
    rigid &= np.linalg.det(rotation) > 0
    rigid &= (array[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all(axis=-1)
    if not rigid.all():
        raise ValueError(
            f"{name} must be rigid transforms: a rotation, a translation in metres and the last "
            f"row 0, 0, 0, 1; {int((~rigid).sum())} of {rigid.size} are not"
        )
    return array
