//! Density-based clusters of points, exact, with memory proportional to the points.
//!
//! Ester, Kriegel, Sander, Xu: A density-based algorithm for discovering clusters, KDD 1996.
//! The cells of the grid have a diagonal of `eps`: all points of a cell are within reach of
//! each other, so a cell with `min_samples` points is all core, and clusters are joined cell
//! by cell.

use crate::{Error, Vector, Workers};

/// Cells between two questions to the caller.
const CHUNK: usize = 1 << 12;
/// Cells within reach on either side: the diagonal of a cell is `eps`.
const REACH: i128 = 2;
/// Bits of one cell coordinate within a key.
const BITS: u32 = 42;

/// Labels the points: clusters are numbered by their first core point, -1 is noise, and a
/// border point joins the lowest-numbered cluster within reach.
///
/// A point is core when at least `min_samples` points, itself included, are within `eps`.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn dbscan(
    points: &[Vector],
    eps: f64,
    min_samples: usize,
    workers: &Workers,
) -> Result<Vec<i64>, Error> {
    let grid = Grid::new(points, eps);
    let core = grid.core_points(min_samples, workers)?;
    let mut clusters = Clusters::of(grid.starts.len() - 1);
    grid.join(&core, &mut clusters, workers)?;
    Ok(grid.number(&core, &mut clusters, points.len()))
}

/// Points sorted by the cell that they lie in.
struct Grid {
    points: Vec<Vector>,
    row: Vec<u32>,
    keys: Vec<i128>,
    starts: Vec<usize>,
    eps_squared: f64,
}

impl Grid {
    fn new(points: &[Vector], eps: f64) -> Self {
        let mut low = [f64::INFINITY; 3];
        for point in points {
            for k in 0..3 {
                low[k] = low[k].min(point[k]);
            }
        }
        // A touch smaller than eps / sqrt(3), so that rounding never parts a cell.
        let side = eps / 3.0_f64.sqrt() * (1.0 - 1e-9);
        let key = |point: &Vector| {
            (0..3).fold(0_i128, |key, k| {
                let cell = ((point[k] - low[k]) / side).floor() as i128;
                (key << BITS) + cell.min((1 << (BITS - 1)) - 1) + REACH
            })
        };
        let mut sorted: Vec<(i128, u32)> =
            points.iter().zip(0..).map(|(point, row)| (key(point), row)).collect();
        sorted.sort_unstable();
        let mut keys = Vec::new();
        let mut starts = Vec::new();
        for (i, (key, _)) in sorted.iter().enumerate() {
            if keys.last() != Some(key) {
                keys.push(*key);
                starts.push(i);
            }
        }
        starts.push(points.len());
        Self {
            points: sorted.iter().map(|&(_, row)| points[row as usize]).collect(),
            row: sorted.into_iter().map(|(_, row)| row).collect(),
            keys,
            starts,
            eps_squared: eps * eps,
        }
    }

    fn is_near(&self, i: usize, j: usize) -> bool {
        let (a, b) = (self.points[i], self.points[j]);
        let (dx, dy, dz) = (a[0] - b[0], a[1] - b[1], a[2] - b[2]);
        dx * dx + dy * dy + dz * dz <= self.eps_squared
    }

    /// Calls `visit` with each cell in order and the runs of cells around it.
    fn for_each_cell(
        &self,
        offsets: &[i128],
        workers: &Workers,
        mut visit: impl FnMut(usize, &[(usize, usize)]),
    ) -> Result<(), Error> {
        // Along z the cells around a cell are one run, whose ends only ever move forward.
        let mut runs = vec![(0, 0); offsets.len()];
        for (cell, key) in self.keys.iter().enumerate() {
            if cell % CHUNK == 0 {
                workers.check()?;
            }
            for (run, offset) in runs.iter_mut().zip(offsets) {
                while run.0 < self.keys.len() && self.keys[run.0] < key + offset - REACH {
                    run.0 += 1;
                }
                run.1 = run.1.max(run.0);
                while run.1 < self.keys.len() && self.keys[run.1] <= key + offset + REACH {
                    run.1 += 1;
                }
            }
            visit(cell, &runs);
        }
        Ok(())
    }

    fn core_points(&self, min_samples: usize, workers: &Workers) -> Result<Vec<bool>, Error> {
        let mut core = vec![true; self.points.len()];
        if min_samples <= 1 {
            return Ok(core);
        }
        self.for_each_cell(&columns(), workers, |cell, runs| {
            let own = self.starts[cell]..self.starts[cell + 1];
            if own.len() >= min_samples {
                return;
            }
            for i in own {
                let mut near = 0;
                core[i] =
                    runs.iter().flat_map(|run| self.starts[run.0]..self.starts[run.1]).any(|j| {
                        near += usize::from(self.is_near(i, j));
                        near >= min_samples
                    });
            }
        })?;
        Ok(core)
    }

    /// Joins the cells that have core points within reach of each other.
    fn join(&self, core: &[bool], clusters: &mut Clusters, workers: &Workers) -> Result<(), Error> {
        let columns = columns();
        // Each pair once: only cells before this one.
        let before = &columns[..=columns.len() / 2];
        self.for_each_cell(before, workers, |cell, runs| {
            for run in runs.iter().rev() {
                for other in run.0..run.1.min(cell) {
                    if clusters.root(cell) != clusters.root(other) && self.touch(core, cell, other)
                    {
                        clusters.join(cell, other);
                    }
                }
            }
        })
    }

    fn touch(&self, core: &[bool], cell: usize, other: usize) -> bool {
        let core_of = |cell: usize| (self.starts[cell]..self.starts[cell + 1]).filter(|&i| core[i]);
        core_of(cell).any(|i| core_of(other).any(|j| self.is_near(i, j)))
    }

    fn number(&self, core: &[bool], clusters: &mut Clusters, n_points: usize) -> Vec<i64> {
        let mut place = vec![0; n_points];
        for (i, &row) in self.row.iter().enumerate() {
            place[row as usize] = i;
        }
        let mut cell_of = vec![0; n_points];
        for cell in 0..self.keys.len() {
            cell_of[self.starts[cell]..self.starts[cell + 1]].fill(cell);
        }
        let mut number = vec![-1; self.keys.len()];
        let mut n_clusters = 0;
        let mut labels = vec![-1; n_points];
        for (label, &i) in labels.iter_mut().zip(&place) {
            if core[i] {
                let root = clusters.root(cell_of[i]);
                if number[root] < 0 {
                    number[root] = n_clusters;
                    n_clusters += 1;
                }
                *label = number[root];
            }
        }
        let columns = columns();
        for (label, &i) in labels.iter_mut().zip(&place) {
            if core[i] {
                continue;
            }
            let key = self.keys[cell_of[i]];
            let lowest = columns
                .iter()
                .flat_map(|offset| {
                    let first = self.keys.partition_point(|&k| k < key + offset - REACH);
                    let last = self.keys.partition_point(|&k| k <= key + offset + REACH);
                    self.starts[first]..self.starts[last]
                })
                .filter(|&j| core[j] && self.is_near(i, j))
                .map(|j| number[clusters.root(cell_of[j])])
                .min();
            *label = lowest.unwrap_or(-1);
        }
        labels
    }
}

/// Key offsets of the columns of cells around a cell, in rising order.
fn columns() -> Vec<i128> {
    (-REACH..=REACH)
        .flat_map(|dx| (-REACH..=REACH).map(move |dy| (dx << (2 * BITS)) + (dy << BITS)))
        .collect()
}

/// Union and find over cells, with the lower cell as the root.
struct Clusters(Vec<usize>);

impl Clusters {
    fn of(n_cells: usize) -> Self {
        Self((0..n_cells).collect())
    }

    fn root(&mut self, mut cell: usize) -> usize {
        while self.0[cell] != cell {
            self.0[cell] = self.0[self.0[cell]];
            cell = self.0[cell];
        }
        cell
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }
}
