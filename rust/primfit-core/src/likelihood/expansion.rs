//! The likelihood of a prism near one place, to second order where it is smooth.
//!
//! While every corner stays on its side of a beam, the beam meets the same wall, and its range is a
//! smooth function of the two corners of that wall. Those beams are summed up as a gradient and an
//! information matrix; the others, at silhouettes and edges, are left open, to be cast again for
//! each candidate.

use super::Candidate;
use super::beams::{BLOCK, BeamBlocks, Block, Row};
use super::ellipse;
use super::meeting::{Edges, Real, Walls};
use crate::instructions::widest;
use crate::lanes::{Isa, Lanes};

/// Blocks that are summed up in single precision.
const RUN: usize = 8;

/// Cost of a prism and how it changes with its corners.
pub struct Expansion {
    /// Of all beams that are not open, at the prism itself.
    pub cost: f64,
    /// Derivatives (2 m) of that cost along x and y of each corner.
    pub gradient: Vec<f64>,
    /// Gauss-Newton matrix (2 m x 2 m) of second derivatives.
    pub information: Vec<f64>,
    /// Beams whose surface, or whether they have one, may change.
    pub open: Vec<usize>,
}

/// Sums over the beams that meet one wall: the gradient by the share of its first and second corner,
/// and the products of both.
const N_SUMS: usize = 5;

/// Second-order expansion of the cost of one prism, whose corners may move by `slack` in any
/// direction and whose top by `top_slack` up and down; see [`Expansion`].
#[must_use]
pub fn expand(beams: &BeamBlocks, candidate: &Candidate, slack: f64, top_slack: f64) -> Expansion {
    let walls = beams.walls(candidate);
    let slack = (slack + top_slack > 0.0).then_some([slack as Real, top_slack as Real]);
    let (cost, sums, open) = sum_walls(beams, &walls, slack);
    let (gradient, information) = if candidate.is_round {
        ellipse::assemble(candidate, &sums)
    } else {
        assemble(candidate, sums.as_chunks().0)
    };
    Expansion { cost, gradient, information, open }
}

widest! {
fn sum_walls(
    beams: &BeamBlocks,
    walls: &Walls<Real>,
    slack: Option<[Real; 2]>,
) -> (f64, Vec<f64>, Vec<usize>) {
    type Lane = <Set as Isa>::Sixteen;
    let n_sums = N_SUMS * walls.corners.len();
    let n_sums = if walls.ellipse.is_some() { ellipse::N_SUMS } else { n_sums };
    let (mut cost, mut sums) = (0.0, vec![0.0; n_sums]);
    let mut open = Vec::new();
    let mut run_sums = vec![Lane::splat(0.0); n_sums];
    for (run, blocks) in beams.blocks.chunks(RUN).enumerate() {
        run_sums.fill(Lane::splat(0.0));
        let mut run_cost = Lane::splat(0.0);
        for (block, number) in blocks.iter().zip(run * RUN..) {
            let nearest = block.meet(walls, Lane::load(&block.background));
            let mut weight = [1.0; BLOCK];
            if let Some([slack, top_slack]) = slack {
                let may_change = may_change(block, walls, nearest, slack, top_slack);
                let n_beams = BLOCK.min(beams.len() - number * BLOCK);
                for (i, weight) in weight.iter_mut().enumerate().take(n_beams) {
                    if may_change >> i & 1 == 1 {
                        open.push(number * BLOCK + i);
                        *weight = 0.0;
                    }
                }
            }
            let weight = Lane::load(&weight);
            let costs = block.costs(nearest);
            run_cost = run_cost + weight * costs;
            add_slopes(block, walls, nearest, weight, &mut run_sums);
        }
        cost += total(run_cost);
        for (sum, &run_sum) in sums.iter_mut().zip(&run_sums) {
            *sum += total(run_sum);
        }
    }
    (cost, sums, open)
}
}

/// The sum of the lanes, in their order.
#[allow(clippy::inline_always)]
#[inline(always)]
fn total<L: Row>(lanes: L) -> f64 {
    lanes.store().iter().copied().map(f64::from).sum()
}

/// Adds what the beams of a block that meet each wall say of its corners, or of an ellipse.
// Part of loops that are compiled for several instruction sets.
#[allow(clippy::inline_always)]
#[inline(always)]
fn add_slopes<L: Row>(block: &Block, walls: &Walls<Real>, nearest: L, weight: L, sums: &mut [L]) {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    // Sigmas a metre where the range counts, else nothing, and no infinite residual beside it.
    let residual: L = block.residuals(nearest);
    let precision = weight * L::load(&block.precision);
    let precision = block.within(nearest, precision, zero);
    let square = L::splat(0.5) * residual * residual;
    let precision = L::load(&block.most).where_le(square, zero, precision);
    let residual = zero.where_le(zero - precision, zero, residual);
    if let Some(ellipse) = &walls.ellipse {
        ellipse::add_slopes(block, ellipse, nearest, residual, precision, sums);
        return;
    }
    let mut last = block.pass::<L, Real>(&walls.corners[walls.corners.len() - 1]);
    for (&corner, sums) in walls.corners.iter().zip(sums.as_chunks_mut::<N_SUMS>().0) {
        let next = block.pass(&corner);
        let is_between = last.is_between(next);
        if is_between.any_negative() {
            // The very steps by which the nearest was found, so it is found again.
            let (share, range) = last.crossing(next);
            let met = range.where_le(nearest, nearest.where_le(range, is_between, one), one);
            let rate = met.where_negative(precision / (last.side - next.side), zero);
            let second = met.where_negative(share * rate, zero);
            let first = rate - second;
            sums[0] = sums[0] - residual * first;
            sums[1] = sums[1] - residual * second;
            sums[2] = sums[2] + first * first;
            sums[3] = sums[3] + first * second;
            sums[4] = sums[4] + second * second;
        }
        last = next;
    }
}

/// The sums of the walls as derivatives by corner. A range changes with the corners of its wall
/// along the wall's normal only.
fn assemble(candidate: &Candidate, sums: &[[f64; N_SUMS]]) -> (Vec<f64>, Vec<f64>) {
    let m = candidate.footprint.len();
    let (mut gradient, mut matrix) = (vec![0.0; 2 * m], vec![0.0; 4 * m * m]);
    for (k, sums) in sums.iter().enumerate() {
        let corners = [(k + m - 1) % m, k];
        let [a, b] = corners.map(|corner| candidate.footprint[corner]);
        let normal = [b[1] - a[1], a[0] - b[0]];
        // Rounding must not make information negative.
        let [_, _, first, both, second] = *sums;
        let most = (first * second).sqrt();
        let information = [first, both.clamp(-most, most), second];
        for (p, &row) in corners.iter().enumerate() {
            for x in 0..2 {
                gradient[2 * row + x] += sums[p] * normal[x];
                for (q, &column) in corners.iter().enumerate() {
                    for y in 0..2 {
                        matrix[(2 * row + x) * 2 * m + 2 * column + y] +=
                            information[p + q] * normal[x] * normal[y];
                    }
                }
            }
        }
    }
    (gradient, matrix)
}

/// A bit for each beam of a block that may meet something else when corners and top move.
// Part of loops that are compiled for several instruction sets.
#[allow(clippy::inline_always)]
#[inline(always)]
fn may_change<L: Row>(
    block: &Block,
    walls: &Walls<Real>,
    nearest: L,
    slack: Real,
    top_slack: Real,
) -> u32 {
    let zero = L::splat(0.0);
    let edges = Edges::of(block, walls, top_slack);
    let (open, crossed) = match &walls.ellipse {
        Some(ellipse) => ellipse::may_change(block, ellipse, nearest, slack, &edges),
        None => corners_may_change(block, walls, nearest, slack, &edges),
    };
    let top = L::splat(walls.top - top_slack);
    let over = !L::load(&block.z).le(top) & !zero.le(L::load(&block.uz));
    if walls.is_open { open } else { open | over & crossed }
}

/// The same by the walls alone; and a bit for each beam that crosses one of them ahead.
#[allow(clippy::inline_always)]
#[inline(always)]
fn corners_may_change<L: Row>(
    block: &Block,
    walls: &Walls<Real>,
    nearest: L,
    slack: Real,
    edges: &Edges<L>,
) -> (u32, u32) {
    let zero = L::splat(0.0);
    let level = L::load(&block.level);
    // How far along a beam a wall may move that it crosses at right angles.
    let play = L::splat(slack) * L::load(&block.level.map(Real::sqrt));
    let (mut open, mut crossed) = (0, 0);
    let mut before = walls.corners[walls.corners.len() - 1];
    let mut last = block.pass::<L, Real>(&before);
    for &corner in &walls.corners {
        let next = block.pass(&corner);
        let length = (corner[0] - before[0]).hypot(corner[1] - before[1]);
        let (_, range) = last.crossing(next);
        let slide = L::splat(slack * length) / (last.side - next.side).abs();
        let crosses = !zero.le(last.is_between(next));
        open |= crosses & edges.may_change(range, slide);
        crossed |= crosses & zero.le(range);
        // A corner near the beam, before what it meets, may change sides.
        let near = (next.side * next.side * level).le(L::splat(slack * slack));
        let ahead = (zero - play).le(next.depth);
        open |= near & ahead & next.depth.le(nearest + play + play);
        (last, before) = (next, corner);
    }
    (open, crossed)
}
