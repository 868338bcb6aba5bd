"""The command that prints the tables of the paper beside ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from primfit.commands.common import AsJson, Progress, Seed, bar, check_folders, explained, say


@explained
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

    check_folders(figure)
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
            progress=bar(progress),
        )
    if figure:
        reproduction.save_against_noise(figure, tables[-1])
    if as_json:
        say(json.dumps([table.to_dict() for table in tables]))
        return
    say(reproduction.preface(spacing, data))
    for result in tables:
        say(f"\n{result}")
