"""Projects for Webots, run by a stand-in for it, and its sensors."""

from __future__ import annotations

import runpy
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import primfit
from primfit.sensors.mounts import E_PUCK_TURRET


class Simulator:
    """As much of the module `controller` of Webots as the controller uses.

    Its sensor sees what primfit casts, from where the robot is after a step.
    """

    SIMULATION_MODE_PAUSE = 0

    def __init__(self, file):
        self.world, self.lidar = primfit.World.load(file), primfit.Lidar.from_webots(file)
        self.fields, self.seen = {}, None

    def getBasicTimeStep(self):
        return 32.0

    def getDevice(self, name):
        assert name == "lidar"
        return SimpleNamespace(
            enable=lambda step: None,
            getRangeImage=lambda: self.seen.astype(np.float32).tolist(),
            getNumberOfLayers=lambda: self.lidar.number_of_layers,
            getHorizontalResolution=lambda: self.lidar.horizontal_resolution,
        )

    def getSelf(self):
        def field(name):
            def put(values):
                self.fields[name] = np.array(values)

            return SimpleNamespace(setSFVec3f=put, setSFRotation=put)

        return SimpleNamespace(getField=field)

    def step(self, milliseconds):
        x, y, z, angle = self.fields["rotation"]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        pose = np.eye(4)
        pose[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        pose[:3, 3] = self.fields["translation"]
        self.seen = primfit.scan(self.world, pose @ self.lidar.mount, self.lidar, rng=1).ranges

    def simulationSetMode(self, mode):
        self.is_paused = mode == self.SIMULATION_MODE_PAUSE


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.06), "turned"])
def test_a_project_scans_as_primfit_does(mount, small_world, tmp_path, monkeypatch):
    if mount == "turned":
        mount = np.eye(4)
        mount[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
        mount[:3, 3] = [0.01, 0.0, 0.05]
    lidar = primfit.Lidar(horizontal_resolution=40, number_of_layers=4, mount=mount)
    path = primfit.grid_path(small_world, 0.25, rng=3)
    file = primfit.export_webots(small_world, tmp_path / "project", path, lidar)
    assert primfit.Lidar.from_webots(file).horizontal_resolution == 40
    np.testing.assert_allclose(primfit.Lidar.from_webots(file).mount, lidar.mount, atol=1e-12)
    assert primfit.World.load(file).left_out == {"Robot": 1}
    simulator = Simulator(file)
    controller = SimpleNamespace(
        Supervisor=type("S", (), {"__new__": lambda cls: simulator, "SIMULATION_MODE_PAUSE": 0})
    )
    monkeypatch.setitem(sys.modules, "controller", controller)
    runpy.run_path(str(tmp_path / "project" / "controllers" / "primfit_scan" / "primfit_scan.py"))
    assert simulator.is_paused
    ranges = np.load(tmp_path / "project" / "controllers" / "primfit_scan" / "scan.npz")["ranges"]
    read = primfit.Scan.from_readings(path, lidar, ranges)
    scan = primfit.scan(small_world, path, lidar, rng=1)
    np.testing.assert_allclose(read.ranges, scan.ranges, rtol=1e-6)
    assert read.sigma is None


def test_lidars(tmp_path):
    file = tmp_path / "world.wbt"
    file.write_text(
        """#VRML_SIM R2023b utf8
        E-puck { controller "a" turretSlot [
          Lidar { translation 0 0 0.01 numberOfLayers 8 horizontalResolution 100 maxRange 3
                  verticalFieldOfView 0.4 noise 0.02 fieldOfView 1.5708 } ] }"""
    )
    lidar = primfit.Lidar.from_webots(file)
    assert (lidar.number_of_layers, lidar.max_range, lidar.noise) == (8, 3.0, 0.02)
    np.testing.assert_allclose(lidar.mount[:3, 3], np.add(E_PUCK_TURRET, [0, 0, 0.01]))
    file.write_text("#VRML_SIM R2023b utf8\nRobot { }")
    with pytest.raises(ValueError, match="has no node Lidar"):
        primfit.Lidar.from_webots(file)
    with pytest.raises(ValueError, match="grid of angles"):
        primfit.export_webots(
            primfit.World(), tmp_path, (0, 0, 0), primfit.Lidar.rosette(mount=(0, 0, 1))
        )


def test_range_finders(tmp_path, small_world):
    file = tmp_path / "world.wbt"
    file.write_text(
        """#VRML_SIM R2023b utf8
        Robot { children [ Pose { translation 0.1 0 0.3 rotation 0 0 1 1.5707963267948966 children [
          RangeFinder { translation 0.02 0 0 width 40 height 30 fieldOfView 1 minRange 0.2
                        maxRange 3 noise 0.01 resolution 0.005 } ] } ] }"""
    )
    camera = primfit.DepthCamera.from_webots(file)
    # Turned to the left: its own x is the robot's y.
    place = np.eye(4)
    place[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    place[:3, 3] = [0.1, 0.02, 0.3]
    np.testing.assert_allclose(camera.mount, place, atol=1e-12)
    told = primfit.DepthCamera.range_finder(
        field_of_view=1.0, width=40, height=30, min_range=0.2, max_range=3.0, noise=0.01,
        resolution=0.005, mount=camera.mount,
    )  # fmt: skip
    scans = [primfit.scan(small_world, (0.3, 0.3, 0.2), each, rng=1) for each in (camera, told)]
    np.testing.assert_array_equal(scans[0].ranges, scans[1].ranges)
    file.write_text("#VRML_SIM R2023b utf8\nRobot { children RangeFinder { } }")
    plain = primfit.DepthCamera.from_webots(file)
    assert (plain.width, plain.height, plain.max_depth) == (64, 64, 1.0)
    assert plain.fx == primfit.DepthCamera.range_finder().fx


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ("Lidar { }", "has no node RangeFinder"),
        (
            'RangeFinder { projection "cylindrical" }',
            "must have a planar projection, not cylindrical",
        ),
        ("RangeFinder { spherical TRUE }", "must have a planar projection, not spherical"),
        ('RangeFinder { maxRange "far" }', "maxRange of RangeFinder must be a number, not 'far'"),
        ("RangeFinder { fieldOfView 4 }", "field_of_view must be less than pi"),
    ],
)
def test_range_finders_that_are_no_pinholes(node, message, tmp_path):
    file = tmp_path / "world.wbt"
    file.write_text(f"#VRML_SIM R2023b utf8\nRobot {{ children [ {node} ] }}")
    with pytest.raises(ValueError, match=message):
        primfit.DepthCamera.from_webots(file)
