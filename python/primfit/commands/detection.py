"""The command that finds planes and solids."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import primfit
from primfit.commands.common import (
    AsJson,
    Method,
    Progress,
    Seed,
    View,
    bar,
    check_folders,
    explained,
    say,
)


@explained
def detect(
    file: Annotated[
        Path,
        typer.Argument(
            help="A scan of primfit (.npz), a cloud, or a recording of ROS (.bag .mcap .db3 or the "
            "folder of one)."
        ),
    ],
    world: Annotated[Path | None, typer.Option(help="The truth (.json), to compare with.")] = None,
    method: Annotated[
        Method | None,
        typer.Option(
            help="If none is given, what the file holds decides: likelihood for scans of primfit, "
            "paper for clouds of upright walls without tops (likelihood with --origin), planes, "
            "which are solids in any position, for other clouds."
        ),
    ] = None,
    orientation: Annotated[
        Literal["vertical", "horizontal", "any"] | None,
        typer.Option(
            help="Of planes. If none is given, vertical for the paper method, which sees solids in "
            "vertical ones, and any for planes."
        ),
    ] = None,
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Where the sensor of a cloud was (x y z), metres."),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(help="Of a recording: its clouds or laser scans.")
    ] = None,
    message: Annotated[
        int | None, typer.Option(min=0, help="Of a recording: which message; the first if none.")
    ] = None,
    poses: Annotated[
        str | None,
        typer.Option(help="Of a recording: topic of poses, to take all messages as one scan."),
    ] = None,
    sigma: Annotated[float | None, typer.Option(help="Noise, metres; estimated if none.")] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Greatest distance of a plane's point, metres.")
    ] = None,
    min_points: Annotated[int | None, typer.Option(help="Least points of a plane.")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="By how much solids may be off the shapes that they are called by, metres; 2 % of "
            "their size if none. For the likelihood."
        ),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Picture to write (.png).")] = None,
    view: View = None,
    cloud: Annotated[Path | None, typer.Option(help="Coloured cloud to write (.ply ...).")] = None,
    mesh: Annotated[Path | None, typer.Option(help="Solids to write (.ply .obj .stl).")] = None,
    csv: Annotated[Path | None, typer.Option(help="Table of solids to write.")] = None,
    tiles: Annotated[
        float | None,
        typer.Option(
            help="Find planes alone, by square tiles of this side, metres, in .las and .laz files "
            "that need not fit into memory; labels go to FILE_planes.npy, a number a point."
        ),
    ] = None,
    halo: Annotated[
        float | None, typer.Option(help="How far beyond its border a tile sees, metres.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes for tiles.")] = None,
    rng: Seed = 0,
    as_json: AsJson = False,
    progress: Progress = True,
) -> None:
    """Find planes and solids in a scan or cloud; a cloud is also written coloured by plane."""
    check_folders(picture, view, cloud, mesh, csv)
    if tiles is not None:
        others = {"world": world, "topic": topic, "message": message, "poses": poses}
        others |= {"picture": picture, "view": view, "cloud": cloud, "mesh": mesh, "csv": csv}
        _refuse(others | {"tolerance": tolerance}, "--tiles, which finds planes alone")
        if method not in (None, "planes"):
            raise ValueError(f"--tiles is for --method planes, not {method}")
        wishes = {"orientation": orientation or "any", "origins": origin, "sigma": sigma}
        wishes |= {"threshold": threshold, "min_points": min_points, "tiles": tiles, "halo": halo}
        _detect_by_tiles(file, jobs or 1, as_json, wishes | {"progress": bar(progress)})
        return
    if halo is not None or jobs is not None:
        raise ValueError("--halo and --jobs are for --tiles")
    truth = None if world is None else primfit.World.load(world)
    recorded = _read(file, origin, topic, message, poses)
    n_left_out = int(recorded.is_blank.sum())
    is_scan = recorded.pose_index is not None
    chosen, reason = (method, "asked for") if method else primfit.choose_method(recorded)
    options: dict[str, Any] = {"sigma": sigma, "progress": bar(progress)}
    if chosen == "paper":
        options["settings"] = primfit.PaperSettings(
            threshold=threshold, min_points=min_points or 10
        )
    elif chosen == "planes":
        options |= {"threshold": threshold, "min_points": min_points}
    elif threshold is not None or min_points is not None or orientation is not None:
        raise ValueError(
            "--threshold, --min-points and --orientation are wishes for planes, which --method "
            f"paper and planes take, not {chosen} ({reason})"
        )
    if orientation:
        options["orientation"] = orientation
    if tolerance is not None:
        if chosen != "likelihood":
            raise ValueError(f"--tolerance is for --method likelihood, not {chosen} ({reason})")
        options["tolerance"] = tolerance
    found = primfit.detect(recorded, method, rng=rng, **options)
    if not is_scan:
        picture = picture or Path(f"{file.stem}_planes.png")
        cloud = cloud or Path(f"{file.stem}_planes.ply")
    written = _write(found, picture=picture, cloud=cloud, mesh=mesh, csv=csv)
    if view:
        found.show(view, world=truth)
        written.append(view)
    report = None if truth is None else primfit.evaluate(found, truth)
    if as_json:
        content = found.to_dict() | {"report": report and report.to_dict()}
        say(json.dumps(content | {"written": [str(path) for path in written]}))
        return
    say(f"{recorded!r}" + (f", {n_left_out} rows without a point" if n_left_out else ""))
    say(f"{found!r}")
    say(f"method {found.method}: {reason}")
    numbers = {key: x for key, x in found.settings.items() if not isinstance(x, str | bool)}
    say(", ".join(f"{key} {x:.4g}" for key, x in numbers.items()))
    say(_planes_table(found))
    for solid in found.solids:
        say(f"{solid!r}")
    if report:
        say(f"\n{report}")
    for path in written:
        say(f"written: {path}")


def _refuse(options: dict[str, Any], by: str) -> None:
    for name, value in options.items():
        if value is not None:
            raise ValueError(f"--{name} does not go with {by}")


def _detect_by_tiles(file: Path, jobs: int, as_json: bool, wishes: dict[str, Any]) -> None:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    import numpy as np

    from primfit._files import replacing

    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as executor:
        wishes["executor"] = executor if jobs > 1 else None
        planes = primfit.detect_planes(file, **wishes)
    out = Path(f"{file.stem}_planes.npy")
    with replacing(out) as part, part.open("wb") as stream:
        np.save(stream, planes.labels)
    if as_json:
        rows = [
            {
                "equation": plane.equation.tolist(),
                "covariance": plane.covariance.tolist(),
                "n_inliers": len(plane.inliers),
                "area": plane.area,
                "rms": plane.rms,
                "boundary": plane.boundary.tolist(),
            }
            for plane in planes
        ]
        content = {"planes": rows, "sigma": planes.sigma, "settings": planes.settings}
        say(json.dumps(content | {"written": [str(out)]}))
        return
    say(f"{planes!r}")
    say(", ".join(f"{key} {x:.4g}" for key, x in planes.settings.items()))
    say(_table(planes.planes, planes.labels))
    say(f"written: {out}")


def _read(
    file: Path,
    origin: tuple[float, float, float] | None,
    topic: str | None,
    message: int | None,
    poses: str | None,
) -> primfit.Scan:
    from itertools import islice

    from primfit.scans.bags import is_bag
    from primfit.scans.recorded import as_scan

    content: Any = file
    if is_bag(file):
        if poses is not None:
            return primfit.read_scan(file, topic, poses)
        clouds = list(islice(primfit.read_clouds(file, topic), (message or 0) + 1))
        if len(clouds) <= (message or 0):
            raise ValueError(f"--message must be below {len(clouds)}, the number of messages")
        content = clouds[-1]
    elif (topic, message, poses) != (None, None, None):
        raise ValueError("--topic, --message and --poses are for recordings of ROS")
    recorded = as_scan(content)
    if origin and recorded.pose_index is not None:
        raise ValueError("--origin is for clouds: the scan knows where its beams began")
    if recorded.is_blank.all():
        raise ValueError(f"{file} holds no finite point")
    return as_scan(recorded.points, origin) if origin else recorded


def _write(
    found: primfit.Detection,
    *,
    picture: Path | None,
    cloud: Path | None,
    mesh: Path | None,
    csv: Path | None,
) -> list[Path]:
    from primfit import plotting

    if cloud:
        rows = found.scan.is_return
        colors = plotting.plane_colors(len(found.planes))[found.labels[rows]]
        fields = {"color": colors, "label": found.labels[rows]}
        primfit.write_cloud(cloud, primfit.Cloud(found.scan.points[rows], fields))
    if picture:
        plotting.save_detection(picture, found)
    if mesh:
        found.save_mesh(mesh)
    if csv:
        found.to_csv(csv)
    return [path for path in (picture, cloud, mesh, csv) if path]


def _planes_table(found: primfit.Detection) -> str:
    return _table(found.planes, found.labels[found.scan.is_return])


def _table(planes: Sequence[primfit.Plane], labels: Any) -> str:
    from primfit._tables import PLANES, plane_row

    order = sorted(range(len(planes)), key=lambda i: -len(planes[i].inliers))
    rows = [PLANES, *(plane_row(i, planes[i]) for i in order)]
    lines = ["{:>5}  {:>8}  {:>9}  {:>8}  {}".format(*row) for row in rows]
    share = (labels >= 0).mean()
    lines.append(f"{len(planes)} planes hold {share:.1%} of the points")
    return "\n".join(lines)
