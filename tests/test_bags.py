"""Recordings of ROS 1 and 2, written by rosbags."""

from __future__ import annotations

import builtins
import json

import numpy as np
import pytest
from test_cli import primfit_command
from test_foreign import message

import primfit

rosbags = pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

KINDS = ["ros1", "sqlite3", "mcap"]
START = 1_700_000_000


class Recorder:
    """Writes a recording of one of the kinds."""

    def __init__(self, kind, folder):
        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.LATEST)
        if kind == "ros1":
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        if kind == "ros1":
            self.path = folder / "drive.bag"
            self.writer = Writer1(self.path)
        else:
            self.path = folder / "drive"
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(self.path, version=9, storage_plugin=plugin)
        self.connections = {}

    def __enter__(self):
        self.writer.__enter__()
        return self

    def __exit__(self, *error):
        return self.writer.__exit__(*error)

    def header(self, seconds):
        whole = int(np.floor(seconds))
        time = self.store.types["builtin_interfaces/msg/Time"](
            START + whole, round(1e9 * (seconds - whole))
        )
        names = {"seq": 0} if self.kind == "ros1" else {}
        return self.store.types["std_msgs/msg/Header"](**names, stamp=time, frame_id="lidar")

    def write(self, topic, kind, seconds, **values):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        own = self.store.types[kind](header=self.header(seconds), **values)
        serialize = self.store.serialize_ros1 if self.kind == "ros1" else self.store.serialize_cdr
        self.writer.write(
            self.connections[topic], int(1e9 * (START + seconds)), serialize(own, kind)
        )

    def cloud(self, topic, seconds, points, **options):
        like = message(points, **options)
        field = self.store.types["sensor_msgs/msg/PointField"]
        values = vars(like) | {
            "fields": [field(**vars(each)) for each in like.fields],
        }
        self.write(topic, "sensor_msgs/msg/PointCloud2", seconds, **values)

    def laser(self, topic, seconds, ranges, increment):
        self.write(
            topic,
            "sensor_msgs/msg/LaserScan",
            seconds,
            angle_min=-np.pi / 2,
            angle_max=np.pi / 2,
            angle_increment=np.pi / (len(ranges) - 1),
            time_increment=increment,
            scan_time=0.1,
            range_min=0.1,
            range_max=8.0,
            ranges=np.asarray(ranges, np.float32),
            intensities=np.array([], np.float32),
        )

    def transform(self, topic, seconds, parent, child, place, turn):
        """`turn` is a rotation vector, radians."""
        types, kind = self.store.types, "tf2_msgs/msg/TFMessage"
        header = self.header(seconds)
        header.frame_id = parent
        x, y, z, w = Rotation.from_rotvec(turn).as_quat().tolist()
        one = types["geometry_msgs/msg/TransformStamped"](
            header=header,
            child_frame_id=child,
            transform=types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](*place),
                rotation=types["geometry_msgs/msg/Quaternion"](x, y, z, w),
            ),
        )
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.kind == "ros1" else self.store.serialize_cdr
        self.writer.write(
            self.connections[topic],
            int(1e9 * (START + seconds)),
            serialize(types[kind](transforms=[one]), kind),
        )

    def odometry(self, topic, seconds, x, y, yaw):
        types = self.store.types
        pose = types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](x, y, 0.0),
            orientation=types["geometry_msgs/msg/Quaternion"](
                0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)
            ),
        )
        self.write(topic, "geometry_msgs/msg/PoseStamped", seconds, pose=pose)


@pytest.fixture(scope="module")
def clouds():
    return np.random.default_rng(3).normal(size=(3, 40, 3))


@pytest.mark.parametrize("kind", KINDS)
def test_clouds_are_read_as_they_were_written(kind, clouds, tmp_path):
    with Recorder(kind, tmp_path) as recorder:
        for k, points in enumerate(clouds):
            recorder.cloud("/points", k, points, order="<>"[k % 2], rows=1 + k % 2 * 3)
    read = list(primfit.read_clouds(recorder.path))
    assert len(read) == 3
    for cloud, points in zip(read, clouds, strict=True):
        np.testing.assert_array_equal(cloud.points, points)
        assert cloud.fields["ring"].tolist() == [*range(16), *range(16), *range(8)]
        assert cloud.fields["intensity"].dtype == np.float32
    assert [cloud.shape for cloud in read] == [None, (4, 10), None]
    if kind != "ros1":
        (alone,) = recorder.path.glob("*.mcap" if kind == "mcap" else "*.db3")
        assert len(list(primfit.read_clouds(alone, "/points"))) == 3


@pytest.mark.parametrize("kind", KINDS)
def test_a_scan_of_clouds_and_poses(kind, clouds, tmp_path):
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, np.pi / 2], [0.0, 1.0, np.pi]])
    with Recorder(kind, tmp_path) as recorder:
        for k, points in enumerate(clouds):
            recorder.cloud("/points", k, points)
    scan = primfit.read_scan(recorder.path, "/points", poses, mount=(0.0, 0.0, 0.5))
    assert scan.has_origins
    assert scan.layer.max() == 15
    assert scan.column is None
    for k, (x, y, yaw) in enumerate(poses):
        own = scan.pose_index == k
        c, s = np.cos(yaw), np.sin(yaw)
        expected = clouds[k] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [x, y, 0.5]
        np.testing.assert_allclose(scan.points[own], expected, atol=1e-12)
        np.testing.assert_allclose(scan.origins[own], [[x, y, 0.5]] * 40, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_moving_laser_in_a_room(kind, tmp_path):
    """The walls of a room come out straight though the robot moves and turns within a sweep."""
    n, increment = 181, 0.002
    angles = np.linspace(-np.pi / 2, np.pi / 2, n)
    velocity, turn = 0.7, 0.4

    def pose(t):
        return np.array([velocity * t, 0.1 * t, turn * t])

    with Recorder(kind, tmp_path) as recorder:
        for t in np.arange(0.0, 2.05, 0.05):
            recorder.odometry("/odom", t, *pose(t))
        for start in (0.2, 0.7, 1.2, 5.0):
            times = start + increment * np.arange(n)
            x, y, yaw = np.array([pose(t) for t in times]).T
            dx, dy = np.cos(yaw + angles), np.sin(yaw + angles)
            with np.errstate(divide="ignore"):
                to_x = np.where(dx > 0, (3.0 - x) / dx, (-2.0 - x) / dx)
                to_y = np.where(dy > 0, (2.5 - y) / dy, (-2.5 - y) / dy)
            ranges = np.minimum(to_x, to_y)
            ranges[[3, 4, 5]] = np.inf, np.nan, 0.01
            recorder.laser("/scan", start, ranges, increment)
    with pytest.warns(UserWarning, match="1 of 4 messages have no point, or no pose"):
        scan = primfit.read_scan(recorder.path, "/scan", "/odom", mount=(0.0, 0.0, 0.3))
    assert (scan.min_range, scan.max_range) == (pytest.approx(0.1), 8.0)
    assert len(scan) == 3 * (n - 2)
    assert (~scan.is_return).sum() == 3
    points = scan.points[scan.is_return]
    off = np.abs(points[:, :2] - [3.0, 2.5]), np.abs(points[:, :2] + [2.0, 2.5])
    assert np.max(np.min(np.hstack(off), axis=1)) < 1e-5
    np.testing.assert_allclose(points[:, 2], 0.3)
    (cloud, *_) = primfit.read_clouds(recorder.path)
    assert np.isnan(cloud.points[3:6]).all()
    assert np.isfinite(np.delete(cloud.points, [3, 4, 5], axis=0)).all()


class TestTransforms:
    """A drive along x, turning in space, with the lidar tilted on the robot; odom drifts in map."""

    MOUNT = ((0.2, 0.0, 0.5), (0.0, 0.3, 0.0))
    TURN = np.array([0.1, 0.2, 0.8])

    def record(self, kind, folder, clouds, *, extra=()):
        slash = "/" if kind == "ros1" else ""
        with Recorder(kind, folder) as recorder:
            recorder.transform("/tf_static", 0.0, f"{slash}base", f"{slash}lidar", *self.MOUNT)
            for t in (1.0, 0.0, 2.0):
                at = [3.0 * t, 0.0, 0.0]
                recorder.transform("/tf", t, "odom", "base", at, t * self.TURN)
            for t in (0.0, 1.5):
                recorder.transform("/tf", t, "map", "odom", [0.0, t, 0.0], [0.0, 0.0, 0.0])
            for more in extra:
                recorder.transform(*more)
            for t, points in zip((0.25, 1.4, 1.75), clouds, strict=True):
                recorder.cloud("/points", t, points)
        return recorder.path

    def expected(self, t, points, *, in_map):
        robot = Rotation.from_rotvec(t * self.TURN)
        on_robot = Rotation.from_rotvec(self.MOUNT[1]).apply(points) + self.MOUNT[0]
        return robot.apply(on_robot) + np.array([3.0 * t, t * in_map, 0.0])

    @pytest.mark.parametrize("kind", KINDS)
    def test_lead_from_the_sensor_to_the_fixed_frame(self, kind, clouds, tmp_path):
        path = self.record(kind, tmp_path, clouds)
        with pytest.warns(UserWarning, match="1 of 3 messages have no point, or no pose"):
            in_map = primfit.read_scan(path, "/points")
        in_odom = primfit.read_scan(path, "/points", fixed_frame="odom")
        for scan, is_map, times in ((in_map, 1.0, (0.25, 1.4)), (in_odom, 0.0, (0.25, 1.4, 1.75))):
            assert np.unique(scan.pose_index).tolist() == [*range(len(times))]
            for k, t in enumerate(times):
                own = scan.pose_index == k
                expected = self.expected(t, clouds[k], in_map=is_map)
                # Stamps have 2e-7 s left in float64, at speeds of some m/s.
                np.testing.assert_allclose(scan.points[own], expected, atol=1e-5)
                origin = self.expected(t, np.zeros((1, 3)), in_map=is_map)
                np.testing.assert_allclose(scan.origins[own], np.tile(origin, (40, 1)), atol=1e-5)

    def test_of_a_frame_beside_the_way_up(self, clouds, tmp_path):
        beside = ("/tf_static", 0.0, "odom", "world", [1.0, 2.0, 0.0], [0.0, 0.0, np.pi / 2])
        path = self.record("mcap", tmp_path, clouds, extra=[beside])
        scan = primfit.read_scan(path, "/points", fixed_frame="world")
        own = scan.pose_index == 0
        in_odom = self.expected(0.25, clouds[0], in_map=0.0) - [1.0, 2.0, 0.0]
        expected = np.stack([in_odom[:, 1], -in_odom[:, 0], in_odom[:, 2]], axis=1)
        np.testing.assert_allclose(scan.points[own], expected, atol=1e-5)

    def test_mistakes(self, clouds, tmp_path):
        path = self.record("mcap", tmp_path, clouds)
        for options, told in (
            (
                {"fixed_frame": "earth"},
                "from 'lidar' to 'earth'; .* base -> lidar, map -> odom, odom -> base",
            ),
            ({"mount": (0, 0, 1)}, "mount must not be given without poses"),
            ({"poses": np.zeros((3, 3)), "fixed_frame": "map"}, "fixed_frame is for poses=None"),
        ):
            with pytest.raises(ValueError, match=told):
                primfit.read_scan(path, "/points", **options)
        torn = ("/tf", 0.5, "garage", "base", [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
        (tmp_path / "torn").mkdir()
        path = self.record("mcap", tmp_path / "torn", clouds, extra=[torn])
        with pytest.raises(ValueError, match="frame 'base' has two parents, 'odom' and 'garage'"):
            primfit.read_scan(path, "/points")
        for name, links, told in (
            ("bare", [], "it has no transforms, as /tf"),
            ("other", [("base", "lidar")], "none of 'map', 'odom' is above .* base -> lidar"),
            ("ring", [("base", "lidar"), ("lidar", "base")], "is its own ancestor"),
        ):
            (tmp_path / name).mkdir()
            with Recorder("mcap", tmp_path / name) as recorder:
                recorder.cloud("/points", 0, clouds[0])
                for link in links:
                    recorder.transform("/tf_static", 0, *link, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
            with pytest.raises(ValueError, match=told):
                primfit.read_scan(recorder.path, "/points")


def test_mistakes(clouds, tmp_path, monkeypatch):
    with Recorder("mcap", tmp_path) as recorder:
        recorder.cloud("/left", 0, clouds[0])
        recorder.cloud("/right", 0, clouds[1])
    with pytest.raises(ValueError, match=r"has /left \(sensor_msgs/msg/PointCloud2\), /right"):
        next(primfit.read_clouds(recorder.path))
    with pytest.raises(ValueError, match="not '/middle'"):
        next(primfit.read_clouds(recorder.path, "/middle"))
    with pytest.raises(ValueError, match="poses must be one for each of the 1 messages, not 2"):
        primfit.read_scan(recorder.path, "/left", np.zeros((2, 3)))
    with pytest.raises(FileNotFoundError, match="there is no recording"):
        next(primfit.read_clouds(tmp_path / "none.bag"))
    with pytest.raises(ValueError, match="is a recording of many clouds"):
        primfit.read_cloud(recorder.path)
    (tmp_path / "bad.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(40))
    with pytest.raises(ValueError, match=r"bad\.bag is not readable as a recording"):
        next(primfit.read_clouds(tmp_path / "bad.bag"))
    importing = builtins.__import__

    def without_rosbags(name, *rest):
        if name.startswith("rosbags"):
            raise ModuleNotFoundError("No module named 'rosbags'", name="rosbags")
        return importing(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without_rosbags)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'primfit\[ros\]'"):
        next(primfit.read_clouds(recorder.path))


def test_command_line(tmp_path):
    rng = np.random.default_rng(1)
    corner = np.concatenate(
        [np.insert(rng.uniform(1, 2, (800, 2)), k, 1.0, axis=1) for k in (0, 1)]
    )
    with Recorder("mcap", tmp_path) as recorder:
        noisy = corner + rng.normal(0, 0.002, corner.shape)
        recorder.cloud("/points", 0, noisy)
        recorder.cloud("/points", 1, noisy[:800])
        for t in (0.0, 1.0):
            recorder.odometry("/odom", t, t, 0.0, 0.0)
    words = ("detect", "drive", "--json", "--method", "planes", "--topic", "/points")
    for more, n_planes in (((), 2), (("--message", "1"), 1), (("--poses", "/odom"), 3)):
        result = primfit_command(*words, *more, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert len(json.loads(result.stdout)["planes"]) == n_planes
    result = primfit_command(*words, "--message", "2", cwd=tmp_path)
    assert "--message must be below 2, the number of messages" in result.stderr
    primfit.write_points(tmp_path / "corner.ply", corner)
    result = primfit_command("detect", "corner.ply", "--topic", "/points", cwd=tmp_path)
    assert "--topic, --message and --poses are for recordings of ROS" in result.stderr


class TestReadings:
    def test_equal_the_scan_that_they_are_of(self, small_world):
        lidar = primfit.Lidar(noise=0.01)
        path = primfit.grid_path(small_world, rng=3)
        scan = primfit.scan(small_world, path, lidar, rng=3)
        ranges = scan.ranges.reshape(len(path), 8, 100)
        for given in (ranges, ranges.reshape(len(path), -1), scan.ranges):
            read = primfit.Scan.from_readings(path, lidar, given)
            np.testing.assert_allclose(read.directions, scan.directions, atol=1e-15)
            for name in ("ranges", "origins", "layer", "column", "pose_index"):
                np.testing.assert_array_equal(getattr(read, name), getattr(scan, name))
            assert read.sigma == scan.sigma
            np.testing.assert_allclose(read.points, scan.points, atol=1e-12)

    def test_what_is_unknown(self):
        lidar = primfit.Lidar(number_of_layers=1, horizontal_resolution=3)
        read = primfit.Scan.from_readings((0, 0, 0), lidar, [[0.5, np.nan, np.inf]])
        assert read.column.tolist() == [0, 2]
        assert read.sigma is None
        with pytest.raises(ValueError, match=r"ranges must have shape \(1, 1, 3\)"):
            primfit.Scan.from_readings((0, 0, 0), lidar, [0.5, 0.5])
