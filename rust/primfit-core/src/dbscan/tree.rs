//! Boxes of boxes around the points of a crowded cell.

use super::hulls::are_apart;
use super::near;
use crate::bounds::bounds;
use crate::workers::Stop;
use crate::{Error, Vector};

/// Points of a box that is not divided further.
const LEAF: usize = 16;
/// Pairs of points that are looked at one by one.
const FEW_PAIRS: usize = 1 << 12;
/// Points below which a division takes no time worth a look at the caller's wish.
const SHORT: usize = 1 << 12;

/// A k-d tree with tight boxes.
///
/// Every leaf but the last is full, so that a node's children follow from its length: nodes are
/// stored with the left subtree first, then the right one.
pub struct Tree {
    points: Vec<Vector>,
    boxes: Vec<[Vector; 2]>,
}

/// A box of a tree.
#[derive(Clone, Copy)]
pub struct Node {
    index: usize,
    start: usize,
    end: usize,
}

impl Node {
    pub fn len(self) -> usize {
        self.end - self.start
    }

    pub fn children(self) -> Option<[Self; 2]> {
        if self.len() <= LEAF {
            return None;
        }
        let left_leaves = self.len().div_ceil(LEAF).div_ceil(2);
        let middle = self.start + left_leaves * LEAF;
        Some([
            Self { index: self.index + 1, start: self.start, end: middle },
            Self { index: self.index + 2 * left_leaves, start: middle, end: self.end },
        ])
    }
}

/// What the bounds of a box say about its points.
pub enum Sight {
    /// All are near.
    Near,
    /// None is near.
    Far,
    /// Its two halves must be asked.
    Halves([Node; 2]),
    /// So many are near.
    Count(usize),
}

impl Tree {
    pub fn new(points: &[Vector], stop: &Stop) -> Result<Self, Error> {
        let mut tree = Self {
            points: points.to_vec(),
            boxes: Vec::with_capacity(2 * points.len().div_ceil(LEAF)),
        };
        tree.divide(tree.root(), stop)?;
        Ok(tree)
    }

    pub fn root(&self) -> Node {
        Node { index: 0, start: 0, end: self.points.len() }
    }

    fn divide(&mut self, node: Node, stop: &Stop) -> Result<(), Error> {
        if node.len() > SHORT {
            stop.check()?;
        }
        let points = &mut self.points[node.start..node.end];
        let bounds = bounds(points);
        self.boxes.push(bounds);
        if let Some([left, right]) = node.children() {
            let (axis, _) = widest_axis(bounds);
            points.select_nth_unstable_by(left.len(), |a, b| a[axis].total_cmp(&b[axis]));
            self.divide(left, stop)?;
            self.divide(right, stop)?;
        }
        Ok(())
    }

    /// How a box lies to a place. Rounding is monotone, so the bounds never contradict [`near`].
    pub fn look(&self, node: Node, place: Vector, eps_squared: f64) -> Sight {
        let [low, high] = self.bounds(node);
        if !near(place, nearest_in([low, high], place), eps_squared) {
            return Sight::Far;
        }
        let farthest = std::array::from_fn(|k| {
            let (below, above) = ((place[k] - low[k]).abs(), (high[k] - place[k]).abs());
            if below > above { low[k] } else { high[k] }
        });
        if near(place, farthest, eps_squared) {
            return Sight::Near;
        }
        node.children().map_or_else(
            || {
                let points = &self.points[node.start..node.end];
                Sight::Count(points.iter().filter(|&&p| near(place, p, eps_squared)).count())
            },
            Sight::Halves,
        )
    }

    /// Whether all points of a box are near all places of another, or none; None when neither is
    /// clear. Rounding is monotone here, too.
    pub fn look_from(
        &self,
        [low, high]: [Vector; 2],
        node: Node,
        eps_squared: f64,
    ) -> Option<bool> {
        let [own_low, own_high] = self.bounds(node);
        let origin = [0.0; 3];
        let least =
            std::array::from_fn(|k| (own_low[k] - high[k]).max(low[k] - own_high[k]).max(0.0));
        if !near(least, origin, eps_squared) {
            return Some(false);
        }
        let most = std::array::from_fn(|k| (own_high[k] - low[k]).max(high[k] - own_low[k]));
        near(most, origin, eps_squared).then_some(true)
    }

    /// Whether any point is near.
    pub fn has_near(&self, node: Node, place: Vector, eps_squared: f64) -> bool {
        match self.look(node, place, eps_squared) {
            Sight::Near => true,
            Sight::Far => false,
            Sight::Count(count) => count > 0,
            Sight::Halves(halves) => {
                halves.into_iter().any(|half| self.has_near(half, place, eps_squared))
            }
        }
    }

    /// Whether any point is near one of another tree.
    pub fn touches(
        &self,
        node: Node,
        other: &Self,
        other_node: Node,
        eps: f64,
        stop: &Stop,
    ) -> Result<bool, Error> {
        let (bounds, other_bounds) = (self.bounds(node), other.bounds(other_node));
        let nearest = nearest_in(bounds, other_bounds[0]);
        if !near(nearest, nearest_in(other_bounds, nearest), eps * eps) {
            return Ok(false);
        }
        let (points, others) = (self.points(node), other.points(other_node));
        if points.len() * others.len() <= FEW_PAIRS {
            return Ok(points.iter().any(|&p| others.iter().any(|&q| near(p, q, eps * eps))));
        }
        stop.check()?;
        if are_apart([(self, node), (other, other_node)], eps) {
            return Ok(false);
        }
        let pairs = match (node.children(), other_node.children()) {
            (Some(halves), None) => halves.map(|half| (half, other_node)),
            (Some(halves), _) if widest_axis(bounds).1 > widest_axis(other_bounds).1 => {
                halves.map(|half| (half, other_node))
            }
            (_, Some(halves)) => halves.map(|half| (node, half)),
            (None, None) => return Ok(false),
        };
        for (node, other_node) in pairs {
            if self.touches(node, other, other_node, eps, stop)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    pub fn bounds(&self, node: Node) -> [Vector; 2] {
        self.boxes[node.index]
    }

    pub fn points(&self, node: Node) -> &[Vector] {
        &self.points[node.start..node.end]
    }
}

/// The place of a box that is nearest to another place.
fn nearest_in([low, high]: [Vector; 2], place: Vector) -> Vector {
    std::array::from_fn(|k| place[k].clamp(low[k], high[k]))
}

pub fn widest_axis([low, high]: [Vector; 2]) -> (usize, f64) {
    let widths: Vector = std::array::from_fn(|k| high[k] - low[k]);
    let axis = (1..3).fold(0, |widest, k| if widths[k] > widths[widest] { k } else { widest });
    (axis, widths[axis])
}
