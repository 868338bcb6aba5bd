"""The command line: demo, scan, detect, reproduce."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

import primfit
from primfit.commands.common import say
from primfit.commands.detection import detect
from primfit.commands.reproduction import reproduce
from primfit.commands.scanning import demo, scan

app = typer.Typer(
    help="LiDAR scans to solid geometry.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        say(f"primfit {primfit.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


for command in (demo, scan, detect, reproduce):
    app.command()(command)


def main() -> None:
    """Run the command line."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
