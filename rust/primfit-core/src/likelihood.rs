//! How well upright prisms explain the ranges of many beams.

use crate::beams::{BLOCK, BeamBlocks, Block, LANES, Real, Walls};
use crate::instructions::widest;
use crate::{Error, Workers};
use rayon::prelude::*;

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
                let walls = beams.walls(candidate);
                *cost = beams.blocks.iter().map(|block| block_cost(block, &walls, beams)).sum();
            });
        });
    }
    Ok(costs)
}

/// How far along each beam it first meets the upright walls over a footprint, however high they
/// are; infinite for never.
#[must_use]
pub fn wall_depths(beams: &BeamBlocks, footprint: &[[f64; 2]]) -> Vec<f64> {
    let endless = Candidate { footprint, bottom: f64::NEG_INFINITY, top: f64::INFINITY };
    let walls = beams.walls(&endless);
    let mut depths = Vec::with_capacity(beams.blocks.len() * BLOCK);
    for block in &beams.blocks {
        depths.extend(block_depths(block, &walls).map(f64::from));
    }
    depths.truncate(beams.len());
    depths
}

widest! {
fn block_depths(block: &Block, walls: &Walls) -> [Real; BLOCK] {
    block.meet(walls, [Real::INFINITY; BLOCK])
}
}

widest! {
fn block_cost(block: &Block, walls: &Walls, beams: &BeamBlocks) -> f64 {
    let nearest = block.meet(walls, block.background);
    let mut sums = [0.0; LANES];
    for first in (0..BLOCK).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += beams.cost(block, first + lane, nearest[first + lane]);
        }
    }
    f64::from(sums.iter().sum::<Real>())
}
}
