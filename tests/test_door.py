"""What crosses from Python into Rust, and back: types, shapes, threads, interrupts."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import primfit
from primfit import _primfit

SQUARE = ([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
DOWN = [[0, 0, -1]]


def test_the_stub_says_what_the_module_has():
    result = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "primfit._primfit"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32, ">f8", bool])
def test_dtypes(dtype):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 1]]).astype(dtype)
    np.testing.assert_array_equal(primfit.dbscan(points, 1.1), [0, 0, 1])


def test_strides_lists_and_read_only_arrays():
    origins = np.asfortranarray([[0.2, 0.2, 1.0], [0.7, 0.3, 2.0], [5, 5, 5]])[::-1]
    origins.setflags(write=False)
    caster = primfit.RayCaster(SQUARE)
    ranges, ids = caster.cast(origins, DOWN * 3)
    np.testing.assert_array_equal(ranges, [np.inf, 2, 1])
    np.testing.assert_array_equal(ids >= 0, [False, True, True])
    assert ranges.dtype == np.float64
    assert ids.dtype == np.int64


def test_empty_arrays_keep_their_shape():
    ranges, ids = primfit.RayCaster(SQUARE).cast(np.empty((0, 3)), np.empty((0, 3)))
    assert ranges.shape == ids.shape == (0,)
    assert primfit.dbscan(np.empty((0, 3)), 1.0).shape == (0,)
    assert _primfit.score_planes(np.empty((0, 3)), np.empty((0, 4)), 1.0).shape == (0,)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: primfit.RayCaster(SQUARE).cast([[0, 0]], DOWN),
            r"origins must have shape \(n, 3\)",
        ),
        (
            lambda: primfit.RayCaster(SQUARE).cast([[0, 0, 0]] * 2, DOWN),
            "directions must have as many",
        ),
        (lambda: primfit.RayCaster(SQUARE).cast([[0, 0, np.nan]], DOWN), "origins must be finite"),
        (
            lambda: primfit.RayCaster(SQUARE).cast([[0, 0, 0]], [[0, 0, 0]]),
            "directions must not be zero",
        ),
        (
            lambda: primfit.RayCaster(SQUARE).cast([[0, 0, 0]] * 2, [[0, 0, -1], [np.inf, 0, 0]]),
            "directions must be finite, but row 1 is not",
        ),
        (
            lambda: primfit.RayCaster(SQUARE).cast_beams(np.eye(4), DOWN),
            r"poses must have shape \(p, 4, 4\)",
        ),
        (
            lambda: primfit.RayCaster(SQUARE).cast_beams([np.eye(4)], [[0, 0, 0]]),
            "directions must not be zero",
        ),
        (
            lambda: primfit.RayCaster(SQUARE).cast_beams([np.zeros((4, 4))], DOWN),
            "directions must not be zero",
        ),
        (
            lambda: _primfit.RayCaster(np.array(SQUARE[0]), np.array(SQUARE[1]), np.array([1])),
            "names must have as many rows as triangles",
        ),
        (
            lambda: primfit.RayCaster(SQUARE).cast([[0, 0, 0]], DOWN, n_jobs=0),
            "n_jobs must be at least 1",
        ),
        (lambda: primfit.RayCaster((SQUARE[0], [[0, 1, 4]])), "triangle 0 names vertex 4"),
        (lambda: primfit.RayCaster((SQUARE[0], [[0, 1, -1]])), "triangle 0 names vertex"),
        (lambda: primfit.RayCaster((SQUARE[0], [[0, 1]])), r"triangles must have shape \(t, 3\)"),
        (lambda: primfit.RayCaster(([[0, 0, np.inf]] * 3, [[0, 1, 2]])), "vertices must be finite"),
        (lambda: primfit.dbscan([[0, 0, np.nan]], 1.0), "points must be finite, but 1 of 1"),
        (lambda: primfit.dbscan([1, 2, 3], 1.0), "points must be an array"),
        (lambda: primfit.dbscan(np.zeros((3, 3)), 0.0), "eps must be greater than 0"),
        (lambda: primfit.dbscan(np.zeros((3, 3)), np.nan), "eps must be finite"),
        (lambda: primfit.dbscan(np.zeros((3, 3)), 1.0, 0), "min_samples must be at least 1"),
        (
            lambda: primfit.dbscan([[0, 0, 0], [1e9, 0, 0]], 1e-9),
            "eps=1e-9 m is below the rounding",
        ),
        (lambda: _primfit.dbscan(np.zeros((3, 2)), 1.0, 1), r"points must have shape \(n, 3\)"),
        (lambda: _primfit.dbscan(np.zeros((3, 6))[:, ::2], 1.0, 1), "points must be C-contiguous"),
    ],
)
def test_bad_values_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: primfit.RayCaster("mesh"), "mesh_or_world must be a World or .vertices"),
        (lambda: primfit.RayCaster((SQUARE[0], [[0.0, 1.0, 2.0]])), "triangles must be integers"),
        (lambda: primfit.dbscan([["a", "b", "c"]], 1.0), "its array holds <U1, not numbers"),
        (lambda: primfit.dbscan(np.zeros((3, 3)), "wide"), "eps must be a number"),
        (lambda: primfit.dbscan(np.zeros((3, 3)), 1.0, 1.5), "min_samples must be an integer"),
        (lambda: _primfit.dbscan(np.zeros((3, 3), np.float32), 1.0, 1), "points"),
    ],
)
def test_wrong_types_are_named(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def slow_call():
    rng = np.random.default_rng(1)
    points, equations = rng.uniform(size=(200_000, 3)), rng.normal(size=(200_000, 4))
    _primfit.score_planes(points, equations, 1e-3, None, True)


def test_other_threads_run_meanwhile():
    """The GIL is released: a thread counts while another one computes."""
    ticks, done = [], threading.Event()

    def count():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    rng = np.random.default_rng(1)
    points, equations = rng.uniform(size=(100_000, 3)), rng.normal(size=(5000, 4))
    counter.start()
    start = time.perf_counter()
    _primfit.score_planes(points, equations, 1e-3, None, True)
    stop = time.perf_counter()
    done.set()
    counter.join()
    assert sum(start < tick < stop for tick in ticks) >= 3


def normals_by(n_jobs):
    points = np.random.default_rng(1).uniform(size=(50_000, 3))
    return primfit.estimate_normals(points, n_jobs=n_jobs)


def found_in(scan):
    """Of a scan whose directions nobody has asked for."""
    return [solid.center for solid in primfit.detect(scan, rng=1).solids]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes that fork")
def test_a_forked_process_has_threads_of_its_own():
    """Threads do not survive a fork; work that waits for them would never end."""
    world = primfit.random_world(1, 1.0, rng=1)
    scan = primfit.scan(world, primfit.grid_path(world, 0.25, rng=1), rng=1)
    calls = [(normals_by, None), (normals_by, 2), (found_in, scan)]
    copy = pickle.loads(pickle.dumps(scan))
    ours = [normals_by(None), normals_by(2), found_in(copy)]
    with multiprocessing.get_context("fork").Pool(1) as pool:
        for (call, argument), mine in zip(calls, ours, strict=True):
            theirs = pool.apply_async(call, (argument,)).get(timeout=60)
            np.testing.assert_array_equal(theirs, mine)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_stops_a_long_call():
    timer = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        slow_call()
    timer.join()


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_stops_the_building_of_a_caster():
    rng = np.random.default_rng(0)
    vertices = rng.uniform(size=(300_000, 3))
    triangles = rng.integers(0, len(vertices), (3_000_000, 3))
    timer = threading.Timer(0.5, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        primfit.RayCaster((vertices, triangles))
    timer.join()
