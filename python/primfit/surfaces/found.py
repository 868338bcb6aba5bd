"""What found surfaces of all kinds have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np

from primfit._check import Floats, Ints
from primfit._later import Later, called, mapped, replaced
from primfit.clouds.foreign import PointsLike
from primfit.surfaces.charts import Patch

_NO_PATCH = Patch((), 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundSurface(ABC):
    """What found surfaces of all kinds have in common.

    Attributes
    ----------
    inliers : (m,) int64
        Rows of the points that lie on it.
    rms : float, metres
        Root mean square distance of the inliers: along the beams where they are known, else
        perpendicular.
    covariance : (p, p) float64
        Of the parameters, in the order of `parameters`. Where neighbouring errors are alike, as
        those of depth images are, it has grown by the number of points whose errors are one.
    is_convex : bool or None
        Whether it was seen from outside, as a pipe is, or from inside, as a bowl or a vault is;
        None without origins.
    correlation_area : float
        Number of neighbouring points whose errors are one: 1 for independent errors.
    """

    inliers: Ints
    rms: float
    covariance: Floats
    is_convex: bool | None = None
    correlation_area: float = 1.0
    patch: Later[Patch] = Later(_NO_PATCH)  # noqa: RUF009

    kind: ClassVar[str]
    """Name of the kind."""

    _sigmas: ClassVar[dict[str, slice]]

    def __getstate__(self) -> dict[str, Any]:
        return called(self)

    @property
    def boundary(self) -> tuple[Floats, ...]:
        """Border of the part of the surface that has points: loops of corners (k, 3) on it, metres.

        The outline comes first, then holes. What is closed is cut where it has fewest points.
        """
        return self.patch.loops

    @property
    def area(self) -> float:
        """Area of the surface within the boundary, square metres."""
        return self.patch.area

    @property
    @abstractmethod
    def parameters(self) -> Floats:
        """What `covariance` is of (p,)."""

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by name: metres; of axis and angle radians.

        That of a place or an axis is the root of the sum over its components.
        """
        variances = np.diag(self.covariance)
        return {name: float(np.sqrt(variances[at].sum())) for name, at in self._sigmas.items()}

    @abstractmethod
    def distances(self, points: PointsLike) -> Floats:
        """Signed distances (n,) of points (n, 3), metres, positive away from axis or centre."""

    @abstractmethod
    def normals(self, points: PointsLike) -> Floats:
        """Unit normals (n, 3) at the feet of points (n, 3), away from axis or centre."""

    def moved(self, offset: Floats) -> Self:
        """The surface moved by a vector (3,), metres."""
        if not offset.any():
            return self
        place = {
            name: getattr(self, name) + offset for name in ("center", "apex") if hasattr(self, name)
        }

        def shifted(patch: Patch) -> Patch:
            return Patch(tuple(loop + offset for loop in patch.loops), patch.area)

        return replaced(self, **place, patch=mapped(self, "patch", shifted))

    def to_dict(self) -> dict[str, Any]:
        """The surface as plain numbers, for JSON."""
        left_out = ("inliers", "covariance", "patch")
        values = {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if each.name not in left_out
        }
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}
        told = {"kind": self.kind, "n_inliers": len(self.inliers), "area": self.area}
        return told | plain | {"sigmas": self.sigmas}

    def _told(self, what: str) -> str:
        side = {True: ", convex", False: ", concave", None: ""}[self.is_convex]
        return (
            f"{type(self).__name__}({what}, {len(self.inliers)} inliers, "
            f"rms {self.rms * 1000:.2f} mm{side})"
        )


def row_of(values: Floats) -> str:
    """A vector as text."""
    return "(" + ", ".join(f"{value:.4f}" for value in values) + ")"
