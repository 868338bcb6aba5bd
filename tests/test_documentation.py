"""What the documentation says is run."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re
import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest
from test_cli import primfit_command

import primfit

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    "name", [m.name for m in pkgutil.walk_packages(primfit.__path__, "primfit.")]
)
def test_examples_in_docstrings(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module).failed == 0


def test_every_public_function_has_an_example():
    for name in primfit.__all__:
        thing = getattr(primfit, name)
        assert thing.__doc__, name
        if callable(thing) and not isinstance(thing, type) and name != "write_points":
            assert ">>>" in thing.__doc__, name


def test_readme_in_a_notebook():
    import matplotlib as mpl

    mpl.use("Agg")
    (code,) = blocks(README, "python")
    names = {}
    exec(code, names)
    assert names["report"].all_right


def assert_same_report(printed, told):
    """The words are the same, and errors but for what other processors may round otherwise."""
    told = told.split()
    words = printed[printed.index("Ground Truth") :].split()[: len(told)]
    for word, expected in zip(words, told, strict=True):
        if "." in expected:
            assert float(word) == pytest.approx(float(expected), abs=0.02)
        else:
            assert word == expected


def test_readme_on_the_command_line(tmp_path):
    commands = [block for block in blocks(README, "sh") if block.startswith("primfit")]
    lines = [line for block in commands for line in block.splitlines()]
    assert len(lines) == 4
    for line in lines:
        words = shlex.split(line)[1:]
        if words[0] == "reproduce":
            words = ["reproduce", "-n", "1", "--n-paper", "1", "--spacing", "2", "--table", "1",
                     "--no-paper", *words[3:]]  # fmt: skip
        result = primfit_command(*words, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        if words[0] == "demo":
            assert_same_report(result.stdout, blocks(README, "text")[0])
    assert {"demo.png", "scan.npz", "found.png", "solids.obj"} <= {
        file.name for file in tmp_path.iterdir()
    }


def test_tutorial():
    names = {}
    for block in blocks((ROOT / "docs" / "tutorial.md").read_text(), "python"):
        exec(block, names)
    assert names["report"].all_right


def test_points_of_any_kind():
    names = {}
    exec(blocks((ROOT / "docs" / "data.md").read_text(), "python")[0], names)
    assert len(names["planes"]) == 1


def test_how_to(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    table, roof, town = blocks((ROOT / "docs" / "howto.md").read_text(), "python")
    exec(table, names)
    solids = sorted(names["found"].solids, key=lambda solid: -solid.volume)
    for solid, box in zip(solids, names["boxes"], strict=True):
        assert np.linalg.norm(solid.center - box.center) < 0.01
        assert solid.volume == pytest.approx(box.volume, rel=0.1)
    exec(roof, names)
    assert len(names["planes"]) == 2
    assert (tmp_path / "roof.html").stat().st_size > 1e5
    exec(town, names)
    assert len(names["planes"]) == 2


def test_notebook(tmp_path):
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(ROOT / "docs" / "first_look.ipynb", as_version=4)
    resources = {"metadata": {"path": str(tmp_path)}}
    with warnings.catch_warnings():
        # Its event loop warns of what sockets it uses.
        warnings.simplefilter("ignore")
        nbclient.NotebookClient(notebook, timeout=280, resources=resources).execute()
    shown = [
        output["data"]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type == "execute_result"
    ]
    pages = [each["text/html"] for each in shown if "<iframe" in each.get("text/html", "")]
    tables = [each["text/html"] for each in shown if "<table>" in each.get("text/html", "")]
    assert (len(pages), len(tables)) == (2, 3)
    assert " 0 missed, 0 spurious" in tables[1]


def test_api_page_names_everything_public():
    page = (ROOT / "docs" / "api.md").read_text()
    for name in primfit.__all__:
        assert f"::: primfit.{name}\n" in page, name
