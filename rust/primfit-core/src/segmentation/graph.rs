//! Which points touch: the nearest, and some that lie in other directions.

use crate::instructions::widest;
use crate::neighbors::vicinity::{Ranking, Vicinity};
use crate::neighbors::{PointTree, squared_distance};
use crate::{Error, Vector, Workers};

/// Most neighbours that are not among the nearest.
const BRIDGES: usize = 8;
/// No neighbour.
const NONE: u32 = u32::MAX;
/// Points whose neighbours are looked for before they are packed.
const AT_ONCE: usize = 1 << 15;

/// Neighbours of the points of a tree, in its order.
pub struct Graph {
    n_nearest: usize,
    /// Where the neighbours start of each group of `AT_ONCE` points.
    groups: Vec<usize>,
    /// Where, within them, those of each point start, and where those of the last one end.
    starts: Vec<u32>,
    places: Vec<u32>,
    log_rooms: Vec<f64>,
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
        let n_looked_at = n_looked_at.max(n_nearest) + 1;
        let width = n_nearest + BRIDGES;
        let n_groups = points.len().div_ceil(AT_ONCE);
        let mut groups = Vec::with_capacity(n_groups);
        let mut starts = Vec::with_capacity(points.len() + n_groups);
        // More than there will be; what is not written takes no memory.
        let mut places = Vec::with_capacity(points.len() * width);
        let mut table = Vec::new();
        for first in (0..points.len()).step_by(AT_ONCE) {
            table.clear();
            table.resize(AT_ONCE.min(points.len() - first) * width, NONE);
            workers.fill(
                &mut table,
                width,
                || (Vicinity::new(tree), Others::default()),
                |(vicinity, others), i, row| {
                    let place = first + i;
                    let mut found = vicinity.nearest(place, n_looked_at);
                    join(points, place, &mut found, others, n_nearest, row);
                },
            )?;
            let group = places.len();
            groups.push(group);
            for row in table.chunks(width) {
                starts.push((places.len() - group) as u32);
                places.extend(row.iter().take_while(|&&other| other != NONE));
            }
            starts.push((places.len() - group) as u32);
        }
        places.shrink_to_fit();
        let mut graph = Self { n_nearest, groups, starts, places, log_rooms: Vec::new() };
        let mut log_rooms = vec![0.0; points.len()];
        workers.fill(
            &mut log_rooms,
            1,
            || (),
            |(), place, log_room| {
                log_room[0] = (2.0 * graph.reach(place, points)).ln();
            },
        )?;
        graph.log_rooms = log_rooms;
        Ok(graph)
    }

    /// Neighbours of a point; the nearest first.
    pub fn of(&self, place: usize) -> &[u32] {
        let number = place / AT_ONCE;
        let [group, at] = [self.groups[number], number + place];
        &self.places[group + self.starts[at] as usize..group + self.starts[at + 1] as usize]
    }

    /// Most neighbours that a point may have.
    pub fn most(&self) -> usize {
        self.n_nearest + BRIDGES
    }

    /// Logarithm of how wide the neighbourhood of a point is: twice its reach.
    pub fn log_room(&self, place: usize) -> f64 {
        self.log_rooms[place]
    }

    /// Distance from a point to the last of its nearest.
    pub fn reach(&self, place: usize, points: &[Vector]) -> f64 {
        let last = self.of(place)[self.n_nearest - 1];
        squared_distance(&points[last as usize], &points[place]).sqrt()
    }
}

/// Points around one, axis after axis, with the ranks of those that may be bridges.
#[derive(Default)]
struct Others {
    axes: [Vec<f64>; 3],
    /// Squared distances to the one.
    away: Vec<f64>,
    ranks: Vec<u64>,
}

/// Rank of what is no bridge.
const HIDDEN: u64 = u64::MAX;

widest! {
    // Writes the neighbours of a point into its row: the nearest of those found, and the bridges,
    // each the nearest of those that no bridge before is nearer to than the point is.
    fn join(
        points: &[Vector],
        place: usize,
        found: &mut Ranking,
        others: &mut Others,
        n_nearest: usize,
        row: &mut [u32],
    ) -> () {
        let here = &points[place];
        found.sort(found.len().min(n_nearest + 1));
        let (mut n, mut last) = (0, 0);
        for &rank in found.ranks() {
            let other = found.place(rank);
            if other as usize != place {
                (row[n], last) = (other, rank);
                n += 1;
                if n == n_nearest {
                    break;
                }
            }
        }
        let Others { axes: [xs, ys, zs], away, ranks } = others;
        for lanes in [&mut *xs, &mut *ys, &mut *zs, &mut *away] {
            lanes.clear();
        }
        ranks.clear();
        for &rank in found.ranks() {
            let other = found.place(rank) as usize;
            if other != place {
                let [x, y, z] = points[other];
                xs.push(x);
                ys.push(y);
                zs.push(z);
                away.push(squared_distance(&points[other], here));
                ranks.push(rank);
            }
        }
        let mut bridge = ranks.iter().fold(HIDDEN, |least, &rank| least.min(rank));
        for _ in 0..BRIDGES {
            if bridge == HIDDEN {
                break;
            }
            let other = found.place(bridge);
            if bridge > last {
                row[n] = other;
                n += 1;
            }
            let [x, y, z] = points[other as usize];
            let mut least = HIDDEN;
            let lanes = xs.iter().zip(&*ys).zip(&*zs).zip(&*away).zip(&mut *ranks);
            for ((((own_x, own_y), own_z), away), rank) in lanes {
                let [x, y, z] = [own_x - x, own_y - y, own_z - z];
                let is_hidden = x * x + y * y + z * z < *away || *rank <= bridge;
                *rank = if is_hidden { HIDDEN } else { *rank };
                least = if *rank < least { *rank } else { least };
            }
            bridge = least;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(points: &[Vector], n_nearest: usize, n_looked_at: usize) -> (PointTree, Graph) {
        let tree = PointTree::new(points);
        let workers = Workers::new(Some(1), &|| true).unwrap_or_else(|error| panic!("{error}"));
        let graph = Graph::new(&tree, n_nearest, n_looked_at, &workers)
            .unwrap_or_else(|error| panic!("{error}"));
        (tree, graph)
    }

    #[test]
    fn rows_of_a_scan_touch_by_bridges() {
        // Points a step of 1 apart in rows 5 apart: the nearest all lie in the same row.
        let points: Vec<Vector> =
            (0..300).map(|i| [f64::from(i % 100), 5.0 * f64::from(i / 100), 0.0]).collect();
        let (tree, graph) = graph(&points, 4, 32);
        let place = |row: u32| tree.rows().iter().position(|&other| other == row);
        let middle = place(150).unwrap_or_default();
        let mut rows: Vec<u32> =
            graph.of(middle).iter().map(|&other| tree.rows()[other as usize]).collect();
        rows[..4].sort_unstable();
        assert_eq!(rows[..4], [148, 149, 151, 152]);
        rows[4..].sort_unstable();
        assert_eq!(rows[4..], [50, 250]);
        assert_eq!(graph.reach(middle, tree.points()), 2.0);
    }

    #[test]
    fn few_points_all_touch() {
        let points: Vec<Vector> = (0..4).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let (_, graph) = graph(&points, 10, 32);
        for place in 0..4 {
            let mut others = graph.of(place).to_vec();
            others.sort_unstable();
            assert!((0..4).filter(|&other| other != place as u32).eq(others));
        }
    }
}
