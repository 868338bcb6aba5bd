"""Small maps, and the beams around a solid of one, as the likelihood sees them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import primfit
from primfit.likelihood.beam_model import BeamModel
from primfit.likelihood.fitting import Fit, Top
from primfit.likelihood.footprint_models import FreePolygon
from primfit.likelihood.hypotheses import Candidate
from primfit.likelihood.scene import Recording, Scene
from primfit.likelihood.settings import LikelihoodSettings

ROOM = primfit.World([], primfit.Arena((1, 1)))


def in_room(*solids, size=1.0):
    """Solids in a square room."""
    return primfit.World(list(solids), primfit.Arena((size, size)))


def scanned(world, noise, seed, spacing=0.25, **changes):
    """A scan from a grid of poses."""
    path = primfit.grid_path(world, spacing, rng=seed)
    return primfit.scan(world, path, primfit.Lidar(noise=noise, **changes), rng=seed)


def scene_of(solid, noise, seed=1):
    """A scene with the true room and no solid, and the beams of a scan with one."""
    scan = scanned(in_room(solid), noise, seed)
    sigma = np.full(len(scan), max(noise, 1e-5))
    model = BeamModel(sigma=sigma, min_range=scan.min_range, max_range=scan.max_range)
    scene = Scene(Recording.of(scan), model, 0.0, LikelihoodSettings(), n_jobs=1)
    walls = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    fit = Fit(FreePolygon(4), walls.ravel(), np.zeros((8, 8)), 0.0)
    scene = replace(scene, room=Candidate.unsampled(fit, Top(scene.ceiling, np.nan)))
    return scene, scene.near(solid.center[:2], 0.4)


def rays_of(scan, **changes):
    """The same beams, with other limits of the range."""
    limits = {"min_range": scan.min_range, "max_range": scan.max_range} | changes
    return primfit.Scan.from_rays(
        scan.origins,
        scan.directions,
        scan.ranges,
        scan.sigma,
        pose_index=scan.pose_index,
        **limits,
    )
