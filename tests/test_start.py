"""What happens before anything is computed: import, help, completion, types."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import primfit_command

import primfit

SOURCE = Path(primfit.__file__).parent
HEAVY = {"numpy", "scipy", "shapely", "networkx", "matplotlib", "pandas", "trimesh", "tqdm"}


def imported_by(code):
    """Modules at the top that are loaded after `code` ran in a new process."""
    code += "\nimport sys; print(*{name.split('.')[0] for name in sys.modules})"
    output = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout
    return set(output.splitlines()[-1].split())


def test_import_loads_nothing_heavy():
    assert not HEAVY & imported_by("import primfit; dir(primfit)")
    assert "numpy" in imported_by("import primfit; primfit.World")


@pytest.mark.parametrize("words", [["--help"], ["detect", "--help"]])
def test_help_loads_nothing_heavy(words):
    code = f"import primfit.cli as c\ntry: c.app({words})\nexcept SystemExit: pass"
    assert not HEAVY & imported_by(code)


def test_public_names_are_those_of_the_stub():
    stub = ast.parse((SOURCE / "__init__.pyi").read_text())
    (names,) = (ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign))
    assert sorted(primfit.__all__) == sorted(names) == sorted(dir(primfit))
    for name in names:
        assert getattr(primfit, name).__name__ == name
    assert primfit.reproduction.__name__ == "primfit.reproduction"
    with pytest.raises(AttributeError, match="no_such"):
        primfit.no_such  # noqa: B018


def test_shells_complete_commands_and_methods(tmp_path):
    shown = primfit_command("--show-completion", cwd=tmp_path)
    assert "--install-completion" in primfit_command("--help", cwd=tmp_path).stdout, shown
    words = "primfit detect file.ply --method "
    environment = os.environ | {
        "_PRIMFIT_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": "4",
    }
    code = (
        "import sys; sys.argv = ['primfit']; from primfit.cli import app; app(prog_name='primfit')"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert result.stdout.split() == ["likelihood", "planes", "paper"]
