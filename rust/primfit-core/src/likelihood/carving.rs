//! Space that beams crossed, and what of it they passed, on a grid.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;
use std::ops::Range;

/// Beams that one task follows.
const TASK: usize = 1 << 15;
/// Beams between two questions to the caller.
const CHUNK: usize = 1 << 18;

/// Both counts of a cell in one number.
const CROSSED: u64 = 1;
const PASSED: u64 = 1 << 32;

/// Upright cells of one layer.
#[derive(Clone, Copy)]
pub struct Grid {
    /// Corner of the first cell.
    pub low: [f64; 2],
    /// Side of a cell.
    pub cell: f64,
    /// Cells along x and y.
    pub shape: [usize; 2],
    /// z of the lower and the upper end of all.
    pub heights: [f64; 2],
}

impl Grid {
    fn len(&self) -> usize {
        self.shape[0] * self.shape[1]
    }

    /// The way of a beam through the grid, in steps of a cell.
    fn way(&self, origin: Vector, direction: Vector) -> Way {
        let [low, high] = self.heights;
        let scale = 1.0 / self.cell;
        Way {
            start: [
                (origin[0] - self.low[0]) * scale,
                (origin[1] - self.low[1]) * scale,
                (origin[2] - low) * scale,
            ],
            direction,
            ends: [self.shape[0] as f64, self.shape[1] as f64, (high - low) * scale],
        }
    }
}

/// A beam in cells from the corner of a grid.
struct Way {
    start: Vector,
    direction: Vector,
    /// Of the grid.
    ends: Vector,
}

impl Way {
    /// Where the beam is in the middle of a step.
    fn at(&self, axis: usize, step: usize) -> f64 {
        self.start[axis] + (step as f64 + 0.5) * self.direction[axis]
    }

    fn is_inside(&self, step: usize) -> bool {
        (0..3).all(|axis| (0.0..self.ends[axis]).contains(&self.at(axis, step)))
    }

    /// The steps in the grid, from the first to the last, of so many.
    fn steps(&self, n_steps: usize) -> (usize, usize) {
        let (mut first, mut last) = (0, n_steps);
        for axis in 0..3 {
            let [a, b] =
                [0.0, self.ends[axis]].map(|end| (end - self.start[axis]) / self.direction[axis]);
            if a.is_finite() && b.is_finite() {
                first = first.max(a.min(b) as usize);
                last = last.min((a.max(b) as usize).saturating_add(1));
            }
        }
        // Rounding may have put a step at an end in or out.
        first = first.saturating_sub(1);
        while first < last && !self.is_inside(first) {
            first += 1;
        }
        while first < last && !self.is_inside(last - 1) {
            last -= 1;
        }
        (first, last)
    }
}

/// Of each cell, how many beams crossed it before `reach`, and how many of them passed it.
///
/// A beam has passed the cells before its entry of `certain`. Beams are followed in steps of a
/// cell.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn carve(
    origins: &[Vector],
    directions: &[Vector],
    certain: &[f64],
    reach: f64,
    grid: Grid,
    workers: &Workers,
) -> Result<Vec<[u32; 2]>, Error> {
    let empty = || vec![0_u64; grid.len()];
    let n_steps = (reach / grid.cell).ceil() as usize;
    let follow = |mut counts: Vec<u64>, row: usize| {
        let way = grid.way(origins[row], directions[row]);
        let (first, last) = way.steps(n_steps);
        let n_passed = (certain[row] / grid.cell + 0.5) as usize;
        let mut count = |steps: Range<usize>, one: u64| {
            for step in steps {
                let [x, y] = [0, 1].map(|axis| way.at(axis, step) as u32 as usize);
                counts[x * grid.shape[1] + y] += one;
            }
        };
        let end = n_passed.clamp(first, last.max(first));
        count(first..end, CROSSED + PASSED);
        count(end..last, CROSSED);
        counts
    };
    let add = |mut sum: Vec<u64>, other: Vec<u64>| {
        for (sum, other) in sum.iter_mut().zip(other) {
            *sum += other;
        }
        sum
    };
    let mut counts = empty();
    for first in (0..certain.len()).step_by(CHUNK) {
        workers.check()?;
        let rows = first..certain.len().min(first + CHUNK);
        let more = workers.install(|| {
            rows.into_par_iter().with_min_len(TASK).fold(empty, follow).reduce(empty, add)
        });
        counts = add(counts, more);
    }
    Ok(counts.into_iter().map(|count| [count as u32, (count / PASSED) as u32]).collect())
}
