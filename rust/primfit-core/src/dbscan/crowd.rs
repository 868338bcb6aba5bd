//! Which points of a crowd have enough others around them: decided for whole groups where the
//! bounds of boxes allow, and for single points where they do not.
//!
//! Gray and Moore: 'N-Body' problems in statistical learning, NIPS 2000.

use super::near;
use super::tree::{Node, Sight, Tree, widest_axis};
use crate::bounds::bounds;
use crate::workers::Stop;
use crate::{Error, Vector};

/// Points of a group that are looked at one by one.
const FEW: usize = 8;

/// A point of the crowd and its place among those that are asked for.
pub type Member = (Vector, usize);

/// The points around a crowd, in boxes and in cells that are too small for boxes.
pub struct Surroundings<'a> {
    pub trees: Vec<&'a Tree>,
    pub others: Vec<&'a [Vector]>,
    pub eps_squared: f64,
    pub min_samples: usize,
    pub stop: &'a Stop,
}

type Box<'a> = (&'a Tree, Node);

impl<'a> Surroundings<'a> {
    /// Says of each member whether it is core.
    pub fn find_core(&self, members: &mut [Member], is_core: &mut [bool]) -> Result<(), Error> {
        let boxes: Vec<Box> = self.trees.iter().map(|&tree| (tree, tree.root())).collect();
        self.decide(members, 0, &boxes, is_core)
    }

    /// The same, with `count` points near all members, and more only in `boxes` and others.
    fn decide(
        &self,
        members: &mut [Member],
        mut count: usize,
        boxes: &[Box<'a>],
        is_core: &mut [bool],
    ) -> Result<(), Error> {
        self.stop.check()?;
        let places: Vec<Vector> = members.iter().map(|member| member.0).collect();
        let around = bounds(&places);
        let (axis, width) = widest_axis(around);
        let mut waiting = boxes.to_vec();
        let mut unclear = Vec::new();
        while let Some((tree, node)) = waiting.pop() {
            match tree.look_from(around, node, self.eps_squared) {
                Some(true) => count += node.len(),
                Some(false) => {}
                None => match node.children() {
                    Some(halves) if widest_axis(tree.bounds(node)).1 > width => {
                        waiting.extend(halves.map(|half| (tree, half)));
                    }
                    _ => unclear.push((tree, node)),
                },
            }
        }
        let n_unclear: usize = unclear.iter().map(|(_, node)| node.len()).sum();
        let n_others: usize = self.others.iter().map(|points| points.len()).sum();
        let of_all = if count >= self.min_samples {
            Some(true)
        } else if count + n_unclear + n_others < self.min_samples {
            Some(false)
        } else if width == 0.0 {
            Some(self.is_core(places[0], count, &unclear))
        } else {
            None
        };
        if let Some(of_all) = of_all {
            for &(_, row) in members.iter() {
                is_core[row] = of_all;
            }
        } else if members.len() <= FEW {
            for &(place, row) in members.iter() {
                is_core[row] = self.is_core(place, count, &unclear);
            }
        } else {
            let middle = members.len() / 2;
            members.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]));
            let (low, high) = members.split_at_mut(middle);
            self.decide(low, count, &unclear, is_core)?;
            self.decide(high, count, &unclear, is_core)?;
        }
        Ok(())
    }

    /// Whether enough points are near one place.
    fn is_core(&self, place: Vector, mut count: usize, boxes: &[Box<'a>]) -> bool {
        let others = self.others.iter().copied().flatten();
        count += others.filter(|&&point| near(place, point, self.eps_squared)).count();
        let mut n_open: usize = boxes.iter().map(|(_, node)| node.len()).sum();
        let mut boxes = boxes.to_vec();
        // Large boxes first: the answer is mostly clear before the small ones.
        let mut at = 0;
        while count < self.min_samples && count + n_open >= self.min_samples {
            let (tree, node) = boxes[at];
            at += 1;
            n_open -= node.len();
            match tree.look(node, place, self.eps_squared) {
                Sight::Far => {}
                Sight::Near => count += node.len(),
                Sight::Count(n_near) => count += n_near,
                Sight::Halves(halves) => {
                    n_open += node.len();
                    boxes.extend(halves.map(|half| (tree, half)));
                }
            }
        }
        count >= self.min_samples
    }
}
