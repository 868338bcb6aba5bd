"""Clouds and scans in the recordings of ROS 1 and ROS 2; needs the extra ``ros``, but no ROS."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Bools, Floats, Ints
from primfit._files import as_path
from primfit.clouds.cloud import Cloud
from primfit.clouds.messages import beams_of_message, cloud_of_message, pose_of_message
from primfit.scans.lidar import Lidar
from primfit.scans.scan import Scan
from primfit.scans.scanning import as_transforms

_CLOUD = "sensor_msgs/msg/PointCloud2"
_LASER = "sensor_msgs/msg/LaserScan"
_POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)


def is_bag(file: str | PathLike[str]) -> bool:
    """Whether a path is that of a recording: .bag, .mcap, .db3 or a folder of ROS 2."""
    path = as_path(file)
    return path.suffix.lower() in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file()


def read_clouds(bag: str | PathLike[str], topic: str | None = None) -> Iterator[Cloud]:
    """The clouds of a recording, one a message, in the frame of the sensor.

    Parameters
    ----------
    bag : path
        A .bag of ROS 1, a folder of ROS 2 (with metadata.yaml), or its .mcap or .db3 alone.
    topic : str or None
        Of PointCloud2 or LaserScan. None is the only one of these that the recording has.

    Yields
    ------
    Cloud
        With all fields of a PointCloud2, whatever its layout and byte order. Of a LaserScan, the
        points at z = 0, NaN where nothing came back, and "intensity" if it has some.

    Raises
    ------
    FileNotFoundError
        When there is no such recording.
    ValueError
        When it cannot be read, or has no such topic; the message names those that it has.
    ModuleNotFoundError
        When the extra ``ros`` is not installed.

    Examples
    --------
    >>> import primfit
    >>> for cloud in primfit.read_clouds("drive.mcap", "/points"):  # doctest: +SKIP
    ...     print(primfit.detect_planes(cloud))
    """
    with _opened(bag) as reader:
        chosen = _connections(bag, reader, topic, (_CLOUD, _LASER))
        for _, message in _messages(reader, chosen):
            yield cloud_of_message(message)


def read_scan(
    bag: str | PathLike[str],
    topic: str | None,
    poses: ArrayLike | str,
    *,
    mount: ArrayLike = (0.0, 0.0, 0.0),
    sigma: ArrayLike | None = None,
    min_range: float | None = None,
    max_range: float | None = None,
) -> Scan:
    """All messages of a topic as one scan, with the poses from which they were taken.

    Parameters
    ----------
    bag : path
        As in `read_clouds`.
    topic : str or None
        Of PointCloud2 or LaserScan. None is the only one of these that the recording has.
    poses : (m, 3) or (m, 4, 4) float64, or str
        One for each message: planar poses of the robot (x, y in metres, yaw in radians), to which
        the mount is added, or rigid transforms ``T_world_sensor``. Or the topic of Odometry,
        PoseStamped or PoseWithCovarianceStamped that tells the robot's pose. It is interpolated at
        the time of each message, and of each beam of a LaserScan; what was measured before the
        first pose or after the last is left out.
    mount : (3,) or (4, 4)
        Where the sensor sits in the robot's frame, as in `Lidar`.
    sigma : float or None, metres
        Standard deviation of the ranges; None is to be estimated.
    min_range, max_range : float or None, metres
        Range limits of the sensor. A LaserScan tells its own.

    Returns
    -------
    Scan
        With `pose_index`, the row of the message; `layer` of the field "ring" of a PointCloud2; of
        a LaserScan `column`, and the beams that did not return. Points that are not finite or
        0 0 0 are left out, since nothing tells where their beams went.

    Raises
    ------
    FileNotFoundError, ModuleNotFoundError
        As `read_clouds` does.
    ValueError
        As `read_clouds` does, and when the poses are as many as the messages, or cover none.

    Warns
    -----
    UserWarning
        When messages are left out.

    Examples
    --------
    >>> import primfit
    >>> scan = primfit.read_scan("room.bag", "/scan", "/odom", mount=(0, 0, 0.2))  # doctest: +SKIP
    >>> primfit.detect(scan)  # doctest: +SKIP
    """
    carrier = Lidar(mount=mount)
    with _opened(bag) as reader:
        messages = list(_messages(reader, _connections(bag, reader, topic, (_CLOUD, _LASER))))
        if isinstance(poses, str):
            track = list(_messages(reader, _connections(bag, reader, poses, _POSES)))
            pose_at = _track(track, carrier)
        else:
            pose_at = _one_each(poses, carrier, len(messages))
    origins, directions, ranges, layers, columns, rows = [], [], [], [], [], []
    limits = []
    for row, (stamp, message) in enumerate(messages):
        beams = beams_of_message(message)
        limits.append(beams.limits)
        is_known, transforms = pose_at(row, stamp + beams.delays)
        origins.append(transforms[:, :3, 3])
        own = beams.directions[is_known]
        directions.append(np.einsum("nij,nj->ni", transforms[:, :3, :3], own))
        ranges.append(beams.ranges[is_known])
        layers.append(beams.layer[is_known])
        columns.append(beams.column[is_known])
        rows.append(np.full(len(transforms), row))
    n_left_out = sum(not len(each) for each in ranges)
    if n_left_out == len(messages):
        raise ValueError(f"poses cover none of the {len(messages)} messages of {as_path(bag)}")
    if n_left_out:
        warnings.warn(
            f"{n_left_out} of {len(messages)} messages have no point, or no pose at their time: "
            f"they are left out",
            stacklevel=2,
        )
    nearest, farthest = zip(*limits, strict=True)
    return Scan.from_rays(
        np.concatenate(origins),
        np.concatenate(directions),
        np.concatenate(ranges),
        sigma,
        min_range=min(nearest) if min_range is None and None not in nearest else min_range,
        max_range=max(farthest) if max_range is None and None not in farthest else max_range,
        layer=_known(layers),
        column=_known(columns),
        pose_index=np.concatenate(rows),
    )


def _known(indices: list[Ints]) -> Ints | None:
    """Layers or columns of all messages, or None when a message does not tell them."""
    together = np.concatenate(indices)
    return None if (together < 0).any() else together


PoseAt = Callable[[int, Floats], tuple[Bools, Floats]]
"""Of a message's row and the times (n,) of its beams: which have a pose, and these (m, 4, 4)."""


def _one_each(poses: ArrayLike, carrier: Lidar, n_messages: int) -> PoseAt:
    given, _ = as_transforms(poses, carrier)
    if len(given) != n_messages:
        raise ValueError(
            f"poses must be one for each of the {n_messages} messages, not {len(given)}"
        )

    def pose_at(row: int, times: Floats) -> tuple[Bools, Floats]:
        return np.ones(len(times), bool), np.broadcast_to(given[row], (len(times), 4, 4))

    return pose_at


def _track(messages: list[tuple[float, Any]], carrier: Lidar) -> PoseAt:
    """Poses between those of messages: places linearly, turns along the shortest way."""
    from scipy.spatial.transform import Rotation, Slerp

    stamps, first = np.unique([stamp for stamp, _ in messages], return_index=True)
    poses = [pose_of_message(messages[row][1]) for row in first]
    places = np.array([place for place, _ in poses])
    turns = Rotation.from_quat([quaternion for _, quaternion in poses])
    turn_at = Slerp(stamps, turns) if len(stamps) > 1 else lambda times: turns[[0] * len(times)]

    def pose_at(_: int, times: Floats) -> tuple[Bools, Floats]:
        is_known = (times >= stamps[0]) & (times <= stamps[-1])
        times = times[is_known]
        transforms = np.zeros((len(times), 4, 4))
        transforms[:, 3, 3] = 1.0
        if len(times):
            transforms[:, :3, :3] = turn_at(times).as_matrix()
            for k in range(3):
                transforms[:, k, 3] = np.interp(times, stamps, places[:, k])
        return is_known, transforms @ carrier.mount

    return pose_at


@contextmanager
def _opened(bag: str | PathLike[str]) -> Iterator[Any]:
    path = as_path(bag)
    if not path.exists():
        raise FileNotFoundError(f"there is no recording {path}")
    if not is_bag(path):
        raise ValueError(
            f"bag must be a .bag, .mcap or .db3, or a folder with metadata.yaml, not {path}"
        )
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"recordings of ROS need {error.name}: install it with pip install 'primfit[ros]'"
        ) from None
    try:
        # Recordings of old versions of ROS 2 do not tell what their messages are made of.
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader
    except AnyReaderError as error:
        raise ValueError(f"{path} is not readable as a recording: {error}") from error


def _connections(
    bag: str | PathLike[str], reader: Any, topic: str | None, kinds: Sequence[str]
) -> list[Any]:
    """What the topic is recorded by; without one, the only topic of these kinds."""
    right = [each for each in reader.connections if each.msgtype in kinds]
    topics = sorted({each.topic for each in right})
    if topic is None and len(topics) == 1:
        return right
    if topic in topics:
        return [each for each in right if each.topic == topic]
    told = sorted({f"{each.topic} ({each.msgtype})" for each in reader.connections})
    wanted = " or ".join(kind.rpartition("/")[2] for kind in kinds)
    raise ValueError(
        f"topic must be one of {wanted} in {as_path(bag)}, which has {', '.join(told) or 'none'}; "
        f"not {topic!r}"
    )


def _messages(reader: Any, connections: list[Any]) -> Iterator[tuple[float, Any]]:
    """Messages in order, each with its time, seconds: of its header, or else when it came."""
    for connection, received, content in reader.messages(connections=connections):
        message = reader.deserialize(content, connection.msgtype)
        stamp = message.header.stamp
        seconds = stamp.sec + 1e-9 * stamp.nanosec
        yield (seconds or 1e-9 * received), message
