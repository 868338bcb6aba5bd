//! How well upright prisms explain the ranges of many beams.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Beams that stay in the first-level cache while the edges of a prism pass over them.
const BLOCK: usize = 256;
/// Sums side by side, as many as the widest registers hold.
const LANES: usize = 8;
/// Candidates between two questions to the caller.
const CHUNK: usize = 64;

/// Beams, and what they meet when the prism in question is not there.
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
    /// True ranges beyond give no return.
    pub max_range: f64,
    /// Cost of a beam that the model does not explain.
    pub cap: f64,
}

/// Beams by coordinate.
struct Block {
    x: [f64; BLOCK],
    y: [f64; BLOCK],
    z: [f64; BLOCK],
    ux: [f64; BLOCK],
    uy: [f64; BLOCK],
    uz: [f64; BLOCK],
    range: [f64; BLOCK],
    background: [f64; BLOCK],
    precision: [f64; BLOCK],
}

/// An upright prism: corners of its footprint in order, bottom and top.
#[derive(Clone, Copy)]
pub struct Candidate<'a> {
    /// Corners in order, in either direction.
    pub footprint: &'a [[f64; 2]],
    /// z of its lower end.
    pub bottom: f64,
    /// z of its upper end.
    pub top: f64,
}

/// Negative log-likelihood of the ranges for each candidate, up to a constant.
///
/// A return that the model foresees costs half its squared residual in sigmas, at the most
/// `cap`; a return without a surface in range, or a missing one, costs `cap`. Beams meet walls
/// from both sides and the top from above. The sums run in the order of the beams.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn prism_costs(
    beams: Beams,
    candidates: &[Candidate],
    workers: &Workers,
) -> Result<Vec<f64>, Error> {
    let blocks = blocks(beams);
    let mut costs = vec![0.0; candidates.len()];
    for (costs, candidates) in costs.chunks_mut(CHUNK).zip(candidates.chunks(CHUNK)) {
        workers.check()?;
        workers.install(|| {
            costs.par_iter_mut().zip(candidates).for_each(|(cost, candidate)| {
                *cost = blocks.iter().map(|block| block_cost(block, candidate, beams)).sum();
            });
        });
    }
    Ok(costs)
}

/// The last block is filled up with beams that cost nothing: no return, nothing to meet.
fn blocks(beams: Beams) -> Vec<Block> {
    (0..beams.ranges.len())
        .step_by(BLOCK)
        .map(|first| {
            let mut block = Block {
                x: [0.0; BLOCK],
                y: [0.0; BLOCK],
                z: [f64::INFINITY; BLOCK],
                ux: [0.0; BLOCK],
                uy: [0.0; BLOCK],
                uz: [0.0; BLOCK],
                range: [f64::INFINITY; BLOCK],
                background: [f64::INFINITY; BLOCK],
                precision: [0.0; BLOCK],
            };
            let last = beams.ranges.len().min(first + BLOCK);
            for (i, row) in (first..last).enumerate() {
                [block.x[i], block.y[i], block.z[i]] = beams.origins[row];
                [block.ux[i], block.uy[i], block.uz[i]] = beams.directions[row];
                block.range[i] = beams.ranges[row];
                block.background[i] = beams.background[row];
                block.precision[i] = 1.0 / beams.sigmas[row];
            }
            block
        })
        .collect()
}

fn block_cost(block: &Block, candidate: &Candidate, beams: Beams) -> f64 {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512vl,avx512dq")]
        fn avx512(block: &Block, candidate: &Candidate, beams: Beams) -> f64 {
            block_cost_body(block, candidate, beams)
        }
        #[target_feature(enable = "avx2")]
        fn avx2(block: &Block, candidate: &Candidate, beams: Beams) -> f64 {
            block_cost_body(block, candidate, beams)
        }
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
        {
            // SAFETY: the processor has what the function is compiled for.
            return unsafe { avx512(block, candidate, beams) };
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has what the function is compiled for.
            return unsafe { avx2(block, candidate, beams) };
        }
    }
    block_cost_body(block, candidate, beams)
}

// A plain function would not be compiled for the instruction set of its caller.
#[allow(clippy::inline_always)]
#[inline(always)]
fn block_cost_body(block: &Block, candidate: &Candidate, beams: Beams) -> f64 {
    let mut expected = block.background;
    let mut beyond = [0.0_f64; BLOCK];
    let (bottom, top) = (candidate.bottom, candidate.top);
    let corners = candidate.footprint;
    for (k, a) in corners.iter().enumerate() {
        let b = corners[(k + 1) % corners.len()];
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        for i in 0..BLOCK {
            let (dx, dy) = (a[0] - block.x[i], a[1] - block.y[i]);
            let across = block.ux[i] * ey - block.uy[i] * ex;
            let depth = (dx * ey - dy * ex) / across;
            // Where along the edge, times `across`: between zero and it on the edge.
            let along = dx * block.uy[i] - dy * block.ux[i];
            let on_edge = along * across >= 0.0 && along.abs() <= across.abs() && across != 0.0;
            let z = block.z[i] + depth * block.uz[i];
            let meets = on_edge && depth >= 0.0 && z >= bottom && z <= top;
            expected[i] = if meets && depth < expected[i] { depth } else { expected[i] };
            // Edges crossed after the height of the top tell whether it is met inside.
            let descent = (top - block.z[i]) / block.uz[i];
            beyond[i] += if on_edge && depth > descent { 1.0 } else { 0.0 };
        }
    }
    for i in 0..BLOCK {
        let descent = (top - block.z[i]) / block.uz[i];
        let inside = beyond[i] - 2.0 * (beyond[i] * 0.5).floor() > 0.5;
        let meets = inside && block.z[i] > top && block.uz[i] < 0.0 && descent < expected[i];
        expected[i] = if meets { descent } else { expected[i] };
    }
    let mut sums = [0.0_f64; LANES];
    for first in (0..BLOCK).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            let i = first + lane;
            let foreseen = expected[i] <= beams.max_range;
            let returned = block.range[i] < f64::INFINITY;
            let residual = (block.range[i] - expected[i]) * block.precision[i];
            let explained = (0.5 * residual * residual).min(beams.cap);
            let mismatch = if foreseen == returned { 0.0 } else { beams.cap };
            *sum += if foreseen && returned { explained } else { mismatch };
        }
    }
    sums.iter().sum()
}
