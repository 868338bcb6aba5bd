//! The likelihood of a prism near one place, to second order where it is smooth.
//!
//! While every corner stays on its side of a beam, the beam meets the same wall, and its range is a
//! smooth function of the two corners of that wall. Those beams are summed up as a gradient and an
//! information matrix; the others, at silhouettes and edges, are left open, to be cast again for
//! each candidate.

// Conditions in loops that are to become vectors are joined without branches.
#![allow(clippy::needless_bitwise_bool)]

use crate::beams::{BLOCK, BeamBlocks, Block, LANES, Real, Walls};
use crate::instructions::widest;
use crate::likelihood::Candidate;

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

/// Sums over the beams that meet one wall, by the share of its second corner.
#[derive(Clone, Copy, Default)]
struct Sums {
    gradient: [f64; 2],
    information: [f64; 3],
}

/// Second-order expansion of the cost of one prism, whose corners may move by `slack` in any
/// direction and whose top by `top_slack` up and down; see [`Expansion`].
#[must_use]
pub fn expand(beams: &BeamBlocks, candidate: &Candidate, slack: f64, top_slack: f64) -> Expansion {
    let walls = beams.walls(candidate);
    let mut sums = vec![Sums::default(); walls.corners.len()];
    let (mut cost, mut open) = (0.0, Vec::new());
    for (number, block) in beams.blocks.iter().enumerate() {
        let nearest = nearest(block, &walls);
        let mut weight = [1.0; BLOCK];
        if slack + top_slack > 0.0 {
            let (slack, top_slack) = (slack as Real, top_slack as Real);
            let may_change = may_change(block, &walls, &nearest, slack, top_slack, beams.max_range);
            for i in 0..BLOCK.min(beams.len() - number * BLOCK) {
                if may_change[i] != 0 {
                    open.push(number * BLOCK + i);
                    weight[i] = 0.0;
                }
            }
        }
        cost += add_slopes(block, &walls, &nearest, &weight, beams, &mut sums);
    }
    let (gradient, information) = assemble(candidate, &sums);
    Expansion { cost, gradient, information, open }
}

widest! {
fn nearest(block: &Block, walls: &Walls) -> [Real; BLOCK] {
    block.meet(walls, block.background)
}
}

widest! {
fn add_slopes(
    block: &Block,
    walls: &Walls,
    nearest: &[Real; BLOCK],
    weight: &[Real; BLOCK],
    beams: &BeamBlocks,
    sums: &mut [Sums],
) -> f64 {
    let mut costs = [0.0; LANES];
    // Where the range counts: the residual in sigmas, and sigmas a metre.
    let (mut residual, mut precision) = ([0.0; BLOCK], [0.0; BLOCK]);
    for first in (0..BLOCK).step_by(LANES) {
        for (lane, sum) in costs.iter_mut().enumerate() {
            let i = first + lane;
            let cost = beams.cost(block, i, nearest[i]);
            *sum += weight[i] * cost;
            let counts = (block.range[i] < Real::INFINITY)
                & (nearest[i] <= beams.max_range)
                & (cost < beams.outlier);
            let off = (block.range[i] - nearest[i]) * block.precision[i];
            residual[i] = if counts { off } else { 0.0 };
            precision[i] = if counts { weight[i] * block.precision[i] } else { 0.0 };
        }
    }
    let (mut side, mut depth) = block.corner(walls.corners[walls.corners.len() - 1]);
    for (&corner, sums) in walls.corners.iter().zip(sums) {
        let (next_side, next_depth) = block.corner(corner);
        let mut lanes = [[0.0; LANES]; 5];
        for start in (0..BLOCK).step_by(LANES) {
            for (lane, i) in (start..start + LANES).enumerate() {
                let width = side[i] - next_side[i];
                let share = side[i] / width;
                // The very steps by which the nearest was found, so it is found again.
                let range = depth[i] + share * (next_depth[i] - depth[i]);
                let crosses = (side[i] < 0.0) != (next_side[i] < 0.0);
                let is_met = crosses & (range == nearest[i]);
                let rate = if is_met { precision[i] / width } else { 0.0 };
                let second = if is_met { share * rate } else { 0.0 };
                let first = rate - second;
                lanes[0][lane] -= residual[i] * first;
                lanes[1][lane] -= residual[i] * second;
                lanes[2][lane] += first * first;
                lanes[3][lane] += first * second;
                lanes[4][lane] += second * second;
            }
        }
        let totals = lanes.map(|lanes| f64::from(lanes.iter().sum::<Real>()));
        for (sum, total) in sums.gradient.iter_mut().chain(&mut sums.information).zip(totals) {
            *sum += total;
        }
        (side, depth) = (next_side, next_depth);
    }
    f64::from(costs.iter().sum::<Real>())
}
}

/// The sums of the walls as derivatives by corner. A range changes with the corners of its wall
/// along the wall's normal only.
fn assemble(candidate: &Candidate, sums: &[Sums]) -> (Vec<f64>, Vec<f64>) {
    let m = candidate.footprint.len();
    let (mut gradient, mut matrix) = (vec![0.0; 2 * m], vec![0.0; 4 * m * m]);
    for (k, sums) in sums.iter().enumerate() {
        let corners = [(k + m - 1) % m, k];
        let [a, b] = corners.map(|corner| candidate.footprint[corner]);
        let normal = [b[1] - a[1], a[0] - b[0]];
        // Rounding must not make information negative.
        let [first, both, second] = sums.information;
        let most = (first * second).sqrt();
        let information = [first, both.clamp(-most, most), second];
        for (p, &row) in corners.iter().enumerate() {
            for x in 0..2 {
                gradient[2 * row + x] += sums.gradient[p] * normal[x];
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

widest! {
fn may_change(
    block: &Block,
    walls: &Walls,
    nearest: &[Real; BLOCK],
    slack: Real,
    top_slack: Real,
    max_range: Real,
) -> [u32; BLOCK] {
    let &Walls { bottom, top, ref corners } = walls;
    let mut open = [0; BLOCK];
    let mut crossed = [0; BLOCK];
    // How far along a beam a wall may move that it crosses at right angles.
    let play: [Real; BLOCK] = std::array::from_fn(|i| slack * block.level[i].sqrt());
    let last = corners[corners.len() - 1];
    let (mut side, mut depth) = block.corner(last);
    let mut before = last;
    for &corner in corners {
        let (next_side, next_depth) = block.corner(corner);
        let length = (corner[0] - before[0]).hypot(corner[1] - before[1]);
        for i in 0..BLOCK {
            let crosses = (side[i] < 0.0) != (next_side[i] < 0.0);
            let width = side[i] - next_side[i];
            let range = depth[i] + side[i] / width * (next_depth[i] - depth[i]);
            let z = block.z[i] + range * block.uz[i];
            let slide = slack * length / width.abs();
            let rise = slide * block.uz[i].abs();
            let at_top = (z - top).abs() < top_slack + rise;
            let at_bottom = (z - bottom).abs() < rise;
            let at_end = ((range - block.background[i]).abs() < slide)
                | ((range - max_range).abs() < slide)
                | (range.abs() < slide);
            let reaches = (range < block.background[i] + slide) & (range > -slide);
            open[i] |= u32::from(crosses & reaches & (at_top | at_bottom | at_end));
            crossed[i] |= u32::from(crosses & (range >= 0.0));
        }
        // A corner near the beam, before what it meets, may change sides.
        for i in 0..BLOCK {
            let near = next_side[i] * next_side[i] * block.level[i] < slack * slack;
            let before = (next_depth[i] > -play[i])
                & (next_depth[i] < nearest[i] + 2.0 * play[i]);
            open[i] |= u32::from(near & before);
        }
        (side, depth) = (next_side, next_depth);
        before = corner;
    }
    for i in 0..BLOCK {
        let over = (block.z[i] > top - top_slack) & (block.uz[i] < 0.0);
        open[i] |= u32::from(over) & crossed[i];
    }
    open
}
}
