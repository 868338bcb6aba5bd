"""The sensor: where a LiDAR's beams go, and how well it measures."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, as_floats, integer, number
from primfit.sensors.lidar_presets import LidarPresets
from primfit.sensors.mounts import as_mount
from primfit.sensors.sensor import RangeGate, Sensor

_MOST_BEAMS = 100_000
"""Layers, or columns, of a sensor."""

_WIDEST = 0.5
"""Full angle of a cone of light, radians: wider ones are no beams, and the mean of a few rays does
not stand for them."""


@dataclass(frozen=True, eq=False)
class Lidar(LidarPresets, Sensor):
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
        set_field(self, "mount", as_mount(self.mount))
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
    def gate(self) -> RangeGate:
        """How true ranges become readings, but for imperfections."""
        return RangeGate(
            min_range=self.min_range,
            max_range=self.max_range,
            sigma=self.noise * self.max_range,
            resolution=self.resolution,
        )

    def sigma_of(self, ranges: Floats) -> float | Floats:
        """Standard deviation of all ranges, or (..., layers, columns) where it grows with them.

        That of incidence is not in them: see `sigma_at`.
        """
        return self.sigma_at(ranges) if self.noise_per_metre else self.sigma

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
