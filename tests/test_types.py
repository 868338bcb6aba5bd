"""What type checkers know."""

from __future__ import annotations

import sys

import pytest


def test_options_of_detect_are_known_to_type_checkers(tmp_path):
    api = pytest.importorskip("mypy.api")
    right = [
        "detect(points, threshold=0.1, rng=7)",
        "detect(points, 'paper', orientation='vertical', n_jobs=1)",
        "detect(points, 'likelihood', tolerance=0.01)",
    ]
    wrong = [
        "detect(points, treshold=0.1)",
        "detect(points, 'planes', tolerance=0.1)",
        "detect(points, 'plane')",
    ]
    snippet = tmp_path / "snippet.py"
    lines = ["import numpy as np", "from primfit import detect", "points = np.zeros((9, 3))"]
    lines += [f"reveal_type({call})" for call in (*right, *wrong)]
    snippet.write_text("\n".join(lines))
    settings = tmp_path / "mypy.ini"
    settings.write_text("[mypy]\nstrict = True\n[mypy-primfit.*]\nignore_errors = True\n")
    # The library is found as this Python finds it, and as its py.typed allows.
    output, trouble, _ = api.run(
        ["--python-executable", sys.executable, "--config-file", str(settings), str(snippet)]
    )
    assert not trouble
    told = {line: [] for line in range(4, 4 + len(lines) - 3)}
    for each in output.splitlines()[:-1]:
        place = each.split(":")
        if place[0].endswith("snippet.py"):
            told[int(place[1])].append(each)
    for line, call in enumerate((*right, *wrong), 4):
        is_error = any("[call-overload]" in each for each in told[line])
        assert is_error == (call in wrong), told[line]
        if not is_error:
            assert 'Revealed type is "primfit.results.Detection"' in told[line][0]
