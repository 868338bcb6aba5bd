//! Sixteen neighbouring beams of one origin through the tree together.
//!
//! At a node the box of their directions is held against eight children at once; each child that
//! is left is held against sixteen rays. At a leaf, the origin being one, each triangle has its
//! vectors computed once and costs nine products a ray. When few rays are left they go on alone.

#![allow(clippy::inline_always)]
// Lazy operators would be branches.
#![allow(clippy::needless_bitwise_bool)]
// Lanes are counted, so that the compiler sees whole vectors.
#![allow(clippy::needless_range_loop)]

use super::beam::{self, Span};
use super::bundle::{Bundle, Doubles, Floats};
use super::caster::Hit;
use super::interleaved::{self, Flight, prefetch_child};
use super::leaf::Triangles;
use super::query::{Nearest, Query};
use super::ray::{Start, ULP};
use super::tiles::{RAYS, Tiles};
use super::tree::{Block, LEAF, Node, ROUND_LEAF, Tree, WIDTH};
use super::triangle::ShearedRay;
use super::walk::STACK;
use crate::Vector;
use crate::lanes::{Isa, Lanes, lane, load};

/// So many rays go on alone.
const FEW: u32 = 5;
/// And so many in a tree that fits no cache: alone, one of them computes while others wait.
const MANY: u32 = 12;
/// Nodes of such a tree.
const LARGE: usize = 16_000;
/// So many candidates are decided one by one.
const FEW_CANDIDATES: u32 = 2;

/// The rays, what they hit so far and which children wait.
pub struct Packet {
    pub bundle: Bundle,
    origin: Vector,
    start: Start,
    limits: Floats,
    /// The greatest of the limits.
    last: f32,
    /// Axes and shears when all rays have the same longest component.
    axes: Option<[usize; 3]>,
    shears: [Doubles; 3],
    nearest: Nearest<RAYS>,
    beam: [Span; 3],
    stack: [(u64, u32); STACK],
    waiting: usize,
}

/// Casts all rays of one origin, which must not be far, tile by tile; whether all have a direction.
#[inline(always)]
pub fn cast<I: Isa, Q: Query, const ROUND: bool>(
    tree: &Tree,
    tiles: Tiles,
    start: Start,
    query: &mut Q,
    packet: &mut Packet,
    flights: &mut [Flight],
) -> bool {
    packet.origin = query.origin(0);
    packet.start = start;
    for tile in 0..tiles.count(query.len()) {
        let (rows, count) = tiles.tile(tile, query.len());
        if count == 0 {
            continue;
        }
        if !packet.bundle.aim(query, rows) {
            return false;
        }
        packet.prepare::<I>(tree);
        packet.traverse::<I, ROUND>(tree, flights, u32::MAX >> (32 - count));
        query.answer(rows, count, &packet.bundle.exact, &packet.nearest);
    }
    true
}

impl Packet {
    pub fn new() -> Self {
        Self {
            bundle: Bundle::new(),
            origin: [0.0; 3],
            start: Start::default(),
            limits: [0.0; RAYS],
            last: 0.0,
            axes: None,
            shears: [[0.0; RAYS]; 3],
            nearest: Nearest::none(),
            beam: [Span::Both { low: 0.0, high: 0.0 }; 3],
            stack: [(0, 0); STACK],
            waiting: 0,
        }
    }

    #[inline(always)]
    fn prepare<I: Isa>(&mut self, tree: &Tree) {
        self.bundle.place_together::<I>(self.start, &tree.frame);
        let slack = self.start.slack();
        for (k, components) in self.bundle.directions.iter().enumerate() {
            let components = I::Sixteen::load(components);
            self.beam[k] = Span::of(k, components.least(), components.greatest(), slack);
        }
        (self.axes, self.shears) = self.bundle.shear();
        self.limits = [self.start.limit(); RAYS];
        self.last = self.start.limit();
        self.nearest = Nearest::none();
        self.waiting = 0;
    }

    #[inline(always)]
    fn exact(&self, i: usize) -> ShearedRay {
        match self.axes {
            Some(axes) => ShearedRay::from_shear(self.origin, axes, lane(&self.shears, i)),
            None => self.bundle.sheared(i, self.origin),
        }
    }

    #[inline(always)]
    fn traverse<I: Isa, const ROUND: bool>(
        &mut self,
        tree: &Tree,
        flights: &mut [Flight],
        all: u32,
    ) {
        let few = if tree.nodes.len() < LARGE { FEW } else { MANY };
        let (mut child, mut mask) = (0_u32, all);
        loop {
            if ROUND && child & (LEAF | ROUND_LEAF) == LEAF | ROUND_LEAF {
                self.meet::<I>(tree, child ^ (LEAF | ROUND_LEAF), mask);
            } else if child & LEAF != 0 {
                self.leaf::<I>(tree, &tree.blocks[(child ^ LEAF) as usize], mask);
            } else if mask.count_ones() <= few {
                self.go_alone::<I, ROUND>(tree, flights, child, mask);
            } else if let Some(next) =
                self.enter::<I, ROUND>(tree, &tree.nodes[child as usize], mask)
            {
                (child, mask) = next;
                continue;
            }
            let Some(next) = self.pop::<I>() else { return };
            (child, mask) = next;
        }
    }

    /// The children that rays of `mask` enter; the nearest is next, with its rays.
    #[inline(always)]
    fn enter<I: Isa, const ROUND: bool>(
        &mut self,
        tree: &Tree,
        node: &Node,
        mask: u32,
    ) -> Option<(u32, u32)> {
        let (entry, mut children) = beam::slabs::<I>(node, self.start, &self.beam, self.last);
        if !tree.is_cached() {
            let mut rest = children;
            while rest != 0 {
                prefetch_child::<ROUND>(tree, node.children[rest.trailing_zeros() as usize]);
                rest &= rest - 1;
            }
        }
        let first = self.waiting;
        let mut nearest: Option<(u64, u32)> = None;
        while children != 0 {
            let slot = children.trailing_zeros() as usize;
            children &= children - 1;
            let rays = self.slabs::<I>(node, slot) & mask;
            if rays == 0 {
                continue;
            }
            let key = u64::from(entry[slot].to_bits()) << 32 | u64::from(node.children[slot]);
            let mut other = (key, rays);
            match &mut nearest {
                None => {
                    nearest = Some(other);
                    continue;
                }
                Some(nearest) => {
                    if other.0 < nearest.0 {
                        std::mem::swap(nearest, &mut other);
                    }
                }
            }
            // The farthest lies deepest.
            let mut place = self.waiting;
            while place > first && self.stack[place - 1].0 < other.0 {
                self.stack[place] = self.stack[place - 1];
                place -= 1;
            }
            self.stack[place] = other;
            self.waiting += 1;
        }
        match nearest {
            Some((key, rays)) => Some((key as u32, rays)),
            None => self.pop::<I>(),
        }
    }

    #[inline(always)]
    fn pop<I: Isa>(&mut self) -> Option<(u32, u32)> {
        let limits = I::Sixteen::load(&self.limits);
        while self.waiting > 0 {
            self.waiting -= 1;
            let (key, mask) = self.stack[self.waiting];
            let entry = f32::from_bits((key >> 32) as u32);
            let mask = mask & I::Sixteen::splat(entry).le(limits);
            if mask != 0 {
                return Some((key as u32, mask));
            }
        }
        None
    }

    /// A bit for each ray that enters a child.
    #[inline(always)]
    fn slabs<I: Isa>(&self, node: &Node, slot: usize) -> u32 {
        let inverses = load::<I::Sixteen>(&self.bundle.inverses);
        let (near, far) = (load(&self.bundle.near), load(&self.bundle.far));
        let mut enter = I::Sixteen::splat(0.0);
        let mut leave = I::Sixteen::load(&self.limits);
        for k in 0..3 {
            match self.beam[k] {
                Span::OneWay { near_row, far_row, .. } => {
                    let (first, last) = (node.planes[near_row][slot], node.planes[far_row][slot]);
                    enter = enter.max(I::Sixteen::splat(first).mul_add(inverses[k], near[k]));
                    leave = leave.min(I::Sixteen::splat(last).mul_add(inverses[k], far[k]));
                }
                Span::Both { .. } => {
                    let low = I::Sixteen::splat(node.planes[k][slot]);
                    let high = I::Sixteen::splat(node.planes[k + 3][slot]);
                    let first = low.mul_add(inverses[k], near[k]);
                    enter = enter.max(first.min(high.mul_add(inverses[k], near[k])));
                    let last = low.mul_add(inverses[k], far[k]);
                    leave = leave.min(last.max(high.mul_add(inverses[k], far[k])));
                }
            }
        }
        enter.le(leave)
    }

    /// All triangles of a block against the rays of `mask`.
    #[inline(always)]
    fn leaf<I: Isa>(&mut self, tree: &Tree, block: &Block, mask: u32) {
        let triangles = Triangles::from::<I>(block, self.start);
        let directions = load::<I::Sixteen>(&self.bundle.directions);
        for i in 0..WIDTH {
            if block.extent[i] < 0.0 {
                break;
            }
            let limits = I::Sixteen::load(&self.limits);
            let candidates = mask & triangles.candidates::<I>(i, directions, limits);
            if candidates != 0 {
                self.decide::<I>(tree, block.first as usize + i, candidates);
            }
        }
    }

    /// One triangle against some rays in float64.
    #[inline(always)]
    fn decide<I: Isa>(&mut self, tree: &Tree, triangle: usize, mut candidates: u32) {
        let triangle = &tree.exact[triangle];
        let id = triangle.id();
        if candidates.count_ones() > FEW_CANDIDATES
            && let Some(axes) = self.axes
            && let Some(depths) =
                ShearedRay::cast_many(self.origin, axes, &self.shears, &triangle.corners)
        {
            self.take::<I>(&depths, id);
            return;
        }
        while candidates != 0 {
            let i = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            if let Some(range) = self.exact(i).cast(&triangle.corners) {
                let hit = Hit { range, triangle: id };
                if hit.is_before(self.nearest.get(i)) {
                    self.nearest.set(i, hit);
                    let limit =
                        (range * self.bundle.scales[i]) as f32 + 8.0 * ULP * self.start.reach;
                    self.limits[i] = self.limits[i].min(limit);
                }
            }
        }
        self.last = I::Sixteen::load(&self.limits).greatest();
    }

    /// A round solid against all rays; those that do not enter its box do not meet it.
    #[inline(always)]
    fn meet<I: Isa>(&mut self, tree: &Tree, row: u32, mask: u32) {
        let (round, id) = (&tree.rounds[row as usize], tree.round_id(row));
        if mask.count_ones() > FEW_CANDIDATES {
            self.take::<I>(&round.cast(self.origin, &self.bundle.exact, mask), id);
            return;
        }
        let mut rest = mask;
        let mut ranges = [f64::INFINITY; RAYS];
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            ranges[i] = round.cast_one(self.origin, lane(&self.bundle.exact, i));
        }
        self.take::<I>(&ranges, id);
    }

    /// Takes the ranges of all rays to what has a number, infinite for none, where they are nearer.
    #[inline(always)]
    fn take<I: Isa>(&mut self, ranges: &Doubles, id: i64) {
        let mut positions = [0.0; RAYS];
        for i in 0..RAYS {
            let (old, new) = (self.nearest.ranges[i], ranges[i]);
            let is_before = (new < old) | ((new == old) & (id < self.nearest.triangles[i]));
            self.nearest.ranges[i] = if is_before { new } else { old };
            self.nearest.triangles[i] = if is_before { id } else { self.nearest.triangles[i] };
            positions[i] = self.nearest.ranges[i] * self.bundle.scales[i];
        }
        let reach = I::Sixteen::splat(8.0 * ULP * self.start.reach);
        let limits = I::Sixteen::narrow(&positions) + reach;
        let limits = limits.min(I::Sixteen::load(&self.limits));
        self.last = limits.greatest();
        self.limits = limits.store();
    }

    /// Each ray of `mask` by itself from `child` on.
    #[inline(always)]
    fn go_alone<I: Isa, const ROUND: bool>(
        &mut self,
        tree: &Tree,
        flights: &mut [Flight],
        child: u32,
        mask: u32,
    ) {
        let flights = &mut flights[..mask.count_ones() as usize];
        let mut rest = mask;
        for flight in &mut *flights {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let ray = self.bundle.ray(i, self.start, self.limits[i]);
            let (exact, hit) = (self.exact(i), self.nearest.get(i));
            let direction = lane(&self.bundle.exact, i);
            flight.restart::<ROUND>(tree, (ray, exact, direction), hit, child);
        }
        interleaved::finish::<I, ROUND>(tree, flights);
        let mut rest = mask;
        for flight in flights {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            self.nearest.set(i, flight.walk.hit);
            self.limits[i] = flight.walk.ray.limit;
        }
        self.last = I::Sixteen::load(&self.limits).greatest();
    }
}
