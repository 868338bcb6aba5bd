"""Writes that fail or are killed leave what was there."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_files import SUFFIXES

import primfit
from primfit._files import replacing

POINTS = np.random.default_rng(0).uniform(-50, 50, (200_000, 3))
KINDS = [
    *SUFFIXES,
    "scan.npz",
    "world.json",
    "found.json",
    "found.csv",
    "found.png",
    "mesh.ply",
    "mesh.obj",
]

WRITE = """
import sys, numpy as np, primfit
from primfit.clouds.files import write_mesh
name, n = sys.argv[1], int(sys.argv[2])
points = np.random.default_rng(0).uniform(-50, 50, (n, 3))
def write():
    if name.endswith("scan.npz"):
        primfit.Scan.from_points(points).save(name)
    elif name.endswith("world.json"):
        solids = [primfit.Prism.regular(4, 0.1, center=(k, 0)) for k in range(n // 20 + 1)]
        primfit.World(solids).save(name)
    elif "found." in name:
        wall = primfit.Plane(np.array([0.0, 0, 1, 0]), np.arange(3), points, 1.0, 0.1, np.eye(4))
        found = primfit.Detection(primfit.Scan.from_points(points[:9]), "planes", (wall,), np.full(9, -1),
            tuple(primfit.FoundSolid.upright("square", np.eye(4)[:, :2], 0, 1, 0, 1, np.eye(4), (), ()) for _ in range(n // 20)),
            None, None, 0.1, {})
        if name.endswith("json"):
            found.to_json(name)
        elif name.endswith("csv"):
            found.to_csv(name)
        else:
            from primfit import plotting
            plotting.save_detection(name, found)
    elif "mesh." in name:
        write_mesh(name, points, np.arange(n // 3 * 3).reshape(-1, 3))
    else:
        primfit.write_cloud(name, primfit.Cloud(points))
"""

LIMITED = """
import resource, signal
write_first = True
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    write()
except (OSError, ValueError) as error:
    print("failed")
"""


def run(code, file, n, **options):
    command = [sys.executable, "-c", WRITE + code, str(file), str(n)]
    return subprocess.run(command, capture_output=True, text=True, check=True, **options)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX limits")
@pytest.mark.parametrize("kind", KINDS)
def test_a_full_disk_leaves_the_old_file(kind, tmp_path):
    file = tmp_path / f"a{kind}"
    file.write_bytes(b"the old one")
    assert run(LIMITED, file, 30_000).stdout == "failed\n"
    assert file.read_bytes() == b"the old one"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("kind", [".ply", ".las", ".e57", ".xyz", ".npz", "scan.npz"])
def test_a_kill_leaves_the_old_file(kind, tmp_path):
    file = tmp_path / f"a{kind}"
    file.write_bytes(b"the old one")
    code = "print('begins', flush=True)\nwhile True: write(); print('again', flush=True)"
    command = [sys.executable, "-c", WRITE + code, str(file), "100000"]
    rng = np.random.default_rng(len(kind))
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "begins\n"
        time.sleep(rng.uniform(0.0, 0.3))
        child.kill()
    # The old one, or one that is whole.
    if file.read_bytes() != b"the old one":
        reader = primfit.Scan.load if kind == "scan.npz" else primfit.read_cloud
        assert len(reader(file)) == 100_000


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_an_error_in_the_middle_leaves_the_old_file(error, tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("the old one")

    def write():
        with replacing(file) as part:
            part.write_text("half of the new o")
            raise error

    with pytest.raises(error):
        write()
    assert file.read_text() == "the old one"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
def test_permissions_and_links_stay(tmp_path):
    file, link = tmp_path / "a.xyz", tmp_path / "link.xyz"
    primfit.write_points(file, [[1, 2, 3]])
    assert stat.S_IMODE(file.stat().st_mode) == 0o666 & ~_umask()
    file.chmod(0o640)
    link.symlink_to(file)
    primfit.write_points(link, [[4, 5, 6]])
    assert link.is_symlink()
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert primfit.read_points(file).tolist() == [[4, 5, 6]]


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX pipes")
def test_what_is_no_plain_file_is_written_to(tmp_path):
    pipe = tmp_path / "pipe.xyz"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE, text=True) as reader:
        primfit.write_points(pipe, [[1, 2, 3]])
        assert reader.stdout.read() == "1 2 3\n"
    with pytest.raises(IsADirectoryError, match="is a folder, not a file to write to"):
        primfit.write_points(_folder(tmp_path / "folder.xyz"), [[1, 2, 3]])


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


def test_folders_that_are_not_there(world, scan, found, tmp_path):
    nowhere = tmp_path / "nowhere"
    for write in (
        lambda: primfit.write_points(nowhere / "a.ply", [[1, 2, 3]]),
        lambda: world.save(nowhere / "a.json"),
        lambda: scan.save(nowhere / "a.npz"),
        lambda: found.to_json(nowhere / "a.json"),
        lambda: found.to_csv(nowhere / "a.csv"),
        lambda: found.save_mesh(nowhere / "a.obj"),
    ):
        with pytest.raises(FileNotFoundError, match=r"there is no folder .*nowhere to write a\."):
            write()


def test_long_names(tmp_path):
    file = tmp_path / ("a" * 240 + ".xyz")
    primfit.write_points(file, [[1, 2, 3]])
    assert primfit.read_points(file).tolist() == [[1, 2, 3]]
