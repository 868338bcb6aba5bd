"""Scanning a world along a path (the paper's Algorithm 2)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import Bools, Floats, Ints, check_finite, generator, instance, n_jobs_or_none
from primfit._progress import Progress, reporting
from primfit.geometry.motions import wrapped
from primfit.scans.casting import RayCaster
from primfit.scans.imperfections import read
from primfit.scans.path_errors import as_pose_sigmas, carried_along, drifted, misplaced
from primfit.scans.scan import TRUTHS, Scan
from primfit.sensors.lidar import Lidar
from primfit.sensors.mounts import check_transforms
from primfit.sensors.sensor import RangeGate, Sensor
from primfit.worlds.places import warn_of_places
from primfit.worlds.world import World

_BEAMS_AT_ONCE = 1 << 18


def scan(
    world: World,
    path: ArrayLike,
    lidar: Sensor | None = None,
    *,
    rng: Any = None,
    pose_noise: ArrayLike | None = None,
    step_noise: ArrayLike | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Scan:
    """All returns of a LiDAR or a depth camera along a path.

    Every beam is cast exactly against solids, arena and floor. The range gate is applied to the
    true range; then Gaussian noise is added along the beam, and the range is rounded to the
    sensor's resolution. A `DepthCamera` does so with depths. A beam without return stays without
    return. Poses inside a solid are passed over, as in the paper, and planar ones outside the
    arena. The noise of a beam depends on `rng` and on its row alone. A lidar with imperfections
    (see `Lidar`) reads through its footprints, loses returns and moves within a turn; then the scan
    has the truth of each beam beside it, and its `sigma` is that of each beam where noise grows
    with range or incidence. No `sigma` holds for mixed pixels, nor for what a moving sensor
    distorts. Its readings are the same at any `n_jobs`; on another processor NumPy's functions may
    round the last digit differently.

    Parameters
    ----------
    world : World
    path : (n, 3) or (3,) or (n, 4, 4) or (4, 4) float64
        Planar poses of the robot (x, y in metres, yaw in radians), to which the sensor's mount is
        added, or rigid transforms ``T_world_sensor``.
    lidar : Sensor or None
        A `Lidar`, a `DepthCamera` or another `Sensor`; None for `Lidar()`.
    rng : None, int or numpy.random.Generator
        Same `rng`, same scan, at any number of threads.
    pose_noise : (position, heading), (x, y, heading) or None, metres and radians
        Standard deviations of what the scan believes of each pose by itself, as of a robot with
        beacons and a compass. The beams are cast from the path; origins, directions, points and
        `Scan.path` are as they seem from where the robot believes to be, and `Scan.true_path` is
        the path.
    step_noise : (position, heading), (forward, left, heading) or None, metres and radians
        The same for each step from one pose to the next, in the robot's frame, as of a robot that
        counts the turns of its wheels: what it believes drifts away. The first pose is exact.
    n_jobs : int or None
        Threads; None for all.
    progress : bool or callable
        True shows a bar; a callable gets the number of poses done and in all.

    Returns
    -------
    Scan
        One row a beam: pose by pose, layer by layer, column by column. Takes 40 bytes a beam, and
        72 more when origins, directions and places in the sensor have been asked for; of a camera
        32 more when depths, `sigma` and limits have been.

    Raises
    ------
    ValueError
        When the path has no valid pose, or is not a path; when poses shall be noisy in both ways,
        or are not planar.

    Warns
    -----
    UserWarning
        When poses are left out since they are inside a solid or outside the arena, a yaw is more
        than a full turn, or solids reach into each other or beyond the arena.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.World(arena=primfit.Arena((1, 1)))
    >>> primfit.scan(world, (0.5, 0.5, 0.0), rng=7)
    Scan(800 beams from 1 pose, 800 returns, sigma 0 mm)
    """
    instance("world", world, World)
    lidar = Lidar() if lidar is None else lidar
    instance("lidar", lidar, Sensor)
    poses, planar = as_transforms(path, lidar)
    sigmas = _noise_of_poses(pose_noise, step_noise, planar)
    inside_arena = planar is not None
    valid = np.flatnonzero(_is_valid(world, poses[:, :3, 3], inside_arena=inside_arena))
    if not len(valid):
        raise ValueError(
            f"path has no valid pose: all {len(poses)} are inside a solid or outside the arena of "
            f"{world!r}"
        )
    if len(valid) < len(poses):
        warnings.warn(
            f"path has {len(poses) - len(valid)} of {len(poses)} poses inside a solid or outside "
            f"the arena: they are left out",
            stacklevel=2,
        )
    warn_of_places(world)
    rng = generator(rng)
    n_jobs = n_jobs_or_none(n_jobs)
    beams = np.ascontiguousarray(lidar.directions.reshape(-1, 3))
    transforms = np.ascontiguousarray(poses[valid].reshape(-1, 16))
    n_poses, n_beams = len(transforms), len(beams)
    seed = int(rng.integers(1 << 64, dtype=np.uint64))
    measured: dict[str, Any] = {}
    truth: dict[str, Any] = {}
    with reporting(progress, n_poses, "pose") as tell:
        if not isinstance(lidar, Lidar) or lidar.is_perfect:
            points, ranges, ids = _cast(world, lidar, transforms, seed, n_jobs, tell)
        else:
            turns = partial(
                _in_turn, path=poses if planar is None else planar, used=valid, lidar=lidar
            )
            readings = read(world, lidar, turns, n_poses, seed, n_jobs, tell)
            points, ranges, ids = None, readings.ranges, readings.solid_index
            if lidar.noise_per_metre or lidar.beam_divergence:
                measured = {"sigma": readings.sigma}
            truth = {name: getattr(readings, name) for name in TRUTHS}
    believed = planar
    if planar is not None and sigmas is not None:
        errors = misplaced if step_noise is None else drifted
        believed = carried_along(planar, valid, errors(planar[valid], sigmas, rng))
        transforms = _mounted(believed[valid], lidar).reshape(-1, 16)
    if believed is not planar:
        points = None
    return scan_of(
        lidar,
        transforms,
        ranges,
        points=points,
        pose_index=partial(np.repeat, valid, n_beams),
        solid_index=ids,
        path=believed,
        true_path=planar,
        **measured,
        **truth,
    )


def scan_of(
    sensor: Sensor, transforms: Floats, ranges: Floats, *, points: Floats | None = None, **more: Any
) -> Scan:
    """The scan of what a sensor read (n,) from poses (p, 16), and of what else is known of it."""
    poses = np.ascontiguousarray(transforms.reshape(-1, 16))
    layers, columns, _ = sensor.directions.shape
    beams = np.ascontiguousarray(sensor.directions.reshape(-1, 3))
    n_poses, n_beams = len(poses), len(beams)
    known = {
        "pose_index": partial(np.repeat, np.arange(n_poses), n_beams),
        **_measured(sensor, ranges),
        **more,
    }
    return Scan(
        points=_ends(poses, beams, ranges) if points is None else points,
        origins=partial(np.repeat, poses[:, [3, 7, 11]], n_beams, axis=0),
        directions=partial(_primfit.turned, poses, beams),
        ranges=ranges,
        layer=partial(np.tile, np.repeat(np.arange(layers), columns), n_poses),
        column=partial(np.tile, np.arange(columns), n_poses * layers),
        **known,
    )


def _ends(transforms: Floats, beams: Floats, ranges: Floats) -> Floats:
    """Where beams (m, 3) from poses (p, 16) end (p * m, 3); NaN without a return."""
    points, n_beams = np.empty((len(ranges), 3)), len(beams)
    at_once = max(1, _BEAMS_AT_ONCE // n_beams)
    for first in range(0, len(transforms), at_once):
        some = transforms[first : first + at_once]
        rows = slice(first * n_beams, (first + len(some)) * n_beams)
        starts = np.repeat(some[:, [3, 7, 11]], n_beams, axis=0)
        reach = np.where(np.isfinite(ranges[rows]), ranges[rows], np.nan)[:, None]
        points[rows] = starts + reach * _primfit.turned(some, beams)
    return points


def _cast(
    world: World,
    sensor: Sensor,
    transforms: Floats,
    seed: int,
    n_jobs: int | None,
    tell: Callable[[int], None],
) -> tuple[Floats, Floats, Ints]:
    """Points, ranges and what is met by the beams of a sensor from poses (p, 16)."""
    caster = RayCaster(world)._core
    beams, gate = np.ascontiguousarray(sensor.directions.reshape(-1, 3)), sensor.gate
    n_poses, n_beams = len(transforms), len(beams)
    at_once = max(1, _BEAMS_AT_ONCE // n_beams)
    n = n_poses * n_beams
    points, ranges, ids = np.empty((n, 3)), np.empty(n), np.empty(n, dtype=np.int64)
    for first in range(0, n_poses, at_once):
        some = transforms[first : first + at_once]
        rows = slice(first * n_beams, (first + len(some)) * n_beams)
        out = points[rows], ranges[rows], ids[rows]
        caster.scan(some, beams, gate, (seed, rows.start), *out, n_jobs)
        tell(first + len(some))
    return points, ranges, ids


def _measured(sensor: Sensor, ranges: Floats) -> dict[str, Any]:
    """What a scan says of how a sensor measures each beam, of images when it is asked for."""
    images = ranges.reshape(-1, *sensor.directions.shape[:2])
    later = {
        "sigma": partial(_sigma, sensor, images),
        "min_range": partial(_limit, sensor, 0, images),
        "max_range": partial(_limit, sensor, 1, images),
    }
    if isinstance(sensor.gate, RangeGate):
        return {name: value() for name, value in later.items()}
    return {**later, "depths": partial(_depths, sensor, images)}


def _sigma(sensor: Sensor, images: Floats) -> float | Floats:
    return _of_beams(sensor.sigma_of(images), images)


def _limit(sensor: Sensor, which: int, images: Floats) -> float | Floats:
    return _of_beams(sensor.limits[which], images)


def _depths(sensor: Sensor, images: Floats) -> Floats:
    depths: Floats = (images * sensor.directions[..., 2]).ravel()
    return depths


def _of_beams(values: float | Floats, images: Floats) -> float | Floats:
    """One number for all beams of images, or those of each (n,)."""
    return np.broadcast_to(values, images.shape).ravel() if np.ndim(values) else values


def _in_turn(some: slice, *, path: Floats, used: Ints, lidar: Lidar) -> Floats:
    """Sensor poses (k, 1 or columns, 4, 4) at the columns of turns that begin at poses of a path.

    `path` (n, 3) is that of the robot, or (n, 4, 4) that of the sensor; `used` are rows of it.
    """
    first = used[some]
    if not lidar.motion_distortion or len(path) == 1:
        poses = path[first]
        return (poses if path.ndim == 3 else _mounted(poses, lidar))[:, None]
    start = np.minimum(first, len(path) - 2)
    columns = lidar.horizontal_resolution
    share = lidar.motion_distortion * np.arange(columns) / columns
    if path.ndim == 2:
        step = path[start + 1] - path[start]
        step[:, 2] = wrapped(step[:, 2])
        moved = path[first][:, None] + share[:, None] * step[:, None]
        return _mounted(moved.reshape(-1, 3), lidar).reshape(-1, columns, 4, 4)
    from scipy.spatial.transform import Rotation

    before, after = path[start], path[start + 1]
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", before[:, :3, :3], after[:, :3, :3]))
    vectors = share[:, None] * turn.as_rotvec()[:, None]
    turns = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(-1, columns, 3, 3)
    moved = np.zeros((len(first), columns, 4, 4))
    moved[..., 3, 3] = 1.0
    moved[..., :3, :3] = np.einsum("nij,ncjk->ncik", path[first, :3, :3], turns)
    step = (after - before)[:, None, :3, 3]
    moved[..., :3, 3] = path[first][:, None, :3, 3] + share[:, None] * step
    return moved


def _noise_of_poses(
    pose_noise: ArrayLike | None, step_noise: ArrayLike | None, planar: Floats | None
) -> Floats | None:
    """Standard deviations (3,) of poses or of steps; None for exact ones."""
    if pose_noise is None and step_noise is None:
        return None
    if pose_noise is not None and step_noise is not None:
        raise ValueError("pose_noise and step_noise exclude each other: give one of them")
    name, noise = ("pose_noise", pose_noise) if step_noise is None else ("step_noise", step_noise)
    if planar is None:
        raise ValueError(f"{name} needs a planar path (n, 3) of x, y and yaw, not transforms")
    return as_pose_sigmas(name, noise)


def as_transforms(path: ArrayLike, lidar: Sensor) -> tuple[Floats, Floats | None]:
    """Sensor poses (n, 4, 4), and the path (n, 3) of the robot if it is planar."""
    try:
        array = np.asarray(path, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"path must be an array of numbers: {error}") from None
    if array.shape[-2:] == (4, 4) and array.ndim in (2, 3):
        return check_transforms("path", array.reshape(-1, 4, 4), array.shape), None
    if array.ndim not in (1, 2) or array.shape[-1] != 3:
        raise ValueError(
            f"path must have shape (n, 3), (3,), (n, 4, 4) or (4, 4), not {array.shape}"
        )
    array = array.reshape(-1, 3)
    check_finite("path", array)
    yaw = array[:, 2]
    if (np.abs(yaw) > 2 * np.pi + 1e-9).any():
        row = int(np.argmax(np.abs(yaw)))
        warnings.warn(
            f"path has a yaw of more than a full turn, {yaw[row]:g} radians in row {row}; if "
            f"degrees are meant, use numpy.radians",
            stacklevel=3,
        )
    return _mounted(array, lidar), np.array(array)


def _mounted(path: Floats, lidar: Sensor) -> Floats:
    """Sensor poses (n, 4, 4) of a robot on a planar path (n, 3)."""
    x, y, yaw = path.T
    robots = np.tile(np.eye(4), (len(path), 1, 1))
    robots[:, 0, 0] = robots[:, 1, 1] = np.cos(yaw)
    robots[:, 1, 0] = np.sin(yaw)
    robots[:, 0, 1] = -np.sin(yaw)
    robots[:, 0, 3], robots[:, 1, 3] = x, y
    mounted: Floats = np.einsum("nij,jk->nik", robots, lidar.mount)
    return mounted


def _is_valid(world: World, positions: Floats, *, inside_arena: bool) -> Bools:
    valid = np.ones(len(positions), dtype=bool)
    if inside_arena and world.arena is not None:
        valid &= world.arena.clearance(positions[:, :2]) > 0.0
    for solid in world.solids:
        valid &= ~solid.contains(positions)
    return valid
