"""Planes by tiles: the same planes as of the whole, wherever the tiles are worked on."""

from __future__ import annotations

import os
import signal
import threading
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from town import share_alike, town

import primfit
from primfit._workers import results_of
from primfit.clouds.chunks import read_parts
from primfit.planes.joining import Moments, joined
from primfit.planes.tile_store import InFiles, InMemory, with_halo

SIDE = 40.0


@pytest.fixture(scope="module")
def cloud():
    """Points of nine houses, not tile by tile."""
    return town(3, 6.0, 1)


@pytest.fixture(scope="module")
def whole(cloud):
    return primfit.detect_planes(cloud[0])


@pytest.fixture(scope="module")
def tiled(cloud):
    return primfit.detect_planes(cloud[0], tiles=SIDE)


class Backwards(Executor):
    """Begins when it is asked for a result, with the piece that came last."""

    def __init__(self):
        self._pool = ThreadPoolExecutor(1)
        self._hold = threading.Event()
        self._pool.submit(self._hold.wait)
        self._held = []

    def submit(self, fn, /, *args, **kwargs):
        from concurrent.futures import Future

        future = Future()
        self._held.append((future, fn, args, kwargs))
        threading.Timer(0.3, self._run).start()
        return future

    def _run(self):
        while self._held:
            future, fn, args, kwargs = self._held.pop()
            future.set_result(fn(*args, **kwargs))

    def shutdown(self, wait=True, *, cancel_futures=False):
        self._hold.set()
        self._pool.shutdown()


def alike(one, other):
    assert_array_equal(one.labels, other.labels)
    assert_array_equal(one.equations, other.equations)
    assert one.settings == other.settings


def test_tiles_give_the_planes_of_the_whole(cloud, whole, tiled):
    points, truth = cloud
    assert len(tiled) == len(whole) == 19
    assert share_alike(whole.labels, tiled.labels) == 1.0
    assert share_alike(truth, tiled.labels) == 1.0
    assert tiled.settings["n_tiles"] > 3
    assert tiled.settings["largest_tile"] < 0.8 * len(points)


def test_planes_of_tiles_are_fitted_to_all_their_points(cloud, whole, tiled):
    ground, same = tiled[0], whole[0]
    assert_array_equal(np.sort(ground.inliers), np.flatnonzero(tiled.labels == 0))
    assert len(ground.inliers) == pytest.approx(len(same.inliers), rel=1e-3)
    assert ground.area == pytest.approx(same.area, rel=0.01)
    sigma = np.sqrt(np.diag(same.covariance))
    assert (abs(ground.equation - same.equation) < sigma).all()
    assert np.sqrt(np.diag(ground.covariance)) == pytest.approx(sigma, rel=0.02)
    for plane, threshold in zip(tiled, tiled.thresholds, strict=True):
        off = cloud[0][plane.inliers] @ plane.equation[:3] + plane.equation[3]
        assert abs(off).max() <= threshold * (1 + 1e-9)


def test_labels_are_in_the_order_of_the_input(cloud, tiled):
    points, _ = cloud
    order = np.random.default_rng(2).permutation(len(points))
    shuffled = primfit.detect_planes(points[order], tiles=SIDE)
    assert share_alike(tiled.labels[order], shuffled.labels, 0.99) == 1.0


def test_rows_without_a_point_have_no_label(cloud, tiled):
    points, _ = cloud
    rows = np.arange(len(points)) + np.arange(len(points)) // 10
    holed = np.full((rows[-1] + 1, 3), np.nan)
    holed[rows] = points
    labels = primfit.detect_planes(holed, tiles=SIDE).labels
    assert_array_equal(labels[rows], tiled.labels)
    assert (np.delete(labels, rows) == -1).all()


def test_far_from_0_the_planes_are_the_same(cloud, tiled):
    far = primfit.detect_planes(cloud[0] + [4_500_000.0, 5_300_000.0, 400.0], tiles=SIDE)
    assert share_alike(tiled.labels, far.labels) == 1.0


def test_the_executor_does_not_matter(cloud, tiled):
    with ThreadPoolExecutor(2) as executor:
        alike(primfit.detect_planes(cloud[0], tiles=SIDE, executor=executor), tiled)
    with Backwards() as executor:
        alike(primfit.detect_planes(cloud[0], tiles=SIDE, executor=executor), tiled)


class Deadly(ProcessPoolExecutor):
    """Kills one of its workers after the second piece of work."""

    n = 0

    def submit(self, fn, /, *args, **kwargs):
        future = super().submit(fn, *args, **kwargs)
        self.n += 1
        if self.n == 2:
            os.kill(next(iter(self._processes)), signal.SIGKILL)
        return future


def test_a_killed_worker_loses_nothing(cloud, tiled):
    with Deadly(2, mp_context=get_context("spawn")) as executor:
        found = primfit.detect_planes(cloud[0], tiles=SIDE, executor=executor)
        assert executor.n >= 2
    alike(found, tiled)


def _die(_):
    os._exit(1)


def _fail_once(folder, number):
    try:
        (Path(folder) / str(number)).touch(exist_ok=False)
    except FileExistsError:
        return number
    raise OSError("no room")


def _fail(number):
    raise OSError(f"no room for {number}")


def test_pieces_are_tried_again_but_not_for_ever(tmp_path):
    with ThreadPoolExecutor(2) as executor:
        load = {1: (str(tmp_path), 1), 2: (str(tmp_path), 2)}.__getitem__
        assert dict(results_of(executor, _fail_once, load, {1: 10, 2: 10})) == {1: 1, 2: 2}
        with pytest.raises(OSError, match="no room for 7"):
            dict(results_of(executor, _fail, lambda key: (key,), {7: 10}))
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        pytest.raises(RuntimeError, match=r"lost 3 times .* tile 7: .* smaller tiles"),
    ):
        dict(results_of(pool, _die, lambda key: (key,), {7: 10}))


def test_dask_workers_do_the_tiles_and_one_may_be_killed(cloud, tiled):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        victims = list(client.run(os.getpid).values())
        assert os.getpid() not in victims

        def kill(done, total):
            if done == 1:
                os.kill(victims[0], signal.SIGKILL)

        executor = client.get_executor()
        found = primfit.detect_planes(cloud[0], tiles=SIDE, executor=executor, progress=kill)
        client.wait_for_workers(2, timeout=60)
        assert victims[0] not in client.run(os.getpid).values()
    alike(found, tiled)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_files_are_read_in_parts(cloud, tmp_path, monkeypatch, suffix):
    pytest.importorskip("laspy")
    from primfit.clouds.formats import las, laz

    monkeypatch.setattr(las, "_AT_ONCE", 300_000)
    monkeypatch.setattr(laz, "_AT_ONCE", 300_000)
    file = tmp_path / f"town{suffix}"
    primfit.write_points(file, cloud[0])
    parts = list(read_parts(file))
    assert len(parts) > (2 if suffix == ".las" else 0)
    assert_array_equal(np.concatenate(parts), primfit.read_points(file))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    seen = []
    found = primfit.detect_planes(
        file, tiles=SIDE, progress=lambda *_: seen.append(len(list(tmp_path.glob("primfit_*/*"))))
    )
    assert min(seen) > 3
    assert not list(tmp_path.glob("primfit_*"))
    alike(found, primfit.detect_planes(primfit.read_points(file), tiles=SIDE))


def test_damaged_files_are_refused(tmp_path):
    file = tmp_path / "town.laz"
    with pytest.raises(FileNotFoundError, match=r"no file .*town\.laz"):
        primfit.detect_planes(file, tiles=SIDE)
    file.write_bytes(b"LASF" + bytes(500))
    with pytest.raises(ValueError, match=r"town\.laz is not readable as \.laz"):
        primfit.detect_planes(file, tiles=SIDE)
    file.write_bytes(b"")
    with pytest.raises(ValueError, match=r"town\.laz is not readable as \.laz"):
        primfit.detect_planes(file, tiles=SIDE)


def test_both_stores_have_the_same_halos(tmp_path):
    rng = np.random.default_rng(3)
    points = rng.uniform(-20.0, 20.0, (500, 3))
    memory, files = InMemory(points, np.arange(500), 7.0), InFiles(tmp_path, 7.0)
    files.add(points[:300], np.arange(300))
    files.add(points[300:], np.arange(300, 500))
    assert memory.sizes == files.sizes
    assert sum(memory.sizes.values()) == 500
    for tile in memory.sizes:
        rows, inside, n_own = with_halo(memory, tile, 7.0, 2.0)
        for one, other in zip((rows, inside, n_own), with_halo(files, tile, 7.0, 2.0), strict=True):
            assert_array_equal(one, other)
        low = np.array(tile) * 7.0
        off = np.maximum(np.maximum(low - points[:, :2], points[:, :2] - low - 7.0), 0.0).max(
            axis=1
        )
        assert_array_equal(np.sort(rows), np.flatnonzero(off <= 2.0))
        assert_array_equal(np.sort(rows[:n_own]), np.flatnonzero(off == 0.0))


def test_planes_with_a_bend_between_them_are_not_joined():
    x, y = np.mgrid[0:10:50j, 0:10:50j].reshape(2, -1)
    rng = np.random.default_rng(4)
    left = np.column_stack([x - 10.0, y, 0.02 * rng.normal(size=len(x))])
    pairs = np.array([[0, 1]] * 30)
    for slope, number in ((0.0, 0), (0.02, 1)):
        right = np.column_stack([x, y, slope * x + 0.02 * rng.normal(size=len(x))])
        moments = [Moments.of(left), Moments.of(right)]
        assert joined(moments, pairs, np.array([0, 1]), 0.02).tolist() == [0, number]
    both = Moments.of(left) + Moments.of(right)
    assert both.scatter == pytest.approx(Moments.of(np.concatenate([left, right])).scatter)


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"tiles": 0.0}, ValueError, "tiles must be"),
        ({"tiles": "auto"}, TypeError, "tiles must be a number"),
        ({"tiles": 1e-9}, ValueError, "tiles must be larger"),
        ({"tiles": 5.0, "halo": 6.0}, ValueError, "halo must be at most tiles"),
        ({"tiles": 5.0, "executor": 3}, TypeError, "executor must be a concurrent"),
        ({"halo": 6.0}, ValueError, "halo is for tiles"),
        ({"executor": ThreadPoolExecutor(1)}, ValueError, "executor is for tiles"),
    ],
)
def test_bad_tiles_are_named(cloud, options, error, text):
    with pytest.raises(error, match=text):
        primfit.detect_planes(cloud[0][:100], **options)
