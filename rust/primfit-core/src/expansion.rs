//! The likelihood of a prism near one place, to second order where it is smooth.
//!
//! While every corner stays on its side of a beam, the beam meets the same wall, and its range is a
//! smooth function of the two corners of that wall. Those beams are summed up as a gradient and an
//! information matrix; the others, at silhouettes and edges, are left open, to be cast again for
//! each candidate.

use crate::beams::{BLOCK, BeamBlocks, Block};
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

/// What the edges of a prism are to the beams of a block.
struct Crossings {
    expected: [f64; BLOCK],
    /// Edge that is met first; the number of edges for another surface.
    edge: [usize; BLOCK],
    open: [bool; BLOCK],
}

/// Sums over the beams that meet one edge, by the share of its second corner.
#[derive(Clone, Copy, Default)]
struct EdgeSums {
    gradient: [f64; 2],
    information: [f64; 3],
}

/// Second-order expansion of the cost of one prism, whose corners may move by `slack` in any
/// direction and whose top by `top_slack` up and down; see [`Expansion`].
#[must_use]
pub fn expand(beams: &BeamBlocks, candidate: &Candidate, slack: f64, top_slack: f64) -> Expansion {
    let m = candidate.footprint.len();
    let mut sums = vec![EdgeSums::default(); m];
    let (mut cost, mut open) = (0.0, Vec::new());
    for (number, block) in beams.blocks.iter().enumerate() {
        let crossings = crossings(block, candidate, slack, top_slack, beams.prices.max_range);
        for i in 0..BLOCK.min(beams.len() - number * BLOCK) {
            if crossings.open[i] {
                open.push(number * BLOCK + i);
                continue;
            }
            let expected = crossings.expected[i];
            let each = beams.cost(block, i, expected);
            cost += each;
            let k = crossings.edge[i];
            let returned = block.range[i] < f64::INFINITY;
            if k == m || !returned || expected > beams.prices.max_range {
                continue;
            }
            if each < beams.prices.outlier {
                sums[k].add(block, i, candidate.edge(k), expected);
            }
        }
    }
    let (gradient, information) = assemble(candidate, &sums);
    Expansion { cost, gradient, information, open }
}

impl EdgeSums {
    fn add(&mut self, block: &Block, i: usize, (a, b): ([f64; 2], [f64; 2]), expected: f64) {
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        let across = block.ux[i] * ey - block.uy[i] * ex;
        let (dx, dy) = (a[0] - block.x[i], a[1] - block.y[i]);
        let along = (dx * block.uy[i] - dy * block.ux[i]) / across;
        let rate = block.precision[i] / across;
        let residual = (block.range[i] - expected) * block.precision[i];
        let (first, second) = ((1.0 - along) * rate, along * rate);
        self.gradient[0] -= residual * first;
        self.gradient[1] -= residual * second;
        self.information[0] += first * first;
        self.information[1] += first * second;
        self.information[2] += second * second;
    }
}

/// The sums of the edges as derivatives by corner. A range changes with the corners of its edge
/// along the edge's normal only.
fn assemble(candidate: &Candidate, sums: &[EdgeSums]) -> (Vec<f64>, Vec<f64>) {
    let m = candidate.footprint.len();
    let (mut gradient, mut information) = (vec![0.0; 2 * m], vec![0.0; 4 * m * m]);
    for (k, sums) in sums.iter().enumerate() {
        let (a, b) = candidate.edge(k);
        let normal = [b[1] - a[1], a[0] - b[0]];
        let corners = [k, (k + 1) % m];
        for (p, &row) in corners.iter().enumerate() {
            for x in 0..2 {
                gradient[2 * row + x] += sums.gradient[p] * normal[x];
                for (q, &column) in corners.iter().enumerate() {
                    for y in 0..2 {
                        information[(2 * row + x) * 2 * m + 2 * column + y] +=
                            sums.information[p + q] * normal[x] * normal[y];
                    }
                }
            }
        }
    }
    (gradient, information)
}

widest! {
fn crossings(
    block: &Block,
    candidate: &Candidate,
    slack: f64,
    top_slack: f64,
    max_range: f64,
) -> Crossings {
    let m = candidate.footprint.len();
    let (bottom, top) = (candidate.bottom, candidate.top);
    let mut met = Crossings { expected: block.background, edge: [m; BLOCK], open: [false; BLOCK] };
    let mut crossed = [false; BLOCK];
    let mut beyond = [false; BLOCK];
    let descent: [f64; BLOCK] = std::array::from_fn(|i| (top - block.z[i]) / block.uz[i]);
    for k in 0..m {
        let (a, b) = candidate.edge(k);
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        let length = ex.hypot(ey);
        for i in 0..BLOCK {
            let (dx, dy) = (a[0] - block.x[i], a[1] - block.y[i]);
            let across = block.ux[i] * ey - block.uy[i] * ex;
            let depth = (dx * ey - dy * ex) / across;
            let along = dx * block.uy[i] - dy * block.ux[i];
            let on_edge = along * across >= 0.0 && along.abs() <= across.abs() && across != 0.0;
            let z = block.z[i] + depth * block.uz[i];
            let ahead = on_edge && depth >= 0.0;
            let meets = ahead && z >= bottom && z <= top;
            // How far the crossing may move along the beam, and up or down.
            let play = slack * length / across.abs();
            let rise = play * block.uz[i].abs();
            let at_top = (z - top).abs() < top_slack + rise;
            let at_bottom = (z - bottom).abs() < rise;
            let at_end = (depth - block.background[i]).abs() < play
                || (depth - max_range).abs() < play
                || depth.abs() < play;
            let reaches = depth < block.background[i] + play;
            met.open[i] |= on_edge && reaches && depth > -play && (at_top || at_bottom || at_end);
            if meets && depth < met.expected[i] {
                met.expected[i] = depth;
                met.edge[i] = k;
            }
            crossed[i] |= ahead;
            beyond[i] ^= on_edge && depth > descent[i];
        }
    }
    for i in 0..BLOCK {
        let over = block.z[i] > top - top_slack && block.uz[i] < 0.0;
        met.open[i] |= over && crossed[i] && slack + top_slack > 0.0;
        if beyond[i] && block.z[i] > top && block.uz[i] < 0.0 && descent[i] < met.expected[i] {
            met.expected[i] = descent[i];
            met.edge[i] = m;
        }
    }
    // A corner near the beam, before what it meets, may change sides.
    for corner in candidate.footprint {
        for i in 0..BLOCK {
            let (dx, dy) = (corner[0] - block.x[i], corner[1] - block.y[i]);
            let (ux, uy) = (block.ux[i], block.uy[i]);
            let squared = ux * ux + uy * uy;
            let off = dx * uy - dy * ux;
            let depth = (dx * ux + dy * uy) / squared;
            let play = slack / squared.sqrt();
            let near = off * off < slack * slack * squared;
            met.open[i] |= near && depth > -play && depth < met.expected[i] + 2.0 * play;
        }
    }
    met
}
}
