"""Every number that the likelihood's behaviour depends on: unit, and why it has this value.

`benches/sensitivity.py` halves and doubles each of them on maps of several kinds.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field, fields
from typing import Any

from primfit._check import instance, integer, number

_MOST = 0.1
"""Largest tolerance in the size of a solid: with more, every shape is a circle."""


class _Checked:
    """Settings that are of the kind of their defaults: counts, or numbers that are not negative."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            factory: Any = each.default_factory
            default = factory() if each.default is MISSING else each.default
            if isinstance(default, int):
                integer(each.name, value, low=0)
            elif isinstance(default, float) or (default is None and value is not None):
                number(each.name, value, low=0.0)
            elif isinstance(default, tuple):
                instance(each.name, value, tuple)
                for part in value:
                    number(each.name, part, low=0.0)
            elif default is not None:
                instance(each.name, value, type(default))


@dataclass(frozen=True, kw_only=True)
class NoiseSettings(_Checked):
    """How beams err.

    Attributes
    ----------
    least_sigma : float
        Least standard deviation of a range as a share of the largest one. The kernels are in
        single precision from the middle of the beams: an error of a ten-millionth.
    rare : float
        Least share of outliers and of dropouts: what was never seen may still happen.
    least_outlier_cost : float, nats
        An outlier costs at least this (3.2 standard deviations), or the noise itself would be
        taken for outliers where their share is large.
    contamination_sigmas : float
        Standard deviations beyond which a residual does not count when noise or floor are
        measured: a Gaussian leaves 6 in 100 000 there.
    range_margin : float
        The sensor's reach is not taken as longer than this times the 99.9 % quantile of its
        returns, so that nothing depends on how far it could have seen.
    """

    least_sigma: float = 2e-5
    rare: float = 1e-5
    least_outlier_cost: float = 5.0
    contamination_sigmas: float = 4.0
    range_margin: float = 1.2


@dataclass(frozen=True, kw_only=True)
class CarvingSettings(_Checked):
    """Free-space carving: which cells are free, and which pieces of the rest may be solids.

    Attributes
    ----------
    clearance_sigmas : float
        A beam passed a cell if it ended this many standard deviations beyond: 1.3 in 1000 beams
        that did not are taken for ones that did.
    least_passes : int
        Beams that must have passed a free cell; one may be an outlier, two by chance.
    least_share : float
        Share of the beams that crossed a free cell and passed it: above the 1.3 in 1000 above
        and the share of outliers of common sensors.
    lapse_factor : float
        Dropouts and outliers look like passes: the least share grows by this times theirs.
    crossings : float
        The cell is so large that nine in ten of the cells with returns are crossed by this many
        beams: with fewer, too many cells of a solid are free by chance or unseen.
    cells_across : int
        Cells along the extent of the scene at first.
    coarsest : float
        Largest cell in that first one.
    layer_ratio : float
        Heights up to which space is carved, the one over the next: a solid of any height has such
        a height between its own and its own over this ratio.
    n_layers : int
        How many such heights: a solid a tenth as high as the highest is among them.
    least_cells : int
        Cells of the smallest region: a square of three.
    least_crossings, enough_crossings : int
        Beams that must have crossed each cell of a region on average, or all of it: few may all
        have ended before.
    least_returns : int
        Returns on a region: three a side of a triangle, and one. Shadows have none.
    contact_cells, contact_sigmas : float
        How far from the region its returns may be: it lacks cells that the solid fills in part,
        and noise moves returns.
    growth, most_growth : float
        Area of a piece, in that of the pieces below greater heights within it, from which it takes
        their place, and up to which: more than the rim of cells in which noise stops beams, and
        less than two solids a size apart with what is between them.
    unseen_rim : float
        Share of the cells around a piece that are not free from which it may hold more than its
        solid: all are free around a solid that was seen from all sides.
    smoothing_cells : float
        Tolerance of outlines, in cells: they are steps of a cell.
    neck : float
        Depth of a pass over that of the lower summit below which a region is cut there.
    room_margin_cells : float
        Cells along the walls of the room that belong to the walls.
    sliver_sigmas : float
        Regions smaller than this times the noise are what noise left.
    """

    clearance_sigmas: float = 3.0
    least_passes: int = 3
    least_share: float = 0.02
    lapse_factor: float = 1.5
    crossings: float = 12.0
    cells_across: int = 256
    coarsest: float = 6.0
    layer_ratio: float = 1.5
    n_layers: int = 7
    least_cells: int = 9
    least_crossings: int = 10
    enough_crossings: int = 400
    least_returns: int = 10
    contact_cells: float = 2.0
    contact_sigmas: float = 1.0
    growth: float = 1.6
    most_growth: float = 10.0
    unseen_rim: float = 0.3
    smoothing_cells: float = 1.0
    neck: float = 0.8
    room_margin_cells: float = 2.5
    sliver_sigmas: float = 0.4


@dataclass(frozen=True, kw_only=True)
class RoomSettings(_Checked):
    """Walls around all.

    Attributes
    ----------
    beams : int
        Beams by which rooms compete: a room of 5 cm walls seen from near by has hundreds of
        returns among so many.
    least_gain : float
        Log-likelihood that walls must gain over none, as a multiple of the logarithm of the
        number of beams: a room has 5 parameters and a height, at half of that each, and as much
        again, since a wrong room is worse than none.
    polygon_gain : float, nats
        What each corner of a polygon beyond four must gain at the least.
    polygon_share : float
        The same as a share of what all walls gain: the notch of an L has a large share of the
        returns from walls, a solid near a wall that is taken for a part of it a small one.
    survey_beams : int
        Beams by which the walls are sampled in the end.
    tolerance_share : float
        By how much walls may be off, as a share of the room's size, where no tolerance is given.
    """

    beams: int = 20_000
    least_gain: float = 10.0
    polygon_gain: float = 50.0
    polygon_share: float = 0.03
    survey_beams: int = 160_000
    tolerance_share: float = 0.002


@dataclass(frozen=True, kw_only=True)
class FittingSettings(_Checked):
    """From a guess to a posterior.

    Attributes
    ----------
    blur : float
        Standard deviation of the ranges, as a share of the solid's size, with which it is sought
        at first: guesses are off by about as much.
    sharpening : float
        By how much that falls from one Gauss-Newton climb to the next.
    margin_sigmas, room_sigmas : float
        Moves of the corners, in their standard deviations, that a local likelihood admits, and
        those that the posterior must find admitted.
    steepness : float
        Slope of the steepest beams that pass over a solid, as a rule: what the top moves where a
        wall does.
    widest : float
        Most that corners may move in one round, as a share of the extent.
    few_beams : int
        Beams that are so few that all of them are cast for each draw.
    rounds : int
        Local likelihoods that are tried.
    known_height : float, nats
        By which a finite height must beat an endless one to be known: odds of 20 to 1.
    model_blur : float
        Standard deviation of the ranges that stands for the tolerance while kinds compete, in
        the tolerance: two standard deviations are within it.
    """

    blur: float = 0.05
    sharpening: float = 3.0
    margin_sigmas: float = 6.0
    room_sigmas: float = 4.5
    steepness: float = 0.2
    widest: float = 0.25
    few_beams: int = 2000
    rounds: int = 5
    known_height: float = 3.0
    model_blur: float = 0.5


@dataclass(frozen=True, kw_only=True)
class ModelSettings(_Checked):
    """Which kinds a footprint may be instead.

    Attributes
    ----------
    flat : float
        How far a corner that may be none is off the line of its neighbours, in the size.
    shallow : float
        Depth of notches, in that of the shallowest ones, from which a star is nearly regular.
    nearly : float
        Sides of a rectangle that is nearly a square, the one over the other, at the most.
    unknown_size : float
        Standard deviation of a size, in the size, from which it is not known.
    round_corners : int
        Corners from which a polygon may be a curve.
    """

    flat: float = 0.03
    shallow: float = 0.85
    nearly: float = 1.3
    unknown_size: float = 0.01
    round_corners: int = 6


@dataclass(frozen=True, kw_only=True)
class PolygonSettings(_Checked):
    """Free polygons gain, lose and move corners.

    Attributes
    ----------
    stride : int
        One beam in so many tells which corners there are.
    bulge : float
        How far a new corner is tried from the middle of its edge, as a share of the edge.
    most_moves : int
        Changes of the number of corners that are tried.
    simplifications : tuple of float
        By how much an outline to start from may be off, as a share of the size.
    """

    stride: int = 8
    bulge: float = 0.1
    most_moves: int = 60
    simplifications: tuple[float, ...] = (0.06, 0.12)


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How hard a posterior is sampled.

    Attributes
    ----------
    n : int
        Draws of a generation.
    generations : int
        Most of them.
    wanted : float
        Effective number of draws at which it ends.
    least : float
        Effective number of draws that tell where the posterior is.
    chained : int
        Draws of Markov chains in `SamplingSettings.few_parameters` parameters.
    """

    n: int
    generations: int
    wanted: float
    least: float
    chained: int


@dataclass(frozen=True, kw_only=True)
class SamplingSettings(_Checked):
    """Sampling posteriors.

    Attributes
    ----------
    few_parameters : int
        Parameters up to which independent draws hit the posterior often enough.
    quick, thorough : Effort
        To compare kinds, and for what is reported: proposals that follow few draws make its
        spread too small (0.92 to 0.94 in the 95 % regions with a third of the draws).
    chains : int
        Markov chains a parameter: each half must span all of them.
    start : float
        Spread of the chains at first, in that of the start: they spread faster than they
        contract.
    burn_in : float
        Share of the steps that only lead to the posterior.
    leap : int
        Every so manieth step may lead from one mode to another.
    most_beams : int
        Beams near a solid by which it is sampled for a report: errors fall with the root of their
        number, and time grows with it.
    jitter : float
        Random part of a step, in standard deviations of the start.
    """

    few_parameters: int = 6
    quick: Effort = Effort(n=144, generations=8, wanted=40.0, least=13.0, chained=768)
    thorough: Effort = Effort(n=320, generations=12, wanted=400.0, least=67.0, chained=5760)
    chains: int = 4
    start: float = 0.3
    burn_in: float = 0.4
    leap: int = 8
    most_beams: int = 300_000
    jitter: float = 1e-4

    def n_chained(self, effort: Effort, n_parameters: int) -> int:
        """Draws of Markov chains in many parameters: chains and steps grow with their number."""
        return effort.chained * n_parameters**2 // self.few_parameters**2


@dataclass(frozen=True, kw_only=True)
class SelectionSettings(_Checked):
    """Kinds compete for a region.

    Attributes
    ----------
    stride : int
        One beam in so many tells which kinds are worth sampling.
    rough_stride : int
        One of these in so many tells kinds roughly apart.
    rough_steps : int
        Gauss-Newton steps of a rough fit.
    turn : float, radians
        Steps of the angle in which a first guess is sought.
    shares, cut_shares : tuple of float
        Areas of guesses as shares of the region's, which is never too small; and of a part of a
        region, which may hold more than its solid.
    move : float
        Steps by which the centre of a part's solid is sought about its own, in its size.
    overhang : float
        How far a solid may leave its region, beyond a cell, as a share of its size and area.
    shortlist : int
        Kinds that are fitted well after a rough fit.
    near : float
        Radius within which beams tell of a solid, in that of its region.
    rival_gain : float, nats
        Log evidence that a kind may lack against the best to stay in the competition.
    size_price : float, nats
        What each size more must gain: half the logarithm of 150 000 beams.
    loose_evidence : float, nats
        By which the evidence of a free polygon may be too large: it is an upper bound.
    climb_gain : float, nats
        By which a climb may be behind the best to be sampled: silhouettes hold climbs.
    draw_gain : float, nats
        By which the best draw with few beams may be behind to be sampled with more.
    away : float
        How far corners may be from the centre of a hypothesis, in its radius.
    most_beams : int
        Beams near a solid by which it is sampled in the competition.
    """

    stride: int = 4
    rough_stride: int = 2
    rough_steps: int = 5
    turn: float = 0.17
    shares: tuple[float, ...] = (0.75, 0.95)
    cut_shares: tuple[float, ...] = (0.3, 0.5, 0.75, 0.95)
    move: float = 0.2
    overhang: float = 0.1
    shortlist: int = 7
    near: float = 1.3
    rival_gain: float = 15.0
    size_price: float = 6.0
    loose_evidence: float = 20.0
    climb_gain: float = 1500.0
    draw_gain: float = 20.0
    away: float = 2.0
    most_beams: int = 60_000


@dataclass(frozen=True, kw_only=True)
class RefinementSettings(_Checked):
    """What does not explain its beams is replaced.

    Attributes
    ----------
    misfit : float, standard deviations
        By which the beams near a solid may fit worse than their noise explains.
    spoilt : float
        By which factor the last sampling may make the misfit of a solid worse.
    missed_factor : float
        The same, as a multiple, while neighbours are known roughly.
    least_gain : float, nats
        That a solid must gain over nothing, beyond what its parameters cost.
    certain_gain : float, nats
        Gain by one beam in `selection.stride` from which the others need not be asked.
    ways, sides : int
        Bundles of beams about a solid: directions, and sides on which they come by.
    few : int
        Beams of a bundle that are few.
    touching : float
        Distance of two parts of a region, as a share of its size, below which they are one solid.
    overlap : float
        Share of the smaller of two solids that the other may cover.
    rounds : int
        Times that parts are sought once more.
    least_height : float
        Of a solid, in its tolerance: less is a floor that is not quite even.
    most_beams : int
        Beams near a solid by which it is judged.
    rim : float
        Width of what a solid leaves of its region that may be nothing, in the region's size.
    """

    misfit: float = 3.5
    spoilt: float = 1.5
    missed_factor: float = 3.0
    least_gain: float = 25.0
    certain_gain: float = 250.0
    ways: int = 24
    sides: int = 24
    few: int = 50
    touching: float = 0.02
    overlap: float = 0.02
    rounds: int = 3
    least_height: float = 0.5
    most_beams: int = 150_000
    rim: float = 0.1


@dataclass(frozen=True, kw_only=True)
class PoseSettings(_Checked):
    """Poses that are not exact, sought with the map.

    Attributes
    ----------
    shared_sigmas : tuple of four floats
        Standard deviations beforehand of bias, x and y of the mount, as shares of the sensor's
        reach, and of its turn, radians, where they are estimated: a hand's breadth a metre.
    widest_blur : float
        Largest blur of walls, as a share of the room's or of the solids' size: with more, beams
        that meet something else count as near.
    sharpening : float
        By how much the blur falls from level to level.
    level_steps, last_steps : int
        Steps at each level, and at the end.
    soft_scale, soft_cut : float, standard deviations
        Residual that counts a quarter, and the largest that counts, as long as beams may meet
        something that the map lacks.
    cut : float, standard deviations
        Residual beyond which a beam does not count at the end: a Gaussian leaves 6 in 100 000.
    longest_step : float, standard deviations
        Of a pose as believed, in one step.
    rise : float
        Share of the beams of a pose that may meet something else after a step at the most, since
        others gain.
    balance : float, standard deviations
        Steps end where they move the unknowns by less, in the mean.
    suspect_sigmas, least_excess : float, standard deviations and nats
        What the beams of a pose cost beyond the others', a beam, from which it is sought anew: in
        the spread of the poses, and at the least, one beam in eighty that meets something else.
    most_suspects : float
        Share of such poses from which solids are sought once more at the poses known by then.
    search_draws : (int, int)
        Places where such a pose is sought in each round, at the least and at the most.
    search_places : int
        The same for all such poses together, but for the least.
    search_rounds : int
        Rounds, each about the best place of the one before.
    search_shrinking : float
        Width of the draws, in that of the round before: so far off is the best of them in three
        dimensions.
    search_stride : int
        One beam in so many by which it is sought.
    most_lost : float
        Share of the beams of a pose that fit nothing from which a warning names it.
    best_known : float
        Poses whose beams are less exact than this times the median do not take part in detection.
    """

    shared_sigmas: tuple[float, float, float, float] = (0.05, 0.03, 0.03, 0.1)
    widest_blur: float = 0.05
    sharpening: float = 2.5
    level_steps: int = 2
    last_steps: int = 6
    soft_scale: float = 2.0
    soft_cut: float = 12.0
    cut: float = 4.0
    longest_step: float = 3.0
    rise: float = 0.01
    balance: float = 0.05
    suspect_sigmas: float = 3.0
    least_excess: float = 0.1
    most_suspects: float = 0.1
    search_draws: tuple[int, int] = (250, 1000)
    search_places: int = 10_000
    search_rounds: int = 3
    search_shrinking: float = 0.3
    search_stride: int = 5
    most_lost: float = 0.1
    best_known: float = 2.0


@dataclass(frozen=True, kw_only=True)
class ConsistencySettings(_Checked):
    """Places of which the beams contradict each other by when they were taken.

    Attributes
    ----------
    core : float
        Beams through a place come this near its middle, in its half width: farther off they may
        pass a corner.
    least_beams, least_returns : int
        Beams that tell of a place, and unexplained returns that make one.
    least_gain : float, nats
        By which two shares must explain beams that ended and passed better than one: the best of
        all splits by chance stays far below.
    least_change : float
        Difference of the two shares: less is what a rough surface or lost returns make.
    crowding : float
        Unexplained returns of a cell, in those of a usual one, from which it belongs to a place.
    most_beams : int
        Returns among which unexplained ones are looked for.
    """

    core: float = 0.4
    least_beams: int = 40
    least_returns: int = 20
    least_gain: float = 30.0
    least_change: float = 0.4
    crowding: float = 4.0
    most_beams: int = 200_000


@dataclass(frozen=True, kw_only=True)
class LikelihoodSettings(_Checked):
    """Settings of `primfit.detect` by the likelihood.

    Attributes
    ----------
    tolerance : float or None, metres
        By how much the walls of a real solid may be off the shape that it is called by; None is
        `tolerance_share` of its size (the square root of the area of its footprint).
    tolerance_share : float
        The paper's own walls, whose ends cross at the corners, are off by 1.3 %.
    """

    tolerance: float | None = None
    tolerance_share: float = 0.02
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    carving: CarvingSettings = field(default_factory=CarvingSettings)
    room: RoomSettings = field(default_factory=RoomSettings)
    fitting: FittingSettings = field(default_factory=FittingSettings)
    models: ModelSettings = field(default_factory=ModelSettings)
    polygons: PolygonSettings = field(default_factory=PolygonSettings)
    sampling: SamplingSettings = field(default_factory=SamplingSettings)
    selection: SelectionSettings = field(default_factory=SelectionSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    poses: PoseSettings = field(default_factory=PoseSettings)
    consistency: ConsistencySettings = field(default_factory=ConsistencySettings)

    def tolerance_of(self, size: float, *, is_room: bool = False) -> float:
        """By how much the walls of a solid or a room of some size may be off, metres."""
        share = self.room.tolerance_share if is_room else self.tolerance_share
        return share * size if self.tolerance is None else min(self.tolerance, _MOST * size)
