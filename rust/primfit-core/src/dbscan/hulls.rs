//! Two sets of points kept apart by a slab.

use super::tree::{Node, Tree};
use crate::Vector;
use parry3d_f64::math::{Pose, Vector as Direction};
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::shape::SupportMap;

/// Allowance for the rounding of a width, in widths.
const ROUNDING: f64 = 1e-12;

/// The convex hull of the points in a box, in lengths of `unit` from `origin`.
struct Hull<'a> {
    tree: &'a Tree,
    node: Node,
    origin: Vector,
    unit: f64,
}

impl Hull<'_> {
    fn local(&self, point: &Vector) -> Direction {
        Direction::from_array(std::array::from_fn(|k| (point[k] - self.origin[k]) / self.unit))
    }

    /// The point of a box that is farthest in a direction, if it is farther than the best so far.
    fn farthest(&self, node: Node, direction: Direction, best: &mut (f64, Direction)) {
        let Some(halves) = node.children() else {
            for point in self.tree.points(node) {
                let place = self.local(point);
                let along = place.dot(direction);
                if along > best.0 {
                    *best = (along, place);
                }
            }
            return;
        };
        let reach = |node| {
            let [low, high] = self.tree.bounds(node).map(|corner| self.local(&corner) * direction);
            low.max(high).element_sum()
        };
        let mut halves = halves.map(|half| (reach(half), half));
        if halves[0].0 < halves[1].0 {
            halves.swap(0, 1);
        }
        for (reach, half) in halves {
            if reach > best.0 {
                self.farthest(half, direction, best);
            }
        }
    }
}

impl SupportMap for Hull<'_> {
    fn local_support_point(&self, direction: Direction) -> Direction {
        let mut best = (f64::NEG_INFINITY, Direction::ZERO);
        self.farthest(self.node, direction, &mut best);
        best.1
    }
}

/// Whether some slab of a width keeps two boxes' points apart. False when there is none, or it is
/// not found.
///
/// Gilbert, Johnson, Keerthi: A fast procedure for computing the distance between complex objects
/// in three-dimensional space, IEEE Journal on Robotics and Automation 4, 1988.
pub fn are_apart(sets: [(&Tree, Node); 2], width: f64) -> bool {
    let origin = sets[0].0.bounds(sets[0].1)[0];
    let [a, b] = sets.map(|(tree, node)| Hull { tree, node, origin, unit: width });
    let wanted = 1.0 + ROUNDING;
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(&Pose::IDENTITY, &a, &b, Direction::X));
    match closest_points(&Pose::IDENTITY, &a, &b, wanted, false, &mut simplex) {
        GJKResult::NoIntersection(direction) => {
            let gap = CsoPoint::from_shapes(&Pose::IDENTITY, &a, &b, direction).point;
            -gap.dot(direction) > wanted
        }
        _ => false,
    }
}
