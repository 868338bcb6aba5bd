"""The pinhole camera: where the pixel of an image looks, and which point its depth is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, number


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion; x to the right, y down, z forward.

    Attributes
    ----------
    fx, fy : float, pixels
        Focal lengths; not zero. A negative one mirrors its axis, as some renderings need.
    cx, cy : float, pixels
        Principal point; the centre of the first pixel is (0, 0).
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, name, number(name, getattr(self, name)))
        for name in ("fx", "fy"):
            if getattr(self, name) == 0.0:
                raise ValueError(f"{name} must not be zero")

    def points(self, depth: Floats) -> Floats:
        """Points (h, w, 3) of depths (h, w) along the axis; NaN where the depth is."""
        height, width = depth.shape
        x, y = self._slopes(width, height)
        return np.stack([x * depth, y * depth, depth], axis=-1)

    def directions(self, width: int, height: int) -> Floats:
        """Unit directions (h, w, 3) of pixels."""
        x, y = self._slopes(width, height)
        return self.points(1.0 / np.sqrt(x * x + y * y + 1.0))

    def _slopes(self, width: int, height: int) -> tuple[Floats, Floats]:
        """x / z (w,) of columns and y / z (h, 1) of rows."""
        columns, rows = np.arange(width, dtype=float), np.arange(height, dtype=float)
        x: Floats = (columns - self.cx) / self.fx
        y: Floats = (rows[:, None] - self.cy) / self.fy
        return x, y


def points_of_depth(
    depth: ArrayLike, fx: float, fy: float, cx: float, cy: float, *, scale: float = 1.0
) -> Floats:
    """The point of each pixel of a depth image, in the frame of the camera.

    Parameters
    ----------
    depth : (h, w) array of numbers
        Distance along the optical axis, not along the ray. Pixels that are zero, negative or not
        finite have no point.
    fx, fy : float, pixels
        Focal lengths; not zero. A negative one mirrors its axis, as some renderings need.
    cx, cy : float, pixels
        Principal point; the centre of the first pixel is (0, 0).
    scale : float, metres
        Length of one unit of depth: 0.001 for millimetres, 1 / 5000 in the TUM and ICL-NUIM sets.

    Returns
    -------
    points : (h, w, 3) float64, metres
        x to the right, y down, z forward; NaN where there is no point. ``points.reshape(-1, 3)``
        is the cloud, row by row.

    Raises
    ------
    ValueError
        When the image is not (h, w), a focal length is zero, or the scale is not positive.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> image = np.array([[1000, 0], [2000, 2000]], dtype=np.uint16)
    >>> points = primfit.points_of_depth(image, 2.0, 2.0, 0.0, 0.0, scale=0.001)
    >>> points[1, 1]
    array([1., 1., 2.])
    >>> np.isfinite(points).all(axis=-1)
    array([[ True, False],
           [ True,  True]])
    """
    image = np.asarray(depth)
    if image.ndim != 2:
        raise ValueError(f"depth must have shape (h, w), not {image.shape}")
    camera = Pinhole(fx, fy, cx, cy)
    return camera.points(depths_of(image, scale, missing=np.nan))


def depths_of(image: ArrayLike, scale: float, *, missing: float) -> Floats:
    """Depths in metres of images of any shape, `missing` where there is none."""
    depth = np.asarray(image)
    if depth.dtype.kind not in "iuf":
        raise TypeError(f"depth must be an array of numbers, not of {depth.dtype}")
    z = depth * number("scale", scale, above=0.0)
    return np.where(np.isfinite(z) & (z > 0.0), z, missing)
