"""LiDAR scans to solid geometry."""

from importlib.metadata import version

from primfit.box_fit import BoxFit, fit_box
from primfit.casting import RayCaster
from primfit.clouds import Cloud
from primfit.clustering import dbscan
from primfit.depth import points_of_depth
from primfit.detection import Detection, FoundArena, FoundSolid, detect
from primfit.evaluation import Report, evaluate
from primfit.files import read_cloud, read_points, write_cloud, write_points
from primfit.found_polyhedra import FoundPolyhedron, Polyhedra
from primfit.normals import estimate_normals
from primfit.paper import PaperSettings
from primfit.paths import grid_path, waypoints
from primfit.plane_detection import detect_planes
from primfit.planes import Plane, Planes
from primfit.polyhedra import find_polyhedra
from primfit.polyhedron import Polyhedron
from primfit.random_worlds import WorldFullError, random_world
from primfit.scanning import scan
from primfit.scans import Scan
from primfit.segmentation import SegmentationReport, evaluate_segmentation
from primfit.sensors import Lidar
from primfit.solids import Prism
from primfit.worlds import Arena, World

__version__ = version("primfit")

__all__ = [
    "Arena",
    "BoxFit",
    "Cloud",
    "Detection",
    "FoundArena",
    "FoundPolyhedron",
    "FoundSolid",
    "Lidar",
    "PaperSettings",
    "Plane",
    "Planes",
    "Polyhedra",
    "Polyhedron",
    "Prism",
    "RayCaster",
    "Report",
    "Scan",
    "SegmentationReport",
    "World",
    "WorldFullError",
    "dbscan",
    "detect",
    "detect_planes",
    "estimate_normals",
    "evaluate",
    "evaluate_segmentation",
    "find_polyhedra",
    "fit_box",
    "grid_path",
    "points_of_depth",
    "random_world",
    "read_cloud",
    "read_points",
    "scan",
    "waypoints",
    "write_cloud",
    "write_points",
]
