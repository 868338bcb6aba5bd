//! How the tree grows: the widest child of a node is split until it has eight.

#![allow(clippy::inline_always)]

use super::memory::with_room;
use super::split::{Part, Range, range_of, split};
use super::tree::{LEAF, Node, ROUND_LEAF, WIDTH};
use crate::Error;
use crate::instructions::Instructions;
use crate::workers::Stop;
use rayon::prelude::*;

/// Fewest parts a node for which there is room at first; meshes have some 14 to 26.
const NODE_PARTS: usize = 8;
/// Parts that are worth another thread.
const PARALLEL: usize = 1 << 14;

/// A run of parts, triangles by then.
#[derive(Clone, Copy)]
#[cfg_attr(test, derive(Debug, PartialEq))]
pub struct Leaf {
    pub first: u32,
    pub n: u32,
}

/// Nodes and leaves over all parts, which it sorts by leaf; those from `first_round` on are round
/// solids, each a leaf without a row, and do not stay among the parts.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn tree(
    parts: &mut Vec<Part>,
    first_round: u32,
    instructions: Instructions,
    stop: &Stop,
) -> Result<(Vec<Node>, Vec<Leaf>), Error> {
    let has_rounds = parts.len() > first_round as usize;
    let kinds = Kinds { first_round, has_rounds, instructions };
    let mut branch = Branch::new(parts.len(), kinds);
    if !parts.is_empty() {
        branch.grow(range_of(instructions, parts), parts, 0, stop)?;
    }
    if has_rounds {
        branch.leave_out_rounds(parts);
    }
    Ok((branch.nodes, branch.leaves))
}

/// A part of the tree.
struct Branch {
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    kinds: Kinds,
}

/// What the parts are, and what they are split with.
#[derive(Clone, Copy)]
struct Kinds {
    /// Parts from this number on are round solids.
    first_round: u32,
    has_rounds: bool,
    instructions: Instructions,
}

impl Branch {
    /// One that will be over `n` parts.
    fn new(n: usize, kinds: Kinds) -> Self {
        Self { nodes: with_room(n / NODE_PARTS + 1), leaves: Vec::with_capacity(n / 4 + 1), kinds }
    }

    /// Appends the node over `range`; `parts` begin where the range does.
    fn grow(
        &mut self,
        range: Range,
        parts: &mut [Part],
        depth: u32,
        stop: &Stop,
    ) -> Result<(), Error> {
        let first = range.first;
        let mut children = [range; WIDTH];
        let mut n = 1;
        while n < WIDTH {
            let widest = (0..n)
                .filter(|&i| !self.kinds.is_leaf(&children[i], &parts[children[i].first - first..]))
                .max_by(|&i, &j| children[i].area().total_cmp(&children[j].area()));
            let Some(widest) = widest else { break };
            stop.check()?;
            let child = children[widest];
            let these = &mut parts[child.first - first..][..child.len()];
            let (left, right) = split(self.kinds.instructions, &child, these, depth);
            children.copy_within(widest + 1..n, widest + 2);
            children[widest] = left;
            children[widest + 1] = right;
            n += 1;
        }
        let children = &children[..n];
        let row = self.nodes.len();
        self.nodes.push(Node::over(children));
        let mut grown = 0;
        for (slot, child) in children.iter().enumerate() {
            let these = &parts[child.first - first..];
            if !self.kinds.is_leaf(child, these) {
                grown += child.len();
                continue;
            }
            let id = these[0].id();
            self.nodes[row].children[slot] = if id < self.kinds.first_round {
                self.leaves.push(Leaf { first: child.first as u32, n: child.len() as u32 });
                LEAF | (self.leaves.len() - 1) as u32
            } else {
                LEAF | ROUND_LEAF | (id - self.kinds.first_round)
            };
        }
        if grown >= PARALLEL {
            return self.grow_at_once(row, children, parts, depth, stop);
        }
        for (slot, child) in children.iter().enumerate() {
            let these = &mut parts[child.first - first..][..child.len()];
            if !self.kinds.is_leaf(child, these) {
                self.nodes[row].children[slot] = self.nodes.len() as u32;
                self.grow(*child, these, depth + 1, stop)?;
            }
        }
        Ok(())
    }

    /// Appends those children of the node in a row that are no leaves, grown side by side.
    fn grow_at_once(
        &mut self,
        row: usize,
        children: &[Range],
        parts: &mut [Part],
        depth: u32,
        stop: &Stop,
    ) -> Result<(), Error> {
        let kinds = self.kinds;
        let mut rest = parts;
        let mut grown: Vec<(usize, Range, &mut [Part])> = Vec::new();
        for (slot, child) in children.iter().enumerate() {
            let (these, others) = rest.split_at_mut(child.len());
            rest = others;
            if !kinds.is_leaf(child, these) {
                grown.push((slot, *child, these));
            }
        }
        let branches = grown
            .into_par_iter()
            .map(|(slot, child, parts)| {
                let mut branch = Self::new(child.len(), kinds);
                branch.grow(child, parts, depth + 1, stop)?;
                Ok((slot, branch))
            })
            .collect::<Result<Vec<_>, Error>>()?;
        for (slot, branch) in branches {
            self.nodes[row].children[slot] = self.nodes.len() as u32;
            self.append(branch);
        }
        Ok(())
    }

    fn append(&mut self, branch: Self) {
        let (n_nodes, n_leaves) = (self.nodes.len() as u32, self.leaves.len() as u32);
        self.nodes.extend(branch.nodes.into_iter().map(|mut node| {
            for child in &mut node.children {
                *child += match *child & (LEAF | ROUND_LEAF) {
                    0 => n_nodes,
                    LEAF => n_leaves,
                    _ => 0,
                };
            }
            node
        }));
        self.leaves.extend(branch.leaves);
    }

    /// Leaves only triangles in `parts`, and counts the leaves by them.
    fn leave_out_rounds(&mut self, parts: &mut Vec<Part>) {
        let first_round = self.kinds.first_round;
        let mut n_triangles = 0;
        let before: Vec<u32> = parts
            .iter()
            .map(|part| {
                n_triangles += u32::from(part.id() < first_round);
                n_triangles - u32::from(part.id() < first_round)
            })
            .collect();
        for leaf in &mut self.leaves {
            leaf.first = before[leaf.first as usize];
        }
        parts.retain(|part| part.id() < first_round);
    }
}

impl Kinds {
    /// Whether a range of parts that begin with it is a leaf: few triangles, or one round solid.
    #[inline(always)]
    fn is_leaf(self, range: &Range, parts: &[Part]) -> bool {
        let n = range.len();
        let is_round = |part: &Part| part.id() >= self.first_round;
        n <= WIDTH && (n == 1 || !self.has_rounds || !parts[..n].iter().any(is_round))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::Vector;

    /// Boxes of many sizes at places that follow from their number; some lie on one spot.
    fn boxes(n: u32) -> Vec<Part> {
        let place = |i: u32, k: u32| f64::from(i.wrapping_mul(2_654_435_761) >> (8 * k) & 1023);
        let low = |i: u32| [0, 1, 2].map(|k| place(i / 3, k) / 512.0 - 1.0);
        let size = |i: u32| [0.0, 1e-4, 0.03, 0.5][i as usize % 4];
        let corners = |i: u32| [low(i), low(i).map(|x| x + size(i))];
        (0..n).map(|i| Part::new(i, corners(i) as [Vector; 2])).collect()
    }

    fn grown(n: u32, set: Instructions) -> (Vec<Part>, Vec<Node>, Vec<Leaf>) {
        let mut parts = boxes(n);
        let (nodes, leaves) = tree(&mut parts, n - n / 50, set, &Stop::default()).unwrap();
        (parts, nodes, leaves)
    }

    #[test]
    fn trees_are_the_same_on_all_sets() {
        for n in [1, 7, 100, 3000, 40_000] {
            let first = grown(n, Instructions::Scalar);
            for set in Instructions::available() {
                let (parts, nodes, leaves) = grown(n, set);
                assert!(parts.iter().map(Part::id).eq(first.0.iter().map(Part::id)));
                assert!(nodes == first.1 && leaves == first.2);
            }
        }
    }

    #[test]
    fn boxes_hold_all_that_is_below() {
        for n in [1, 7, 100, 3000, 40_000] {
            let (parts, nodes, leaves) = grown(n, Instructions::best());
            let all = boxes(n);
            let mut met = vec![0; n as usize];
            let everywhere = [[f32::MIN; 3], [f32::MAX; 3]];
            let mut waiting = vec![(0, everywhere)];
            while let Some((row, around)) = waiting.pop() {
                let node: &Node = &nodes[row];
                for slot in 0..WIDTH {
                    let [low, high] = [0, 3].map(|k| [0, 1, 2].map(|i| node.planes[k + i][slot]));
                    if low[0] > high[0] {
                        continue;
                    }
                    assert!((0..3).all(|k| low[k] >= around[0][k] && high[k] <= around[1][k]));
                    let child = node.children[slot];
                    let ids: Vec<u32> = if child & LEAF == 0 {
                        waiting.push((child as usize, [low, high]));
                        vec![]
                    } else if child & ROUND_LEAF != 0 {
                        vec![n - n / 50 + (child ^ (LEAF | ROUND_LEAF))]
                    } else {
                        let Leaf { first, n } = leaves[(child ^ LEAF) as usize];
                        assert!(n as usize <= WIDTH);
                        parts[first as usize..][..n as usize].iter().map(Part::id).collect()
                    };
                    for id in ids {
                        met[id as usize] += 1;
                        let part = all[id as usize].bounds();
                        assert!((0..3).all(|k| part.low(k) >= low[k] && part.high(k) <= high[k]));
                    }
                }
            }
            assert!(met.iter().all(|&times| times == 1));
        }
    }
}
