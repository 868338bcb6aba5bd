"""What a scan asks of a sensor: where its beams go, what comes back, and how well it measures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from primfit._check import Floats


@dataclass(frozen=True, kw_only=True)
class RangeGate:
    """How true ranges become readings: those within the limits, with noise, in whole steps.

    Attributes
    ----------
    min_range, max_range : float, metres
        A true range outside gives no reading.
    sigma : float, metres
        Standard deviation of the noise.
    resolution : float, metres
        Step to which readings are rounded; none when not positive.
    """

    min_range: float = 0.0
    max_range: float = float("inf")
    sigma: float = 0.0
    resolution: float = -1.0


@dataclass(frozen=True, kw_only=True)
class DepthGate:
    """How true depths, along the optical axis z of the sensor, become readings of an image.

    Attributes
    ----------
    min_depth, max_depth : float, metres
        A true depth outside gives no reading.
    sigma : (a, b, c) of float
        The standard deviation of a depth z is ``a + b (z - c)**2`` metres; that of the disparity
        is added as independent.
    resolution : float, metres
        Step to which depths are rounded; none when not positive.
    width : int
        Pixels of a row.
    disparity : float, pixels x metres
        Of the second eye at a depth of 1 m, negative where it is on the side of the first column;
        0 for none.
    disparity_noise, disparity_step : float, pixels
        Standard deviation of a disparity, and the step to which it is rounded.
    shadow : bool
        Whether there is no reading where something hides a point from the second eye.
    stereo : bool
        Whether there is no reading of points outside the image of the second eye. With either, a
        pixel without reading tells nothing: its range is NaN, not inf.
    """

    min_depth: float
    max_depth: float
    sigma: tuple[float, float, float]
    resolution: float
    width: int
    disparity: float
    disparity_noise: float
    disparity_step: float
    shadow: bool
    stereo: bool


class Sensor(ABC):
    """What `primfit.scan` and `Scan.from_readings` ask of a sensor.

    One that is written elsewhere is a frozen dataclass with a `mount` and the members below. Two
    are equal when their fields are.

    Attributes
    ----------
    mount : (4, 4) float64
        Where the sensor sits in the robot's frame, ``T_robot_sensor``.
    """

    mount: Any

    @property
    @abstractmethod
    def directions(self) -> Floats:
        """Unit directions (rows, columns, 3) in the sensor's frame.

        Neighbours in the array are neighbours in direction, as far as can be: they are cast
        together, and images and neighbourhoods of a scan come from rows and columns.
        """

    @property
    @abstractmethod
    def gate(self) -> RangeGate | DepthGate:
        """How true ranges become readings; by depth, the optical axis is the sensor's z."""

    @abstractmethod
    def sigma_of(self, ranges: Floats) -> float | Floats:
        """Standard deviations, metres, of measured ranges (..., rows, columns) along the beams.

        One for all, or of the shape of the ranges. No return, inf, has that of the longest range.
        Neither noise nor rounding is left out: a sigma too small is believed.
        """

    @property
    def limits(self) -> tuple[float | Floats, float | Floats]:
        """Shortest and longest true range that gives a return, metres: for all, or (rows, columns).

        The gate says the same.
        """
        gate = self.gate
        if isinstance(gate, RangeGate):
            return gate.min_range, gate.max_range
        cosines = self.directions[..., 2]
        return gate.min_depth / cosines, gate.max_depth / cosines

    def _key(self) -> tuple[Any, ...]:
        values = (getattr(self, each.name) for each in fields(self))  # type: ignore[arg-type]
        plain = (each.tobytes() if isinstance(each, np.ndarray) else each for each in values)
        return (type(self), *plain)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sensor) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())
