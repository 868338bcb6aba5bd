//! One ray on its way through the tree, one step at a time.

#![allow(clippy::inline_always)]

use super::bundle::Bundle;
use super::caster::Hit;
use super::leaf::candidates;
use super::query::Query;
use super::ray::Ray;
use super::supply::{Next, Supply};
use super::tree::{LEAF, Node, ROUND_LEAF, Tree, WIDTH};
use super::triangle::ShearedRay;
use crate::Vector;
use crate::lanes::{Isa, Lanes, splat};

/// More than the children that can wait: seven a level, and `split::DEEPEST` levels and those of
/// a halved set.
pub const STACK: usize = 512;

/// A ray, what it hit so far and which children wait.
pub struct Walk {
    pub ray: Ray,
    exact: ShearedRay,
    /// Of unit length, for round solids.
    direction: Vector,
    pub hit: Hit,
    /// Children by entry: the bits of the position, then the code of the child.
    stack: [u64; STACK],
    waiting: usize,
}

impl Walk {
    /// One that has no ray yet.
    pub fn idle() -> Self {
        Self {
            ray: Ray::default(),
            exact: ShearedRay::default(),
            direction: [0.0; 3],
            hit: Hit::NONE,
            stack: [0; STACK],
            waiting: 0,
        }
    }

    /// Starts another ray, which hit something already or [`Hit::NONE`].
    #[inline(always)]
    pub fn restart<const ROUND: bool>(
        &mut self,
        ray: Ray,
        exact: ShearedRay,
        direction: Vector,
        hit: Hit,
    ) {
        self.ray = ray;
        self.exact = exact;
        if ROUND {
            self.direction = direction;
        }
        self.hit = hit;
        self.waiting = 0;
    }

    /// All steps from `child` on.
    #[inline(always)]
    pub fn finish<I: Isa, const ROUND: bool>(&mut self, tree: &Tree, child: u32) {
        let mut next = Some(child);
        while let Some(child) = next {
            next = if child & LEAF == 0 {
                self.enter::<I>(&tree.nodes[child as usize])
            } else if ROUND && child & ROUND_LEAF != 0 {
                self.meet(tree, child ^ (LEAF | ROUND_LEAF))
            } else {
                let block = &tree.blocks[(child ^ LEAF) as usize];
                let mask = candidates::<I>(block, &self.ray);
                self.decide(tree, block.first, mask)
            };
        }
    }

    /// The children of a node that the ray enters; the nearest is next.
    #[inline(always)]
    pub fn enter<I: Isa>(&mut self, node: &Node) -> Option<u32> {
        let (entry, mut mask) = slabs::<I>(node, &self.ray);
        if mask == 0 {
            return self.pop();
        }
        let key =
            |slot: usize| u64::from(entry[slot].to_bits()) << 32 | u64::from(node.children[slot]);
        let one = key(mask.trailing_zeros() as usize);
        mask &= mask - 1;
        if mask == 0 {
            return Some(one as u32);
        }
        let other = key(mask.trailing_zeros() as usize);
        mask &= mask - 1;
        let mut nearest = one.min(other);
        let first = self.waiting;
        self.stack[first] = one.max(other);
        self.waiting += 1;
        while mask != 0 {
            let next = key(mask.trailing_zeros() as usize);
            mask &= mask - 1;
            let other = nearest.max(next);
            nearest = nearest.min(next);
            // The farthest lies deepest.
            let mut place = self.waiting;
            while place > first && self.stack[place - 1] < other {
                self.stack[place] = self.stack[place - 1];
                place -= 1;
            }
            self.stack[place] = other;
            self.waiting += 1;
        }
        Some(nearest as u32)
    }

    /// Tests candidates in float64; `first` is the row of the first triangle of their block.
    #[inline(always)]
    pub fn decide(&mut self, tree: &Tree, first: u32, mut mask: u32) -> Option<u32> {
        while mask != 0 {
            let triangle = &tree.exact[(first + mask.trailing_zeros()) as usize];
            mask &= mask - 1;
            if let Some(range) = self.exact.cast(&triangle.corners) {
                let hit = Hit { range, triangle: triangle.id() };
                if hit.is_before(self.hit) {
                    self.hit = hit;
                    self.ray.stop_at(range);
                }
            }
        }
        self.pop()
    }

    /// Tests a round solid.
    #[inline(always)]
    pub fn meet(&mut self, tree: &Tree, row: u32) -> Option<u32> {
        let range = tree.rounds[row as usize].cast_one(self.exact.origin(), self.direction);
        let hit = Hit { range, triangle: tree.round_id(row) };
        if range < f64::INFINITY && hit.is_before(self.hit) {
            self.hit = hit;
            self.ray.stop_at(range);
        }
        self.pop()
    }

    #[inline(always)]
    pub fn pop(&mut self) -> Option<u32> {
        let limit = self.ray.limit;
        while self.waiting > 0 {
            self.waiting -= 1;
            let top = self.stack[self.waiting];
            if f32::from_bits((top >> 32) as u32) <= limit {
                return Some(top as u32);
            }
        }
        None
    }
}

/// Casts all rays, one after the other; whether all have a direction.
#[inline(always)]
pub fn cast<I: Isa, Q: Query, const ROUND: bool>(
    tree: &Tree,
    query: &mut Q,
    bundle: &mut Bundle,
    walk: &mut Walk,
) -> bool {
    let mut supply = Supply::new(bundle);
    loop {
        match supply.next::<I, Q>(tree, query) {
            Next::Enters { row, direction, ray, exact } => {
                walk.restart::<ROUND>(ray, exact, direction, Hit::NONE);
                walk.finish::<I, ROUND>(tree, 0);
                query.answer_one(row, direction, walk.hit);
            }
            Next::NoDirection => return false,
            Next::NoMore => return true,
        }
    }
}

/// Where the ray enters each child, at zero or beyond, and a bit for each that it enters.
#[inline(always)]
fn slabs<I: Isa>(node: &Node, ray: &Ray) -> ([f32; WIDTH], u32) {
    let [nx, ny, nz] = crossings::<I::Eight>(node, ray.near_rows, ray.inverse, ray.near);
    let [fx, fy, fz] = crossings::<I::Eight>(node, ray.far_rows, ray.inverse, ray.far);
    let enter = nx.max(ny).max(nz.max(I::Eight::splat(0.0)));
    let leave = fx.min(fy).min(fz.min(I::Eight::splat(ray.limit)));
    (enter.store(), enter.le(leave))
}

/// Where the ray crosses a plane of each axis.
#[inline(always)]
fn crossings<L: Lanes<Array = [f32; WIDTH]>>(
    node: &Node,
    rows: [usize; 3],
    inverse: [f32; 3],
    terms: [f32; 3],
) -> [L; 3] {
    let planes = [&node.planes[rows[0]], &node.planes[rows[1]], &node.planes[rows[2]]];
    let (inverse, terms) = (splat::<L>(inverse), splat::<L>(terms));
    [
        L::load(planes[0]).mul_add(inverse[0], terms[0]),
        L::load(planes[1]).mul_add(inverse[1], terms[1]),
        L::load(planes[2]).mul_add(inverse[2], terms[2]),
    ]
}
