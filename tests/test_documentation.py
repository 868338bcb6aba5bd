"""What the documentation says is run."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re
import shlex
from pathlib import Path

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


def test_api_page_names_everything_public():
    page = (ROOT / "docs" / "api.md").read_text()
    for name in primfit.__all__:
        assert f"::: primfit.{name}\n" in page, name
