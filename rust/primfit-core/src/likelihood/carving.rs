//! Space that beams crossed, and what of it they passed, on a grid.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Beams that one task follows.
const TASK: usize = 1 << 15;
/// Beams between two questions to the caller.
const CHUNK: usize = 1 << 18;

/// Upright columns of cells, cut into layers.
#[derive(Clone, Copy)]
pub struct Grid<'a> {
    /// Corner of the first column.
    pub low: [f64; 2],
    /// Side of a cell.
    pub cell: f64,
    /// Columns along x and y.
    pub shape: [usize; 2],
    /// z between the layers, rising: one more than there are layers.
    pub levels: &'a [f64],
}

impl Grid<'_> {
    fn len(&self) -> usize {
        (self.levels.len() - 1) * self.shape[0] * self.shape[1]
    }

    /// Number of the cell, layer by layer, x by x, at a place in cells along x and y and a height.
    fn index(&self, [x, y]: [f64; 2], z: f64) -> Option<usize> {
        let layer = self.levels.partition_point(|&level| level <= z).checked_sub(1)?;
        let [nx, ny] = self.shape;
        let inside = x >= 0.0 && y >= 0.0 && x < nx as f64 && y < ny as f64;
        (inside && layer + 1 < self.levels.len())
            .then(|| (layer * nx + x as usize) * ny + y as usize)
    }

    /// Steps of a cell, from `first` to `last`, on which a beam may be between the outer levels.
    fn steps(&self, z: f64, rise: f64, reach: f64) -> (usize, usize) {
        let n_steps = (reach / self.cell).ceil() as usize;
        let at = |level: &f64| (level - z) / (rise * self.cell);
        let (Some(a), Some(b)) = (self.levels.first().map(at), self.levels.last().map(at)) else {
            return (0, 0);
        };
        if a.is_finite() && b.is_finite() {
            let (first, last) = (a.min(b).max(0.0) as usize, a.max(b).max(0.0) as usize + 1);
            return (first.min(n_steps), last.min(n_steps));
        }
        (0, n_steps)
    }
}

/// How many beams crossed each cell before `reach`, and how many of them passed it.
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
) -> Result<(Vec<u32>, Vec<u32>), Error> {
    let empty = || (vec![0_u32; grid.len()], vec![0_u32; grid.len()]);
    let follow = |(mut crossed, mut passed): (Vec<u32>, Vec<u32>), row: usize| {
        let (origin, direction) = (origins[row], directions[row]);
        let (first, last) = grid.steps(origin[2], direction[2], reach);
        let start: [f64; 2] = std::array::from_fn(|k| (origin[k] - grid.low[k]) / grid.cell);
        for step in first..last {
            let cells = step as f64 + 0.5;
            let depth = cells * grid.cell;
            let at = std::array::from_fn(|k| start[k] + cells * direction[k]);
            if let Some(cell) = grid.index(at, origin[2] + depth * direction[2]) {
                crossed[cell] += 1;
                passed[cell] += u32::from(depth < certain[row]);
            }
        }
        (crossed, passed)
    };
    let add = |mut sum: Vec<u32>, other: Vec<u32>| {
        sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        sum
    };
    let (mut crossed, mut passed) = empty();
    for first in (0..certain.len()).step_by(CHUNK) {
        workers.check()?;
        let rows = first..certain.len().min(first + CHUNK);
        let (more_crossed, more_passed) = workers.install(|| {
            rows.into_par_iter()
                .with_min_len(TASK)
                .fold(empty, follow)
                .reduce(empty, |a, b| (add(a.0, b.0), add(a.1, b.1)))
        });
        (crossed, passed) = (add(crossed, more_crossed), add(passed, more_passed));
    }
    Ok((crossed, passed))
}
