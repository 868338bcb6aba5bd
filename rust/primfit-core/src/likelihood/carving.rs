//! Free-space carving: how many beams crossed each cell, and how many of them surely passed it.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Beams that one task follows, and beams between two questions to the caller.
const TASK: usize = 1 << 12;
const CHUNK: usize = 1 << 18;

/// Bytes that a cell takes: both its counts, and these as they are handed out.
const CELL_BYTES: usize = 16;

/// Both counts of a cell in one number.
const CROSSED: u64 = 1;
const PASSED: u64 = 1 << 32;

/// Upright cells, each cut into layers.
#[derive(Clone, Copy)]
pub struct Grid<'a> {
    /// Corner of the first cell.
    pub low: [f64; 2],
    /// Side of a cell.
    pub cell: f64,
    /// Cells along x and y.
    pub shape: [usize; 2],
    /// z of the ends of the layers, ascending; one more than there are layers.
    pub heights: &'a [f64],
}

impl Grid<'_> {
    fn n_layers(&self) -> usize {
        self.heights.len() - 1
    }

    /// Numbers of layers, cells along x and y, and all together.
    fn len(&self) -> usize {
        self.shape[0] * self.shape[1] * self.n_layers()
    }

    /// The way of a beam through the grid, in steps of a cell.
    fn way(&self, origin: Vector, direction: Vector) -> Way {
        let low = self.heights[0];
        let high = self.heights[self.n_layers()];
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

    /// The steps in the grid, from the first to the last, between two given ones.
    fn steps(&self, [mut first, mut last]: [usize; 2]) -> (usize, usize) {
        for axis in 0..3 {
            let [a, b] =
                [0.0, self.ends[axis]].map(|end| (end - self.start[axis]) / self.direction[axis]);
            if a.is_finite() && b.is_finite() {
                first = first.max(a.min(b) as usize);
                last = last.min((a.max(b) as usize).saturating_add(1));
            }
        }
        // Rounding may have put a step at an end in or out.
        while first < last && !self.is_inside(first) {
            first += 1;
        }
        while first < last && !self.is_inside(last - 1) {
            last -= 1;
        }
        (first, last)
    }
}

/// Which part of each beam counts, metres from its origin.
#[derive(Clone, Copy)]
pub struct Spans<'a> {
    /// Where its part begins.
    pub starts: &'a [f64],
    /// Up to where it surely passed.
    pub passed: &'a [f64],
    /// Up to where it is followed: it crossed the cells between, but may have ended before.
    pub ends: &'a [f64],
}

/// How many beams crossed each cell of each layer, and how many of them passed it.
///
/// Cells along x, then along y, then layers. Beams are followed in steps of a cell.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn carve(
    origins: &[Vector],
    directions: &[Vector],
    spans: Spans,
    grid: Grid,
    workers: &Workers,
) -> Result<Vec<[u32; 2]>, Error> {
    workers.room(CELL_BYTES.saturating_mul(grid.len()))?;
    let counts: Vec<AtomicU64> = (0..grid.len()).map(|_| AtomicU64::new(0)).collect();
    let n_layers = grid.n_layers();
    let edges: Vec<f64> = grid.heights.iter().map(|z| (z - grid.heights[0]) / grid.cell).collect();
    let step_of = |metres: f64| (metres / grid.cell + 0.5) as usize;
    let follow = |row: usize| {
        let way = grid.way(origins[row], directions[row]);
        let (first, last) = way.steps([step_of(spans.starts[row]), step_of(spans.ends[row])]);
        let n_passed = step_of(spans.passed[row]);
        let mut layer = 0;
        for step in first..last {
            let z = way.at(2, step);
            while layer + 1 < n_layers && z >= edges[layer + 1] {
                layer += 1;
            }
            while layer > 0 && z < edges[layer] {
                layer -= 1;
            }
            let [x, y] = [0, 1].map(|axis| way.at(axis, step) as u32 as usize);
            let one = if step < n_passed { CROSSED + PASSED } else { CROSSED };
            counts[(x * grid.shape[1] + y) * n_layers + layer].fetch_add(one, Ordering::Relaxed);
        }
    };
    for first in (0..origins.len()).step_by(CHUNK) {
        workers.check()?;
        let rows = first..origins.len().min(first + CHUNK);
        workers.install(|| rows.into_par_iter().with_min_len(TASK).for_each(follow));
    }
    Ok(counts
        .into_iter()
        .map(AtomicU64::into_inner)
        .map(|count| [count as u32, (count / PASSED) as u32])
        .collect())
}
