"""How well solids and rooms of the scenes in `scenes.py` are found, and how honestly.

    python benches/scenes_accuracy.py reference room low_walls --seeds 100 10 --jobs 2
    python benches/scenes_accuracy.py paper --seeds 1 5 --set sigma=0.15 --verbose
    python benches/scenes_accuracy.py moved --seeds 1 20 --set static=True

Scenes are made from N seeds from FIRST on. Prints a sum a kind of scene: solids found, kinds right,
spurious ones, and rooms; errors of centres; the share of centres in the 95 % region of their
covariance, and with the tolerance; the largest errors in standard deviations; scenes of which
`detect` warned that something moved, of those where something did and where nothing did; and CPU
seconds. `judging.py` says what counts and what is right.
"""

from __future__ import annotations

import argparse
import time
import traceback
import warnings
from ast import literal_eval
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from judging import SURE, Verdict, judge
from scenes import SCENES, Scene

import primfit


class Run(NamedTuple):
    """The verdict on one scene, or the error that there was instead."""

    seed: int
    verdict: Verdict | None
    cpu: float
    n_beams: int
    error: str = ""


def looked_at(scene: Scene, seed: int, options: dict[str, Any]) -> tuple[Verdict, float]:
    """The verdict on one scene and the CPU seconds that its detection took."""
    start = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = primfit.detect(scene.scan, rng=seed, **options)
    cpu = time.process_time() - start
    told = [(each.category.__name__, str(each.message)) for each in caught]
    return judge(scene, found, told), cpu


def run(seed: int, name: str, changes: dict[str, Any], options: dict[str, Any]) -> Run:
    """Make a scene, look at it, and judge; an error of the detection is a result, too."""
    scene = SCENES[name](seed, **changes)
    try:
        return Run(seed, *looked_at(scene, seed, options), len(scene.scan))
    except Exception as error:  # the others shall still be judged
        place = traceback.extract_tb(error.__traceback__)[-1]
        why = f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})"
        return Run(seed, None, np.nan, len(scene.scan), why)


def line(name: str, result: Run) -> str:
    """One scene."""
    if result.verdict is None:
        return f"{name} {result.seed}: {result.error}"
    v = result.verdict
    worst = max(v.centers_mm, default=np.nan)
    text = (
        f"{name} {result.seed}: {v.n_solids} solids, {v.counting} count, found {v.found}, kind "
        f"{v.kind}, unsure {v.unsure}, spurious {v.spurious}, room {v.room}; worst {worst:.2f} mm, "
        f"{max(v.sigmas, default=np.nan):.1f} sigmas; {result.n_beams} beams, {result.cpu:.1f} CPU s"
    )
    wrong = "".join(f"\n    {true} as {found}" for true, found in v.wrong_kinds)
    return text + wrong + "".join(f"\n    {kind}: {told}" for kind, told in v.warnings)


def summary(name: str, results: list[Run]) -> str:
    """All scenes of a kind."""
    done = [result.verdict for result in results if result.verdict is not None]
    if not done:
        return f"{name}: {len(results)} errors"
    counting = max(sum(v.counting for v in done), 1)

    def share(field: str) -> str:
        number = sum(getattr(v, field) for v in done)
        return f"{100 * number / counting:.1f} %"

    def all_of(field: str) -> np.ndarray:
        return np.fromiter(chain.from_iterable(getattr(v, field) for v in done), float)

    rooms = Counter(v.room for v in done)
    centers, sizes = (all_of(field) for field in ("centers_mm", "sizes"))
    cpu = [result.cpu for result in results if result.verdict is not None]
    lines = [
        f"{name}: {len(results)} scenes, {len(results) - len(done)} errors, {counting} of "
        f"{sum(v.n_solids for v in done)} solids count: found {share('found')}, kind "
        f"{share('kind')}, unsure {share('unsure')}, spurious {sum(v.spurious for v in done)}; of "
        f"{sum(v.seen for v in done)} seen at all {sum(v.reported for v in done)} reported; "
        f"rooms {_counted(rooms)}",
        f"centre median {_median(centers):.3f} mm, {100 * _median(sizes):.3f} % of the size, "
        f"worst {centers.max(initial=0.0):.2f} mm; CPU median {_median(cpu):.2f} s, most "
        f"{max(cpu):.2f} s",
        f"in the 95 % region {_region(all_of('sigmas'))}; with the tolerance "
        f"{_region(all_of('tolerant_sigmas'))}",
    ]
    for should, what in ((True, "where something moved"), (False, "where nothing did")):
        some = [v.warned for v in done if v.should_warn is should]
        if some:
            lines.append(f"warned {what} in {sum(some)} of {len(some)} scenes")
    kinds = Counter(f"{true} as {found}" for v in done for true, found in v.wrong_kinds)
    if kinds:
        lines.append(f"wrong kinds: {_counted(kinds)}")
    told = Counter(kind for v in done for kind, _ in v.warnings)
    if told:
        lines.append(f"warnings: {_counted(told)}")
    return "\n  ".join(lines)


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{what} {number}" for what, number in counter.most_common())


def _median(values: Iterable[float]) -> float:
    values = list(values)
    return float(np.median(values)) if values else np.nan


def _region(sigmas: np.ndarray) -> str:
    if not len(sigmas):
        return "- of 0"
    return f"{np.mean(sigmas <= SURE):.3f} of {len(sigmas)}, largest {sigmas.max():.1f} sigmas"


def assigned(pairs: list[str]) -> dict[str, Any]:
    """Options NAME=VALUE with Python values; what is none is a word."""
    options = {}
    for pair in pairs:
        name, _, text = pair.partition("=")
        try:
            options[name] = literal_eval(text)
        except (ValueError, SyntaxError):
            options[name] = text
    return options


def main() -> None:
    """Judge and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+", choices=list(SCENES), metavar="scene")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 10), metavar=("FIRST", "N"))
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="of the scenes")
    parser.add_argument("--detect", nargs="*", default=[], metavar="NAME=VALUE", help="of detect")
    parser.add_argument("--verbose", action="store_true", help="a line a scene")
    parser.add_argument("--jobs", type=int, default=1, help="processes, of one thread each")
    options = parser.parse_args()
    first, n = options.seeds
    told = {"n_jobs": 1} | assigned(options.detect)
    print(f"primfit {primfit.__version__}, seeds {first} to {first + n - 1}")
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        for name in options.scenes:
            job = partial(run, name=name, changes=assigned(options.set), options=told)
            results = []
            for result in (map if options.jobs == 1 else pool.map)(job, range(first, first + n)):
                results.append(result)
                if options.verbose or result.error:
                    print(line(name, result), flush=True)
            print(summary(name, results), flush=True)


if __name__ == "__main__":
    main()
