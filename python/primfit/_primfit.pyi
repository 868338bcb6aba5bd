from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from primfit.sensors.sensor import DepthGate, RangeGate

__all__ = [
    "BeamBlocks",
    "Family",
    "LevelLines",
    "Local",
    "PointTree",
    "PoseBeams",
    "RayCaster",
    "carve",
    "correlation_area",
    "dbscan",
    "detect_surfaces",
    "first_surface",
    "fit_parts",
    "fit_plane",
    "fit_plane_to_ranges",
    "fit_surface",
    "format_rows",
    "laid_out",
    "outlines",
    "parse_rows",
    "passages",
    "ply_bytes",
    "ply_words",
    "residuals",
    "sample",
    "score_planes",
    "segment_image",
    "segmentation_settings",
    "surface_distances",
    "surface_normals",
    "thinned",
    "turned",
]

@final
class BeamBlocks:
    def __new__(
        cls,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        ranges: NDArray[np.float64],
        background: NDArray[np.float64],
        sigmas: NDArray[np.float64],
        limits: tuple[float, float] | NDArray[np.float64],
        outlier: float,
        missing: float,
    ) -> BeamBlocks: ...
    def __len__(self) -> int: ...
    def costs(
        self,
        footprints: NDArray[np.float64],
        bottoms: NDArray[np.float64],
        tops: NDArray[np.float64],
        is_open: bool = False,
        is_round: bool = False,
        n_jobs: int | None = None,
    ) -> NDArray[np.float64]: ...
    def prism_ranges(
        self,
        footprint: NDArray[np.float64],
        bottom: float,
        top: float,
        is_round: bool = False,
    ) -> NDArray[np.float64]: ...
    def wall_depths(self, footprint: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def around(
        self,
        footprint: NDArray[np.float64],
        bottom: float,
        top: float,
        slack: float = 0.0,
        top_slack: float = 0.0,
        weight: float = 1.0,
        is_open: bool = False,
        is_round: bool = False,
    ) -> Local: ...
    def climb(
        self,
        family: Family,
        start: NDArray[np.float64],
        bottom: float,
        top: float,
        weight: float,
        n_steps: int,
        is_open: bool,
    ) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]: ...

_Prisms = tuple[NDArray[np.float64], list[int], list[float], list[float], list[bool]]

@final
class PoseBeams:
    def __new__(
        cls,
        starts: Sequence[int],
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        ranges: NDArray[np.float64],
        sigmas: NDArray[np.float64],
        limits: tuple[float, float] | NDArray[np.float64],
    ) -> PoseBeams: ...
    def __len__(self) -> int: ...
    def sums(
        self,
        poses: NDArray[np.float64],
        prisms: _Prisms,
        floor: float,
        shared: Sequence[float],
        robust: Sequence[float],
        n_jobs: int | None = None,
    ) -> tuple[NDArray[np.float64], ...]: ...
    def costs(
        self,
        of: Sequence[int],
        places: NDArray[np.float64],
        prisms: _Prisms,
        floor: float,
        shared: Sequence[float],
        robust: Sequence[float],
        stride: int = 1,
        n_jobs: int | None = None,
    ) -> NDArray[np.float64]: ...

@final
class LevelLines:
    def __new__(
        cls, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> LevelLines: ...
    def near(
        self, place: tuple[float, float], radius: float, reach: float, stride: int
    ) -> NDArray[np.int64]: ...
    def entries(
        self, rows: NDArray[np.int64], place: tuple[float, float], radius: float
    ) -> NDArray[np.float64]: ...
    def bundles(
        self,
        rows: NDArray[np.int64],
        place: tuple[float, float],
        radius: float,
        shape: tuple[int, int],
    ) -> NDArray[np.int64]: ...

@final
class Local:
    cost: float
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    open: NDArray[np.uint64]
    def costs(
        self, family: Family, parameters: NDArray[np.float64], n_jobs: int | None = None
    ) -> NDArray[np.float64]: ...

@final
class Family:
    @staticmethod
    def template(
        axes: NDArray[np.float64],
        slimmest: float,
        is_round: bool = False,
        has_angle: bool = True,
    ) -> Family: ...
    @staticmethod
    def polygon(n_corners: int) -> Family: ...
    def footprints(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def frame(
        self, parameters: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def is_proper(self, parameters: NDArray[np.float64]) -> NDArray[np.bool_]: ...

@final
class RayCaster:
    def __new__(
        cls,
        vertices: NDArray[np.float64],
        triangles: NDArray[np.int64],
        names: NDArray[np.int64] | None = None,
        rounds: NDArray[np.float64] | None = None,
    ) -> RayCaster: ...
    def parts(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64] | None, NDArray[np.float64]]: ...
    def __len__(self) -> int: ...
    def cast(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        n_jobs: int | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]: ...
    def scan(
        self,
        poses: NDArray[np.float64],
        beams: NDArray[np.float64],
        gate: RangeGate | DepthGate,
        noise: tuple[int, int],
        points: NDArray[np.float64],
        ranges: NDArray[np.float64],
        ids: NDArray[np.int64],
        n_jobs: int | None = None,
    ) -> None: ...

@final
class PointTree:
    def __new__(cls, points: NDArray[np.float64], n_jobs: int | None = None) -> PointTree: ...
    def __len__(self) -> int: ...
    def order(self) -> NDArray[np.int64]: ...
    def neighbors(
        self, queries: NDArray[np.float64], k: int, n_jobs: int | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]: ...
    def normals(self, k: int, n_jobs: int | None = None) -> NDArray[np.float64]: ...
    def local_planes(
        self, sigma: NDArray[np.float64] | None = None, n_jobs: int | None = None
    ) -> tuple[
        NDArray[np.float64],
        NDArray[np.float64],
        NDArray[np.float64],
        NDArray[np.int64],
        NDArray[np.bool_],
    ]: ...
    def segment(
        self,
        sigma: NDArray[np.float64] | None = None,
        n_jobs: int | None = None,
        factors: Sequence[tuple[str, float]] | None = None,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], int, int]: ...

def carve(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    starts: NDArray[np.float64],
    passed: NDArray[np.float64],
    ends: NDArray[np.float64],
    low: Sequence[float],
    cell: float,
    shape: Sequence[int],
    heights: NDArray[np.float64],
    n_jobs: int | None = None,
) -> NDArray[np.uint32]: ...
def dbscan(points: NDArray[np.float64], eps: float, min_samples: int) -> NDArray[np.int64]: ...
def fit_parts(
    points: NDArray[np.float64],
    directions: NDArray[np.float64] | None,
    labels: NDArray[np.int64],
    sigma: NDArray[np.float64],
    normal_space: NDArray[np.float64],
    axis: Sequence[float] | NDArray[np.float64],
    cosines: tuple[float, float],
    limit: float | None = None,
    n_jobs: int | None = None,
) -> list[
    tuple[tuple[NDArray[np.float64], NDArray[np.float64], float], float, NDArray[np.int64]] | None
]: ...
def fit_plane(
    points: NDArray[np.float64], weights: NDArray[np.float64], normal_space: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None: ...
def fit_plane_to_ranges(
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    equation: Sequence[float] | NDArray[np.float64],
    normal_space: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None: ...
def laid_out(
    points: NDArray[np.float64],
    numbers: NDArray[np.int64],
    equation: Sequence[float] | NDArray[np.float64],
    axes: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def passages(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    lengths: NDArray[np.float64],
    equation: Sequence[float] | NDArray[np.float64],
    axes: Sequence[Sequence[float]] | NDArray[np.float64],
    clear: float,
) -> NDArray[np.float64]: ...
def residuals(
    points: NDArray[np.float64],
    directions: NDArray[np.float64] | None,
    equation: Sequence[float] | NDArray[np.float64],
) -> NDArray[np.float64]: ...
def sample(
    cost: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    seed: int,
    n: int,
    generations: int,
    wanted: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float, float, float]: ...
def format_rows(columns: Sequence[NDArray[Any]], separator: int) -> bytes: ...
def parse_rows(
    text: bytes,
    start: int,
    first_line: int,
    n_columns: int,
    columns: Sequence[int],
    kind: str = "f",
    separator: int | None = None,
    has_remarks: bool = False,
) -> NDArray[Any]: ...
def ply_bytes(
    content: bytes,
    start: int,
    n_rows: int,
    properties: Sequence[tuple[str, str]],
    is_big_endian: bool,
) -> tuple[bytes, int]: ...
def ply_words(
    content: bytes, start: int, n_rows: int, properties: Sequence[tuple[str, str]]
) -> tuple[NDArray[np.float64], int]: ...
def outlines(
    planes: list[NDArray[np.float64]], n_jobs: int | None = None
) -> list[tuple[list[NDArray[np.float64]], float]]: ...
def score_planes(
    points: NDArray[np.float64],
    equations: NDArray[np.float64],
    threshold: float,
    directions: NDArray[np.float64] | None = None,
    msac: bool = False,
    n_jobs: int | None = None,
) -> NDArray[np.float64]: ...
def segmentation_settings() -> list[tuple[str, list[float]]]: ...
def segment_image(
    points: NDArray[np.float64],
    width: int,
    sigma: NDArray[np.float64] | None = None,
    n_jobs: int | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]: ...
def thinned(points: NDArray[np.float64]) -> NDArray[np.float64]: ...
def turned(poses: NDArray[np.float64], beams: NDArray[np.float64]) -> NDArray[np.float64]: ...
def first_surface(
    kind: str, points: NDArray[np.float64], normals: NDArray[np.float64]
) -> list[float] | None: ...
def fit_surface(
    kind: str,
    start: Sequence[float] | NDArray[np.float64],
    points: NDArray[np.float64],
    sigma: NDArray[np.float64],
    beams: NDArray[np.float64] | None = None,
    cutoff: float = float("inf"),
    is_isotropic: bool = True,
    n_steps: int = 60,
    n_jobs: int | None = None,
) -> tuple[list[float], NDArray[np.float64], float, NDArray[np.float64], bool]: ...
def surface_distances(
    kind: str, surface: Sequence[float] | NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def surface_normals(
    kind: str, surface: Sequence[float] | NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def correlation_area(
    tree: PointTree, errors: NDArray[np.float64], n_jobs: int | None = None
) -> float: ...
def detect_surfaces(
    tree: PointTree,
    sigma: NDArray[np.float64],
    parts: NDArray[np.int64],
    least: int,
    n_jobs: int | None = None,
) -> tuple[list[tuple[str, list[float]]], NDArray[np.int64], NDArray[np.bool_]]: ...
