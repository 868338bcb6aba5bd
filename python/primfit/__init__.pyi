"""LiDAR scans to solid geometry."""

from .clouds.cloud import Cloud
from .clouds.clustering import dbscan
from .clouds.files import read_cloud, read_points, write_cloud, write_points
from .clouds.foreign import as_cloud
from .clouds.normals import estimate_normals
from .detection import choose_method, detect
from .evaluation import Report, evaluate
from .likelihood.settings import LikelihoodSettings
from .paper.detection import PaperSettings
from .planes.detection import detect_planes
from .planes.plane import Plane, Planes
from .polyhedra.assembly import find_polyhedra
from .polyhedra.box_fit import BoxFit, fit_box
from .polyhedra.detection import PlaneSettings
from .polyhedra.found import Polyhedra
from .results import Contradiction, Detection, FoundArena
from .scans.bags import read_clouds, read_scan
from .scans.casting import RayCaster
from .scans.scan import Scan
from .scans.scanning import scan
from .scans.webots import export_webots
from .segmentation import SegmentationReport, evaluate_segmentation
from .sensors.depth_camera import DepthCamera
from .sensors.lidar import Lidar
from .sensors.pinhole import points_of_depth
from .sensors.sensor import Sensor
from .solids.found import FoundSolid
from .solids.frusta import Cone, Cylinder
from .solids.polyhedron import Polyhedron
from .solids.prism import Prism
from .solids.solid import Solid
from .solids.sphere import Sphere
from .solids.torus import Torus
from .surfaces.detection import Surfaces, detect_surfaces
from .surfaces.fitting import fit_cone, fit_cylinder, fit_sphere, fit_torus
from .surfaces.kinds import ConeSurface, CylinderSurface, SphereSurface, TorusSurface
from .surfaces.surface import Surface
from .worlds.arena import Arena
from .worlds.paper_setting import built_of_walls, paper_path, paper_world
from .worlds.paths import grid_path, waypoints
from .worlds.random_worlds import WorldFullError, random_world
from .worlds.world import World

__version__: str

__all__ = [
    "Arena",
    "BoxFit",
    "Cloud",
    "Cone",
    "ConeSurface",
    "Contradiction",
    "Cylinder",
    "CylinderSurface",
    "DepthCamera",
    "Detection",
    "FoundArena",
    "FoundSolid",
    "Lidar",
    "LikelihoodSettings",
    "PaperSettings",
    "Plane",
    "PlaneSettings",
    "Planes",
    "Polyhedra",
    "Polyhedron",
    "Prism",
    "RayCaster",
    "Report",
    "Scan",
    "SegmentationReport",
    "Sensor",
    "Solid",
    "Sphere",
    "SphereSurface",
    "Surface",
    "Surfaces",
    "Torus",
    "TorusSurface",
    "World",
    "WorldFullError",
    "as_cloud",
    "built_of_walls",
    "choose_method",
    "dbscan",
    "detect",
    "detect_planes",
    "detect_surfaces",
    "estimate_normals",
    "evaluate",
    "evaluate_segmentation",
    "export_webots",
    "find_polyhedra",
    "fit_box",
    "fit_cone",
    "fit_cylinder",
    "fit_sphere",
    "fit_torus",
    "grid_path",
    "paper_path",
    "paper_world",
    "points_of_depth",
    "random_world",
    "read_cloud",
    "read_clouds",
    "read_points",
    "read_scan",
    "scan",
    "waypoints",
    "write_cloud",
    "write_points",
]
