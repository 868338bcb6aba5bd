//! Beams as the likelihood kernels read them: by coordinate, in blocks that fit the cache.

use crate::Vector;

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

/// Beams by coordinate; the last block is filled up with beams that cost nothing.
pub struct BeamBlocks {
    pub(crate) blocks: Vec<Block>,
    pub(crate) prices: Prices,
    len: usize,
}

/// The moments are those of the level lines along which the beams run: `across` tells on which side
/// of a corner they pass, `before` where they are next to it.
pub(crate) struct Block {
    pub x: [f64; BLOCK],
    pub y: [f64; BLOCK],
    pub z: [f64; BLOCK],
    pub ux: [f64; BLOCK],
    pub uy: [f64; BLOCK],
    pub uz: [f64; BLOCK],
    pub range: [f64; BLOCK],
    pub background: [f64; BLOCK],
    pub precision: [f64; BLOCK],
    across: [f64; BLOCK],
    before: [f64; BLOCK],
    level: [f64; BLOCK],
}

impl Block {
    const EMPTY: Self = Self {
        x: [0.0; BLOCK],
        y: [0.0; BLOCK],
        z: [f64::INFINITY; BLOCK],
        ux: [0.0; BLOCK],
        uy: [0.0; BLOCK],
        uz: [0.0; BLOCK],
        range: [f64::INFINITY; BLOCK],
        background: [f64::INFINITY; BLOCK],
        precision: [0.0; BLOCK],
        across: [0.0; BLOCK],
        before: [0.0; BLOCK],
        level: [0.0; BLOCK],
    };

    /// On which side of a corner each beam passes, and how far along it comes nearest.
    // Part of loops that are compiled for several instruction sets.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub fn corner(&self, [x, y]: [f64; 2]) -> ([f64; BLOCK], [f64; BLOCK]) {
        let (mut side, mut depth) = ([0.0; BLOCK], [0.0; BLOCK]);
        for i in 0..BLOCK {
            side[i] = x * self.uy[i] - y * self.ux[i] - self.across[i];
            depth[i] = (x * self.ux[i] + y * self.uy[i] - self.before[i]) * self.level[i];
        }
        (side, depth)
    }
}

impl BeamBlocks {
    /// Beams of equally long slices.
    #[must_use]
    pub fn new(beams: Beams, prices: Prices) -> Self {
        let len = beams.ranges.len();
        let blocks = (0..len)
            .step_by(BLOCK)
            .map(|first| {
                let mut block = Block::EMPTY;
                for (i, row) in (first..len.min(first + BLOCK)).enumerate() {
                    [block.x[i], block.y[i], block.z[i]] = beams.origins[row];
                    [block.ux[i], block.uy[i], block.uz[i]] = beams.directions[row];
                    block.range[i] = beams.ranges[row];
                    block.background[i] = beams.background[row];
                    block.precision[i] = 1.0 / beams.sigmas[row];
                    let ([x, y, _], [ux, uy, _]) = (beams.origins[row], beams.directions[row]);
                    block.across[i] = x * uy - y * ux;
                    block.before[i] = x * ux + y * uy;
                    block.level[i] = 1.0 / (ux * ux + uy * uy);
                }
                block
            })
            .collect();
        Self { blocks, prices, len }
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

    /// Cost of one beam that should meet a surface at `expected`.
    // Part of loops that are compiled for several instruction sets.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(crate) fn cost(&self, block: &Block, i: usize, expected: f64) -> f64 {
        let Prices { max_range, outlier, missing } = self.prices;
        let foreseen = expected <= max_range;
        let returned = block.range[i] < f64::INFINITY;
        let residual = (block.range[i] - expected) * block.precision[i];
        let explained = (0.5 * residual * residual).min(outlier);
        let unexpected = if returned { outlier } else { 0.0 };
        let lost = if foreseen { missing } else { 0.0 };
        if foreseen && returned { explained } else { unexpected + lost }
    }
}
