//! The nearest points of a cloud, exactly.
//!
//! A k-d tree (Bentley, 1975) whose leaves hold 16 points, stored in the order of the tree:
//! what is near in space is mostly near in memory. Ties go to the lower row.

pub(crate) mod normals;
pub(crate) mod vicinity;

pub use normals::LocalPlane;

use crate::{Error, Vector, Workers};

/// Points of a leaf; only the last leaf may hold fewer.
pub const LEAF: usize = 16;
/// Points of a subtree from which its halves are built at the same time.
const TOGETHER: usize = 1 << 14;

/// Bytes of a point that a tree and its building take, and of a neighbour that was found with what it
/// is turned into.
const BYTES: usize = 80;
const FOUND_BYTES: usize = 32;

/// A cloud ready for questions of nearness.
pub struct PointTree {
    points: Vec<Vector>,
    rows: Vec<u32>,
    nodes: Vec<Node>,
}

/// Some points of the tree, and a box around them.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    low: Vector,
    high: Vector,
    start: u32,
    end: u32,
    /// The second child; the first one follows the node. Zero for a leaf.
    second: u32,
}

/// A point of the tree near a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Squared distance.
    pub squared: f64,
    /// Row of the point as it was given.
    pub row: u32,
    /// Place of the point within the tree.
    pub place: u32,
}

impl Neighbor {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        // Bits of floats that are not negative rise with them.
        let key = |n: &Self| (u128::from(n.squared.to_bits()) << 32) | u128::from(n.row);
        key(self).cmp(&key(other))
    }
}

/// What a search reuses.
#[derive(Default)]
pub struct Search {
    found: Vec<Neighbor>,
    squares: Vec<u64>,
    open: Vec<(f64, u32)>,
}

impl PointTree {
    /// Sorts finite points into a tree, when there is memory for it.
    ///
    /// # Errors
    /// [`Error::Memory`] when there is not.
    pub fn within_memory(points: &[Vector], workers: &Workers) -> Result<Self, Error> {
        workers.room(BYTES * points.len())?;
        Ok(workers.install(|| Self::new(points)))
    }

    /// Sorts finite points into a tree.
    #[must_use]
    pub fn new(points: &[Vector]) -> Self {
        let mut entries: Vec<(Vector, u32)> = points.iter().copied().zip(0..).collect();
        let n_leaves = points.len().div_ceil(LEAF);
        let mut nodes = vec![Node::default(); (2 * n_leaves).saturating_sub(1)];
        if !points.is_empty() {
            build(&mut entries, 0, &mut nodes, 0);
        }
        let (points, rows) = entries.into_iter().unzip();
        Self { points, rows, nodes }
    }

    /// The points in the order of the tree.
    #[must_use]
    pub fn points(&self) -> &[Vector] {
        &self.points
    }

    /// The row of each point as it was given, in the order of the tree.
    #[must_use]
    pub fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// The `k` points nearest to `query`, or all when there are fewer, nearest first.
    pub fn nearest<'s>(&self, query: &Vector, k: usize, search: &'s mut Search) -> &'s [Neighbor] {
        let found = self.nearest_unsorted(query, k, search);
        found.sort_unstable_by(Neighbor::order);
        found
    }

    /// The same in no particular order.
    pub fn nearest_unsorted<'s>(
        &self,
        query: &Vector,
        k: usize,
        search: &'s mut Search,
    ) -> &'s mut [Neighbor] {
        let k = k.min(self.points.len());
        let Search { found, open, .. } = search;
        found.clear();
        open.clear();
        if k == 0 {
            return found;
        }
        let mut reach = f64::INFINITY;
        open.push((0.0, 0));
        while let Some((gap, node)) = open.pop() {
            if gap > reach {
                continue;
            }
            self.open_node(query, node, open, |neighbor| {
                if neighbor.squared <= reach {
                    found.push(neighbor);
                }
            });
            if found.len() >= 2 * k + LEAF || (reach == f64::INFINITY && found.len() >= k + LEAF) {
                found.select_nth_unstable_by(k - 1, Neighbor::order);
                found.truncate(k);
                reach = found[k - 1].squared;
            }
        }
        if found.len() > k {
            found.select_nth_unstable_by(k - 1, Neighbor::order);
            found.truncate(k);
        }
        found
    }

    /// Bits of the squared distances of the `k` nearest, in no particular order: those of floats that
    /// are not negative rise with them.
    pub fn nearest_squares<'s>(
        &self,
        query: &Vector,
        k: usize,
        search: &'s mut Search,
    ) -> &'s mut Vec<u64> {
        let k = k.min(self.points.len());
        let Search { squares, open, .. } = search;
        squares.clear();
        open.clear();
        if k == 0 {
            return squares;
        }
        let mut reach = f64::INFINITY;
        open.push((0.0, 0));
        while let Some((gap, node)) = open.pop() {
            if gap > reach {
                continue;
            }
            self.open_node(query, node, open, |neighbor| squares.push(neighbor.squared.to_bits()));
            if squares.len() >= 2 * k + LEAF
                || (reach == f64::INFINITY && squares.len() >= k + LEAF)
            {
                reach = f64::from_bits(*squares.select_nth_unstable(k - 1).1);
                squares.truncate(k);
            }
        }
        squares.select_nth_unstable(k - 1);
        squares.truncate(k);
        squares
    }

    /// All points within `radius` of `query`, in no particular order.
    pub fn within<'s>(
        &self,
        query: &Vector,
        radius: f64,
        search: &'s mut Search,
    ) -> &'s [Neighbor] {
        let Search { found, open, .. } = search;
        found.clear();
        open.clear();
        if !self.nodes.is_empty() {
            open.push((0.0, 0));
        }
        let reach = radius * radius;
        while let Some((gap, node)) = open.pop() {
            if gap <= reach {
                self.open_node(query, node, open, |neighbor| {
                    if neighbor.squared <= reach {
                        found.push(neighbor);
                    }
                });
            }
        }
        found
    }

    /// Hands over the points of a leaf, or puts the children of a node on the stack, nearer last.
    fn open_node(
        &self,
        query: &Vector,
        node: u32,
        open: &mut Vec<(f64, u32)>,
        mut hand_over: impl FnMut(Neighbor),
    ) {
        let Node { start, end, second, .. } = self.nodes[node as usize];
        if second == 0 {
            for place in start..end {
                let squared = squared_distance(query, &self.points[place as usize]);
                hand_over(Neighbor { squared, row: self.rows[place as usize], place });
            }
            return;
        }
        let [first, second] =
            [node + 1, second].map(|child| (self.nodes[child as usize].gap(query), child));
        if first.0 <= second.0 {
            open.extend([second, first]);
        } else {
            open.extend([first, second]);
        }
    }

    /// The `k` nearest points of each query, row after row.
    ///
    /// # Errors
    /// [`Error::Memory`], and [`Error::Stopped`] when the caller does not want to go on.
    pub fn neighbors(
        &self,
        queries: &[Vector],
        k: usize,
        workers: &Workers,
    ) -> Result<Vec<Neighbor>, Error> {
        let k = k.min(self.points.len());
        workers.room((FOUND_BYTES * k).saturating_mul(queries.len()))?;
        let mut table = vec![Neighbor { squared: 0.0, row: 0, place: 0 }; k * queries.len()];
        if k > 0 {
            workers.fill(&mut table, k, Search::default, |search, i, row| {
                row.copy_from_slice(self.nearest(&queries[i], k, search));
            })?;
        }
        Ok(table)
    }
}

impl Node {
    /// Squared distance of a point to the box; never more than that to a point within.
    fn gap(&self, query: &Vector) -> f64 {
        gap(&self.low, &self.high, query, query)
    }
}

/// Squared distance of two boxes.
#[inline]
fn gap(low: &Vector, high: &Vector, other_low: &Vector, other_high: &Vector) -> f64 {
    let across = |k: usize| {
        let (below, above) = (low[k] - other_high[k], other_low[k] - high[k]);
        // Faster than `max`, which looks for NaN, of which there is none.
        let outside = if below > above { below } else { above };
        if outside > 0.0 { outside * outside } else { 0.0 }
    };
    across(0) + across(1) + across(2)
}

/// Squared distance of two points.
#[inline]
pub fn squared_distance(a: &Vector, b: &Vector) -> f64 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

/// Sorts the points of `nodes[0]` and of all nodes below it. `at` is the place of `nodes[0]`,
/// `start` that of the first point.
fn build(entries: &mut [(Vector, u32)], start: usize, nodes: &mut [Node], at: usize) {
    let (mut low, mut high) = (entries[0].0, entries[0].0);
    for (point, _) in &*entries {
        for k in 0..3 {
            low[k] = if point[k] < low[k] { point[k] } else { low[k] };
            high[k] = if point[k] > high[k] { point[k] } else { high[k] };
        }
    }
    let n_leaves = entries.len().div_ceil(LEAF);
    let n_first = n_leaves / 2;
    let end = (start + entries.len()) as u32;
    let second = if n_leaves == 1 { 0 } else { (at + 2 * n_first) as u32 };
    nodes[0] = Node { low, high, start: start as u32, end, second };
    if n_leaves == 1 {
        return;
    }
    let wide = |k: usize| high[k] - low[k];
    let axis = (1..3).fold(0, |axis, k| if wide(k) > wide(axis) { k } else { axis });
    let middle = n_first * LEAF;
    entries
        .select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let n_points = entries.len();
    let (before, after) = entries.split_at_mut(middle);
    let (first_nodes, second_nodes) = nodes[1..].split_at_mut(2 * n_first - 1);
    let mut first = || build(before, start, first_nodes, at + 1);
    let mut rest = || build(after, start + middle, second_nodes, at + 2 * n_first);
    if n_points > TOGETHER {
        rayon::join(first, rest);
    } else {
        first();
        rest();
    }
}
