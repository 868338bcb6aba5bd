"""Which settings of the search for planes matter, and how far each depends on which clouds.

    python benches/plane_settings.py --jobs 2
    python benches/plane_settings.py growth. .chance --groups roofs layered --factors 0.7 1.4

Every number by which the search goes is halved and doubled by itself. The score of a cloud is F at
IoU 0.75; the best IoU where only one plane is known; the share of points without a plane where there
is none. That of a group is the mean over its clouds, and that of all the mean over the groups. A row tells how the score of all changes by each factor;
then, with one group after the other left out, which factor is best on the rest (the usual one where
it is as good), and how much the group that was left out would gain by it: what is tuned to some
clouds loses on the others. "no effect" is a number by which no point changes its plane; what has
none here may have one elsewhere.

The recorded groups need PRIMFIT_DATA; without it they are left out.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from plane_scenes import Scene, curved, furnished, layered, prisms, scattered, turns
from planes import scores
from recorded_scenes import boards, halves, os1, roofs

import primfit
from primfit import _primfit
from primfit.planes.surfaces import flat_parts

GROUPS: dict[str, Callable[[Path], list[Scene]]] = {
    "roofs": roofs,
    "board": lambda data: boards(data)[1:2],
    "halves": lambda data: halves(boards(data)[:1]),
    "os1": lambda data: os1(data)[:1],
    "prisms": lambda _: [prisms(25, 1)],
    "turn": lambda _: [turns(1, 1)],
    "furnished": lambda _: [furnished(16, 900, 30.0, 1)],
    "layered": lambda _: layered(1)[:6],
    "curved": lambda _: curved(1)[:3],
    "scattered": lambda _: [scattered(seed) for seed in (1, 2, 3)],
}
"""Clouds by kind; those that take data are recorded ones."""

RECORDED = ("roofs", "board", "halves", "os1")

ONE_PLANE = ("board", "halves", "os1")
"""Groups of whose planes only one is known."""

NO_PLANE = ("curved", "scattered")
"""Groups whose clouds have no plane."""

Change = tuple[str, float] | None
"""Name of a setting and factor; None leaves all as they are."""


@cache
def scenes_of(group: str, data: Path) -> list[Scene]:
    return GROUPS[group](data)


def outcome(change: Change, groups: list[str], data: Path) -> tuple[np.ndarray, list[bytes], float]:
    """Score of each group (g,), the labels of all clouds, and CPU seconds."""
    factors = [] if change is None else [change]
    means, contents = [], []
    start = time.process_time()
    for group in groups:
        marks = []
        for scene in scenes_of(group, data):
            labels = flat_parts(scene.points, None, 1, factors).labels
            contents.append(labels.tobytes())
            if group in NO_PLANE:
                marks.append(float((labels < 0).mean()))
            else:
                mark = "least_iou" if group in ONE_PLANE else "f_0.75"
                marks.append(scores(labels, scene)[mark])
        means.append(np.mean(marks))
    return np.array(means), contents, time.process_time() - start


def outcome_or_error(
    change: Change, groups: list[str], data: Path
) -> tuple[np.ndarray, list[bytes], float] | str:
    """The same, or the error that a senseless value leads to."""
    try:
        return outcome(change, groups, data)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def held_out(table: np.ndarray, factors: list[float]) -> tuple[list[float], np.ndarray]:
    """The best factor on all groups but one, and what that one gains by it, for each.

    Parameters
    ----------
    table : (1 + f, g) float
        Scores of groups by the usual value, then by each factor.
    factors : list of float
    """
    best, gains = [], []
    for k in range(table.shape[1]):
        rest = np.delete(table, k, axis=1).mean(axis=1)
        chosen = int(rest.argmax())
        best.append([1.0, *factors][chosen])
        gains.append(table[chosen, k] - table[0, k])
    return best, np.array(gains)


def row(
    name: str,
    numbers: list[float],
    factors: list[float],
    usual: tuple[np.ndarray, list[bytes], float],
    others: list[tuple[np.ndarray, list[bytes], float] | str],
) -> str:
    """One line of the table."""
    value = ", ".join(f"{number:g}" for number in numbers)
    cells, table = [], [usual[0]]
    for other in others:
        if isinstance(other, str):
            cells.append(other[:40])
            table.append(np.full(len(usual[0]), -1.0))
            continue
        is_same = other[1] == usual[1]
        change = (other[0] - usual[0]).mean()
        cells.append("no effect" if is_same else f"{change:+.3f}, x{other[2] / usual[2]:.2f}")
        table.append(other[0])
    best, gains = held_out(np.array(table), factors)
    chosen = " ".join(f"{each:g}" for each in sorted(set(best)))
    return f"| {name} | {value} | {' | '.join(cells)} | {chosen} | {gains.mean():+.4f} |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=[""], help="of settings, or parts of them")
    parser.add_argument("--groups", nargs="+", choices=list(GROUPS), metavar="group")
    parser.add_argument("--factors", nargs="+", type=float, default=[0.5, 2.0])
    parser.add_argument("--jobs", type=int, default=1, help="processes, of one thread each")
    args = parser.parse_args()
    data = Path(os.environ.get("PRIMFIT_DATA", Path(__file__).parents[2] / "shared" / "data"))
    groups = args.groups or [g for g in GROUPS if g not in RECORDED or data.is_dir()]
    chosen = [
        (name, numbers)
        for name, numbers in _primfit.segmentation_settings()
        if any(part in name for part in args.names)
    ]
    usual = outcome(None, groups, data)
    print(
        f"primfit {primfit.__version__}, {len(usual[1])} clouds; scores "
        + ", ".join(f"{group} {mark:.3f}" for group, mark in zip(groups, usual[0], strict=True))
        + f"; all {usual[0].mean():.3f}; {usual[2]:.1f} CPU s; {len(chosen)} settings\n\n"
        "Change of the score of all, CPU; best factors with one group left out, and what the groups "
        "left out gain by them.\n\n"
        f"| setting | value | {' | '.join(f'times {f:g}' for f in args.factors)} | best | gain |\n"
        f"|---|---|{'---|' * len(args.factors)}---|---|",
        flush=True,
    )
    changes = [(name, factor) for name, _ in chosen for factor in args.factors]
    job = partial(outcome_or_error, groups=groups, data=data)
    with ProcessPoolExecutor(args.jobs, get_context("spawn")) as pool:
        results = (map if args.jobs == 1 else pool.map)(job, changes)
        for name, numbers in chosen:
            others = [next(results) for _ in args.factors]
            print(row(name, numbers, args.factors, usual, others), flush=True)


if __name__ == "__main__":
    main()
