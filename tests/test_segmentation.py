"""Measures of segmentations: closed forms, a slow twin, EVOPS itself, published figures."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit

EVOPS = ("precision", "recall", "f_score", "mean_iou", "panoptic", "usr", "osr", "noise", "missed")


def random_labels(seed, n=600):
    """A truth, and a detection of it with moved borders, joined and cut segments, and noise."""
    rng = np.random.default_rng(seed)
    truth = np.repeat(np.arange(12), n // 12) - 1
    found = np.roll(truth, rng.integers(0, 20))
    for _ in range(rng.integers(0, 4)):
        found[found == rng.integers(0, 11)] = rng.integers(-1, 20)
    for _ in range(rng.integers(0, 4)):
        start = rng.integers(0, n)
        found[start : start + rng.integers(1, 60)] = rng.integers(-1, 30)
    return found, truth


def slow_evops(found, truth, full=0.75, part=0.2):
    """The definitions by sets of points."""
    a = [set(np.flatnonzero(found == i)) for i in np.unique(found[found >= 0])]
    b = [set(np.flatnonzero(truth == i)) for i in np.unique(truth[truth >= 0])]
    iou = np.array([[len(x & y) / len(x | y) for y in b] for x in a]).reshape(len(a), len(b))
    hits, related = iou >= full, iou >= part
    precision, recall = hits.any(1).mean(), hits.any(0).mean()
    f_score = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    mean_iou = iou[hits].mean() if hits.any() else 0.0

    def lonely(related, hits):
        """Segments without a relative, or with one that has no other and is not the same."""
        lost = 0
        for row in range(len(related)):
            others = np.flatnonzero(related[row])
            single = len(others) == 1 and related[:, others[0]].sum() == 1
            lost += len(others) == 0 or (single and not hits[row].any())
        return lost / len(related)

    return {
        "precision": precision,
        "recall": recall,
        "f_score": f_score,
        "mean_iou": mean_iou,
        "panoptic": f_score * mean_iou,
        "usr": (related.sum(1) > 1).mean(),
        "osr": (related.sum(0) > 1).mean(),
        "noise": lonely(related, hits),
        "missed": lonely(related.T, hits.T),
    }


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**9), st.sampled_from([0.51, 0.75, 0.9]))
def test_measures_equal_their_definitions(seed, min_iou):
    found, truth = random_labels(seed)
    report = primfit.evaluate_segmentation(found, truth, min_iou=min_iou)
    for name, value in slow_evops(found, truth, min_iou).items():
        assert getattr(report, name) == pytest.approx(value, abs=1e-12), name
    for label, best, iou in zip(report.labels, report.best, report.best_iou, strict=True):
        both = ((found == best) & (truth == label)).sum()
        assert iou == (both / ((found == best) | (truth == label)).sum() if best >= 0 else 0.0)
    assert ((report.best_iou >= min_iou).mean()) == pytest.approx(report.recall)


@pytest.mark.parametrize("seed", range(20))
def test_measures_equal_those_of_evops(seed):
    metrics = pytest.importorskip("evops.metrics", reason="evops is not installed")
    found, truth = random_labels(seed)
    theirs = metrics.full_statistics(
        (found + 1).astype(np.int32), (truth + 1).astype(np.int32), metrics.iou, "iou"
    )
    report = primfit.evaluate_segmentation(found, truth)
    names = {"f_score": "fScore", "mean_iou": "mean"}
    for name in EVOPS:
        assert getattr(report, name) == pytest.approx(theirs[names.get(name, name)], abs=1e-12)


def test_published_frame(data):
    frame = np.load(data / "icl_rendered/icl_frame0_labels.npz")
    report = primfit.evaluate_segmentation(frame["pred"], frame["gt"], unlabeled=0)
    published = (0.800, 0.235, 0.364, 0.994, 0.362, 0.2, 0.0, 0.0, 0.588)
    assert [round(getattr(report, name), 3) for name in EVOPS] == pytest.approx(published)
    assert len(report.labels) == 17
    assert report.n_found == 5


class TestSegComp:
    def counts(self, found, truth, **options):
        report = primfit.evaluate_segmentation(found, truth, **options)
        return (
            report.n_correct,
            report.n_over_segmented,
            report.n_under_segmented,
            report.n_missed,
            report.n_noise,
        )

    def test_each_instance(self):
        truth = np.repeat([0, 1, 2, 3, 4], 100)
        found = truth.copy()
        assert self.counts(found, truth) == (5, 0, 0, 0, 0)
        found[50:100] = 9
        assert self.counts(found, truth) == (4, 1, 0, 0, 0)
        found[200:400] = 2
        assert self.counts(found, truth) == (2, 1, 1, 0, 0)
        found[400:] = -1
        assert self.counts(found, truth) == (1, 1, 1, 1, 0)
        truth[100:200] = -1
        assert self.counts(found, truth) == (0, 1, 1, 1, 1)

    def test_the_share_decides(self):
        truth = np.repeat([0, -1], 100)
        found = np.where(np.arange(200) < 85, 0, -1)
        assert self.counts(found, truth) == (1, 0, 0, 0, 0)
        assert self.counts(found, truth, overlap=0.9) == (0, 0, 0, 1, 1)

    def test_a_segment_is_in_one_instance_only(self):
        # 90 points and 10 more of the same segment: correct by one pair, cut in two by both.
        truth = np.zeros(100, dtype=int)
        found = np.where(np.arange(100) < 90, 0, 1)
        assert self.counts(found, truth) == (0, 1, 0, 0, 0)
        # With 30 points outside the second piece does not lie in the segment.
        truth = np.append(truth, np.full(30, -1))
        found = np.append(found, np.ones(30, dtype=int))
        assert self.counts(found, truth) == (1, 0, 0, 0, 1)

    @settings(max_examples=40, deadline=None)
    @given(st.integers(0, 10**9))
    def test_segments_are_counted_once(self, seed):
        found, truth = random_labels(seed)
        report = primfit.evaluate_segmentation(found, truth)
        turned = primfit.evaluate_segmentation(truth, found)
        assert report.n_correct == turned.n_correct
        assert report.n_over_segmented == turned.n_under_segmented
        assert report.n_missed == turned.n_noise
        n_true = len(report.labels)
        assert report.n_correct + report.n_over_segmented + report.n_missed <= n_true


class TestInput:
    def test_names_and_shape_of_labels_do_not_matter(self):
        found, truth = random_labels(5)
        plain = primfit.evaluate_segmentation(found, truth)
        renamed = primfit.evaluate_segmentation(
            np.where(found < 0, 0, 10**12 - found).reshape(20, 30),
            np.where(truth < 0, 0, 7 * truth + 3).reshape(20, 30),
            unlabeled=0,
        )
        for name in EVOPS:
            assert getattr(renamed, name) == pytest.approx(getattr(plain, name), abs=1e-12)

    def test_nothing_found_and_nothing_there(self):
        nothing = primfit.evaluate_segmentation([], [])
        assert [getattr(nothing, name) for name in EVOPS] == [0.0] * 9
        missed = primfit.evaluate_segmentation([-1, -1], [0, 0])
        assert (missed.missed, missed.n_missed, missed.noise) == (1.0, 1, 0.0)
        assert missed.best.tolist() == [-1]
        noise = primfit.evaluate_segmentation([0, 0], [-1, -1])
        assert (noise.noise, noise.n_noise, noise.missed) == (1.0, 1, 0.0)

    def test_a_tie_goes_to_the_lower_label(self):
        report = primfit.evaluate_segmentation([0, 1], [0, 0], min_iou=0.5)
        assert (report.precision, report.recall) == (0.5, 1.0)
        assert report.best.tolist() == [0]

    def test_text_and_json(self):
        report = primfit.evaluate_segmentation(*random_labels(1))
        assert "precision" in repr(report)
        assert "SegComp" in repr(report)
        assert json.loads(json.dumps(report.to_dict()))["recall"] == report.recall

    @pytest.mark.parametrize(
        ("arguments", "error", "message"),
        [
            (([0, 1], [0]), ValueError, r"labels must have the shape of truth, \(1,\), not \(2,\)"),
            (([0.5], [0]), TypeError, "labels must be integers, not float64"),
            (([0], [True]), TypeError, "truth must be integers, not bool"),
        ],
    )
    def test_bad_labels(self, arguments, error, message):
        with pytest.raises(error, match=message):
            primfit.evaluate_segmentation(*arguments)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"min_iou": 0.0}, "min_iou must be greater than 0, not 0.0"),
            ({"min_iou": 1.5}, "min_iou must be at most 1, not 1.5"),
            ({"min_iou": 0.1}, "part_iou must be at most 0.1, not 0.2"),
            ({"overlap": 0.5}, "overlap must be greater than 0.5, not 0.5"),
        ],
    )
    def test_bad_thresholds(self, options, message):
        with pytest.raises(ValueError, match=message):
            primfit.evaluate_segmentation([0], [0], **options)
