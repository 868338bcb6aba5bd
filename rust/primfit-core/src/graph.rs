//! Which points touch: the nearest, and some that lie in other directions.

use crate::neighbors::{PointTree, Search, squared_distance};
use crate::{Error, Vector, Workers};

/// Most neighbours that are not among the nearest.
const BRIDGES: usize = 8;
/// No neighbour.
const NONE: u32 = u32::MAX;

/// Neighbours of the points of a tree, in its order.
pub struct Graph {
    n_nearest: usize,
    places: Vec<u32>,
}

impl Graph {
    /// Joins each point to its `n_nearest`, and to up to 8 relative neighbours among the
    /// `n_looked_at` nearest (Toussaint: The relative neighbourhood graph of a finite planar set,
    /// 1980). Where points lie in rows, the latter reach the next row.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn new(
        tree: &PointTree,
        n_nearest: usize,
        n_looked_at: usize,
        workers: &Workers,
    ) -> Result<Self, Error> {
        let points = tree.points();
        let n_nearest = n_nearest.min(points.len().saturating_sub(1)).max(1);
        let width = n_nearest + BRIDGES;
        let mut places = vec![NONE; width * points.len()];
        workers.fill(&mut places, width, Search::default, |search, i, row| {
            let found = tree.nearest(&points[i], n_looked_at.max(n_nearest) + 1, search);
            let others = found.iter().map(|n| n.place).filter(|&place| place != i as u32);
            let mut bridges = [NONE; BRIDGES];
            let (mut n_bridges, mut n) = (0, n_nearest);
            for (rank, place) in others.enumerate() {
                if rank < n_nearest {
                    row[rank] = place;
                }
                let point = &points[place as usize];
                let away = squared_distance(point, &points[i]);
                let hides = |&other: &u32| squared_distance(point, &points[other as usize]) < away;
                if n_bridges < BRIDGES && !bridges[..n_bridges].iter().any(hides) {
                    bridges[n_bridges] = place;
                    n_bridges += 1;
                    if rank >= n_nearest {
                        row[n] = place;
                        n += 1;
                    }
                }
            }
        })?;
        Ok(Self { n_nearest, places })
    }

    /// Neighbours of a point; the nearest first.
    pub fn of(&self, place: usize) -> &[u32] {
        let width = self.n_nearest + BRIDGES;
        let row = &self.places[place * width..(place + 1) * width];
        let n = row[self.n_nearest..].iter().take_while(|&&other| other != NONE).count();
        &row[..self.n_nearest + n]
    }

    /// Distance from a point to the last of its nearest.
    pub fn reach(&self, place: usize, points: &[Vector]) -> f64 {
        let last = self.of(place)[self.n_nearest - 1];
        squared_distance(&points[last as usize], &points[place]).sqrt()
    }
}
