//! Beams as the likelihood kernels read them: by coordinate, in blocks that fit the cache.
//!
//! The loops over a block are written for vectors: conditions are joined without branches, and
//! least ranges are taken without a choice between old and new, which would become stores under a
//! mask, slow on some processors.

#![allow(clippy::needless_bitwise_bool)]

use crate::Vector;
use crate::likelihood::Candidate;

/// Beams that stay in the first-level cache while the edges of a prism pass over them.
pub const BLOCK: usize = 64;

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

/// Sums side by side, as many as a register holds.
pub(crate) const LANES: usize = 8;

/// Precision of the kernels: twice as many numbers a register as in double precision, and an error
/// of a ten-millionth of the sensor's reach, since they are taken from the middle of the beams.
pub(crate) type Real = f32;

/// Beams by coordinate; the last block is filled up with beams that cost nothing.
pub struct BeamBlocks {
    pub(crate) blocks: Vec<Block>,
    /// Middle of the origins, from which all places are taken.
    middle: Vector,
    pub(crate) max_range: Real,
    pub(crate) outlier: Real,
    missing: Real,
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
    ux: [Real; BLOCK],
    uy: [Real; BLOCK],
    across: [Real; BLOCK],
    before: [Real; BLOCK],
    pub level: [Real; BLOCK],
}

/// An upright prism as the blocks see it: relative to the middle of their beams.
pub(crate) struct Walls {
    pub corners: Vec<[Real; 2]>,
    pub bottom: Real,
    pub top: Real,
}

impl Block {
    const EMPTY: Self = Self {
        z: [Real::INFINITY; BLOCK],
        uz: [0.0; BLOCK],
        range: [Real::INFINITY; BLOCK],
        background: [Real::INFINITY; BLOCK],
        precision: [0.0; BLOCK],
        ux: [0.0; BLOCK],
        uy: [0.0; BLOCK],
        across: [0.0; BLOCK],
        before: [0.0; BLOCK],
        level: [0.0; BLOCK],
    };

    /// On which side of a corner each beam passes, and how far along it comes nearest.
    // Part of loops that are compiled for several instruction sets.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub fn corner(&self, [x, y]: [Real; 2]) -> ([Real; BLOCK], [Real; BLOCK]) {
        let (mut side, mut depth) = ([0.0; BLOCK], [0.0; BLOCK]);
        for i in 0..BLOCK {
            side[i] = x * self.uy[i] - y * self.ux[i] - self.across[i];
            depth[i] = (x * self.ux[i] + y * self.uy[i] - self.before[i]) * self.level[i];
        }
        (side, depth)
    }

    /// Range of what each beam meets first: walls from both sides, the top from above, or what is
    /// at `limit`.
    // Part of loops that are compiled for several instruction sets.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub fn meet(&self, walls: &Walls, limit: [Real; BLOCK]) -> [Real; BLOCK] {
        let &Walls { bottom, top, ref corners } = walls;
        let mut nearest = limit;
        let descent: [Real; BLOCK] = std::array::from_fn(|i| (top - self.z[i]) / self.uz[i]);
        let (mut from_above, mut beyond) = (0, [0_u32; BLOCK]);
        for i in 0..BLOCK {
            from_above |= u32::from(self.z[i] > top && self.uz[i] < 0.0);
        }
        let (mut side, mut depth) = self.corner(corners[corners.len() - 1]);
        for &corner in corners {
            let (next_side, next_depth) = self.corner(corner);
            for i in 0..BLOCK {
                let crosses = (side[i] < 0.0) != (next_side[i] < 0.0);
                let share = side[i] / (side[i] - next_side[i]);
                let range = depth[i] + share * (next_depth[i] - depth[i]);
                let z = self.z[i] + range * self.uz[i];
                let meets = crosses & (range >= 0.0) & (z >= bottom) & (z <= top);
                nearest[i] = least(nearest[i], if meets { range } else { Real::INFINITY });
                // Walls crossed after the height of the top tell whether it is met inside.
                beyond[i] ^= from_above & u32::from(crosses & (range > descent[i]));
            }
            (side, depth) = (next_side, next_depth);
        }
        for i in 0..BLOCK {
            let over = (self.z[i] > top) & (self.uz[i] < 0.0);
            let meets = (beyond[i] != 0) & over;
            nearest[i] = least(nearest[i], if meets { descent[i] } else { Real::INFINITY });
        }
        nearest
    }
}

/// The smaller of two numbers of which none is NaN.
// Part of loops that are compiled for several instruction sets.
#[allow(clippy::inline_always)]
#[inline(always)]
fn least(a: Real, b: Real) -> Real {
    if a < b { a } else { b }
}

impl BeamBlocks {
    /// Beams of equally long slices.
    #[must_use]
    pub fn new(beams: Beams, prices: Prices) -> Self {
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
                }
                block
            })
            .collect();
        let Prices { max_range, outlier, missing } = prices;
        let [max_range, outlier, missing] = [max_range, outlier, missing].map(|x| x as Real);
        Self { blocks, middle, max_range, outlier, missing, len }
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

    /// Cost of one beam that should meet a surface at `expected`.
    // Part of loops that are compiled for several instruction sets.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(crate) fn cost(&self, block: &Block, i: usize, expected: Real) -> Real {
        let foreseen = expected <= self.max_range;
        let returned = block.range[i] < Real::INFINITY;
        let residual = (block.range[i] - expected) * block.precision[i];
        let explained = (0.5 * residual * residual).min(self.outlier);
        let unexpected = if returned { self.outlier } else { 0.0 };
        let lost = if foreseen { self.missing } else { 0.0 };
        if foreseen & returned { explained } else { unexpected + lost }
    }
}
