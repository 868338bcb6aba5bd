//! A bounding-volume tree with eight children a node and eight triangles a leaf.
//!
//! It lies in a frame of its own, in which the scene is centred and reaches from -1 to 1: boxes
//! and triangles are float32 there. Beside them are the triangles as they came, in float64, in
//! the order of the leaves, and the round solids, each a leaf by itself.

#![allow(clippy::inline_always)]

use super::memory::with_room;
use super::round::Round;
use super::split::{Part, Range, split};
use super::triangle::Corners;
use crate::instructions::Instructions;
use crate::workers::Stop;
use crate::{Error, Vector};
use rayon::prelude::*;

/// Children of a node, triangles of a leaf.
pub const WIDTH: usize = 8;
/// Set in the code of a child that is a leaf; the rest is the row of the block or node.
pub const LEAF: u32 = 1 << 31;
/// Set as well in that of a round solid, whose row the rest is then.
pub const ROUND_LEAF: u32 = 1 << 30;
/// Nodes from which a tree does not stay in the cache.
const CACHED: usize = 4000;
/// Fewest parts a node for which there is room at first; meshes have some 14 to 26.
const NODE_PARTS: usize = 8;
/// Parts that are worth another thread, and fewest items that one fills in.
const PARALLEL: usize = 1 << 14;
const AT_ONCE: usize = 1 << 11;
/// Items between two looks at whether to stop.
const STEP: usize = 1 << 18;

/// The boxes of eight children and where they are.
#[derive(Clone)]
#[repr(C, align(64))]
pub struct Node {
    /// Low x, y, z, then high x, y, z; a missing child has its low above its high.
    pub planes: [[f32; WIDTH]; 6],
    pub children: [u32; WIDTH],
}

/// Eight triangles of a leaf, or fewer: coordinates by row.
#[derive(Clone)]
#[repr(C, align(32))]
pub struct Block {
    pub vertex: [[f32; WIDTH]; 3],
    /// From the first vertex to the second and to the third.
    pub edges: [[[f32; WIDTH]; 3]; 2],
    /// Largest component of an edge; negative for a missing triangle.
    pub extent: [f32; WIDTH],
    /// Row of the first triangle in [`Tree::exact`].
    pub first: u32,
}

/// A triangle as it came.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Exact {
    /// Fourth on the first axis is its row.
    pub corners: Corners,
}

impl Exact {
    fn new(corners: [Vector; 3], id: u32) -> Self {
        let [a, b, c] = corners;
        let mut corners = [0, 1, 2].map(|k| [a[k], b[k], c[k], a[k]]);
        corners[0][3] = f64::from(id);
        Self { corners }
    }

    /// The row of the triangle.
    #[inline(always)]
    pub fn id(&self) -> i64 {
        self.corners[0][3] as i64
    }

    /// One of its corners.
    pub fn corner(&self, i: usize) -> Vector {
        [0, 1, 2].map(|k| self.corners[k][i])
    }
}

/// From the coordinates of the scene to those of the tree.
#[derive(Clone, Copy)]
pub struct Frame {
    pub center: Vector,
    /// A power of two.
    pub scale: f64,
}

impl Frame {
    fn around([low, high]: [Vector; 2]) -> Self {
        let half = (0..3).map(|k| high[k] / 2.0 - low[k] / 2.0).fold(0.0, f64::max);
        if half == 0.0 || !half.is_finite() {
            return Self { center: low.map(|x| if x.is_finite() { x } else { 0.0 }), scale: 1.0 };
        }
        Self {
            center: std::array::from_fn(|k| f64::midpoint(low[k], high[k])),
            // Beyond 2^1000 it would leave the range of float64.
            scale: (-half.log2().ceil()).clamp(-1024.0, 1000.0).exp2(),
        }
    }

    #[inline]
    pub fn place(&self, point: Vector) -> Vector {
        std::array::from_fn(|k| (point[k] - self.center[k]) * self.scale)
    }
}

/// The tree; row 0 is its root.
pub struct Tree {
    pub frame: Frame,
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    pub exact: Vec<Exact>,
    /// Their rows follow those of the triangles.
    pub rounds: Vec<Round>,
}

impl Tree {
    /// `triangles` must name vertices that exist.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn new(
        vertices: &[Vector],
        triangles: &[[i64; 3]],
        rounds: &[Round],
        stop: &Stop,
    ) -> Result<Self, Error> {
        let corners = |id: u32| triangles[id as usize].map(|vertex| vertices[vertex as usize]);
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (id, triangle) in triangles.iter().enumerate() {
            if id % STEP == 0 {
                stop.check()?;
            }
            for vertex in triangle.map(|vertex| vertices[vertex as usize]) {
                for k in 0..3 {
                    low[k] = low[k].min(vertex[k]);
                    high[k] = high[k].max(vertex[k]);
                }
            }
        }
        for [least, greatest] in rounds.iter().map(Round::bounds) {
            for k in 0..3 {
                low[k] = low[k].min(least[k]);
                high[k] = high[k].max(greatest[k]);
            }
        }
        let frame = Frame::around([low, high]);
        let part = |id, corners: [Vector; 2]| Part::new(id, corners.map(|v| frame.place(v)));
        let mut parts = filled(triangles.len(), stop, |id| {
            let id = id as u32;
            part(id, box_of(corners(id)))
        })?;
        let first_round = triangles.len() as u32;
        parts.extend((first_round..).zip(rounds).map(|(id, round)| part(id, round.bounds())));
        let instructions = Instructions::best();
        let kinds = Kinds { first_round, has_rounds: !rounds.is_empty(), instructions };
        let mut branch = Branch::new(parts.len(), kinds);
        if !parts.is_empty() {
            branch.grow(Range::all(instructions, &parts), &mut parts, 0, stop)?;
        }
        if !rounds.is_empty() {
            branch.leave_out_rounds(&mut parts);
        }
        let exact = filled(parts.len(), stop, |i| Exact::new(corners(parts[i].id()), parts[i].id()))?;
        let blocks = filled(branch.leaves.len(), stop, |i| {
            let (first, count) = branch.leaves[i];
            Block::new(frame, &exact, first, count)
        })?;
        branch.nodes.shrink_to_fit();
        Ok(Self { frame, nodes: branch.nodes, blocks, exact, rounds: rounds.to_vec() })
    }
}

/// Lower and upper corner of the box around a triangle.
#[inline(always)]
fn box_of([a, b, c]: [Vector; 3]) -> [Vector; 2] {
    let mut corners = [a; 2];
    for k in 0..3 {
        corners[0][k] = a[k].min(b[k]).min(c[k]);
        corners[1][k] = a[k].max(b[k]).max(c[k]);
    }
    corners
}

/// Items by number, with a look at `stop` now and then.
fn filled<T: Send>(
    n: usize,
    stop: &Stop,
    item: impl Fn(usize) -> T + Sync + Send,
) -> Result<Vec<T>, Error> {
    let mut items = with_room(n);
    for first in (0..n).step_by(STEP) {
        stop.check()?;
        let some = (first..n.min(first + STEP)).into_par_iter().with_min_len(AT_ONCE);
        items.par_extend(some.map(&item));
    }
    Ok(items)
}

impl Tree {
    /// Whether it is small enough to stay in the cache.
    #[inline]
    pub fn is_cached(&self) -> bool {
        self.nodes.len() < CACHED
    }

    /// How many triangles and round solids there are.
    #[inline]
    pub fn len(&self) -> usize {
        self.exact.len() + self.rounds.len()
    }

    /// The number by which the round solid in a row of [`Self::rounds`] is known.
    #[inline(always)]
    pub fn round_id(&self, row: u32) -> i64 {
        self.exact.len() as i64 + i64::from(row)
    }
}

impl Block {
    fn new(frame: Frame, exact: &[Exact], first: u32, count: u32) -> Self {
        let mut block = Self {
            vertex: [[0.0; WIDTH]; 3],
            edges: [[[0.0; WIDTH]; 3]; 2],
            // Small enough that its square does not make the margins positive.
            extent: [-1e-3; WIDTH],
            first,
        };
        for (lane, triangle) in exact[first as usize..][..count as usize].iter().enumerate() {
            let mut extent = 0.0_f32;
            for k in 0..3 {
                let [a, ends @ .., _] = triangle.corners[k];
                block.vertex[k][lane] = ((a - frame.center[k]) * frame.scale) as f32;
                for (edge, end) in block.edges.iter_mut().zip(ends) {
                    edge[k][lane] = ((end - a) * frame.scale) as f32;
                    extent = extent.max(edge[k][lane].abs());
                }
            }
            // Below it, squares leave the range of float32; a wider margin does no harm.
            block.extent[lane] = extent.next_up().max(1e-12);
        }
        block
    }
}

/// Nodes and leaves (first part, number of parts) of a part of the tree.
struct Branch {
    nodes: Vec<Node>,
    leaves: Vec<(u32, u32)>,
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
                self.leaves.push((child.first as u32, child.len() as u32));
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
        for (first, _) in &mut self.leaves {
            *first = before[*first as usize];
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

impl Node {
    fn over(children: &[Range]) -> Self {
        let mut node = Self { planes: [[0.0; WIDTH]; 6], children: [0; WIDTH] };
        for k in 0..3 {
            node.planes[k] = [f32::MAX; WIDTH];
            node.planes[3 + k] = [f32::MIN; WIDTH];
            for (slot, child) in children.iter().enumerate() {
                node.planes[k][slot] = child.bounds.low(k);
                node.planes[3 + k][slot] = child.bounds.high(k);
            }
        }
        node
    }
}
