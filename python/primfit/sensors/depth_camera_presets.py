"""Depth cameras by their data sheets and by files."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import integer, number

if TYPE_CHECKING:
    from primfit.sensors.depth_camera import DepthCamera

MOST_PIXELS = 20_000
"""Rows, or columns, of an image."""


class DepthCameraPresets:
    """Makers of `DepthCamera`, which inherits them."""

    @classmethod
    def kinect(cls, *, mount: ArrayLike = (0.0, 0.0, 0.06), **changes: Any) -> Self:
        """A Kinect of the first generation: 640 x 480 pixels over 57 degrees, 0.8 to 4 m.

        Limits are those of its default mode (Microsoft: Near Mode, what it is and isn't, 2012; 0.4
        to 3 m in near mode), the field of view is Microsoft's. Noise is ``0.0012 + 0.0019 * (z -
        0.4)**2``, measured head-on with all that disturbs a depth (Nguyen, Izadi, Lovell: Modeling
        Kinect Sensor Noise, 3DIMPVT 2012), so with the steps, which are added here: together they
        are at most a seventh too much, never too little. The base of 75 mm and steps of an eighth
        of a pixel are those of the simulator SimKinect (after Handa et al.: A benchmark for RGB-D
        visual odometry, ICRA 2014). That the projector is on the right of the camera, so that
        shadows are to the left of things, is from memory.

        Parameters
        ----------
        mount
            Where it sits, as everywhere.
        **changes
            Parameters of `DepthCamera` that differ, such as ``shadow=False``.

        Examples
        --------
        >>> import primfit
        >>> camera = primfit.DepthCamera.kinect()
        >>> camera.width, camera.max_depth, round(camera.fx, 1)
        (640, 4.0, 589.4)
        """
        sheet = _focal(640, np.radians(57.0)) | {
            "height": 480,
            "min_depth": 0.8,
            "max_depth": 4.0,
            "axial_noise": (0.0012, 0.0019, 0.4),
            "baseline": 0.075,
            "disparity_step": 0.125,
            "shadow": True,
        }
        return cls(**(sheet | {"mount": mount} | changes))

    @classmethod
    def realsense_d435(cls, *, mount: ArrayLike = (0.0, 0.0, 0.06), **changes: Any) -> Self:
        """An Intel RealSense D435: stereo of 848 x 480 pixels over 90 degrees, 0.3 to 3 m.

        The image at which it works best, its field of view, its base of 50 mm and a standard
        deviation of 0.08 pixels of the disparity are those by which its makers draw its error
        (Grunnet-Jepsen, Sweetser, Woodfill: Tuning depth cameras for best performance; a target
        with good texture), steps of 1/32 pixel theirs, too (Subpixel linearity improvement). Limits
        are the range that Intel calls ideal; it measures to 10 m and more. The left camera is the
        image, so the second eye is on the right.

        Parameters
        ----------
        mount, **changes
            As of `DepthCamera.kinect`.

        Examples
        --------
        >>> import primfit
        >>> camera = primfit.DepthCamera.realsense_d435()
        >>> camera.width, round(camera.fx, 1), camera.disparity_noise
        (848, 424.0, 0.08)
        """
        sheet = _focal(848, np.radians(90.0)) | {
            "height": 480,
            "min_depth": 0.3,
            "max_depth": 3.0,
            "baseline": 0.05,
            "disparity_noise": 0.08,
            "disparity_step": 1 / 32,
            "shadow": True,
            "stereo": True,
        }
        return cls(**(sheet | {"mount": mount} | changes))

    @classmethod
    def range_finder(
        cls,
        *,
        field_of_view: float = 0.7854,
        width: int = 64,
        height: int = 64,
        min_range: float = 0.01,
        max_range: float = 1.0,
        noise: float = 0.0,
        resolution: float = -1.0,
        mount: ArrayLike = (0.0, 0.0, 0.06),
    ) -> Self:
        """The node `RangeFinder` of Webots, with its fields and their defaults.

        Its documentation (R2023b): pixels are square, `min_range` and `max_range` are depths, and
        noise and resolution are those of depths. Not its spherical projection, motion blur and
        lens.

        Parameters
        ----------
        field_of_view : float, radians
            Horizontal, less than pi.
        width, height : int, pixels
        min_range, max_range : float, metres
        noise : float
            Standard deviation as a fraction of `max_range`.
        resolution : float, metres
            Step of depths; -1 for none.
        mount
            As everywhere.

        Examples
        --------
        >>> import primfit
        >>> camera = primfit.DepthCamera.range_finder(noise=0.01, max_range=2.0)
        >>> camera.axial_noise[0], camera.directions.shape
        (0.02, (64, 64, 3))
        """
        angle = number("field_of_view", field_of_view, above=0.0)
        if angle >= np.pi:
            raise ValueError(f"field_of_view must be less than pi radians, not {field_of_view!r}")
        columns = integer("width", width, low=1, high=MOST_PIXELS)
        farthest = number("max_range", max_range, above=0.0)
        nearest = number("min_range", min_range, low=0.0)
        if nearest >= farthest:
            raise ValueError(
                f"min_range must be less than max_range={farthest:g}, not {min_range!r}"
            )
        sheet = _focal(columns, angle) | {
            "height": height,
            "min_depth": nearest,
            "max_depth": farthest,
            "axial_noise": number("noise", noise, low=0.0) * farthest,
            "resolution": resolution,
        }
        return cls(**(sheet | {"mount": mount}))

    @classmethod
    def from_webots(cls, file: str | PathLike[str]) -> DepthCamera:
        """The first `RangeFinder` of a world of Webots, with its mount in the frame of its robot.

        Parameters
        ----------
        file : path
            Of R2022a or later (.wbt), where z is up and range finders look along x.

        Raises
        ------
        OSError
            When the file cannot be opened.
        ValueError
            When it is no such world, has no `RangeFinder`, or one whose projection is not planar.

        Examples
        --------
        >>> import primfit, pathlib, tempfile
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "robot.wbt"
        >>> _ = file.write_text("Robot { children RangeFinder { width 80 } }")
        >>> primfit.DepthCamera.from_webots(file).width
        80
        """
        from primfit.scans.webots import camera_of_webots

        return camera_of_webots(file)


def _focal(width: int, field_of_view: float) -> dict[str, Any]:
    """Width and focal lengths of square pixels over a field of view, radians."""
    focal = width / 2 / float(np.tan(field_of_view / 2))
    return {"width": width, "fx": focal, "fy": focal}
