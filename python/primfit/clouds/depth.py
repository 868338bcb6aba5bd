"""Depth images to points, by the pinhole camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, number


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
    if image.dtype.kind not in "iuf":
        raise TypeError(f"depth must be an array of numbers, not of {image.dtype}")
    focal = number("fx", fx), number("fy", fy)
    for name, value in zip(("fx", "fy"), focal, strict=True):
        if value == 0.0:
            raise ValueError(f"{name} must not be zero")
    center = number("cx", cx), number("cy", cy)
    z = image * number("scale", scale, above=0.0)
    z = np.where(np.isfinite(z) & (z > 0.0), z, np.nan)
    height, width = image.shape
    x = (np.arange(width) - center[0]) / focal[0] * z
    y = (np.arange(height)[:, None] - center[1]) / focal[1] * z
    return np.stack([x, y, z], axis=-1)
