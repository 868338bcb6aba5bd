"""What every surface that was found tells of itself, flat or curved."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

from primfit._check import Floats, Ints
from primfit.clouds.foreign import PointsLike


@runtime_checkable
class Surface(Protocol):
    """A surface that was found, such as `Plane`, `SphereSurface` and `CylinderSurface`.

    Attributes
    ----------
    kind : str
        "plane", "sphere", "cylinder", "cone" or "torus".
    inliers : (m,) int64
        Rows of the points that lie on it.
    rms : float, metres
        Root mean square distance of the inliers.
    covariance : (p, p) float64
        Of the parameters.

    References
    ----------
    The words are those of CGAL's Shape_detection and of the models of scikit-image.
    """

    kind: ClassVar[str]

    @property
    def inliers(self) -> Ints: ...  # noqa: D102

    @property
    def rms(self) -> float: ...  # noqa: D102

    @property
    def covariance(self) -> Floats: ...  # noqa: D102

    @property
    def area(self) -> float:
        """Area of the part that has points, square metres."""

    @property
    def parameters(self) -> Floats:
        """What determines it (p,)."""

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by name: metres and radians."""

    def distances(self, points: PointsLike) -> Floats:
        """Signed distances (n,) of points (n, 3), metres."""

    def normals(self, points: PointsLike) -> Floats:
        """Unit normals (n, 3) at the feet of points (n, 3)."""
