//! How well upright prisms explain the ranges of many beams.

use crate::beams::{BLOCK, BeamBlocks, Block};
use crate::instructions::widest;
use crate::{Error, Workers};
use rayon::prelude::*;

/// Sums side by side, as many as the widest registers hold.
const LANES: usize = 8;
/// Candidates between two questions to the caller.
const CHUNK: usize = 64;

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

impl Candidate<'_> {
    /// The two corners of edge `k`.
    pub(crate) fn edge(&self, k: usize) -> ([f64; 2], [f64; 2]) {
        (self.footprint[k], self.footprint[(k + 1) % self.footprint.len()])
    }
}

/// Negative log-likelihood of the ranges for each candidate, up to a constant.
///
/// A return that the model foresees costs half its squared residual in sigmas, at the most what an
/// outlier costs; a return without a surface in range costs as an outlier, a missing return its
/// own price. Beams meet walls from both sides and the top from above. The sums run in the order
/// of the beams.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn prism_costs(
    beams: &BeamBlocks,
    candidates: &[Candidate],
    workers: &Workers,
) -> Result<Vec<f64>, Error> {
    let mut costs = vec![0.0; candidates.len()];
    for (costs, candidates) in costs.chunks_mut(CHUNK).zip(candidates.chunks(CHUNK)) {
        workers.check()?;
        workers.install(|| {
            costs.par_iter_mut().zip(candidates).for_each(|(cost, candidate)| {
                *cost = beams.blocks.iter().map(|block| block_cost(block, candidate, beams)).sum();
            });
        });
    }
    Ok(costs)
}

/// How far along each beam it first meets the upright walls over a footprint, however high they
/// are; infinite for never.
#[must_use]
pub fn wall_depths(beams: &BeamBlocks, footprint: &[[f64; 2]]) -> Vec<f64> {
    let mut depths = Vec::with_capacity(beams.blocks.len() * BLOCK);
    for block in &beams.blocks {
        depths.extend(block_depths(block, footprint));
    }
    depths.truncate(beams.len());
    depths
}

widest! {
fn block_depths(block: &Block, footprint: &[[f64; 2]]) -> [f64; BLOCK] {
    let mut nearest = [f64::INFINITY; BLOCK];
    let (mut side, mut depth) = block.corner(footprint[footprint.len() - 1]);
    for &corner in footprint {
        let (next_side, next_depth) = block.corner(corner);
        for i in 0..BLOCK {
            let crosses = (side[i] < 0.0) != (next_side[i] < 0.0);
            let along = side[i] / (side[i] - next_side[i]);
            let met = depth[i] + along * (next_depth[i] - depth[i]);
            let meets = crosses && met >= 0.0 && met < nearest[i];
            nearest[i] = if meets { met } else { nearest[i] };
        }
        (side, depth) = (next_side, next_depth);
    }
    nearest
}
}

widest! {
fn block_cost(block: &Block, candidate: &Candidate, beams: &BeamBlocks) -> f64 {
    let mut expected = block.background;
    let (bottom, top) = (candidate.bottom, candidate.top);
    let mut from_above = false;
    for i in 0..BLOCK {
        from_above |= block.z[i] > top && block.uz[i] < 0.0;
    }
    let mut beyond = [false; BLOCK];
    let first = candidate.footprint[candidate.footprint.len() - 1];
    let (mut side, mut depth) = block.corner(first);
    for &corner in candidate.footprint {
        let (next_side, next_depth) = block.corner(corner);
        for i in 0..BLOCK {
            let crosses = (side[i] < 0.0) != (next_side[i] < 0.0);
            let along = side[i] / (side[i] - next_side[i]);
            let met = depth[i] + along * (next_depth[i] - depth[i]);
            let z = block.z[i] + met * block.uz[i];
            let meets = crosses && met >= 0.0 && z >= bottom && z <= top && met < expected[i];
            expected[i] = if meets { met } else { expected[i] };
        }
        if from_above {
            // Edges crossed after the height of the top tell whether it is met inside.
            for i in 0..BLOCK {
                let crosses = (side[i] < 0.0) != (next_side[i] < 0.0);
                let along = side[i] / (side[i] - next_side[i]);
                let met = depth[i] + along * (next_depth[i] - depth[i]);
                let descent = (top - block.z[i]) / block.uz[i];
                beyond[i] ^= crosses && met > descent;
            }
        }
        (side, depth) = (next_side, next_depth);
    }
    if from_above {
        for i in 0..BLOCK {
            let descent = (top - block.z[i]) / block.uz[i];
            let over = block.z[i] > top && block.uz[i] < 0.0;
            let meets = beyond[i] && over && descent < expected[i];
            expected[i] = if meets { descent } else { expected[i] };
        }
    }
    let mut sums = [0.0_f64; LANES];
    for first in (0..BLOCK).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            let i = first + lane;
            *sum += beams.cost(block, i, expected[i]);
        }
    }
    sums.iter().sum()
}
}
