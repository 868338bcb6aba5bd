"""The command line: demo, scan, detect, reproduce."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import primfit

# NumPy and what needs it are imported where a command needs them: help and completion are at once.

app = typer.Typer(
    help="LiDAR scans to solid geometry.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Seed = Annotated[int | None, typer.Option("--rng", help="Seed; the same gives the same result.")]
Kinds = Annotated[
    list[str] | None,
    typer.Option("--kind", help="Kind of the random solids, again for more: circle, star, ..."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
View = Annotated[
    Path | None, typer.Option(help="Page to write (.html) in which the result can be turned.")
]
Progress = Annotated[bool, typer.Option(help="Show a bar, where a terminal is looking.")]
Method = Literal["likelihood", "planes", "paper"]


def _bar(wanted: bool) -> bool:
    return wanted and sys.stderr.isatty()


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")


def _explained(command: Callable[..., None]) -> Callable[..., None]:
    """Turn errors that users can mend into one line and exit status 2."""

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except BrokenPipeError:
            raise typer.Exit(1) from None
        except (ValueError, TypeError, OSError, MemoryError, ModuleNotFoundError) as error:
            typer.echo(f"primfit: {error}", err=True)
            raise typer.Exit(2) from None

    return run


def _check_folders(*files: Path | None) -> None:
    """Refuse to work for files that cannot be written."""
    for file in files:
        if file is not None and not file.parent.is_dir():
            raise ValueError(f"there is no folder {file.parent} to write {file.name} to")


def _version(wanted: bool) -> None:
    if wanted:
        _say(f"primfit {primfit.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
@_explained
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

    _check_folders(picture, view)
    seed = int(np.random.SeedSequence().generate_state(1)[0]) if rng is None else rng
    world = _random_world(kind, seed)
    path = primfit.grid_path(world, rng=seed)
    lidar = primfit.Lidar(noise=noise)
    scan = primfit.scan(world, path, lidar, rng=seed, progress=_bar(progress))
    found = primfit.detect(scan, method, rng=seed, progress=_bar(progress))
    report = primfit.evaluate(found, world)
    plotting.save_demo(picture, world, scan, found, report.verdict)
    if view:
        found.show(view, world=world)
    if as_json:
        _say(json.dumps({"rng": seed, "report": report.to_dict(), "found": found.to_dict()}))
        return
    _say(f"{world!r}, rng {seed}\n{scan!r}\n\n{report}\n\nThe picture is in {picture}")


def _random_world(kinds: list[str] | None, rng: Any) -> primfit.World:
    return primfit.random_world(kinds=kinds, rng=rng) if kinds else primfit.random_world(rng=rng)


@app.command()
@_explained
def scan(
    out: Annotated[
        Path, typer.Argument(help="Scan to write: .npz; or a cloud: .ply .pcd .xyz ...")
    ],
    world: Annotated[
        Path | None, typer.Option(help="World to scan (.json); a random one if none is given.")
    ] = None,
    save_world: Annotated[Path | None, typer.Option(help="Where to write the world.")] = None,
    noise: Annotated[float, typer.Option(help="Noise, as a fraction of --max-range.")] = 0.0,
    layers: Annotated[int, typer.Option(help="Layers of the lidar.")] = 8,
    columns: Annotated[int, typer.Option(help="Columns of the lidar.")] = 100,
    max_range: Annotated[float, typer.Option(help="Longest range, metres.")] = 1.0,
    spacing: Annotated[float, typer.Option(help="Distance between positions, metres.")] = 0.25,
    headings: Annotated[int, typer.Option(help="Headings at each position.")] = 4,
    kind: Kinds = None,
    rng: Seed = None,
    progress: Progress = True,
) -> None:
    """Scan a world from a grid of poses."""
    from primfit._check import generator

    _check_folders(out, save_world)
    if world and kind:
        raise ValueError("--kind is for random worlds, not for that of --world")
    numbers = generator(rng)
    scene = primfit.World.load(world) if world else _random_world(kind, numbers)
    lidar = primfit.Lidar(
        number_of_layers=layers, horizontal_resolution=columns, max_range=max_range, noise=noise
    )
    path = primfit.grid_path(scene, spacing, headings=headings, rng=numbers)
    result = primfit.scan(scene, path, lidar, rng=numbers, progress=_bar(progress))
    if out.suffix.lower() == ".npz":
        result.save(out)
    else:
        primfit.write_points(out, result.points[result.is_return])
    if save_world:
        scene.save(save_world)
    _say(f"{scene!r}\n{result!r}\nwritten to {out}")


@app.command()
@_explained
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
    _check_folders(picture, view, cloud, mesh, csv)
    if tiles is not None:
        others = {"world": world, "topic": topic, "message": message, "poses": poses}
        others |= {"picture": picture, "view": view, "cloud": cloud, "mesh": mesh, "csv": csv}
        _refuse(others | {"tolerance": tolerance}, "--tiles, which finds planes alone")
        if method not in (None, "planes"):
            raise ValueError(f"--tiles is for --method planes, not {method}")
        wishes = {"orientation": orientation or "any", "origins": origin, "sigma": sigma}
        wishes |= {"threshold": threshold, "min_points": min_points, "tiles": tiles, "halo": halo}
        _detect_by_tiles(file, jobs or 1, as_json, wishes | {"progress": _bar(progress)})
        return
    if halo is not None or jobs is not None:
        raise ValueError("--halo and --jobs are for --tiles")
    truth = None if world is None else primfit.World.load(world)
    recorded = _read(file, origin, topic, message, poses)
    n_left_out = int(recorded.is_blank.sum())
    is_scan = recorded.pose_index is not None
    chosen, reason = (method, "asked for") if method else primfit.choose_method(recorded)
    options: dict[str, Any] = {"sigma": sigma, "progress": _bar(progress)}
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
        _say(json.dumps(content | {"written": [str(path) for path in written]}))
        return
    _say(f"{recorded!r}" + (f", {n_left_out} rows without a point" if n_left_out else ""))
    _say(f"{found!r}")
    _say(f"method {found.method}: {reason}")
    numbers = {key: x for key, x in found.settings.items() if not isinstance(x, str | bool)}
    _say(", ".join(f"{key} {x:.4g}" for key, x in numbers.items()))
    _say(_planes_table(found))
    for solid in found.solids:
        _say(f"{solid!r}")
    if report:
        _say(f"\n{report}")
    for path in written:
        _say(f"written: {path}")


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
        _say(json.dumps(content | {"written": [str(out)]}))
        return
    _say(f"{planes!r}")
    _say(", ".join(f"{key} {x:.4g}" for key, x in planes.settings.items()))
    _say(_table(planes.planes, planes.labels))
    _say(f"written: {out}")


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


@app.command()
@_explained
def reproduce(
    n: Annotated[
        int, typer.Option("-n", min=1, help="Random worlds behind each row of our reference.")
    ] = 20,
    n_paper: Annotated[
        int,
        typer.Option(min=1, help="The same in the paper's setting, up to 1.9 million beams each."),
    ] = 3,
    setting: Annotated[
        list[str] | None, typer.Option(help="paper or reference; both if none is given.")
    ] = None,
    spacing: Annotated[
        float, typer.Option(help="Distance of positions in the paper's setting, metres.")
    ] = 0.2,
    data: Annotated[
        Path | None,
        typer.Option(
            envvar="PRIMFIT_DATA",
            help="Folder whose authors/test_map_1_shapes.csv is the paper's map, for table 6.",
        ),
    ] = None,
    rng: Seed = 0,
    paper: Annotated[
        bool, typer.Option(help="Show the paper's method beside ours, repaired and literal.")
    ] = True,
    table: Annotated[
        list[int] | None,
        typer.Option(
            min=1,
            max=12,
            help="Number of a table, again for more: 10 is noise 0.06, 11 columns, 12 noisy maps.",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    figure: Annotated[
        Path | None, typer.Option(help="Picture of found and error against noise to write.")
    ] = None,
    as_json: AsJson = False,
    progress: Progress = True,
) -> None:
    """Print every table of the paper beside ours, in its own setting and in our reference."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from primfit import experiments, reproduction

    _check_folders(figure)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as executor:
        tables = reproduction.reproduce(
            n,
            n_paper=n_paper,
            settings=setting or experiments.SETTINGS,
            spacing=spacing,
            data=data,
            rng=rng,
            paper=paper,
            tables=[number - 1 for number in table] if table else None,
            executor=executor if jobs > 1 else None,
            progress=_bar(progress),
        )
    if figure:
        reproduction.save_against_noise(figure, tables[-1])
    if as_json:
        _say(json.dumps([table.to_dict() for table in tables]))
        return
    _say(reproduction.preface(spacing, data))
    for result in tables:
        _say(f"\n{result}")


def main() -> None:
    """Run the command line."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
