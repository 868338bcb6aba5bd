"""Settings of the likelihood: frozen, by keyword, and each with its meaning."""

from __future__ import annotations

import inspect
import re
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace

import pytest

import primfit
from primfit.likelihood import settings
from primfit.likelihood.settings import CarvingSettings, LikelihoodSettings

CLASSES = [
    each
    for _, each in inspect.getmembers(settings, is_dataclass)
    if each.__module__ == settings.__name__
]
STAGES = [each for each in fields(LikelihoodSettings) if is_dataclass(each.default_factory)]


@pytest.mark.parametrize("stage", CLASSES, ids=lambda each: each.__name__)
def test_each_setting_has_its_meaning_in_the_docstring(stage):
    _, _, section = inspect.getdoc(stage).partition("Attributes\n----------\n")
    described = {}
    for entry in re.split(r"\n(?=\S)", section):
        head, _, meaning = entry.partition("\n")
        names, _, type_ = head.partition(" : ")
        described |= {name: (type_, meaning.strip()) for name in names.split(", ")}
    named = {each.name for each in fields(stage)} - {each.name for each in STAGES}
    assert set(described) == named
    for name, (type_, meaning) in described.items():
        assert type_, name
        assert len(meaning) > 10, name


def test_settings_are_frozen_nested_and_by_keyword():
    how = LikelihoodSettings()
    assert len(STAGES) >= 9
    assert how == LikelihoodSettings()
    assert hash(how) == hash(LikelihoodSettings())
    with pytest.raises(FrozenInstanceError):
        how.tolerance_share = 0.1
    with pytest.raises(FrozenInstanceError):
        how.carving.coarsest = 1.0
    with pytest.raises(TypeError):
        CarvingSettings(3.0)
    with pytest.raises(TypeError):
        LikelihoodSettings(0.1)
    for stage in STAGES:
        assert isinstance(getattr(how, stage.name), stage.default_factory)


def test_settings_reach_the_detection(small_scan):
    how = LikelihoodSettings()
    # With as many returns wanted as no solid has, nothing is one.
    none = replace(how, carving=replace(how.carving, least_returns=10**9))
    assert not primfit.detect(small_scan, rng=1, settings=none).solids
    found = primfit.detect(small_scan, rng=1, settings=replace(how, tolerance_share=0.03))
    assert found.settings["tolerance_share"] == 0.03
    assert [each.kind for each in found.solids] == ["square"]
    asked = primfit.detect(small_scan, rng=1, tolerance=0.01)
    assert asked.to_json() == (
        primfit.detect(small_scan, rng=1, settings=replace(how, tolerance=0.01)).to_json()
    )


@pytest.mark.parametrize(
    ("stage", "mistake", "error", "message"),
    [
        (LikelihoodSettings, {"tolerance": "a"}, TypeError, "tolerance must be a number, not 'a'"),
        (LikelihoodSettings, {"tolerance": -1}, ValueError, "tolerance must be at least 0"),
        (LikelihoodSettings, {"noise": 3}, TypeError, "noise must be a NoiseSettings, not int"),
        (CarvingSettings, {"n_layers": 2.5}, TypeError, "n_layers must be an integer, not 2.5"),
        (settings.NoiseSettings, {"rare": float("nan")}, ValueError, "rare must be finite"),
        (settings.PolygonSettings, {"simplifications": 3}, TypeError, "must be a tuple, not int"),
        (settings.PolygonSettings, {"simplifications": (None,)}, TypeError, "must be a number"),
    ],
)
def test_settings_of_the_wrong_kind_are_told(stage, mistake, error, message):
    with pytest.raises(error, match=message):
        stage(**mistake)
