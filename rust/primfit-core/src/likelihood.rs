//! How well upright prisms explain the ranges of many beams.

mod beams;
mod carving;
mod climbing;
mod expansion;
mod family;
mod sampling;
mod student;

pub use beams::{BeamBlocks, Beams, Candidate, Prices};
pub use carving::{Grid, carve};
pub use climbing::{Climb, Slope};
pub use expansion::{Expansion, expand};
pub use family::Family;
pub use sampling::{Effort, Posterior, sample};

use crate::instructions::widest;
use crate::lanes::{Isa, Lanes};
use crate::{Error, Workers};
use beams::{BLOCK, Real, Walls};
use rayon::prelude::*;

/// Candidates between two questions to the caller.
const CHUNK: usize = 64;

/// Pairs of a candidate and a beam that are done sooner than other threads would begin.
const FEW: usize = 1 << 17;

/// Blocks that are summed up in single precision.
pub(crate) const RUN: usize = 8;

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
    let cost = |candidate| walls_cost(beams, &beams.walls(candidate));
    if candidates.len() * beams.len() < FEW {
        return Ok(candidates.iter().map(cost).collect());
    }
    let mut costs = vec![0.0; candidates.len()];
    for (costs, candidates) in costs.chunks_mut(CHUNK).zip(candidates.chunks(CHUNK)) {
        workers.check()?;
        workers.install(|| {
            costs
                .par_iter_mut()
                .zip(candidates)
                .for_each(|(each, candidate)| *each = cost(candidate));
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
    let mut depths = walls_depths(beams, &walls);
    depths.truncate(beams.len());
    depths
}

widest! {
fn walls_depths(beams: &BeamBlocks, walls: &Walls) -> Vec<f64> {
    type Lane = <Set as Isa>::Sixteen;
    let mut depths = Vec::with_capacity(beams.blocks.len() * BLOCK);
    for block in &beams.blocks {
        let nearest = block.meet(walls, Lane::splat(Real::INFINITY));
        depths.extend(nearest.store().map(f64::from));
    }
    depths
}
}

widest! {
fn walls_cost(beams: &BeamBlocks, walls: &Walls) -> f64 {
    type Lane = <Set as Isa>::Sixteen;
    let mut cost = 0.0;
    for run in beams.blocks.chunks(RUN) {
        let mut sum = Lane::splat(0.0);
        for block in run {
            let nearest = block.meet(walls, Lane::load(&block.background));
            sum = sum + block.costs(nearest, beams.max_range);
        }
        cost += sum.store().map(f64::from).iter().sum::<f64>();
    }
    cost
}
}
