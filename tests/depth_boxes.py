"""Boxes as a depth camera sees them: cut out of the image, wavy, in steps."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

FOCAL = 525.0


def seen_box(rng, size, distance, wave, inside=False):
    """Points (n, 3) of a box in the frame of the camera, one a pixel.

    Of the box, turned about the axis of the camera, three faces are seen.

    The depth errs by `wave`, metres, alike over some 50 pixels, and comes in steps of a disparity of
    1/8 pixel with a baseline of 75 mm. `inside` looks at the far walls, as into a corner of a room.
    """
    turn = Rotation.from_euler("xyz", [0.6, 0.65, rng.uniform(0.0, 6.28)]).as_matrix()
    center = np.array([0.0, 0.0, distance])
    reach = int(FOCAL * 0.6 * np.linalg.norm(size) / (distance - 0.5 * np.linalg.norm(size)))
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    rays = np.column_stack([u / FOCAL, v / FOCAL, np.ones(len(u))])
    own, start = rays @ turn, -center @ turn
    with np.errstate(divide="ignore"):
        near, far = np.sort((np.array([[-1], [1]])[:, None] * size / 2 - start) / own, axis=0)
    enters, leaves = near.max(axis=1), far.min(axis=1)
    depth = np.where(enters < leaves, leaves if inside else enters, np.nan)
    image = depth.reshape(2 * reach + 1, -1)
    smooth = gaussian_filter(rng.normal(size=image.shape), 20.0)
    image = image + wave * smooth / smooth.std()
    disparity = np.rint(8.0 * FOCAL * 0.075 / image)
    image = 8.0 * FOCAL * 0.075 / disparity
    points = rays * image.reshape(-1, 1)
    return points[np.isfinite(points).all(axis=1)]
