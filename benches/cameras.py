"""Depth cameras: how fast they scan, whether they are as noisy as they say, what is found by them.

    python benches/cameras.py speed --repeat 20
    python benches/cameras.py noise --poses 20
    python benches/cameras.py maps --maps 30 --camera kinect --jobs 1

`speed`: CPU milliseconds of one image on one thread, median, for 640 x 480 pixels without noise, a
Kinect and a D435, beside those of casting the same rays alone. `noise`: points of the depth images
against the points of the scan, and the rms of depths against the sigma that the camera tells, by
depth. `maps`: solids of random maps by the likelihood, from images of 80 x 60 pixels at the poses of
the reference; map i is made, scanned and looked at from seed rng + i. Cameras: "axial" has the
Kinect's axial noise alone, "kinect" also its steps of disparity and its shadow, "stereo" the D435's
noise, steps, shadow and blind columns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import Any

import numpy as np
from accuracy import KINDS, judged, summary

import primfit

BINS = (0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
"""Edges of depths, metres."""

AXIAL = (0.0012, 0.0019, 0.4)
SMALL = {
    "axial": {"axial_noise": AXIAL},
    "kinect": {
        "axial_noise": AXIAL,
        "baseline": 0.075,
        "disparity_step": 0.125 / 8,
        "shadow": True,
    },
    "stereo": {
        "baseline": 0.05,
        "disparity_noise": 0.08 / 5,
        "disparity_step": 1 / 32 / 5,
        "shadow": True,
        "stereo": True,
    },
}
"""Cameras whose focal length in pixels is an eighth of a Kinect's, or less than a fifth of a D435's:
disparities in pixels are divided by 8 and 5, so that depths are as noisy, or a little more."""


def small(name: str) -> primfit.DepthCamera:
    """A camera of 80 x 60 pixels over 57 degrees that sees 0.05 to 1.5 m."""
    focal = 40 / np.tan(np.radians(57.0) / 2)
    return primfit.DepthCamera(80, 60, focal, focal, min_depth=0.05, max_depth=1.5, **SMALL[name])


def cpu_ms(call: Callable[[], Any], repeat: int) -> float:
    """CPU milliseconds of a call, median."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def speed(options: argparse.Namespace) -> None:
    """Images of a map from one pose."""
    world = primfit.random_world(12, 3.0, rng=options.rng)
    pose = primfit.grid_path(world, 0.4, rng=options.rng)[0]
    cameras = {
        "640 x 480 exact": primfit.DepthCamera(),
        "640 x 480 Kinect": primfit.DepthCamera.kinect(min_depth=0.2),
        "848 x 480 D435": primfit.DepthCamera.realsense_d435(min_depth=0.1),
    }
    caster = primfit.RayCaster(world)
    for name, camera in cameras.items():
        scan = primfit.scan(world, pose, camera, rng=1)
        rays = scan.origins, scan.directions
        alone = cpu_ms(partial(caster.cast, *rays, 1), options.repeat)
        whole = cpu_ms(partial(primfit.scan, world, pose, camera, rng=1, n_jobs=1), options.repeat)
        print(f"{name}: {whole:.1f} ms of CPU; cast alone {alone:.1f}")


def noise(options: argparse.Namespace) -> None:
    """Round trip, and rms of depths over what the camera says."""
    world = primfit.random_world((8, 10), 6.0, rng=options.rng)
    path = primfit.grid_path(world, 0.7, rng=options.rng)[: options.poses]
    for name in ("kinect", "realsense_d435"):
        camera = getattr(primfit.DepthCamera, name)(min_depth=0.2, max_depth=5.0)
        intrinsics = camera.fx, camera.fy, camera.cx, camera.cy
        exact = primfit.DepthCamera(
            camera.width, camera.height, *intrinsics, min_depth=0.2, max_depth=5.0
        )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.mount[:3, :3], [*path[0, :2], 0.06]
        scan = primfit.scan(world, pose, camera, rng=1)
        points = primfit.points_of_depth(scan.image("depth")[0], *intrinsics).reshape(-1, 3)
        off = points @ pose[:3, :3].T + pose[:3, 3] - scan.points
        is_same = np.array_equal(np.isnan(off[:, 0]), ~scan.is_return)
        print(f"{name}: round trip {np.nanmax(np.abs(off)):.1e} m, the same pixels: {is_same}")
        measured = primfit.scan(world, path, camera, rng=1).image("depth")
        true = primfit.scan(world, path, exact, rng=1).image("depth")
        known = np.isfinite(measured)
        error, depth = (measured - true)[known], true[known]
        told = camera.sigma_at(depth)
        for low, high in pairwise(BINS):
            some = (depth >= low) & (depth < high)
            if some.any():
                rms, sigma = (1e3 * np.sqrt(np.mean(x[some] ** 2)) for x in (error, told))
                print(
                    f"  {low} to {high} m, {some.sum():8d} pixels: rms {rms:7.3f} mm, told "
                    f"{sigma:7.3f}, ratio {rms / sigma:.4f}"
                )


def run(seed: int, camera: str) -> dict:
    """One map."""
    rng = np.random.default_rng(seed)
    world = primfit.random_world((5, 7), 2.0, KINDS, rng)
    path = primfit.grid_path(world, 0.25, rng=rng)
    return judged(world, primfit.scan(world, path, small(camera), rng=rng))


def maps(options: argparse.Namespace) -> None:
    """What the likelihood finds."""
    seeds = range(options.rng, options.rng + options.maps)
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as executor:
        results = list(executor.map(partial(run, camera=options.camera), seeds))
    rows = [row for result in results for row in result["rows"]]
    right = np.mean([row["truth"] == row["found"] for row in rows])
    lost = np.array([result["lost"] for result in results])
    print(f"{options.camera}\n  {summary(results)}")
    print(
        f"  right {right:.3f}; lost, of beams that should return: median {np.median(lost):.4f}, "
        f"most {lost.max():.4f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["speed", "noise", "maps"])
    parser.add_argument("--camera", choices=SMALL, default="kinect")
    parser.add_argument("--maps", type=int, default=30)
    parser.add_argument("--poses", type=int, default=20)
    parser.add_argument("--repeat", type=int, default=20)
    parser.add_argument("--rng", type=int, default=7)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(f"primfit {primfit.__version__}, {vars(options)}")
    {"speed": speed, "noise": noise, "maps": maps}[options.what](options)


if __name__ == "__main__":
    main()
