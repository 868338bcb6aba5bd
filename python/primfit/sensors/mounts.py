"""Where a sensor sits on its robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, as_vector

E_PUCK_TURRET = (-0.0095, 0.0, 0.0486)
"""Turret slot of the e-puck in the robot's frame, metres (Webots R2022b documentation)."""


def as_mount(mount: Any) -> Floats:
    """A translation (3,), a rigid transform (4, 4) or a robot's slot as ``T_robot_sensor``."""
    if isinstance(mount, str):
        if mount != "e-puck":
            raise ValueError(f'mount must be (3,), (4, 4) or "e-puck", not {mount!r}')
        mount = E_PUCK_TURRET
    if np.shape(mount) == (3,):
        transform = np.eye(4)
        transform[:3, 3] = as_vector("mount", mount, 3)
        return transform
    return check_transforms("mount", mount, np.shape(mount))[()]


def check_transforms(name: str, transforms: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """``transforms`` as finite float64 rigid transforms (..., 4, 4)."""
    try:
        array = np.asarray(transforms, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None
    if array.shape[-2:] != (4, 4):
        raise ValueError(f"{name} must be rigid transforms (..., 4, 4), not shape {shape}")
    rotation = array[..., :3, :3]
    rigid = np.isfinite(array).all(axis=(-2, -1))
    rigid &= np.isclose(np.swapaxes(rotation, -1, -2) @ rotation, np.eye(3), atol=1e-6).all(
        (-2, -1)
    )
    rigid &= np.linalg.det(rotation) > 0
    rigid &= (array[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all(axis=-1)
    if not rigid.all():
        raise ValueError(
            f"{name} must be rigid transforms: a rotation, a translation in metres and the last "
            f"row 0, 0, 0, 1; {int((~rigid).sum())} of {rigid.size} are not"
        )
    return array
