"""LiDARs by their data sheets."""

from __future__ import annotations

import warnings
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, number


class LidarPresets:
    """Makers of `Lidar`, which inherits them."""

    @classmethod
    def paper(cls, **changes: Any) -> Self:
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
    def vlp16(cls, *, mount: ArrayLike, **changes: Any) -> Self:
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
    def hdl32e(cls, *, mount: ArrayLike, **changes: Any) -> Self:
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
    def os1_64(cls, *, mount: ArrayLike, **changes: Any) -> Self:
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
    def rplidar_a1(cls, *, mount: ArrayLike, **changes: Any) -> Self:
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
    def rosette(cls, *, mount: ArrayLike, seconds: float = 0.1, **changes: Any) -> Self:
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
    ) -> Self:
        sheet = {"min_range": min_range, "max_range": max_range, "resolution": resolution}
        settings = sheet | grid | {"mount": mount} | changes
        if "noise" not in changes:
            farthest = number("max_range", settings["max_range"], above=0.0)
            settings["noise"] = sigma / farthest
        return cls(**settings)


def _turn_of_layers(elevations: Floats, columns: int) -> Floats:
    """Directions (layers, columns, 3) of a whole turn, at elevations (layers,)."""
    azimuth = -((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi
    level, height = np.cos(elevations)[:, None], np.sin(elevations)[:, None]
    parts = [level * np.cos(azimuth), level * np.sin(azimuth), height + np.zeros(columns)]
    return np.stack(parts, axis=-1)
