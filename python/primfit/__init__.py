"""LiDAR scans to solid geometry."""

from importlib.metadata import version

from primfit.clouds.cloud import Cloud
from primfit.clouds.clustering import dbscan
from primfit.clouds.depth import points_of_depth
from primfit.clouds.files import read_cloud, read_points, write_cloud, write_points
from primfit.clouds.normals import estimate_normals
from primfit.detection import choose_method, detect
from primfit.evaluation import Report, evaluate
from primfit.likelihood.settings import LikelihoodSettings
from primfit.paper.detection import PaperSettings
from primfit.planes.detection import detect_planes
from primfit.planes.plane import Plane, Planes
from primfit.polyhedra.assembly import find_polyhedra
from primfit.polyhedra.box_fit import BoxFit, fit_box
from primfit.polyhedra.found import FoundPolyhedron, Polyhedra
from primfit.results import Contradiction, Detection, FoundArena, FoundSolid
from primfit.scans.casting import RayCaster
from primfit.scans.lidar import Lidar
from primfit.scans.scan import Scan
from primfit.scans.scanning import scan
from primfit.segmentation import SegmentationReport, evaluate_segmentation
from primfit.worlds.arena import Arena
from primfit.worlds.paper_setting import built_of_walls, paper_path, paper_world
from primfit.worlds.paths import grid_path, waypoints
from primfit.worlds.polyhedron import Polyhedron
from primfit.worlds.prism import Prism
from primfit.worlds.random_worlds import WorldFullError, random_world
from primfit.worlds.world import World

__version__ = version("primfit")

__all__ = [
    "Arena",
    "BoxFit",
    "Cloud",
    "Contradiction",
    "Detection",
    "FoundArena",
    "FoundPolyhedron",
    "FoundSolid",
    "Lidar",
    "LikelihoodSettings",
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
    "built_of_walls",
    "choose_method",
    "dbscan",
    "detect",
    "detect_planes",
    "estimate_normals",
    "evaluate",
    "evaluate_segmentation",
    "find_polyhedra",
    "fit_box",
    "grid_path",
    "paper_path",
    "paper_world",
    "points_of_depth",
    "random_world",
    "read_cloud",
    "read_points",
    "scan",
    "waypoints",
    "write_cloud",
    "write_points",
]
