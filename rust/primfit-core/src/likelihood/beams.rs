//! Beams as the likelihood kernels read them: by coordinate, in blocks that fill registers.

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
}

/// What beams cost that the model does not explain.
#[derive(Clone, Copy)]
pub struct Prices {
    /// True ranges beyond give no return.
    pub max_range: f64,
    /// Most that a return costs, whatever its range.
    pub outlier: f64,
    /// Cost of a return that should be there and is not.
    pub missing: f64,
}

/// An upright prism: corners of its footprint in order, bottom and top.
#[derive(Clone, Copy)]
pub struct Candidate<'a> {
    /// At least three corners in order, in either direction.
    pub footprint: &'a [[f64; 2]],
    /// z of its lower end.
    pub bottom: f64,
    /// z of its upper end.
    pub top: f64,
}

/// Precision of the kernels: twice as many numbers a register as in double precision, and an error
/// of a ten-millionth of the sensor's reach, since they are taken from the middle of the beams.
pub(crate) type Real = f32;

/// Beams by coordinate; the last block is filled up with beams that cost nothing.
pub struct BeamBlocks {
    pub(crate) blocks: Vec<Block>,
    /// Middle of the origins, from which all places are taken.
    middle: Vector,
    pub(crate) max_range: Real,
    len: usize,
}

/// The moments are those of the level lines along which the beams run: `across` tells on which side
/// of a corner they pass, `before` where they are next to it.
pub(crate) struct Block {
    pub z: [Real; BLOCK],
    pub uz: [Real; BLOCK],
    pub range: [Real; BLOCK],
    pub background: [Real; BLOCK],
    pub precision: [Real; BLOCK],
    /// Most that a beam costs where a surface is in range, and what it costs where none is.
    pub most: [Real; BLOCK],
    nothing: [Real; BLOCK],
    ux: [Real; BLOCK],
    uy: [Real; BLOCK],
    across: [Real; BLOCK],
    before: [Real; BLOCK],
    pub level: [Real; BLOCK],
}

/// Where the beams of a block pass a corner: on which side, and how far along they come nearest.
#[derive(Clone, Copy)]
pub(crate) struct Passage<L> {
    pub side: L,
    pub depth: L,
}

/// An upright prism as the blocks see it: relative to the middle of their beams.
pub(crate) struct Walls {
    pub corners: Vec<[Real; 2]>,
    pub bottom: Real,
    pub top: Real,
}

#[allow(clippy::inline_always)]
impl<L: Row> Passage<L> {
    /// Negative where a beam passes between two corners.
    #[inline(always)]
    pub fn is_between(self, next: Self) -> L {
        self.side.flip(next.side)
    }

    /// What share of the way to the second corner a beam passes at, and how far along it that is.
    #[inline(always)]
    pub fn crossing(self, next: Self) -> (L, L) {
        let share = self.side / (self.side - next.side);
        (share, self.depth + share * (next.depth - self.depth))
    }
}

// Parts of loops that are compiled for several instruction sets.
#[allow(clippy::inline_always)]
impl Block {
    const EMPTY: Self = Self {
        z: [Real::INFINITY; BLOCK],
        uz: [0.0; BLOCK],
        range: [Real::INFINITY; BLOCK],
        background: [Real::INFINITY; BLOCK],
        precision: [0.0; BLOCK],
        most: [0.0; BLOCK],
        nothing: [0.0; BLOCK],
        ux: [0.0; BLOCK],
        uy: [0.0; BLOCK],
        across: [0.0; BLOCK],
        before: [0.0; BLOCK],
        level: [0.0; BLOCK],
    };

    #[inline(always)]
    pub fn pass<L: Row>(&self, [x, y]: [Real; 2]) -> Passage<L> {
        let (x, y) = (L::splat(x), L::splat(y));
        let (ux, uy) = (L::load(&self.ux), L::load(&self.uy));
        Passage {
            side: x * uy - y * ux - L::load(&self.across),
            depth: (x * ux + y * uy - L::load(&self.before)) * L::load(&self.level),
        }
    }

    /// Range of what each beam meets first: walls from both sides, the top from above, or what is
    /// at `limit`.
    #[inline(always)]
    pub fn meet<L: Row>(&self, walls: &Walls, limit: L) -> L {
        let (zero, one, never) = (L::splat(0.0), L::splat(1.0), L::splat(Real::INFINITY));
        let (bottom, top) = (L::splat(walls.bottom), L::splat(walls.top));
        let (z, uz) = (L::load(&self.z), L::load(&self.uz));
        let over = !z.le(top) & !zero.le(uz) & ((1 << BLOCK) - 1);
        let descent = (top - z) / uz;
        // Negative after an odd number of walls beyond the height of the top.
        let mut beyond = one;
        let mut nearest = limit;
        let mut last = self.pass(walls.corners[walls.corners.len() - 1]);
        for &corner in &walls.corners {
            let next = self.pass(corner);
            let (_, range) = last.crossing(next);
            let height = z + range * uz;
            let met = height.where_le(top, range, never);
            let met = bottom.where_le(height, met, never);
            let met = zero.where_le(range, met, never);
            let is_between = last.is_between(next);
            nearest = nearest.min(is_between.where_negative(met, never));
            if over != 0 {
                let side = descent.where_le(range, zero - one, one);
                beyond = beyond.flip(is_between.where_negative(side, one));
            }
            last = next;
        }
        if over != 0 {
            let met = beyond.where_negative(descent, never);
            let met = zero.where_le(uz, never, met);
            nearest = nearest.min(z.where_le(top, never, met));
        }
        nearest
    }

    /// Cost of beams that should meet a surface at `expected`, those beyond `max_range` none.
    #[inline(always)]
    pub fn costs<L: Row>(&self, expected: L, max_range: Real) -> L {
        let residual = self.residuals(expected);
        let explained = (L::splat(0.5) * residual * residual).min(L::load(&self.most));
        expected.where_le(L::splat(max_range), explained, L::load(&self.nothing))
    }

    /// By how many standard deviations ranges exceed what is expected.
    #[inline(always)]
    pub fn residuals<L: Row>(&self, expected: L) -> L {
        (L::load(&self.range) - expected) * L::load(&self.precision)
    }
}

impl BeamBlocks {
    /// Beams of equally long slices.
    #[must_use]
    pub fn new(beams: Beams, prices: Prices) -> Self {
        let Prices { max_range, outlier, missing } = prices;
        let len = beams.ranges.len();
        let scale = 1.0 / len.max(1) as f64;
        let middle = std::array::from_fn(|x| {
            beams.origins.iter().map(|origin| origin[x]).sum::<f64>() * scale
        });
        let blocks = (0..len)
            .step_by(BLOCK)
            .map(|first| {
                let mut block = Block::EMPTY;
                for (i, row) in (first..len.min(first + BLOCK)).enumerate() {
                    let [x, y, z] = std::array::from_fn(|x| beams.origins[row][x] - middle[x]);
                    let [ux, uy, uz] = beams.directions[row];
                    block.z[i] = z as Real;
                    [block.ux[i], block.uy[i], block.uz[i]] = [ux, uy, uz].map(|u| u as Real);
                    block.range[i] = beams.ranges[row] as Real;
                    block.background[i] = beams.background[row] as Real;
                    block.precision[i] = (1.0 / beams.sigmas[row]) as Real;
                    block.across[i] = (x * uy - y * ux) as Real;
                    block.before[i] = (x * ux + y * uy) as Real;
                    block.level[i] = (1.0 / (ux * ux + uy * uy)) as Real;
                    let is_return = beams.ranges[row] < f64::INFINITY;
                    block.most[i] = (if is_return { outlier } else { missing }) as Real;
                    block.nothing[i] = if is_return { outlier as Real } else { 0.0 };
                }
                block
            })
            .collect();
        Self { blocks, middle, max_range: max_range as Real, len }
    }

    /// How many beams there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// A prism as the blocks see it.
    pub(crate) fn walls(&self, candidate: &Candidate) -> Walls {
        let [x, y, z] = self.middle;
        Walls {
            corners: candidate
                .footprint
                .iter()
                .map(|corner| [(corner[0] - x) as Real, (corner[1] - y) as Real])
                .collect(),
            bottom: (candidate.bottom - z) as Real,
            top: (candidate.top - z) as Real,
        }
    }
}
