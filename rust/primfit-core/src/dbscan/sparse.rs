//! Few points a cell of side `eps`: all points of neighboring cells are looked at.

use super::components::Components;
use super::grid::{Column, Grid, Key, Lattice};
use super::{Search, near};
use crate::{Error, Vector};
use std::ops::Range;

pub struct Sparse<K> {
    grid: Grid<K>,
    columns: Vec<Column<K>>,
    eps_squared: f64,
}

impl<K: Key> Sparse<K> {
    /// Cells of the grid have a side of `eps`.
    pub fn new(grid: Grid<K>, lattice: &Lattice, eps: f64) -> Self {
        Self { grid, columns: lattice.columns(1), eps_squared: eps * eps }
    }
}

impl<K: Key> Search<K> for Sparse<K> {
    fn grid(&self) -> &Grid<K> {
        &self.grid
    }

    fn into_grid(self) -> Grid<K> {
        self.grid
    }

    fn links(&self) -> Vec<u32> {
        (0..self.grid.points.len() as u32).collect()
    }

    fn find_core(
        &self,
        points: Range<usize>,
        min_samples: usize,
        is_core: &mut [bool],
    ) -> Result<(), Error> {
        let (grid, first) = (&self.grid, points.start);
        grid.cells.visit_around(points, &grid.cells, &self.columns, |_, own, runs| {
            for i in own {
                is_core[i - first] =
                    grid.is_surrounded(grid.points[i], runs, min_samples, self.eps_squared);
            }
            Ok(())
        })
    }

    fn join(&self, points: Range<usize>, components: &Components) -> Result<(), Error> {
        let Grid { points: places, cells, .. } = &self.grid;
        let before: Vec<_> = self.columns.iter().filter(|c| !c.is_after).copied().collect();
        cells.visit_around(points, cells, &before, |_, own, runs| {
            for i in own {
                for run in runs {
                    let span = cells.span(run);
                    for j in span.start..span.end.min(i) {
                        if near(places[i], places[j], self.eps_squared) {
                            components.join(i, j);
                        }
                    }
                }
            }
            Ok(())
        })
    }

    fn columns(&self) -> &[Column<K>] {
        &self.columns
    }

    fn lower(
        &self,
        label: &mut i64,
        place: Vector,
        runs: &[Range<usize>],
        labels_here: &[i64],
    ) -> Result<(), Error> {
        let Grid { points, cells, .. } = &self.grid;
        for j in runs.iter().flat_map(|run| cells.span(run)) {
            if labels_here[j] < *label && near(place, points[j], self.eps_squared) {
                *label = labels_here[j];
            }
        }
        Ok(())
    }
}
