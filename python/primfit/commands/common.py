"""What commands share: options, errors in a line, what is printed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import primfit

# NumPy and what needs it are imported where a command needs them: help and completion are at once.

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


def bar(wanted: bool) -> bool:
    """Whether to show a bar: if it is wanted, and there is a terminal."""
    return wanted and sys.stderr.isatty()


def say(text: str) -> None:
    """Print a line."""
    sys.stdout.write(text + "\n")


def explained(command: Callable[..., None]) -> Callable[..., None]:
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


def check_folders(*files: Path | None) -> None:
    """Refuse to work for files that cannot be written."""
    for file in files:
        if file is not None and not file.parent.is_dir():
            raise ValueError(f"there is no folder {file.parent} to write {file.name} to")


def world_of_kinds(kinds: list[str] | None, rng: Any) -> primfit.World:
    """Make a random world, of the default kinds if none are given."""
    return primfit.random_world(kinds=kinds, rng=rng) if kinds else primfit.random_world(rng=rng)
