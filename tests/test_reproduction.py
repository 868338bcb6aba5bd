"""The paper's tables, in its authors' setting and in our reference."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_cli import primfit_command

import primfit
from primfit import experiments, reproduction
from primfit.worlds.paper_setting import read_paper_map


def write_map(file, world):
    """A world as the paper's authors publish theirs: corners in whole millimetres."""
    lines = ["Shape,Vertices,Angle,Center"]
    for solid in world.solids:
        corners = np.rint(1000 * solid.footprint[::-1]).astype(int)
        text = ";".join(f"({x},{y})" for x, y in corners)
        lines.append(f'{solid.kind},"{text}",0,"(0, 0)"')
    file.parent.mkdir(exist_ok=True)
    file.write_text("\n".join(lines))


@pytest.mark.parametrize("number", range(len(experiments.TABLES)))
def test_every_table_in_our_reference(number, tmp_path):
    title, cases = experiments.TABLES[number]
    table = reproduction.reproduce(
        1, settings=["reference"], rng=1, paper=number < 2, tables=[number]
    )[0]
    assert table.title == title
    assert [case for case, _ in table.rows] == [c for c in cases if c.setting == "reference"]
    for case, outcomes in table.rows:
        assert case.description in str(table)
        assert outcomes["ours"].n_solids >= 1
        if case.noise == 0 and case.columns >= 16:
            assert outcomes["ours"].n_right == outcomes["ours"].n_solids
    json.dumps(table.to_dict())
    reproduction.save_against_noise(tmp_path / "noise.png", table)
    assert (tmp_path / "noise.png").stat().st_size > 10_000


def test_every_row_of_the_paper_is_scanned_in_its_setting():
    for _, cases in experiments.TABLES:
        assert {case.setting for case in cases} == {"paper", "reference"}
        for case in cases:
            assert (case.paper is None) == (case.setting == "reference")
            if case.setting == "paper":
                world, scan = case.record(np.random.default_rng(1), 2.0)
                assert world.arena.size == (10.0, 10.0)
                assert {solid.kind for solid in world.solids} <= set(case.kinds)
                assert len(scan) <= 25 * 8 * case.columns
                assert scan.sigma == pytest.approx(3.0 * case.noise)
                assert case.sigma_mm == pytest.approx(3000.0 * case.noise)


@pytest.mark.parametrize("number", [0, 5])
def test_tables_in_the_setting_of_the_paper(number, tmp_path):
    (table,) = reproduction.reproduce(
        2, n_paper=1, settings=["paper"], spacing=1.0, rng=1, tables=[number]
    )
    ((case, outcomes),) = table.rows
    assert list(outcomes) == ["ours", "repaired", "literal"]
    assert f"the paper's setting (random worlds of their kind)\n    paper    {case.paper}" in str(
        table
    )
    assert outcomes["ours"].n_worlds == 1
    assert table.to_dict()["rows"][0]["setting"] == "paper"
    reproduction.save_against_noise(tmp_path / "noise.png", table)


def test_the_authors_map_where_it_is_at_hand(tmp_path):
    world = primfit.paper_world(rng=4)
    write_map(tmp_path / experiments.MAP_FILE, world)
    (table,) = reproduction.reproduce(
        1, n_paper=3, settings=["paper"], spacing=2.0, data=tmp_path, paper=False, tables=[5]
    )
    ((case, outcomes),) = table.rows
    assert case.map_file == tmp_path / experiments.MAP_FILE
    assert "the paper's setting (the authors' map)" in str(table)
    assert (outcomes["ours"].n_worlds, outcomes["ours"].n_solids) == (1, len(world.solids))
    assert "is the authors' own" in reproduction.preface(0.2, tmp_path)
    assert "is made of random maps of their kind" in reproduction.preface(0.2, tmp_path / "no")
    assert "is made of random maps" in reproduction.preface(0.2, None)


def test_rules_of_the_authors():
    cases = {case.kinds: case for _, rows in experiments.TABLES for case in rows if case.paper}
    square, star = cases["square",].literal(0.2), cases["star",].literal(0.2)
    assert (square.threshold, square.min_points, square.eps) == (0.03, 500, 0.2)
    assert (star.threshold, star.min_points) == (0.01, 400)
    assert cases["square",].literal(0.4).min_points == 125


@pytest.mark.parametrize("seed", range(8))
def test_a_map_of_whole_millimetres_is_the_exact_one(seed, tmp_path):
    world = primfit.paper_world(rng=seed)
    write_map(tmp_path / "map.csv", world)
    again = read_paper_map(tmp_path / "map.csv")
    assert again.arena == world.arena
    for solid, other in zip(world.solids, again.solids, strict=True):
        assert other.kind == solid.kind
        assert other.angle == pytest.approx(solid.angle)
        np.testing.assert_allclose(other.center, solid.center, atol=5e-4)
        np.testing.assert_allclose(other.size, solid.size, atol=1e-3)


def test_the_map_of_the_paper(data):
    world = read_paper_map(data / experiments.MAP_FILE)
    kinds = ["square", "square", "triangle", "pentagon", "triangle", "rectangle"]
    assert [solid.kind for solid in world.solids] == kinds
    degrees = [float(np.degrees(solid.angle)) for solid in world.solids]
    np.testing.assert_allclose(degrees, [41, 40, 41, 10, 0, 28], atol=1e-9)
    np.testing.assert_allclose(world.solids[1].center[:2], (4.755, 2.095), atol=1e-3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a,b\n1,2\n", "it lacks 'Vertices'"),
        ('Shape,Vertices\nblob,"(0,0);(1,0);(0,1)"\n', "Shape must be one of"),
        ('Shape,Vertices\nsquare,"(0,0);(1,0)"\n', "Vertices must have at least 3"),
        ("Shape,Vertices\nsquare\n", "is not a map of the paper"),
    ],
)
def test_foreign_maps(content, message, tmp_path):
    (tmp_path / "map.csv").write_text(content)
    with pytest.raises(ValueError, match=message):
        read_paper_map(tmp_path / "map.csv")


def test_mistakes():
    with pytest.raises(ValueError, match="settings must be one of 'paper', 'reference'"):
        reproduction.reproduce(1, settings=["ours"])
    with pytest.raises(ValueError, match="n_paper must be at least 1"):
        reproduction.reproduce(1, n_paper=0)
    with pytest.raises(ValueError, match="spacing must be greater than 0"):
        reproduction.reproduce(1, spacing=0.0)


def test_reproduction_does_not_depend_on_where_it_runs():
    how = {"settings": ["reference"], "rng": 5, "paper": False, "tables": [0]}
    with ThreadPoolExecutor(2) as executor:
        there = reproduction.reproduce(2, executor=executor, **how)
    assert reproduction.reproduce(2, **how)[0].to_dict() == there[0].to_dict()


def test_the_command(tmp_path):
    write_map(tmp_path / experiments.MAP_FILE, primfit.paper_world(3, rng=4))
    result = primfit_command(
        "reproduce", "-n", "1", "--n-paper", "1", "--spacing", "2", "--table", "6", "--no-paper",
        "--data", tmp_path, cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    for text in ("is the authors' own", "(the authors' map)", "our reference", "9.35 mm"):
        assert text in result.stdout
    wrong = primfit_command("reproduce", "--setting", "ours", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "settings must be one of 'paper', 'reference', not 'ours'" in wrong.stderr
