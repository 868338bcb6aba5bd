//! Density-based clusters of points, exact, with memory proportional to the points.
//!
//! Ester, Kriegel, Sander, Xu: A density-based algorithm for discovering clusters, KDD 1996.
//! Points are sorted by cell, so that the cells around a cell are a few contiguous runs. Sparse
//! points take cells of side `eps`; crowded ones take cells of diagonal `eps`, whose points are
//! all within reach of each other (de Berg, Gunawan, Roeloffzen: Faster DBSCAN and HDBSCAN in
//! low-dimensional Euclidean spaces, ISAAC 2017).

mod components;
mod crowd;
mod dense;
mod grid;
mod hulls;
mod sparse;
mod tree;

use crate::bounds::bounds;
use crate::workers::Stop;
use crate::{Error, Vector, Workers};
use components::Components;
use dense::Dense;
use grid::{Column, Grid, Key, Lattice, Order};
use rayon::prelude::*;
use sparse::Sparse;
use std::ops::Range;

/// Points that one task looks at.
const CHUNK: usize = 1 << 12;
/// Points that take less time, at the very worst, than a caller who wants to stop would notice.
const FEW: usize = 1 << 12;
/// Mean number of points in the sparse cell of a point above which the dense grid is faster.
const CROWDED: f64 = 12.0;
/// Extent over `eps` above which the rounding of coordinates reaches `eps`.
const WIDEST: f64 = 1e12;

/// Bytes of a point that clustering takes.
const BYTES: usize = 120;

/// Labels the points: clusters are numbered by their first core point, -1 is noise, and a
/// border point joins the lowest-numbered cluster within reach.
///
/// A point is core when at least `min_samples` points, itself included, are within `eps`.
///
/// # Errors
/// [`Error::TooWide`] and [`Error::TooMany`] when the points cannot be sorted into cells,
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn dbscan(
    points: &[Vector],
    eps: f64,
    min_samples: usize,
    workers: &Workers,
) -> Result<Vec<i64>, Error> {
    if points.is_empty() {
        return Ok(Vec::new());
    }
    if points.len() > u32::MAX as usize {
        return Err(Error::TooMany { n_points: points.len() });
    }
    workers.room(BYTES * points.len())?;
    let bounds = bounds(points);
    let span = (0..3).map(|k| bounds[1][k] - bounds[0][k]).fold(0.0, f64::max);
    if span > WIDEST * eps {
        return Err(Error::TooWide { eps, span });
    }
    // Cells in which rounding can neither part a pair within reach nor join one beyond it.
    let slack = 1e-9 + span / eps * f64::EPSILON * 4.0;
    let sparse = Lattice::new(bounds, eps * (1.0 + slack), 1);
    let dense = Lattice::new(bounds, eps / 3.0_f64.sqrt() * (1.0 - slack), 2);
    let label = if dense.bits() <= u64::BITS { label::<u64> } else { label::<u128> };
    if points.len() <= FEW {
        let label = || label(points, eps, min_samples, [sparse, dense], &Stop::default());
        return workers.install(label);
    }
    workers.watch(|stop| label(points, eps, min_samples, [sparse, dense], stop))
}

fn label<K: Key>(
    points: &[Vector],
    eps: f64,
    min_samples: usize,
    [sparse, dense]: [Lattice; 2],
    stop: &Stop,
) -> Result<Vec<i64>, Error> {
    let order = Order::<K>::new(points, &sparse, stop)?;
    if order.company() <= CROWDED {
        let search = |grid: Grid<K>| Sparse::new(grid, &sparse, eps);
        return cluster(order.gather(points), min_samples, search, stop);
    }
    drop(order);
    let search = |grid: Grid<K>| Dense::new(grid, &dense, eps, stop);
    cluster(Order::new(points, &dense, stop)?.gather(points), min_samples, search, stop)
}

/// How the points around a point are found.
trait Search<K>: Sync {
    fn grid(&self) -> &Grid<K>;

    fn into_grid(self) -> Grid<K>;

    /// The lowest point that is in the component of a point from the start.
    fn links(&self) -> Vec<u32>;

    /// Which of some points have enough points around them.
    fn find_core(
        &self,
        points: Range<usize>,
        min_samples: usize,
        is_core: &mut [bool],
    ) -> Result<(), Error>;

    /// Joins the components of some points and of those within reach that come before.
    fn join(&self, points: Range<usize>, components: &Components) -> Result<(), Error>;

    /// Columns of the cells that may have points within reach of a point of a cell.
    fn columns(&self) -> &[Column<K>];

    /// Lowers a label to the lowest of those in some runs of cells that are within reach.
    fn lower(
        &self,
        label: &mut i64,
        place: Vector,
        runs: &[Range<usize>],
        labels_here: &[i64],
    ) -> Result<(), Error>;
}

fn cluster<K: Key, S: Search<K>>(
    grid: Grid<K>,
    min_samples: usize,
    search: impl Fn(Grid<K>) -> S,
    stop: &Stop,
) -> Result<Vec<i64>, Error> {
    let n_points = grid.points.len();
    let everything = search(grid);
    let mut is_core = vec![min_samples <= 1; n_points];
    if min_samples > 1 {
        in_chunks(&mut is_core, stop, |points, is_core| {
            everything.find_core(points, min_samples, is_core)
        })?;
    }
    let (core, rest) = everything.into_grid().split(&is_core);
    drop(is_core);

    let core = search(core);
    let components = Components::new(core.links());
    in_chunks(&mut vec![(); core.grid().points.len()], stop, |points, _| {
        core.join(points, &components)
    })?;
    let core_labels = components.numbered_by(&core.grid().rows, n_points);
    let mut rest_labels = vec![i64::MAX; rest.points.len()];
    in_chunks(&mut rest_labels, stop, |points, labels| {
        let first = points.start;
        rest.cells.visit_around(points, &core.grid().cells, core.columns(), |_, own, runs| {
            own.into_iter().try_for_each(|i| {
                core.lower(&mut labels[i - first], rest.points[i], runs, &core_labels)
            })
        })
    })?;

    let mut labels = vec![-1; n_points];
    for (&row, label) in core.grid().rows.iter().zip(core_labels) {
        labels[row as usize] = label;
    }
    for (&row, label) in rest.rows.iter().zip(rest_labels) {
        if label < i64::MAX {
            labels[row as usize] = label;
        }
    }
    Ok(labels)
}

/// Calls `fill` with ranges of points, and what is wanted of them, on all threads.
fn in_chunks<T: Send>(
    wanted: &mut [T],
    stop: &Stop,
    fill: impl Fn(Range<usize>, &mut [T]) -> Result<(), Error> + Sync,
) -> Result<(), Error> {
    wanted.par_chunks_mut(CHUNK).enumerate().try_for_each(|(k, wanted)| {
        stop.check()?;
        fill(k * CHUNK..k * CHUNK + wanted.len(), wanted)
    })
}

/// The one predicate, as scikit-learn has it.
fn near(a: Vector, b: Vector, eps_squared: f64) -> bool {
    let (dx, dy, dz) = (a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    dx * dx + dy * dy + dz * dz <= eps_squared
}
