//! Beams as the likelihood kernels read them: by coordinate, in blocks that fill registers.

use super::ellipse::Ellipse;
use super::meeting::{Beam, Real, Walls};
use crate::Vector;
use crate::lanes::Lanes;

/// Beams that the edges of a prism pass at a time.
pub(crate) const BLOCK: usize = 16;

/// Numbers of the beams of a block.
pub(crate) trait Row: Lanes<Array = [Real; BLOCK]> {}

impl<L: Lanes<Array = [Real; BLOCK]>> Row for L {}

/// Beams, and what they meet when the solid in question is not there.
#[derive(Clone, Copy)]
pub struct Beams<'a> {
    /// Where each beam starts.
    pub origins: &'a [Vector],
    /// Its unit direction.
    pub directions: &'a [Vector],
    /// Its measured range; infinite for no return.
    pub ranges: &'a [f64],
    /// Range of the nearest other surface; infinite for none.
    pub background: &'a [f64],
    /// Standard deviation of its range.
    pub sigmas: &'a [f64],
    /// Which true ranges give a return.
    pub limits: Limits<'a>,
}

/// True ranges outside give no return.
#[derive(Clone, Copy)]
pub enum Limits<'a> {
    /// Shortest and longest range of all beams.
    All([f64; 2]),
    /// Shortest and longest ranges, one of each a beam.
    Each([&'a [f64]; 2]),
}

impl Limits<'_> {
    /// Shortest and longest range of a beam.
    #[must_use]
    pub fn of(&self, row: usize) -> [f64; 2] {
        match self {
            Self::All(limits) => *limits,
            Self::Each(limits) => limits.map(|each| each[row]),
        }
    }
}

/// What beams cost that the model does not explain.
#[derive(Clone, Copy)]
pub struct Prices {
    /// Most that a return costs, whatever its range.
    pub outlier: f64,
    /// Cost of a return that should be there and is not.
    pub missing: f64,
}

/// An upright prism or elliptic cylinder: its footprint, bottom and top.
#[derive(Clone, Copy)]
pub struct Candidate<'a> {
    /// At least three corners in order, in either direction; if it is round, the four ends of the
    /// axes of an ellipse, counter-clockwise.
    pub footprint: &'a [[f64; 2]],
    /// Whether the footprint is an ellipse.
    pub is_round: bool,
    /// z of its lower end.
    pub bottom: f64,
    /// z of its upper end.
    pub top: f64,
    /// Whether it has no top face, as the walls of a room.
    pub is_open: bool,
}

/// Beams relative to their middle, one by one and by coordinate.
pub struct BeamBlocks {
    pub(super) beams: Vec<Beam<Real>>,
    /// The last one is filled up with beams that cost nothing.
    pub(super) blocks: Vec<Block>,
    /// Middle of the origins, from which all places are taken.
    pub(super) middle: Vector,
}

pub(super) type Block = Beam<[Real; BLOCK]>;

const NONE: Beam<Real> = Beam {
    z: Real::INFINITY,
    uz: 0.0,
    range: Real::INFINITY,
    background: Real::INFINITY,
    precision: 0.0,
    most: 0.0,
    nothing: 0.0,
    low: 0.0,
    high: 0.0,
    ux: 0.0,
    uy: 0.0,
    across: 0.0,
    before: 0.0,
    level: 0.0,
};

impl BeamBlocks {
    /// Beams of equally long slices.
    #[must_use]
    pub fn new(beams: Beams, prices: Prices) -> Self {
        let Prices { outlier, missing } = prices;
        let len = beams.ranges.len();
        let scale = 1.0 / len.max(1) as f64;
        let middle = std::array::from_fn(|x| {
            beams.origins.iter().map(|origin| origin[x]).sum::<f64>() * scale
        });
        let beam = |row: usize| {
            let [x, y, z] = std::array::from_fn(|x| beams.origins[row][x] - middle[x]);
            let [ux, uy, uz] = beams.directions[row];
            let is_return = beams.ranges[row] < f64::INFINITY;
            let [low, high] = beams.limits.of(row);
            Beam {
                z: z as Real,
                uz: uz as Real,
                range: beams.ranges[row] as Real,
                background: beams.background[row] as Real,
                precision: (1.0 / beams.sigmas[row]) as Real,
                most: (if is_return { outlier } else { missing }) as Real,
                nothing: if is_return { outlier as Real } else { 0.0 },
                low: low as Real,
                high: high as Real,
                ux: ux as Real,
                uy: uy as Real,
                across: (x * uy - y * ux) as Real,
                before: (x * ux + y * uy) as Real,
                level: (1.0 / (ux * ux + uy * uy)) as Real,
            }
        };
        let beams: Vec<_> = (0..len).map(beam).collect();
        let blocks = beams.chunks(BLOCK).map(side_by_side).collect();
        Self { beams, blocks, middle }
    }

    /// How many beams there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.beams.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.beams.is_empty()
    }

    /// A prism as the blocks see it.
    pub(crate) fn walls(&self, candidate: &Candidate) -> Walls<Real> {
        let [x, y, z] = self.middle;
        let corners = if candidate.is_round { &[] } else { candidate.footprint };
        let value = |of: &dyn Fn(&Candidate) -> f64| of(candidate) as Real;
        Walls {
            corners: corners
                .iter()
                .map(|corner| [(corner[0] - x) as Real, (corner[1] - y) as Real])
                .collect(),
            ellipse: candidate.is_round.then(|| Ellipse::of(value, [x, y])),
            bottom: (candidate.bottom - z) as Real,
            top: (candidate.top - z) as Real,
            is_open: candidate.is_open,
        }
    }
}

fn side_by_side(beams: &[Beam<Real>]) -> Block {
    let row = |value: fn(&Beam<Real>) -> Real| {
        std::array::from_fn(|i| value(beams.get(i).unwrap_or(&NONE)))
    };
    Beam {
        z: row(|beam| beam.z),
        uz: row(|beam| beam.uz),
        range: row(|beam| beam.range),
        background: row(|beam| beam.background),
        precision: row(|beam| beam.precision),
        most: row(|beam| beam.most),
        nothing: row(|beam| beam.nothing),
        low: row(|beam| beam.low),
        high: row(|beam| beam.high),
        ux: row(|beam| beam.ux),
        uy: row(|beam| beam.uy),
        across: row(|beam| beam.across),
        before: row(|beam| beam.before),
        level: row(|beam| beam.level),
    }
}
