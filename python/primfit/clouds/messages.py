"""The messages of ROS that hold points or poses, whatever library made them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from primfit._check import Floats, Ints
from primfit.clouds.cloud import (
    Cloud,
    Columns,
    Field,
    cloud_of,
    organised,
    without_packed_colors,
)

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Numbers of `sensor_msgs/PointField`."""


def cloud_of_message(message: Any) -> Cloud:
    """The cloud of a PointCloud2, with all its fields, or of a LaserScan, at z = 0.

    A PointCloud2 of more than one row is an organised cloud. Beams of a LaserScan that did not
    return are NaN.

    Raises
    ------
    ValueError
        When its data is shorter than it says, a field lies outside a point, or x, y or z is
        missing.
    """
    if not hasattr(message, "point_step"):
        return _cloud_of_laser(message)
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    order = ">" if message.is_bigendian else "<"
    layout: dict[str, list[Any]] = {"names": [], "formats": [], "offsets": []}
    for each in message.fields:
        if int(each.datatype) not in _TYPES:
            raise ValueError(f"field {each.name!r} has datatype {each.datatype}, not 1 to 8")
        kind = np.dtype(order + _TYPES[int(each.datatype)])
        # Some drivers count the one number of a field as 0.
        count = max(int(each.count), 1)
        if not 0 <= int(each.offset) <= step - count * kind.itemsize:
            raise ValueError(f"field {each.name!r} is outside a point of {step} bytes")
        layout["names"].append(each.name)
        layout["formats"].append((kind, (count,)) if count > 1 else kind)
        layout["offsets"].append(int(each.offset))
    rows = max(int(message.row_step), width * step)
    content = _bytes_of(message.data)
    if len(content) < (height - 1) * rows + width * step:
        raise ValueError(
            f"its data is {len(content)} bytes, too few for {height} rows of {width} points of "
            f"{step} bytes"
        )
    pixels = np.zeros((height, width * step), np.uint8)
    for row in range(height):
        pixels[row] = content[row * rows : row * rows + width * step]
    table = pixels.reshape(-1).view(np.dtype({**layout, "itemsize": step}))  # type: ignore[call-overload]
    columns: Columns = {name: _native(table[name]) for name in layout["names"]}
    return cloud_of(without_packed_colors(columns), (height, width) if height > 1 else None)


@dataclass(frozen=True, eq=False)
class Beams:
    """The beams of a message, in the frame of the sensor.

    Attributes
    ----------
    directions : (n, 3) float64
    ranges : (n,) float64, metres
        inf for no return.
    delays : (n,) float64, seconds
        After the time of the message.
    layer, column : (n,) int64
        -1 where it is not told.
    limits : (float, float) or (None, None), metres
        Range limits of the sensor.
    """

    directions: Floats
    ranges: Floats
    delays: Floats
    layer: Ints
    column: Ints
    limits: tuple[float | None, float | None]


def beams_of_message(message: Any) -> Beams:
    """The beams of a PointCloud2 or LaserScan, but those of which nothing is known.

    Of a LaserScan, as REP 117 has it, plus infinity and what is beyond its limit are no return;
    NaN, minus infinity and what is nearer than its limit tell nothing. Of a PointCloud2, points
    that are not finite or 0 0 0 tell nothing. Its points are taken as measured all at once: what
    drivers call time differs in unit and origin.
    """
    if not hasattr(message, "point_step"):
        return _beams_of_laser(message)
    cloud = cloud_of_message(message)
    rows = np.flatnonzero(np.isfinite(cloud.points).all(axis=1) & cloud.points.any(axis=1))
    points = cloud.points[rows]
    unknown = np.full(len(rows), -1)
    ring = cloud.fields.get("ring")
    ranges = np.linalg.norm(points, axis=1)
    return Beams(
        directions=points / ranges[:, None],
        ranges=ranges,
        delays=np.zeros(len(rows)),
        layer=unknown if ring is None else ring[rows].astype(np.int64),
        column=unknown,
        limits=(None, None),
    )


def _beams_of_laser(message: Any) -> Beams:
    ranges = np.asarray(message.ranges, np.float64)
    nearest, farthest = float(message.range_min), float(message.range_max)
    with np.errstate(invalid="ignore"):
        column = np.flatnonzero(ranges >= nearest)
        ranges = np.where(ranges > farthest, np.inf, ranges)[column]
    angle = message.angle_min + column * float(message.angle_increment)
    return Beams(
        directions=np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1),
        ranges=ranges,
        delays=np.float64(message.time_increment) * column,
        layer=np.zeros(len(column), np.int64),
        column=column,
        limits=(nearest, farthest),
    )


def _cloud_of_laser(message: Any) -> Cloud:
    beams = _beams_of_laser(message)
    is_return = np.isfinite(beams.ranges)
    points = np.full((len(message.ranges), 3), np.nan)
    ranges = beams.ranges[is_return, None]
    points[beams.column[is_return]] = ranges * beams.directions[is_return]
    intensities = np.asarray(message.intensities, np.float32)
    return organised(points, {"intensity": intensities} if len(intensities) else {}, None)


def pose_of_message(message: Any) -> tuple[list[float], list[float]]:
    """Place and quaternion (x y z w) of an Odometry, PoseStamped or PoseWithCovarianceStamped."""
    pose = getattr(message.pose, "pose", message.pose)
    place, turn = pose.position, pose.orientation
    return [place.x, place.y, place.z], [turn.x, turn.y, turn.z, turn.w]


def _native(values: Field) -> Field:
    return values.astype(values.dtype.newbyteorder("="))


def _bytes_of(data: Any) -> Field:
    """Bytes in any of the types that libraries keep them in."""
    try:
        return np.frombuffer(data, np.uint8)
    except (TypeError, ValueError):
        return np.asarray(data, dtype=np.uint8).reshape(-1)
