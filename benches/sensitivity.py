"""Which settings of the likelihood matter: each halved and doubled, on a few scenes.

    python benches/sensitivity.py --jobs 2
    python benches/sensitivity.py carving. .least_ --scenes room low_walls --seeds 1 3

Every number within `LikelihoodSettings`, and every tuple of numbers as a whole, is changed by
itself. A row tells, for half and for twice the value, how many more (or fewer) solids are found, of
the right kind and spurious, and how many more rooms are right; the median, over solids that both
found, of the error of the centre over that by the defaults; and the ratio of CPU seconds. "same"
is a value that cannot be changed, "no effect" one by which nothing at all changes, neither what is
found nor its covariance; words are errors. What has no effect on these scenes may have one on
others, as polygons on rooms with more than four walls: ask again with `--scenes`. Names, or parts
of them, restrict the table. The default takes some eight CPU seconds a change, half an hour in all.
"""

from __future__ import annotations

import argparse
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from judging import judge
from scenes import SCENES, Scene
from settings_tree import Path, changed, name_of, numbers, scaled

import primfit
from primfit.likelihood.settings import LikelihoodSettings

FACTORS = (0.5, 2.0)

SMALL: dict[str, tuple[str, dict[str, Any]]] = {
    "reference": ("reference", {"sigma": 0.05}),
    "quiet": ("reference", {"sigma": 0.01}),
    "paper": ("paper", {"spacing": 0.8}),
    "room": ("room", {"spacing": 1.5}),
    "rough": ("rough", {}),
}
"""Scenes by default: the reference with two noises, and smaller ones of three other kinds."""

Map = tuple[str, int]
"""Name in `SMALL`, or else in `SCENES`, and seed."""


@dataclass(frozen=True)
class Outcome:
    """What came of one scene, or of several together.

    Attributes
    ----------
    counting : int
        Solids that the beams can tell.
    counts : (4,) int
        Of these found and of the right kind; spurious ones; rooms right.
    centers : (n,) float, metres
        Errors of the centres of all solids; NaN for those not found.
    cpu : float, seconds
    content : tuple
        All that was found, to be compared.
    """

    counting: int
    counts: np.ndarray
    centers: np.ndarray
    cpu: float
    content: tuple


@cache
def scene_of(name: str, seed: int) -> Scene:
    make, changes = SMALL.get(name, (name, {}))
    return SCENES[make](seed, **changes)


def outcome(maps: list[Map], settings: LikelihoodSettings, limit: float) -> Outcome:
    """What comes of some scenes by some settings."""
    counting, counts, centers, seconds, content = 0, np.zeros(4, int), [], 0.0, []
    for name, seed in maps:
        scene = scene_of(name, seed)
        start = time.process_time()
        with at_most(limit):
            found = primfit.detect(scene.scan, "likelihood", rng=seed, settings=settings, n_jobs=1)
        seconds += time.process_time() - start
        verdict = judge(scene, found)
        counting += verdict.counting
        counts += (verdict.found, verdict.kind, verdict.spurious, verdict.room == "right")
        report = primfit.evaluate(found, scene.world)
        centers += [row.center_error_mm / 1e3 for row in report.rows]
        solids = [(s.kind, s.footprint.tobytes(), s.covariance.tobytes()) for s in found.solids]
        room = None if found.arena is None else found.arena.footprint.tobytes()
        content.append((tuple(solids), room))
    return Outcome(counting, counts, np.array(centers), seconds, tuple(content))


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Ends what takes longer by a TimeoutError."""

    def stop(*_: Any) -> None:
        raise TimeoutError(f"more than {seconds:g} s a scene")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def outcome_or_error(
    change: tuple[Path, Any], maps: list[Map], base: LikelihoodSettings, limit: float
) -> Outcome | str:
    """What comes of one change, or the error that it leads to."""
    try:
        return outcome(maps, changed(base, *change), limit)
    except Exception as error:  # whatever a senseless value leads to
        return f"{type(error).__name__}: {error}"


def cell(usual: Outcome, other: Outcome | str | None) -> str:
    """The effect of one change on found, kind, spurious, rooms, error of centres, CPU."""
    if other is None:
        return "same"
    if isinstance(other, str):
        return other[:60]
    more = " ".join(f"{n:+d}" if n else "0" for n in other.counts - usual.counts)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = other.centers / usual.centers
    ratios = ratios[np.isfinite(ratios)]
    error = f"x{np.median(ratios):.2f}" if len(ratios) else "-"
    text = f"{more}, {error}, {other.cpu / usual.cpu:.2f}"
    return text if other.content != usual.content else f"no effect, {other.cpu / usual.cpu:.2f}"


def has_no_effect(usual: Outcome, others: list[Outcome | str | None]) -> bool:
    """Whether none of the changes that could be made changed anything."""
    made = [other for other in others if other is not None]
    return bool(made) and all(
        isinstance(other, Outcome) and other.content == usual.content for other in made
    )


def shown(value: Any) -> str:
    if isinstance(value, tuple):
        return "(" + ", ".join(f"{each:g}" for each in value) + ")"
    return f"{value:g}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=[""], help="of settings, or parts of them")
    parser.add_argument(
        "--scenes", nargs="+", default=list(SMALL), choices=list(SMALL | SCENES), metavar="scene"
    )
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 1), metavar=("FIRST", "N"))
    parser.add_argument("--limit", type=float, default=60.0, help="seconds a scene")
    parser.add_argument("--jobs", type=int, default=1, help="processes, of one thread each")
    options = parser.parse_args()
    first, n = options.seeds
    maps = [(name, seed) for name in options.scenes for seed in range(first, first + n)]
    base = LikelihoodSettings()
    chosen = [
        (path, value)
        for path, value in numbers(base)
        if any(part in name_of(path) for part in options.names)
    ]
    changes = [(path, scaled(value, factor)) for path, value in chosen for factor in FACTORS]
    usual_values = [value for _, value in chosen for _ in FACTORS]
    made = [each for each, usual in zip(changes, usual_values, strict=True) if each[1] != usual]
    outcome(maps, base, options.limit)  # what is slow only once
    usual = outcome(maps, base, options.limit)
    found, kind, spurious, rooms = usual.counts
    print(
        f"primfit {primfit.__version__}, {len(maps)} scenes ({', '.join(options.scenes)}; seeds "
        f"{first} to {first + n - 1}): of {usual.counting} solids that count {found} found, {kind} of "
        f"the right kind, {spurious} spurious, {rooms} rooms right, centre median "
        f"{1e3 * np.nanmedian(usual.centers):.3f} mm, {usual.cpu:.1f} CPU s; {len(chosen)} settings\n"
        "\nFound, kind, spurious, rooms; error of centres; CPU.\n\n"
        "| setting | value | halved | doubled | |\n|---|---|---|---|---|",
        flush=True,
    )
    job = partial(outcome_or_error, maps=maps, base=base, limit=options.limit)
    idle = []
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        results = (map if options.jobs == 1 else pool.map)(job, made)
        for path, value in chosen:
            others = [
                next(results) if scaled(value, factor) != value else None for factor in FACTORS
            ]
            mark = ""
            if has_no_effect(usual, others):
                mark = "NO EFFECT"
                idle.append(name_of(path))
            cells = " | ".join(cell(usual, other) for other in others)
            print(f"| `{name_of(path)}` | {shown(value)} | {cells} | {mark} |", flush=True)
    print(f"\n{len(idle)} of {len(chosen)} without any effect: {', '.join(idle) or 'none'}")


if __name__ == "__main__":
    main()
