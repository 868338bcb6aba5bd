"""Every table of the paper, its figures beside ours: see `experiments` for what is scanned."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from primfit._check import choice, generator, integer, number
from primfit._files import replacing
from primfit.detection import detect
from primfit.evaluation import Report, evaluate
from primfit.experiments import MAP_FILE, PREFACE, SETTINGS, TABLES, Case
from primfit.paper.detection import PaperSettings
from primfit.plotting import new_figure


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one method made of one case, over all its worlds."""

    n_worlds: int
    n_worlds_right: int
    n_solids: int
    n_right: int
    n_spurious: int
    n_beams: int
    planes: tuple[int, ...]
    planes_true: tuple[int, ...]
    center_mm: tuple[float, ...]
    angle_deg: tuple[float, ...]

    @classmethod
    def of(cls, reports: list[tuple[int, Report]]) -> Outcome:
        """The sum of several reports with the number of beams of each."""
        rows = [row for _, report in reports for row in report.rows]
        return cls(
            n_worlds=len(reports),
            n_worlds_right=sum(report.all_right for _, report in reports),
            n_solids=len(rows),
            n_right=sum(row.found == row.truth for row in rows),
            n_spurious=sum(len(report.spurious) for _, report in reports),
            n_beams=int(np.median([n_beams for n_beams, _ in reports])),
            planes=tuple(report.n_planes for _, report in reports),
            planes_true=tuple(report.n_planes_true for _, report in reports),
            center_mm=tuple(row.center_error_mm for row in rows if row.found),
            angle_deg=tuple(row.angle_error_deg for row in rows if row.found),
        )

    def to_dict(self) -> dict[str, Any]:
        """The outcome as plain numbers, for JSON."""
        return {
            "n_worlds": self.n_worlds,
            "n_worlds_right": self.n_worlds_right,
            "n_solids": self.n_solids,
            "n_right": self.n_right,
            "n_spurious": self.n_spurious,
            "n_beams": self.n_beams,
            "planes_median": float(np.median(self.planes)),
            "planes_true_median": float(np.median(self.planes_true)),
            "center_mm": _median_and_worst(self.center_mm),
            "angle_deg": _median_and_worst(self.angle_deg),
        }

    def __str__(self) -> str:
        def show(values: tuple[float, ...]) -> str:
            known = _median_and_worst(values)
            return f"{known[0]:.3f} / {known[1]:.3f}" if known else "-"

        return (
            f"right {self.n_right}/{self.n_solids} ({self.n_worlds_right}/{self.n_worlds} worlds), "
            f"spurious {self.n_spurious}, "
            f"centre {show(self.center_mm)} mm, angle {show(self.angle_deg)} deg, "
            f"planes {np.median(self.planes):g} for {np.median(self.planes_true):g}, "
            f"{self.n_beams} beams"
        )


def _median_and_worst(values: tuple[float, ...]) -> list[float] | None:
    known = [value for value in values if not np.isnan(value)]
    return [float(np.median(known)), float(np.max(known))] if known else None


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the paper with our figures.

    Attributes
    ----------
    title : str
    rows : tuple of (Case, {method: Outcome})
    """

    title: str
    rows: tuple[tuple[Case, dict[str, Outcome]], ...]

    def to_dict(self) -> dict[str, Any]:
        """The table as plain numbers, for JSON."""
        return {
            "title": self.title,
            "rows": [
                {
                    "name": case.name,
                    "setting": case.setting,
                    "map_file": case.map_file and str(case.map_file),
                    "paper": case.paper,
                    "noise": case.noise,
                    "sigma_mm": case.sigma_mm,
                    "columns": case.columns,
                }
                | {method: outcome.to_dict() for method, outcome in outcomes.items()}
                for case, outcomes in self.rows
            ],
        }

    def __str__(self) -> str:
        lines = [self.title]
        for case, outcomes in self.rows:
            lines.append(f"  {case.description}")
            if case.paper:
                lines.append(f"    {'paper':8} {case.paper}")
            lines += [f"    {method:8} {outcome}" for method, outcome in outcomes.items()]
        return "\n".join(lines)


def reproduce(
    n: int = 20,
    *,
    n_paper: int = 3,
    settings: Sequence[str] = SETTINGS,
    spacing: float = 0.2,
    data: Path | None = None,
    rng: Any = None,
    paper: bool = True,
    tables: Iterable[int] | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> list[Table]:
    """Run the paper's experiments, in its own setting and in ours.

    Parameters
    ----------
    n, n_paper : int
        Worlds behind each row: in our setting, and in the paper's, where each has up to 1.9 million
        beams. Of the authors' map without noise there is one.
    settings : sequence of str
        "paper", "reference" or both.
    spacing : float, metres
        Distance of the positions in the paper's setting; the authors have 0.2.
    data : Path or None
        Folder whose authors/test_map_1_shapes.csv is the authors' map, for table 6 in their
        setting; where there is none, that is of random maps too.
    rng : None, int or numpy.random.Generator
    paper : bool
        Run the paper's method beside the likelihood: with its repairs, and by its own rules.
    tables : iterable of int or None
        Which entries of `experiments.TABLES`; None for all.
    executor : concurrent.futures.Executor or None
        Where the worlds are worked on; None for here.
    progress : bool
        Show a bar.

    Returns
    -------
    list of Table

    Examples
    --------
    >>> from primfit import reproduction
    >>> table = reproduction.reproduce(1, settings=["reference"], rng=1, paper=False, tables=[0])[0]
    >>> case, outcomes = table.rows[0]
    >>> case.name, outcomes["ours"].n_right
    ('square', 1)
    """
    n, n_paper = integer("n", n, low=1), integer("n_paper", n_paper, low=1)
    spacing = number("spacing", spacing, above=0.0)
    for setting in settings:
        choice("settings", setting, SETTINGS)
    map_file = map_in(data)
    chosen = [
        (title, [_placed(case, map_file) for case in cases if case.setting in settings])
        for title, cases in (TABLES[i] for i in (range(len(TABLES)) if tables is None else tables))
    ]
    cases = [case for _, cases in chosen for case in cases]
    counts = [_n_worlds(case, n, n_paper) for case in cases]
    numbers = generator(rng)
    jobs = [
        (case, int(seed), spacing, paper)
        for case, count in zip(cases, counts, strict=True)
        for seed in numbers.integers(2**63, size=count)
    ]
    run = map if executor is None else executor.map
    with tqdm(total=len(jobs), unit="world", disable=not progress) as bar:
        results = []
        for result in run(_run, jobs):
            results.append(result)
            bar.update()
    in_order = iter(results)
    outcomes = []
    for count in counts:
        of_case = list(islice(in_order, count))
        outcomes.append(
            {method: Outcome.of([result[method] for result in of_case]) for method in of_case[0]}
        )
    rows = iter(zip(cases, outcomes, strict=True))
    return [Table(title, tuple(next(rows) for _ in cases)) for title, cases in chosen]


def map_in(data: Path | None) -> Path | None:
    """The authors' map in a folder of data, if it is there."""
    return data / MAP_FILE if data and (data / MAP_FILE).is_file() else None


def preface(spacing: float, data: Path | None) -> str:
    """What the two settings are, and which maps stand for the paper's."""
    file = map_in(data)
    where = f"is the authors' own ({file})" if file else "is made of random maps of their kind"
    return PREFACE.format(
        spacing=spacing,
        map=f"Its table 6 {where};\nall else is of random worlds of their kind.",
    )


def _placed(case: Case, map_file: Path | None) -> Case:
    return replace(case, map_file=map_file) if case.is_the_map else case


def _n_worlds(case: Case, n: int, n_paper: int) -> int:
    if case.map_file and not case.noise:
        return 1
    return n_paper if case.setting == "paper" else n


def save_against_noise(file: Any, table: Table) -> None:
    """Share of solids found, and their median centre error, against noise, as a picture file."""
    figure = new_figure(11, 4.2)
    found, error = figure.subplots(1, 2)
    for setting, style in zip(SETTINGS, ("s--", "o-"), strict=True):
        rows = [row for row in table.rows if row[0].setting == setting]
        for method in rows[0][1] if rows else ():
            outcomes = [outcomes[method] for _, outcomes in rows]
            noise = [case.sigma_mm for case, _ in rows]
            found.plot(noise, [100 * each.n_right / each.n_solids for each in outcomes], style)
            medians = [np.median(each.center_mm) if each.center_mm else np.nan for each in outcomes]
            error.plot(noise, medians, style, label=f"{method}, {setting}")
    found.set_ylabel("right kind, right place [%]")
    error.set_ylabel("centre error, median [mm]")
    error.set_yscale("symlog", linthresh=0.01)
    error.legend()
    for ax in (found, error):
        ax.set_xlabel("standard deviation of the ranges [mm]")
        ax.grid(alpha=0.3)
    with replacing(file) as part:
        figure.savefig(part, dpi=130)


def _run(job: tuple[Case, int, float, bool]) -> dict[str, tuple[int, Report]]:
    case, seed, spacing, paper = job
    rng = np.random.default_rng(seed)
    world, recorded = case.record(rng, spacing)
    methods: dict[str, dict[str, Any]] = {"ours": {"method": "likelihood"}}
    if paper:
        methods["repaired"] = {"method": "paper", "settings": PaperSettings()}
        methods["literal"] = {"method": "paper", "settings": case.literal(spacing)}
    return {
        name: (len(recorded), evaluate(detect(recorded, rng=rng, **how), world))
        for name, how in methods.items()
    }
