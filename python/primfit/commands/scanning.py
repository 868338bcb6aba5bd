"""Commands that scan: demo, scan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import primfit
from primfit.commands.common import (
    AsJson,
    Kinds,
    Method,
    Progress,
    Seed,
    View,
    bar,
    check_folders,
    explained,
    say,
    world_of_kinds,
)

Camera = Literal["kinect", "d435", "range-finder"]


@explained
def demo(
    rng: Seed = None,
    noise: Annotated[float, typer.Option(help="Noise, as a fraction of the range of 1 m.")] = 0.0,
    method: Annotated[Method, typer.Option(help="How to find the solids.")] = "likelihood",
    kind: Kinds = None,
    picture: Annotated[Path, typer.Option(help="Picture to write.")] = Path("demo.png"),
    view: View = None,
    as_json: AsJson = False,
    progress: Progress = True,
) -> None:
    """Do the paper's job on a random map: print its table and write a picture."""
    import numpy as np

    from primfit import plotting

    check_folders(picture, view)
    seed = int(np.random.SeedSequence().generate_state(1)[0]) if rng is None else rng
    world = world_of_kinds(kind, seed)
    path = primfit.grid_path(world, rng=seed)
    lidar = primfit.Lidar(noise=noise)
    scan = primfit.scan(world, path, lidar, rng=seed, progress=bar(progress))
    found = primfit.detect(scan, method, rng=seed, progress=bar(progress))
    report = primfit.evaluate(found, world)
    plotting.save_demo(picture, world, scan, found, report.verdict)
    if view:
        found.show(view, world=world)
    if as_json:
        say(json.dumps({"rng": seed, "report": report.to_dict(), "found": found.to_dict()}))
        return
    say(f"{world!r}, rng {seed}\n{scan!r}\n\n{report}\n\nThe picture is in {picture}")


@explained
def scan(
    out: Annotated[
        Path, typer.Argument(help="Scan to write: .npz; or a cloud: .ply .pcd .xyz ...")
    ],
    world: Annotated[
        Path | None, typer.Option(help="World to scan (.json); a random one if none is given.")
    ] = None,
    save_world: Annotated[Path | None, typer.Option(help="Where to write the world.")] = None,
    camera: Annotated[
        Camera | None, typer.Option(help="Depth camera to scan with instead of a lidar.")
    ] = None,
    noise: Annotated[
        float | None, typer.Option(help="Noise of the lidar, as a fraction of --max-range; none.")
    ] = None,
    layers: Annotated[int | None, typer.Option(help="Layers of the lidar; 8 if none.")] = None,
    columns: Annotated[int | None, typer.Option(help="Columns of the lidar; 100 if none.")] = None,
    max_range: Annotated[
        float | None, typer.Option(help="Longest range of the lidar, metres; 1 if none.")
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(help="Distance between positions, metres; 0.25 if none, 1 for a camera."),
    ] = None,
    headings: Annotated[int, typer.Option(help="Headings at each position.")] = 4,
    kind: Kinds = None,
    rng: Seed = None,
    progress: Progress = True,
) -> None:
    """Scan a world from a grid of poses, with a lidar or a depth camera."""
    from primfit._check import generator

    check_folders(out, save_world)
    if world and kind:
        raise ValueError("--kind is for random worlds, not for that of --world")
    numbers = generator(rng)
    scene = primfit.World.load(world) if world else world_of_kinds(kind, numbers)
    sensor = _sensor(
        camera,
        noise=noise,
        number_of_layers=layers,
        horizontal_resolution=columns,
        max_range=max_range,
    )
    if spacing is None:
        spacing = 0.25 if camera is None else 1.0
    path = primfit.grid_path(scene, spacing, headings=headings, rng=numbers)
    result = primfit.scan(scene, path, sensor, rng=numbers, progress=bar(progress))
    if out.suffix.lower() == ".npz":
        result.save(out)
    else:
        primfit.write_points(out, result.points[result.is_return])
    if save_world:
        scene.save(save_world)
    say(f"{scene!r}\n{result!r}\nwritten to {out}")


def _sensor(camera: Camera | None, **lidar: float | None) -> primfit.Lidar | primfit.DepthCamera:
    """A depth camera by its preset, or a lidar with what of it was told."""
    told: dict[str, Any] = {name: x for name, x in lidar.items() if x is not None}
    if camera is None:
        return primfit.Lidar(**told)
    if told:
        raise ValueError(
            f"--noise, --layers, --columns and --max-range are for a lidar, not --camera {camera}"
        )
    presets = {
        "kinect": primfit.DepthCamera.kinect,
        "d435": primfit.DepthCamera.realsense_d435,
        "range-finder": primfit.DepthCamera.range_finder,
    }
    return presets[camera]()
