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
from primfit.scans.scan import Scan
from primfit.scans.scanning import as_transforms
from primfit.scans.transforms import FrameTree, between
from primfit.sensors.lidar import Lidar

_CLOUD = "sensor_msgs/msg/PointCloud2"
_LASER = "sensor_msgs/msg/LaserScan"
_POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)

_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_FIXED = ("map", "odom")
"""Frames in which a robot says where it is (REP 105), the one without drift first."""


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
    poses: ArrayLike | str | None = None,
    *,
    fixed_frame: str | None = None,
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
    poses : (m, 3) or (m, 4, 4) float64, or str, or None
        One for each message: planar poses of the robot (x, y in metres, yaw in radians), to which
        the mount is added, or rigid transforms ``T_world_sensor``. Or the topic of Odometry,
        PoseStamped or PoseWithCovarianceStamped that tells the robot's pose. It is interpolated at
        the time of each message, and of each beam of a LaserScan; what was measured before the
        first pose or after the last is left out. None takes the transforms that are recorded, as on
        /tf and /tf_static, interpolated in the same way between the two around each time; these
        have the mount in them.
    fixed_frame : str or None
        Frame of the points where `poses` is None. None is "map", or "odom" where no map is above
        the sensor's frame.
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
        As `read_clouds` does, and when the poses are not as many as the messages, or cover none,
        or when no transforms connect the sensor with the fixed frame.

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
    if poses is None and not np.array_equal(carrier.mount, np.eye(4)):
        raise ValueError("mount must not be given without poses: the transforms have it in them")
    if poses is not None and fixed_frame is not None:
        raise ValueError("fixed_frame is for poses=None, which takes them from transforms")
    with _opened(bag) as reader:
        messages = list(_messages(reader, _connections(bag, reader, topic, (_CLOUD, _LASER))))
        if poses is None:
            frames = [message.header.frame_id for _, message in messages]
            pose_at = _of_transforms(bag, reader, frames, fixed_frame)
        elif isinstance(poses, str):
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
    poses = [pose_of_message(message) for _, message in messages]
    robot_at = between([stamp for stamp, _ in messages], *zip(*poses, strict=True))

    def pose_at(_: int, times: Floats) -> tuple[Bools, Floats]:
        is_known, transforms = robot_at(times)
        return is_known, transforms @ carrier.mount

    return pose_at


def _of_transforms(
    bag: str | PathLike[str], reader: Any, frames: list[str], fixed_frame: str | None
) -> PoseAt:
    """Poses of the frames (n,) of messages from the transforms of a recording."""
    chosen = [each for each in reader.connections if each.msgtype in _TRANSFORMS]
    try:
        if not chosen:
            raise ValueError("it has no transforms, as /tf and /tf_static; give poses")
        tree = FrameTree(
            (transform, connection.topic.endswith("_static"))
            for connection, _, content in reader.messages(connections=chosen)
            for transform in reader.deserialize(content, connection.msgtype).transforms
        )
        poses_of = {
            frame: tree.poses(frame, fixed_frame or _fixed(tree, frame)) for frame in frames
        }
    except ValueError as error:
        raise ValueError(f"{as_path(bag)} tells no poses: {error}") from None

    def pose_at(row: int, times: Floats) -> tuple[Bools, Floats]:
        return poses_of[frames[row]](times)

    return pose_at


def _fixed(tree: FrameTree, frame: str) -> str:
    """The usual frame of a map that a sensor is in."""
    chain = tree.chain(frame)
    for name in _FIXED:
        if name in chain:
            return name
    raise ValueError(
        f"none of {', '.join(map(repr, _FIXED))} is above the sensor's frame {frame!r}; give "
        f"fixed_frame, of {tree}"
    )


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
