"""LiDAR scans to solid geometry."""

from importlib.metadata import version

from primfit.casting import RayCaster
from primfit.clustering import dbscan
from primfit.paths import grid_path, waypoints
from primfit.scanning import scan
from primfit.scans import Scan
from primfit.sensors import Lidar
from primfit.solids import Prism
from primfit.worlds import Arena, World, WorldFullError, random_world

__version__ = version("primfit")

__all__ = [
    "Arena",
    "Lidar",
    "Prism",
    "RayCaster",
    "Scan",
    "World",
    "WorldFullError",
    "dbscan",
    "grid_path",
    "random_world",
    "scan",
    "waypoints",
]
