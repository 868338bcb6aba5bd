"""What may stand somewhere: a region that was not carved, and the kinds that compete for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
import shapely.ops

from primfit._check import Floats
from primfit.likelihood.fitting import Fit, Top
from primfit.likelihood.obstacles import Obstacle


@dataclass(frozen=True, eq=False)
class Region:
    """A piece of space that no beam passed.

    Attributes
    ----------
    center : (2,) float64, metres
    area : float, square metres
    outline : (m, 2) float64, metres
        Counter-clockwise, along the cells.
    top : float, metres
        z up to which no beam passed.
    cell : float, metres
        Size of the cells that it is made of: it lacks those that a solid fills in part.
    parts : tuple of Region
        What it falls into where it is cut at its necks, if it may be several solids.
    is_cut : bool
        Whether it is such a part: then it may hold more than its solid, on one side.
    """

    center: Floats
    area: float
    outline: Floats
    top: float
    cell: float
    parts: tuple[Region, ...] = ()
    is_cut: bool = False

    @classmethod
    def of_polygon(
        cls, polygon: shapely.Polygon, top: float, cell: float, *, is_cut: bool
    ) -> Region:
        """The inside of a polygon."""
        outline = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
        center = shapely.get_coordinates(polygon.centroid)[0]
        return cls(center, float(polygon.area), outline, top, cell, is_cut=is_cut)

    @property
    def size(self) -> float:
        """Square root of its area, metres."""
        return float(np.sqrt(self.area))

    @property
    def hull(self) -> Floats:
        """Its convex hull (k, 2), counter-clockwise, metres."""
        hull = shapely.orient_polygons(shapely.Polygon(self.outline).convex_hull)
        corners: Floats = shapely.get_coordinates(hull.exterior)[:-1]
        return corners

    @property
    def radius(self) -> float:
        """Distance of its farthest corner from its centre, metres."""
        return float(np.linalg.norm(self.outline - self.center, axis=1).max())

    def halves(self) -> tuple[Region, ...]:
        """Its parts on either side of the line across its longest extent."""
        frame = shapely.get_coordinates(shapely.Polygon(self.outline).minimum_rotated_rectangle)
        sides = np.diff(frame, axis=0)[:2]
        short = min(sides, key=np.linalg.norm)
        line = shapely.LineString([self.center - short, self.center + short])
        pieces = shapely.ops.split(shapely.Polygon(self.outline), line).geoms
        return tuple(Region.of_polygon(piece, self.top, self.cell, is_cut=True) for piece in pieces)

    def joined(self, other: Region) -> Region:
        """The hull of both, as one region."""
        both = shapely.union(shapely.Polygon(self.hull), shapely.Polygon(other.hull)).convex_hull
        top = max(self.top, other.top)
        return Region.of_polygon(both, top, max(self.cell, other.cell), is_cut=False)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A kind, and what the beams tell of it.

    Attributes
    ----------
    fit : Fit
        Mean and covariance of its posterior, once it is sampled.
    top : Top
    best : (d,) float64
        Parameters of the least cost seen.
    evidence : float
        Logarithm of the likelihood of the kind, whatever its parameters; before it is sampled,
        that of the fit.
    tolerant_evidence : float
        The same if each wall may be anywhere within the tolerance.
    cost : float
        Least cost seen.
    stride : int
        One beam in so many was sampled; 0 before.
    """

    fit: Fit
    top: Top
    best: Floats
    evidence: float
    tolerant_evidence: float
    cost: float = np.inf
    stride: int = 0

    @classmethod
    def unsampled(cls, fit: Fit, top: Top) -> Candidate:
        """A fit whose posterior is not known yet."""
        return cls(fit, top, fit.parameters, -fit.cost, -fit.cost, fit.cost)

    @property
    def tolerant_cost(self) -> float:
        """Least cost if each wall may be anywhere within the tolerance."""
        return self.evidence + self.cost - self.tolerant_evidence

    @cached_property
    def walls(self) -> Obstacle:
        """Those of a room of this shape."""
        return Obstacle(self.fit.footprint, self.top.z, is_open=True)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A solid of the scene, as its beams tell it.

    Attributes
    ----------
    region : Region
        What it grew from.
    candidates : tuple of Candidate
        The most likely first; none before it was fitted, when it fills its region.
    model_error : float, metres
        Standard deviation of its walls from its shape, as the beams tell it.
    doubt : float, metres
        The same at the most: what the beams leave open, within the tolerance.
    """

    region: Region
    candidates: tuple[Candidate, ...] = ()
    model_error: float = 0.0
    doubt: float = 0.0

    @classmethod
    def of_fits(cls, region: Region, fits: list[Fit], top: Top) -> Hypothesis:
        """Fits that have not been sampled, the best first."""
        return cls(region, tuple(Candidate.unsampled(fit, top) for fit in fits))

    @property
    def best(self) -> Candidate:
        """The most likely kind."""
        return self.candidates[0]

    @property
    def footprint(self) -> Floats:
        """Corners (m, 2) of the most likely kind, metres."""
        return self.best.fit.footprint if self.candidates else self.region.hull

    @property
    def top(self) -> float:
        """z of its upper end, metres."""
        return self.best.top.z if self.candidates else self.region.top

    @cached_property
    def obstacle(self) -> Obstacle:
        """What it is to beams."""
        return Obstacle(self.footprint, self.top)

    @property
    def n_parameters(self) -> int:
        """Of the most likely kind."""
        return self.best.fit.shape.n_parameters if self.candidates else 0
