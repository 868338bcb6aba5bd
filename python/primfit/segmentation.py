"""Labels of points against true labels: the measures of EVOPS and of SegComp."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import MOST_INTEGER, Bools, Floats, Ints, integer, number

FULL_IOU = 0.75
PART_IOU = 0.2
"""From which IoU two segments are one, and from which they are related (EVOPS)."""

OVERLAP = 0.8
"""Share of its points from which a segment lies in another (SegComp)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SegmentationReport:
    """How well points were cut into segments.

    Ratios of nothing are 0, as in EVOPS.

    Attributes
    ----------
    precision, recall : float
        Share of the found and of the true segments that match one of the other side.
    f_score : float
        Harmonic mean of `precision` and `recall`.
    mean_iou : float
        Mean intersection over union (IoU) of the matches.
    panoptic : float
        `f_score` times `mean_iou`.
    usr : float
        Under-segmentation rate: share of the found segments that are related to several true ones.
    osr : float
        Over-segmentation rate: share of the true segments that are related to several found ones.
    noise, missed : float
        Share of the found and of the true segments that are related to none of the other side, or
        to a single one which is related to no other, and do not match it.
    n_correct, n_over_segmented, n_under_segmented, n_missed, n_noise : int
        The instances of SegComp: pairs that lie in each other; true segments cut into several
        found ones; found segments that join several true ones; true and found segments in none of
        these.
    n_found : int
        Segments that were found.
    labels : (k,) int64
        The true segments.
    best : (k,) int64
        Label of the found segment that is most like each of them; `unlabeled` without any.
    best_iou : (k,) float64
        IoU of the two; 0 without any.
    """

    precision: float
    recall: float
    f_score: float
    mean_iou: float
    panoptic: float
    usr: float
    osr: float
    noise: float
    missed: float
    n_correct: int
    n_over_segmented: int
    n_under_segmented: int
    n_missed: int
    n_noise: int
    n_found: int
    labels: Ints
    best: Ints
    best_iou: Floats

    def to_dict(self) -> dict[str, Any]:
        """The report as plain numbers, for JSON."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in asdict(self).items()
        }

    def __repr__(self) -> str:
        return (
            f"SegmentationReport({self.n_found} found, {len(self.labels)} true: "
            f"precision {self.precision:.3f}, recall {self.recall:.3f}, F {self.f_score:.3f}, "
            f"mean IoU {self.mean_iou:.3f}, panoptic {self.panoptic:.3f}, usr {self.usr:.3f}, "
            f"osr {self.osr:.3f}, noise {self.noise:.3f}, missed {self.missed:.3f}; "
            f"SegComp {self.n_correct} correct, {self.n_over_segmented} over, "
            f"{self.n_under_segmented} under, {self.n_missed} missed, {self.n_noise} noise)"
        )


@dataclass(frozen=True, eq=False)
class _Overlaps:
    """Pairs of a found and a true segment that share points, one row a pair.

    Attributes
    ----------
    found, true : (p,) int64
        Rows of the segments, in order of their labels.
    common : (p,) int64
        Points in both.
    size_found, size_true : (f,) and (t,) int64
        Points of the segments.
    """

    found: Ints
    true: Ints
    common: Ints
    size_found: Ints
    size_true: Ints

    @property
    def iou(self) -> Floats:
        union = self.size_found[self.found] + self.size_true[self.true] - self.common
        return self.common / union


def evaluate_segmentation(
    labels: ArrayLike,
    truth: ArrayLike,
    *,
    unlabeled: int = -1,
    min_iou: float = FULL_IOU,
    part_iou: float = PART_IOU,
    overlap: float = OVERLAP,
) -> SegmentationReport:
    """How well labels of points, or of pixels, agree with true ones.

    Segments match one to one, the pairs most alike first; from an IoU above 0.5 no segment has two
    candidates, and the figures are those of EVOPS. Takes about 50 bytes a point.

    Parameters
    ----------
    labels, truth : int arrays of one shape
        The segment of each point, found and true. The values need not agree.
    unlabeled : int
        Label of points in no segment, in both arrays; 0 in the files of EVOPS.
    min_iou : float
        Least IoU of two segments that match.
    part_iou : float
        Least IoU of two segments that are related, at most `min_iou`; for `usr`, `osr`, `noise`
        and `missed`.
    overlap : float
        Share, above 0.5, of its points from which a segment lies in another, for the instances of
        SegComp. A segment that could be in several instances is in the one whose two shares, those
        of the found and of the true points in common, have the highest mean.

    Returns
    -------
    SegmentationReport

    Raises
    ------
    ValueError
        When the arrays differ in shape, or a threshold is out of range.
    TypeError
        When labels are not integers.

    References
    ----------
    Kornilova et al., "EVOPS benchmark: evaluation of plane segmentation from RGBD and LiDAR data"
    (2022). Hoover et al., "An experimental comparison of range image segmentation algorithms",
    IEEE Transactions on Pattern Analysis and Machine Intelligence 18 (1996).

    Examples
    --------
    >>> import primfit
    >>> report = primfit.evaluate_segmentation([0, 0, 0, 0, 1, 1, -1], [5, 5, 5, 5, 7, 7, 8])
    >>> report.precision, round(report.recall, 3), report.n_missed
    (1.0, 0.667, 1)
    """
    found, true = _as_labels("labels", labels), _as_labels("truth", truth)
    if found.shape != true.shape:
        raise ValueError(f"labels must have the shape of truth, {true.shape}, not {found.shape}")
    unlabeled = integer("unlabeled", unlabeled, low=-MOST_INTEGER)
    min_iou = _share("min_iou", min_iou)
    part_iou = _share("part_iou", part_iou, most=min_iou)
    overlap = _share("overlap", overlap, above=0.5)

    found_labels, found_rows = _segments(found.ravel(), unlabeled)
    true_labels, true_rows = _segments(true.ravel(), unlabeled)
    n_found, n_true = len(found_labels), len(true_labels)
    pairs = _overlaps(found_rows, true_rows, n_found, n_true)
    iou = pairs.iou
    matched = _matches(pairs, iou, min_iou)
    n_matched = int(matched.sum())
    precision, recall = _ratio(n_matched, n_found), _ratio(n_matched, n_true)
    f_score = _ratio(2.0 * precision * recall, precision + recall)
    mean_iou = float(iou[matched].mean()) if n_matched else 0.0
    # The last pair of a true segment is the one with the highest IoU.
    order = np.lexsort((-pairs.found, iou, pairs.true))
    best, best_iou = np.full(n_true, int(unlabeled)), np.zeros(n_true)
    best[pairs.true[order]] = found_labels[pairs.found[order]]
    best_iou[pairs.true[order]] = iou[order]
    return SegmentationReport(
        precision=precision,
        recall=recall,
        f_score=f_score,
        mean_iou=mean_iou,
        panoptic=f_score * mean_iou,
        **_relations(pairs, iou, min_iou, part_iou),
        **_instances(pairs, overlap),
        n_found=n_found,
        labels=true_labels,
        best=best,
        best_iou=best_iou,
    )


def _as_labels(name: str, values: ArrayLike) -> Ints:
    array = np.asarray(values)
    if array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"{name} must be integers, not {array.dtype}")
    return array.astype(np.int64, copy=False)


def _share(name: str, value: float, *, above: float = 0.0, most: float = 1.0) -> float:
    share = number(name, value, above=above)
    if share > most:
        raise ValueError(f"{name} must be at most {most:g}, not {value!r}")
    return share


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole else 0.0


def _segments(labels: Ints, unlabeled: int) -> tuple[Ints, Ints]:
    """Labels of the segments, and the row of each point among them; -1 for none."""
    values, rows = np.unique(labels, return_inverse=True)
    is_segment = values != unlabeled
    renumbered = np.where(is_segment, np.cumsum(is_segment) - 1, -1)
    return values[is_segment], renumbered[rows]


def _overlaps(found: Ints, true: Ints, n_found: int, n_true: int) -> _Overlaps:
    size_found = np.bincount(found[found >= 0], minlength=n_found)
    size_true = np.bincount(true[true >= 0], minlength=n_true)
    both = (found >= 0) & (true >= 0)
    keys, common = np.unique(found[both] * n_true + true[both], return_counts=True)
    pair = np.divmod(keys, max(n_true, 1))
    return _Overlaps(*pair, common, size_found, size_true)


def _matches(pairs: _Overlaps, iou: Floats, min_iou: float) -> Bools:
    """Which pairs match: one to one, the highest IoU first."""
    matched = np.zeros(len(iou), dtype=bool)
    taken_found, taken_true = set[int](), set[int]()
    rows = np.flatnonzero(iou >= min_iou)
    for row in rows[np.argsort(-iou[rows], kind="stable")]:
        found, true = int(pairs.found[row]), int(pairs.true[row])
        if found not in taken_found and true not in taken_true:
            matched[row] = True
            taken_found.add(found)
            taken_true.add(true)
    return matched


def _relations(pairs: _Overlaps, iou: Floats, min_iou: float, part_iou: float) -> dict[str, Any]:
    """The rates of EVOPS, which count segments that are related without being one."""
    n_found, n_true = len(pairs.size_found), len(pairs.size_true)
    part, full = iou >= part_iou, iou >= min_iou
    of_found = np.bincount(pairs.found[part], minlength=n_found)
    of_true = np.bincount(pairs.true[part], minlength=n_true)
    # Alone with each other, and still not one.
    alone = part & (of_found[pairs.found] == 1) & (of_true[pairs.true] == 1)
    noise, missed = of_found == 0, of_true == 0
    noise[pairs.found[alone]] = True
    missed[pairs.true[alone]] = True
    noise[pairs.found[full]] = False
    missed[pairs.true[full]] = False
    return {
        "usr": _ratio((of_found > 1).sum(), n_found),
        "osr": _ratio((of_true > 1).sum(), n_true),
        "noise": _ratio(noise.sum(), n_found),
        "missed": _ratio(missed.sum(), n_true),
    }


def _instances(pairs: _Overlaps, overlap: float) -> dict[str, Any]:
    """The instances of SegComp, the clearest first; no segment is in two."""
    size_found, size_true = pairs.size_found[pairs.found], pairs.size_true[pairs.true]
    found_in_true = pairs.common >= overlap * size_found
    true_in_found = pairs.common >= overlap * size_true
    shares = (pairs.common / size_found + pairs.common / size_true) / 2.0
    candidates = [
        (-shares[row], 0, np.array([row])) for row in np.flatnonzero(found_in_true & true_in_found)
    ]
    for kind, inside, whole, sizes, part_sizes in (
        (1, found_in_true, pairs.true, pairs.size_true, size_found),
        (2, true_in_found, pairs.found, pairs.size_found, size_true),
    ):
        rows = np.flatnonzero(inside)
        rows = rows[np.argsort(whole[rows], kind="stable")]
        starts = np.flatnonzero(np.diff(whole[rows])) + 1
        for parts in np.split(rows, starts) if len(rows) else []:
            common, size = pairs.common[parts].sum(), sizes[whole[parts[0]]]
            if len(parts) > 1 and common >= overlap * size:
                share = (common / size + common / part_sizes[parts].sum()) / 2.0
                candidates.append((-share, kind, parts))
    counts = [0, 0, 0]
    free_found = np.ones(len(pairs.size_found), dtype=bool)
    free_true = np.ones(len(pairs.size_true), dtype=bool)
    for _, kind, parts in sorted(candidates, key=lambda each: (each[0], each[1], each[2][0])):
        if free_found[pairs.found[parts]].all() and free_true[pairs.true[parts]].all():
            counts[kind] += 1
            free_found[pairs.found[parts]] = False
            free_true[pairs.true[parts]] = False
    return {
        "n_correct": counts[0],
        "n_over_segmented": counts[1],
        "n_under_segmented": counts[2],
        "n_missed": int(free_true.sum()),
        "n_noise": int(free_found.sum()),
    }
