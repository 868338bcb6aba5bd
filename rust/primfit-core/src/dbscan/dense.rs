//! Many points a cell of diagonal `eps`: cells are looked at as wholes, and crowded ones get trees.

use super::Search;
use super::components::Components;
use super::crowd::Surroundings;
use super::grid::{Column, Grid, Key, Lattice};
use super::tree::Tree;
use crate::workers::Stop;
use crate::{Error, Vector};
use std::ops::Range;
use std::sync::OnceLock;

/// Points of a cell that are looked at one by one.
const FEW: usize = 64;
/// Points around a cell that are looked at one by one.
const MANY: usize = 1 << 12;

pub struct Dense<'s, K> {
    grid: Grid<K>,
    /// Columns of cells within reach of any point of a cell, and of those that touch the cell.
    columns: Vec<Column<K>>,
    adjacent: Vec<Column<K>>,
    eps: f64,
    eps_squared: f64,
    /// Cells with more than a few points, in order, and their trees once someone wants them.
    crowded: Vec<usize>,
    trees: Vec<OnceLock<Result<Tree, Error>>>,
    stop: &'s Stop,
}

impl<'s, K: Key> Dense<'s, K> {
    /// Cells of the grid have a diagonal of `eps`.
    pub fn new(grid: Grid<K>, lattice: &Lattice, eps: f64, stop: &'s Stop) -> Self {
        let is_crowded = |&cell: &usize| grid.cells.points(cell).len() > FEW;
        let crowded: Vec<usize> = (0..grid.cells.len()).filter(is_crowded).collect();
        Self {
            columns: lattice.columns(2),
            adjacent: lattice.columns(1),
            eps,
            eps_squared: eps * eps,
            trees: crowded.iter().map(|_| OnceLock::new()).collect(),
            crowded,
            grid,
            stop,
        }
    }

    /// The tree of a cell, if it is crowded.
    fn tree(&self, cell: usize) -> Result<Option<&Tree>, Error> {
        let points = &self.grid.points[self.grid.cells.points(cell)];
        if points.len() <= FEW {
            return Ok(None);
        }
        let place = self.crowded.partition_point(|&other| other < cell);
        let tree = self.trees[place].get_or_init(|| Tree::new(points, self.stop));
        tree.as_ref().map(Some).map_err(Clone::clone)
    }

    /// Whether any point of a cell is near.
    fn has_near(&self, cell: usize, place: Vector) -> Result<bool, Error> {
        Ok(match self.tree(cell)? {
            Some(tree) => tree.has_near(tree.root(), place, self.eps_squared),
            None => self.grid.has_near(place, self.grid.cells.points(cell), self.eps_squared),
        })
    }

    /// Whether any two points of two cells are near.
    fn touch(&self, cell: usize, other: usize) -> Result<bool, Error> {
        let Grid { points, cells, .. } = &self.grid;
        let (mut few, mut many) = (cells.points(cell), cells.points(other));
        // Most cells that touch show it at once.
        few.end = few.end.min(few.start + FEW);
        many.end = many.end.min(many.start + FEW);
        if points[few]
            .iter()
            .any(|&place| self.grid.has_near(place, many.clone(), self.eps_squared))
        {
            return Ok(true);
        }
        match (self.tree(cell)?, self.tree(other)?) {
            (Some(a), Some(b)) => a.touches(a.root(), b, b.root(), self.eps, self.stop),
            (None, Some(tree)) => Ok(self.has_any_near(tree, cell)),
            (Some(tree), None) => Ok(self.has_any_near(tree, other)),
            (None, None) => Ok(false),
        }
    }

    fn has_any_near(&self, tree: &Tree, cell: usize) -> bool {
        let places = &self.grid.points[self.grid.cells.points(cell)];
        places.iter().any(|&place| tree.has_near(tree.root(), place, self.eps_squared))
    }

    /// All points of some runs of cells, in trees where cells are crowded.
    fn surroundings(
        &self,
        runs: &[Range<usize>],
        min_samples: usize,
    ) -> Result<Surroundings<'_>, Error> {
        let (mut trees, mut others) = (Vec::new(), Vec::new());
        for cell in runs.iter().cloned().flatten() {
            match self.tree(cell)? {
                Some(tree) => trees.push(tree),
                None => others.push(&self.grid.points[self.grid.cells.points(cell)]),
            }
        }
        let (eps_squared, stop) = (self.eps_squared, self.stop);
        Ok(Surroundings { trees, others, eps_squared, min_samples, stop })
    }
}

impl<K: Key> Search<K> for Dense<'_, K> {
    fn grid(&self) -> &Grid<K> {
        &self.grid
    }

    fn into_grid(self) -> Grid<K> {
        self.grid
    }

    fn links(&self) -> Vec<u32> {
        let cells = &self.grid.cells;
        let mut links = vec![0; self.grid.points.len()];
        for cell in 0..cells.len() {
            links[cells.points(cell)].fill(cells.points(cell).start as u32);
        }
        links
    }

    fn find_core(
        &self,
        points: Range<usize>,
        min_samples: usize,
        is_core: &mut [bool],
    ) -> Result<(), Error> {
        let (grid, first) = (&self.grid, points.start);
        grid.cells.visit_around(points, &grid.cells, &self.columns, |cell, own, runs| {
            let is_core = &mut is_core[own.start - first..own.end - first];
            let n_around: usize = runs.iter().map(|run| grid.cells.span(run).len()).sum();
            if grid.cells.points(cell).len() >= min_samples {
                is_core.fill(true);
            } else if n_around > MANY {
                let places = &grid.points[own];
                let mut members: Vec<_> =
                    places.iter().copied().enumerate().map(|(row, place)| (place, row)).collect();
                self.surroundings(runs, min_samples)?.find_core(&mut members, is_core)?;
            } else if n_around >= min_samples {
                for (is_core, i) in is_core.iter_mut().zip(own) {
                    *is_core =
                        grid.is_surrounded(grid.points[i], runs, min_samples, self.eps_squared);
                }
            }
            self.stop.check()
        })
    }

    fn join(&self, points: Range<usize>, components: &Components) -> Result<(), Error> {
        let cells = &self.grid.cells;
        // Adjacent cells first: most of the others are in one component by then.
        for columns in [&self.adjacent, &self.columns] {
            let before: Vec<_> = columns.iter().filter(|c| !c.is_after).copied().collect();
            cells.visit_around(points.clone(), cells, &before, |cell, own, runs| {
                if own.start > cells.points(cell).start {
                    return Ok(()); // the chunk before has it
                }
                let mut root = components.root(own.start);
                for run in runs {
                    for other in run.start..run.end.min(cell) {
                        let start = cells.points(other).start;
                        if components.root(start) != root && self.touch(cell, other)? {
                            components.join(own.start, start);
                            root = components.root(own.start);
                        }
                    }
                }
                Ok(())
            })?;
        }
        Ok(())
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
        for cell in runs.iter().cloned().flatten() {
            let here = labels_here[self.grid.cells.points(cell).start];
            if here < *label && self.has_near(cell, place)? {
                *label = here;
            }
        }
        self.stop.check()
    }
}
