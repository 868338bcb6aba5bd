"""The paper's simulator as a source of scans: its sensors, and a project that it runs.

What is written follows the documentation of R2023b; it was not run in Webots itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from primfit._check import Floats, instance
from primfit._files import as_path, replacing
from primfit.scans.scanning import as_transforms
from primfit.sensors.depth_camera import OPTICAL, DepthCamera
from primfit.sensors.lidar import Lidar
from primfit.sensors.mounts import E_PUCK_TURRET
from primfit.worlds.formats.vrml import Node, nodes_of
from primfit.worlds.formats.wbt import children_of, placement, text_of
from primfit.worlds.world import World

_FIELDS = {
    "number_of_layers": ("numberOfLayers", 4),
    "vertical_field_of_view": ("verticalFieldOfView", 0.2),
    "horizontal_resolution": ("horizontalResolution", 512),
    "field_of_view": ("fieldOfView", 1.5708),
    "min_range": ("minRange", 0.01),
    "max_range": ("maxRange", 1.0),
    "noise": ("noise", 0.0),
    "resolution": ("resolution", -1.0),
}
"""Parameters of `Lidar`, with their names and defaults in Webots."""

_RANGE_FINDER = {
    "field_of_view": ("fieldOfView", 0.7854),
    "width": ("width", 64),
    "height": ("height", 64),
    "min_range": ("minRange", 0.01),
    "max_range": ("maxRange", 1.0),
    "noise": ("noise", 0.0),
    "resolution": ("resolution", -1.0),
}
"""The same of `DepthCamera.range_finder`."""

_CONTROLLER = '''"""Scans from each of the poses in poses.npy into scan.npz; written by primfit."""

from pathlib import Path

import numpy as np
from controller import Supervisor

HERE = Path(__file__).parent
robot = Supervisor()
step = int(robot.getBasicTimeStep())
lidar = robot.getDevice("lidar")
lidar.enable(step)
node = robot.getSelf()
ranges = []
for pose in np.load(HERE / "poses.npy"):
    node.getField("translation").setSFVec3f(pose[:3].tolist())
    node.getField("rotation").setSFRotation(pose[3:].tolist())
    # The first image after a move may still be of the place before.
    robot.step(step)
    robot.step(step)
    image = np.array(lidar.getRangeImage(), dtype=np.float64)
    ranges.append(image.reshape(lidar.getNumberOfLayers(), lidar.getHorizontalResolution()))
np.savez(HERE / "scan.npz", ranges=np.array(ranges))
robot.simulationSetMode(Supervisor.SIMULATION_MODE_PAUSE)
'''


def lidar_of_webots(file: str | PathLike[str]) -> Lidar:
    """The lidar that `Lidar.from_webots` gives."""
    node, mount = _first(as_path(file), "Lidar")
    return Lidar(**_settings(node, _FIELDS), mount=mount)


def camera_of_webots(file: str | PathLike[str]) -> DepthCamera:
    """The camera that `DepthCamera.from_webots` gives."""
    path = as_path(file)
    node, mount = _first(path, "RangeFinder")
    # The word of R2023b, and that of releases before.
    projection = node.fields.get("projection", "planar")
    projection = "spherical" if node.fields.get("spherical", False) else projection
    if projection != "planar":
        raise ValueError(f"RangeFinder of {path} must have a planar projection, not {projection}")
    # Its node looks along x with z up, its image along z with y down.
    mount = mount.copy()
    mount[:3, :3] = mount[:3, :3] @ OPTICAL
    return DepthCamera.range_finder(**_settings(node, _RANGE_FINDER), mount=mount)


def _settings(node: Node, fields: dict[str, tuple[str, Any]]) -> dict[str, Any]:
    found = {}
    for name, (theirs, default) in fields.items():
        value = node.fields.get(theirs, [default])
        if not isinstance(value, list) or len(value) != 1 or not isinstance(value[0], int | float):
            raise ValueError(f"{theirs} of {node.kind} must be a number, not {value!r}")
        found[name] = type(default)(value[0])
    return found


def _first(path: Path, kind: str) -> tuple[Node, Floats]:
    """The first node of a kind in a world, and where it is in the frame of its robot."""
    text = path.read_text(encoding="utf-8", errors="replace")
    try:
        nodes = nodes_of(text)
    except ValueError as error:
        raise ValueError(f"{path} is not a world of Webots: {error}") from None
    found = next((each for node in nodes for each in _sensors(node, kind, np.eye(4))), None)
    if found is None:
        raise ValueError(f"{path} has no node {kind}")
    return found


def _sensors(node: Node, kind: str, frame: Floats) -> Iterator[tuple[Node, Floats]]:
    """Sensors of a kind in a node, each with where it is in the frame of its robot."""
    own = frame @ placement(node, is_y_up=False)
    if node.kind == kind:
        yield node, own
    if node.kind == "Robot" or "controller" in node.fields or "turretSlot" in node.fields:
        own = np.eye(4)
    for name in ("children", "turretSlot", "groundSensorsSlot", "sensorSlot", "bodySlot"):
        slot = np.eye(4)
        if name == "turretSlot":
            slot[:3, 3] = E_PUCK_TURRET
        for child in children_of(node, name):
            yield from _sensors(child, kind, own @ slot)


def export_webots(
    world: World, folder: str | PathLike[str], path: ArrayLike, lidar: Lidar | None = None
) -> Path:
    """Write a project of Webots that scans a world from a path.

    A robot without a body carries the sensor from pose to pose; its controller writes the ranges
    to ``controllers/primfit_scan/scan.npz``, which `Scan.from_readings` takes. Written after the
    documentation of Webots R2023b, and not run in Webots itself.

    Parameters
    ----------
    world : World
    folder : path
        Of the project; made if there is none.
    path : (n, 3) or (3,) or (n, 4, 4) or (4, 4) float64
        As in `primfit.scan`.
    lidar : Lidar or None
        None for `Lidar()`; its beams must be a grid of angles, as those of Webots.

    Returns
    -------
    pathlib.Path
        Of the world to open, ``worlds/primfit.wbt``.

    Raises
    ------
    ValueError
        When the path is none, or Webots has no such lidar.

    Examples
    --------
    >>> import primfit, tempfile
    >>> world = primfit.World(arena=primfit.Arena((1, 1)))
    >>> file = primfit.export_webots(world, tempfile.mkdtemp(), (0.5, 0.5, 0.0))
    >>> primfit.Lidar.from_webots(file) == primfit.Lidar()
    True
    """
    instance("world", world, World)
    sensor = Lidar() if lidar is None else lidar
    instance("lidar", sensor, Lidar)
    if sensor.beams is not None:
        raise ValueError("lidar must have beams in a grid of angles, as Webots has them")
    if not sensor.is_perfect:
        raise ValueError(
            f"lidar must have no imperfections that Webots does not know, such as dropout or "
            f"beam_divergence, not {sensor!r}"
        )
    poses, _ = as_transforms(path, sensor)
    robots = poses @ np.linalg.inv(sensor.mount)
    place = np.column_stack([robots[:, :3, 3], _axis_angle(robots[:, :3, :3])])
    root = as_path(folder)
    controller = root / "controllers" / "primfit_scan"
    controller.mkdir(parents=True, exist_ok=True)
    (root / "worlds").mkdir(exist_ok=True)
    file = root / "worlds" / "primfit.wbt"
    with replacing(controller / "primfit_scan.py") as part:
        part.write_text(_CONTROLLER)
    with replacing(controller / "poses.npy") as part:
        np.save(part, place)
    with replacing(file) as part:
        part.write_text(text_of(world) + _robot_text(sensor))
    return file


def _robot_text(lidar: Lidar) -> str:
    fields = " ".join(f"{name} {getattr(lidar, own)!r}" for own, (name, _) in _FIELDS.items())
    place = " ".join(map(repr, lidar.mount[:3, 3].tolist()))
    turn = " ".join(map(repr, _axis_angle(lidar.mount[None, :3, :3])[0].tolist()))
    return (
        'Robot { name "scanner" supervisor TRUE controller "primfit_scan" children [\n'
        f'  Lidar {{ name "lidar" translation {place} rotation {turn} {fields} }}\n] }}\n'
    )


def _axis_angle(rotations: Floats) -> Floats:
    """Axis and angle (n, 4) of rotations (n, 3, 3)."""
    vectors = Rotation.from_matrix(rotations).as_rotvec()
    angle = np.linalg.norm(vectors, axis=1)
    still = angle == 0.0
    axis = np.where(still[:, None], [0.0, 0.0, 1.0], vectors / np.where(still, 1.0, angle)[:, None])
    return np.column_stack([axis, angle])
