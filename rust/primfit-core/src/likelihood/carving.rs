//! Space that beams crossed, and what of it they passed, on a grid.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Beams that one task follows.
const TASK: usize = 1 << 15;
/// Beams between two questions to the caller.
const CHUNK: usize = 1 << 18;

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

    /// Number of the cell, x by x, at a place in cells along x and y and a height.
    fn index(&self, [x, y]: [f64; 2], z: f64) -> Option<usize> {
        let [nx, ny] = self.shape;
        let is_inside = x >= 0.0
            && y >= 0.0
            && x < nx as f64
            && y < ny as f64
            && self.heights[0] <= z
            && z < self.heights[1];
        is_inside.then(|| x as usize * ny + y as usize)
    }

    /// Steps of a cell, from the first to the last, on which a beam may be in the layer.
    fn steps(&self, z: f64, rise: f64, reach: f64) -> (usize, usize) {
        let n_steps = (reach / self.cell).ceil() as usize;
        let [a, b] = self.heights.map(|height| (height - z) / (rise * self.cell));
        if a.is_finite() && b.is_finite() {
            let (first, last) = (a.min(b).max(0.0) as usize, a.max(b).max(0.0) as usize + 1);
            return (first.min(n_steps), last.min(n_steps));
        }
        (0, n_steps)
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
    let empty = || vec![[0_u32; 2]; grid.len()];
    let follow = |mut counts: Vec<[u32; 2]>, row: usize| {
        let (origin, direction) = (origins[row], directions[row]);
        let (first, last) = grid.steps(origin[2], direction[2], reach);
        let start: [f64; 2] = std::array::from_fn(|k| (origin[k] - grid.low[k]) / grid.cell);
        for step in first..last {
            let cells = step as f64 + 0.5;
            let depth = cells * grid.cell;
            let at = std::array::from_fn(|k| start[k] + cells * direction[k]);
            if let Some(cell) = grid.index(at, origin[2] + depth * direction[2]) {
                let [crossed, passed] = &mut counts[cell];
                *crossed += 1;
                *passed += u32::from(depth < certain[row]);
            }
        }
        counts
    };
    let add = |mut sum: Vec<[u32; 2]>, other: Vec<[u32; 2]>| {
        for (sum, other) in sum.as_flattened_mut().iter_mut().zip(other.as_flattened()) {
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
    Ok(counts)
}
