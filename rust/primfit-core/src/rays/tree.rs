//! A bounding-volume tree with eight children a node and eight triangles a leaf.
//!
//! It lies in a frame of its own, in which the scene is centred and reaches from -1 to 1: boxes
//! and triangles are float32 there. Beside them are the triangles as they came, in float64, in
//! the order of the leaves, and the round solids, each a leaf by itself.

#![allow(clippy::inline_always)]

use super::grow::{self, Leaf};
use super::memory::with_room;
use super::round::{Round, greatest, least};
use super::split::{Part, Range};
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
/// Fewest items that a thread fills in.
const AT_ONCE: usize = 1 << 11;
/// Items between two looks at whether to stop.
const STEP: usize = 1 << 18;

/// The boxes of eight children and where they are.
#[derive(Clone)]
#[cfg_attr(test, derive(Debug, PartialEq))]
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
    /// # Errors
    /// [`Error::VertexOutOfRange`] when a triangle names a vertex that does not exist,
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn new(
        vertices: &[Vector],
        triangles: &[[i64; 3]],
        rounds: &[Round],
        instructions: Instructions,
        stop: &Stop,
    ) -> Result<Self, Error> {
        let frame = Frame::around(reach(vertices, triangles, rounds, stop)?);
        let corners = |id: u32| triangles[id as usize].map(|vertex| vertices[vertex as usize]);
        let part = |id, corners: [Vector; 2]| Part::new(id, corners.map(|v| frame.place(v)));
        let mut parts = filled(triangles.len(), stop, |id| {
            let [a, b, c] = corners(id as u32);
            part(id as u32, around(around([a; 2], [b; 2]), [c; 2]))
        })?;
        let first_round = triangles.len() as u32;
        parts.extend((first_round..).zip(rounds).map(|(id, round)| part(id, round.bounds())));
        let (nodes, leaves) = grow::tree(&mut parts, first_round, instructions, stop)?;
        let exact =
            filled(parts.len(), stop, |i| Exact::new(corners(parts[i].id()), parts[i].id()))?;
        let blocks = filled(leaves.len(), stop, |i| Block::new(frame, &exact, leaves[i]))?;
        Ok(Self { frame, nodes, blocks, exact, rounds: rounds.to_vec() })
    }
}

/// Lower and upper corner of the box around all.
fn reach(
    vertices: &[Vector],
    triangles: &[[i64; 3]],
    rounds: &[Round],
    stop: &Stop,
) -> Result<[Vector; 2], Error> {
    let mut reach = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for (triangle, corners) in triangles.iter().enumerate() {
        if triangle % STEP == 0 {
            stop.check()?;
        }
        for &vertex in corners {
            let place = usize::try_from(vertex).ok().and_then(|row| vertices.get(row));
            let Some(&place) = place else {
                let n_vertices = vertices.len();
                return Err(Error::VertexOutOfRange { triangle, vertex, n_vertices });
            };
            reach = around(reach, [place; 2]);
        }
    }
    Ok(rounds.iter().map(Round::bounds).fold(reach, around))
}

/// The box around two.
#[inline(always)]
fn around([low, high]: [Vector; 2], [other_low, other_high]: [Vector; 2]) -> [Vector; 2] {
    [
        std::array::from_fn(|k| least(low[k], other_low[k])),
        std::array::from_fn(|k| greatest(high[k], other_high[k])),
    ]
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
    fn new(frame: Frame, exact: &[Exact], Leaf { first, n }: Leaf) -> Self {
        let mut block = Self {
            vertex: [[0.0; WIDTH]; 3],
            edges: [[[0.0; WIDTH]; 3]; 2],
            // Small enough that its square does not make the margins positive.
            extent: [-1e-3; WIDTH],
            first,
        };
        for (lane, triangle) in exact[first as usize..][..n as usize].iter().enumerate() {
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

impl Node {
    pub fn over(children: &[Range]) -> Self {
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
