"""Depth cameras: a pinhole whose pixels measure how far what they see is along the optical axis."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, as_floats, integer, number
from primfit.sensors.depth_camera_presets import MOST_PIXELS, DepthCameraPresets
from primfit.sensors.mounts import as_mount
from primfit.sensors.pinhole import Pinhole, depths_of
from primfit.sensors.sensor import DepthGate, Sensor

if TYPE_CHECKING:
    from primfit.scans.scan import Scan

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from a camera's frame (x right, y down, z forward) to one with x forward, y left and z
up (ROS REP 103)."""

_MILLIMETRE = 0.001
"""Unit of depth images of whole numbers, metres (ROS REP 118)."""


@dataclass(frozen=True, eq=False)
class DepthCamera(DepthCameraPresets, Sensor):
    """A depth camera: structured light, stereo, time of flight, or rendered.

    Its frame is that of images: x to the right, y down, z forward. What is measured, limited and
    rounded is the depth along z; ranges of a scan are along the beams, as everywhere, and
    `Scan.image` gives depths again.

    Parameters
    ----------
    width, height : int, pixels
    fx, fy : float, pixels
        Focal lengths. A negative `fy` is that of an image upside down.
    cx, cy : float or None, pixels
        Principal point; the centre of the first pixel is (0, 0). None is the middle of the image.
    min_depth, max_depth : float, metres
        A true depth outside gives no return.
    axial_noise : float or (a, b, c)
        Standard deviation of a depth z, metres: ``a + b * (z - c)**2``; a number is the same at
        all depths.
    baseline : float, metres
        How far to the right of the camera its second eye is, a projector or another camera;
        negative to the left, 0 for none. With it the depth z has the disparity
        ``fx * baseline / z``.
    disparity_noise : float, pixels
        Standard deviation of a disparity, to first order ``z**2 / (fx * baseline)`` times it of
        the depth; its variance adds to that of `axial_noise`.
    disparity_step : float, pixels
        Step to which disparities are rounded; 0 for none. Steps in depth grow as its square.
    shadow : bool
        Whether pixels are lost where the second eye is hidden from what they see: beside near
        things, on the side away from it. What the camera does not see hides nothing. A pixel
        without depth may then have many reasons and tells nothing, not even that nothing was there:
        its range is NaN instead of inf.
    stereo : bool
        Whether the second eye is a camera with the same image, outside of which points have no
        depth: on the other side than the eye, as many columns as they have disparity. They tell
        nothing, either.
    resolution : float, metres
        Step to which depths are rounded; -1 for none.
    mount : (3,) or (4, 4)
        Where the camera sits in the robot's frame: a place in metres, from where it looks forward,
        or a rigid transform ``T_robot_sensor`` of the frame of its images.

    Raises
    ------
    ValueError
        When such a camera cannot exist.

    Examples
    --------
    >>> import primfit
    >>> camera = primfit.DepthCamera(64, 48, 60.0, 60.0, max_depth=3.0)
    >>> world = primfit.World(arena=primfit.Arena((2, 2)))
    >>> scan = primfit.scan(world, (0.5, 1.0, 0.0), camera, rng=7)
    >>> float(scan.image("depth")[0, 24, 32].round(9))
    1.5
    """

    width: int = 640
    height: int = 480
    fx: float = 525.0
    fy: float = 525.0
    cx: Any = None
    cy: Any = None
    min_depth: float = 0.1
    max_depth: float = 10.0
    axial_noise: Any = 0.0
    baseline: float = 0.0
    disparity_noise: float = 0.0
    disparity_step: float = 0.0
    shadow: bool = False
    stereo: bool = False
    resolution: float = -1.0
    mount: Any = field(default=(0.0, 0.0, 0.06), repr=False)

    def __post_init__(self) -> None:
        checked: dict[str, Any] = {}
        for name in ("width", "height"):
            checked[name] = integer(name, getattr(self, name), low=1, high=MOST_PIXELS)
        middle = {"cx": (checked["width"] - 1) / 2, "cy": (checked["height"] - 1) / 2}
        center = {
            name: middle[name] if getattr(self, name) is None else getattr(self, name)
            for name in middle
        }
        pinhole = Pinhole(self.fx, self.fy, **center)
        checked |= vars(pinhole)
        if pinhole.fx < 0.0:
            raise ValueError(f"fx must be positive, not {self.fx!r}: columns go to the right")
        checked["min_depth"] = number("min_depth", self.min_depth, low=0.0)
        checked["max_depth"] = number("max_depth", self.max_depth, above=0.0)
        if checked["min_depth"] >= checked["max_depth"]:
            raise ValueError(
                f"min_depth must be less than max_depth={checked['max_depth']:g}, not "
                f"{self.min_depth!r}"
            )
        checked["axial_noise"] = _as_noise(self.axial_noise)
        checked["baseline"] = number("baseline", self.baseline)
        for name in ("disparity_noise", "disparity_step"):
            checked[name] = number(name, getattr(self, name), low=0.0)
        for name in ("disparity_noise", "disparity_step", "shadow", "stereo"):
            if getattr(self, name) and checked["baseline"] == 0.0:
                raise ValueError(
                    f"baseline must not be 0 with {name}={getattr(self, name)!r}: there is no "
                    f"disparity"
                )
        for name in ("shadow", "stereo"):
            if not isinstance(getattr(self, name), bool | np.bool_):
                raise TypeError(f"{name} must be True or False, not {getattr(self, name)!r}")
            checked[name] = bool(getattr(self, name))
        resolution = checked["resolution"] = number("resolution", self.resolution)
        if resolution != -1.0 and resolution <= 0.0:
            raise ValueError(f"resolution must be positive, or -1 for none, not {resolution!r}")
        checked["mount"] = as_mount(self.mount)
        if np.shape(self.mount) != (4, 4):
            checked["mount"][:3, :3] = OPTICAL
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def directions(self) -> Floats:
        """Unit directions (height, width, 3) of the pixels: x right, y down, z forward."""
        return self._directions

    @property
    def gate(self) -> DepthGate:
        """How true depths become readings."""
        return DepthGate(
            min_depth=self.min_depth,
            max_depth=self.max_depth,
            sigma=self.axial_noise,
            resolution=self.resolution,
            width=self.width,
            disparity=self.fx * self.baseline,
            disparity_noise=self.disparity_noise,
            disparity_step=self.disparity_step,
            shadow=self.shadow,
            stereo=self.stereo,
        )

    def sigma_at(self, depths: ArrayLike) -> Floats:
        """Standard deviations of depths, metres: noise and rounding together.

        Parameters
        ----------
        depths : (...) float64, metres
            Those beyond the limits, and no return, inf or NaN, are taken as at the limits.

        Examples
        --------
        >>> import primfit
        >>> primfit.DepthCamera(axial_noise=(0.001, 0.002, 0.4)).sigma_at([0.4, 1.4])
        array([0.001, 0.003])
        """
        given = as_floats("depths", depths)
        known = np.where(np.isnan(given), self.max_depth, given)
        z = np.clip(known, self.min_depth, self.max_depth)
        constant, square, offset = self.axial_noise
        variance = (constant + square * (z - offset) ** 2) ** 2
        variance += max(self.resolution, 0.0) ** 2 / 12.0
        if self.baseline:
            # A disparity d changes by dz d / z.
            pixels = self.disparity_noise**2 + self.disparity_step**2 / 12.0
            variance += pixels * (z * z / (self.fx * self.baseline)) ** 2
        return np.sqrt(variance)

    def sigma_of(self, ranges: Floats) -> float | Floats:
        """Standard deviations of ranges (..., height, width) along the beams, metres.

        No return has that of the farthest depth.
        """
        cosines = self.directions[..., 2]
        return self.sigma_at(ranges * cosines) / cosines if self.has_noise else 0.0

    def scan(
        self, depth_images: ArrayLike, poses: ArrayLike | None = None, *, scale: float | None = None
    ) -> Scan:
        """The scan of depth images that such a camera has recorded.

        Parameters
        ----------
        depth_images : (height, width) or (p, height, width) array of numbers
            Distances along the optical axis. Pixels that are zero, negative or not finite have no
            return; with `shadow` or `stereo` they tell nothing.
        poses : (p, 4, 4), (4, 4), (p, 3), (3,) or None
            Where each was taken: transforms ``T_world_sensor`` of the frame of images, as sets of
            images have them, or planar poses of a robot, to which `mount` is added. None, for one
            image, is the frame of the camera itself.
        scale : float or None, metres
            Length of one unit: 1 / 5000 in the TUM set. None is a millimetre where images hold
            whole numbers, else a metre.

        Returns
        -------
        Scan
            With the limits and the standard deviation of each beam, where the camera has any
            noise.

        Raises
        ------
        ValueError
            When images are not as large as those of the camera, or there is not one a pose.

        Examples
        --------
        >>> import numpy as np, primfit
        >>> camera = primfit.DepthCamera.kinect()
        >>> camera.scan(np.full((480, 640), 1500, dtype=np.uint16))
        Scan(307200 beams from 1 pose, 307200 returns, sigma 4.77337 mm)
        """
        from primfit.scans.scanning import as_transforms, scan_of

        images = np.asarray(depth_images)
        size = (self.height, self.width)
        if images.ndim not in (2, 3) or images.shape[-2:] != size:
            raise ValueError(
                f"depth_images must have shape {size} or (p, {self.height}, {self.width}), not "
                f"{images.shape}"
            )
        images = images.reshape(-1, *size)
        if poses is None:
            if len(images) != 1:
                raise ValueError(f"poses must be given, one for each of {len(images)} images")
            poses = np.eye(4)
        if scale is None:
            scale = _MILLIMETRE if images.dtype.kind in "iu" else 1.0
        transforms, planar = as_transforms(poses, self)
        if len(transforms) != len(images):
            raise ValueError(
                f"poses must be one for each of {len(images)} images, not {len(transforms)}"
            )
        missing = np.nan if self.shadow or self.stereo else np.inf
        ranges = (depths_of(images, scale, missing=missing) / self.directions[..., 2]).ravel()
        scan = scan_of(self, transforms, ranges, path=planar)
        return scan if self.has_noise else replace(scan, sigma=None)

    @property
    def has_noise(self) -> bool:
        """Whether any noise or step of it is known."""
        return bool(np.any(self.sigma_at([self.min_depth, self.max_depth])))

    @cached_property
    def _directions(self) -> Floats:
        pinhole = Pinhole(self.fx, self.fy, self.cx, self.cy)
        directions = pinhole.directions(self.width, self.height)
        directions.flags.writeable = False
        return directions


def _as_noise(noise: Any) -> tuple[float, float, float]:
    """Constant, square and offset, metres."""
    if np.ndim(noise) == 0:
        return number("axial_noise", noise, low=0.0), 0.0, 0.0
    if np.shape(noise) != (3,):
        raise ValueError(
            f"axial_noise must be a number or (constant, square, offset), not {noise!r}"
        )
    constant, square, offset = (number("axial_noise", each) for each in noise)
    if constant < 0.0 or square < 0.0:
        raise ValueError(
            f"axial_noise must have a constant and square of at least 0, not {noise!r}"
        )
    return constant, square, offset
