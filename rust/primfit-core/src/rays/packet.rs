//! Sixteen neighbouring beams of one origin through the tree together.
//!
//! At a node the box of their directions is held against eight children at once; each child that
//! is left is held against sixteen rays. At a leaf, the origin being one, each triangle has its
//! vectors computed once and costs nine products a ray. When few rays are left they go on alone.

#![allow(clippy::inline_always)]
// Lanes are counted, so that the compiler sees whole vectors.
#![allow(clippy::needless_range_loop)]

use super::beam::{self, Span};
use super::caster::Hit;
use super::interleaved::{self, Flight, prefetch_child};
use super::lanes::{Isa, Lanes, lane, load};
use super::leaf::Triangles;
use super::ray::{Ray, Start, ULP, steep};
use super::tiles::{RAYS, Tiles};
use super::tree::{Block, LEAF, Node, Tree, WIDTH};
use super::triangle::ShearedRay;
use super::walk::STACK;
use crate::Vector;

/// So many rays go on alone.
const FEW: u32 = 5;
/// And so many in a tree that fits no cache: alone, one of them computes while others wait.
const MANY: u32 = 12;
/// Nodes of such a tree.
const LARGE: usize = 16_000;
/// So many candidates are decided one by one.
const FEW_CANDIDATES: u32 = 2;

type Floats = [f32; RAYS];
type Doubles = [f64; RAYS];

/// The rays, what they hit so far and which children wait.
struct Packet {
    origin: Vector,
    start: Start,
    exact_directions: [Doubles; 3],
    directions: [Floats; 3],
    inverses: [Floats; 3],
    near: [Floats; 3],
    far: [Floats; 3],
    limits: Floats,
    scales: Doubles,
    /// Axes and shears when all rays have the same longest component.
    axes: Option<[usize; 3]>,
    shears: [Doubles; 3],
    ranges: Doubles,
    triangles: [i64; RAYS],
    beam: [Span; 3],
    stack: [(u64, u32); STACK],
    waiting: usize,
    flights: Vec<Flight>,
}

/// Casts all rays of one origin, which must not be far, tile by tile.
#[inline(always)]
pub fn cast<I: Isa>(
    tree: &Tree,
    tiles: Tiles,
    start: Start,
    origin: Vector,
    directions: &[Vector],
    hits: &mut [Hit],
) {
    let mut packet = Packet::new(origin, start);
    for tile in 0..tiles.count(directions.len()) {
        let (rows, count) = tiles.tile(tile, directions.len());
        if count == 0 {
            continue;
        }
        packet.prepare(tree, directions, rows);
        packet.traverse::<I>(tree, u32::MAX >> (32 - count));
        for i in 0..count {
            hits[rows[i] as usize] = Hit { range: packet.ranges[i], triangle: packet.triangles[i] };
        }
    }
}

impl Packet {
    fn new(origin: Vector, start: Start) -> Self {
        Self {
            origin,
            start,
            exact_directions: [[0.0; RAYS]; 3],
            directions: [[0.0; RAYS]; 3],
            inverses: [[0.0; RAYS]; 3],
            near: [[0.0; RAYS]; 3],
            far: [[0.0; RAYS]; 3],
            limits: [0.0; RAYS],
            scales: [0.0; RAYS],
            axes: None,
            shears: [[0.0; RAYS]; 3],
            ranges: [0.0; RAYS],
            triangles: [0; RAYS],
            beam: [Span::Both { low: 0.0, high: 0.0 }; 3],
            stack: [(0, 0); STACK],
            waiting: 0,
            flights: (0..MANY).map(|_| Flight::idle()).collect(),
        }
    }

    #[inline(always)]
    fn prepare(&mut self, tree: &Tree, directions: &[Vector], rows: [u32; RAYS]) {
        let start = self.start;
        for i in 0..RAYS {
            let direction = directions[rows[i] as usize];
            for k in 0..3 {
                self.exact_directions[k][i] = direction[k];
            }
        }
        let [x, y, z] = &self.exact_directions;
        let mut largest = [0.0; RAYS];
        for i in 0..RAYS {
            largest[i] = x[i].abs().max(y[i].abs()).max(z[i].abs());
            self.scales[i] = largest[i] * tree.frame.scale;
        }
        for k in 0..3 {
            for i in 0..RAYS {
                let direction = steep(self.exact_directions[k][i] / largest[i]);
                let inverse = 1.0 / direction;
                let place = -start.origin[k] * inverse;
                let slack = start.slack() * inverse.abs();
                self.directions[k][i] = direction;
                self.inverses[k][i] = inverse;
                self.near[k][i] = place - slack;
                self.far[k][i] = place + slack;
            }
            self.beam[k] = Span::of(k, &self.directions[k], start.slack());
        }
        self.limits = [start.limit(); RAYS];
        self.ranges = [f64::INFINITY; RAYS];
        self.triangles = [-1; RAYS];
        self.waiting = 0;
        self.shear();
    }

    /// The shears of all rays, when they share their axes.
    #[inline(always)]
    fn shear(&mut self) {
        let first: Vector = std::array::from_fn(|k| self.exact_directions[k][0]);
        let axes = ShearedRay::axes_of(first);
        let [kx, ky, kz] = axes;
        let [dx, dy, dz] = [kx, ky, kz].map(|k| &self.exact_directions[k]);
        let mut agree = true;
        for i in 0..RAYS {
            let (x, y, z) = (dx[i].abs(), dy[i].abs(), dz[i].abs());
            // Ties are left to the general way.
            agree &= z > x && z > y && (dz[i] < 0.0) == (dz[0] < 0.0);
        }
        self.axes = agree.then_some(axes);
        for i in 0..RAYS {
            let inverse = 1.0 / dz[i];
            self.shears[0][i] = dx[i] * inverse;
            self.shears[1][i] = dy[i] * inverse;
            self.shears[2][i] = inverse;
        }
    }

    #[inline(always)]
    fn exact(&self, i: usize) -> ShearedRay {
        match self.axes {
            Some(axes) => ShearedRay::from_shear(self.origin, axes, lane(&self.shears, i)),
            None => ShearedRay::new(self.origin, lane(&self.exact_directions, i)),
        }
    }

    #[inline(always)]
    fn traverse<I: Isa>(&mut self, tree: &Tree, all: u32) {
        let few = if tree.nodes.len() < LARGE { FEW } else { MANY };
        let (mut child, mut mask) = (0_u32, all);
        loop {
            if child & LEAF != 0 {
                self.leaf::<I>(tree, &tree.blocks[(child ^ LEAF) as usize], mask);
            } else if mask.count_ones() <= few {
                self.go_alone::<I>(tree, child, mask);
            } else if let Some(next) = self.enter::<I>(tree, &tree.nodes[child as usize], mask) {
                (child, mask) = next;
                continue;
            }
            let Some(next) = self.pop::<I>() else { return };
            (child, mask) = next;
        }
    }

    /// The children that rays of `mask` enter; the nearest is next, with its rays.
    #[inline(always)]
    fn enter<I: Isa>(&mut self, tree: &Tree, node: &Node, mask: u32) -> Option<(u32, u32)> {
        let mut last = self.limits[0];
        for limit in &self.limits[1..] {
            last = if *limit > last { *limit } else { last };
        }
        let (entry, mut children) = beam::slabs::<I>(node, self.start, &self.beam, last);
        if !tree.is_cached() {
            let mut rest = children;
            while rest != 0 {
                prefetch_child(tree, node.children[rest.trailing_zeros() as usize]);
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
        nearest.map(|(key, rays)| (key as u32, rays)).or_else(|| self.pop::<I>())
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
        let inverses = load::<I::Sixteen>(&self.inverses);
        let (near, far) = (load::<I::Sixteen>(&self.near), load::<I::Sixteen>(&self.far));
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
        let directions = load::<I::Sixteen>(&self.directions);
        for i in 0..WIDTH {
            if block.extent[i] < 0.0 {
                break;
            }
            let limits = I::Sixteen::load(&self.limits);
            let candidates = mask & triangles.candidates::<I>(i, directions, limits);
            if candidates != 0 {
                self.decide(tree, block.first as usize + i, candidates);
            }
        }
    }

    /// One triangle against some rays in float64.
    #[inline(always)]
    fn decide(&mut self, tree: &Tree, triangle: usize, mut candidates: u32) {
        let triangle = &tree.exact[triangle];
        let id = i64::from(triangle.id);
        if candidates.count_ones() > FEW_CANDIDATES
            && let Some(axes) = self.axes
            && let Some(depths) =
                ShearedRay::cast_many(self.origin, axes, &self.shears, &triangle.corners)
        {
            let reach = 8.0 * ULP * self.start.reach;
            for i in 0..RAYS {
                let (old, new) = (self.ranges[i], depths[i]);
                let is_before = new < old || (new == old && id < self.triangles[i]);
                let range = if is_before { new } else { old };
                self.ranges[i] = range;
                self.triangles[i] = if is_before { id } else { self.triangles[i] };
                let limit = (range * self.scales[i]) as f32 + reach;
                self.limits[i] = if limit < self.limits[i] { limit } else { self.limits[i] };
            }
            return;
        }
        while candidates != 0 {
            let i = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            if let Some(range) = self.exact(i).cast(&triangle.corners) {
                let hit = Hit { range, triangle: id };
                if hit.is_before(self.hit(i)) {
                    self.ranges[i] = range;
                    self.triangles[i] = id;
                    let limit = (range * self.scales[i]) as f32 + 8.0 * ULP * self.start.reach;
                    self.limits[i] = self.limits[i].min(limit);
                }
            }
        }
    }

    /// Each ray of `mask` by itself from `child` on.
    #[inline(always)]
    fn go_alone<I: Isa>(&mut self, tree: &Tree, child: u32, mask: u32) {
        let n = mask.count_ones() as usize;
        let mut rest = mask;
        for flight in 0..n {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let ray = Ray::ready(
                self.start,
                lane(&self.directions, i),
                lane(&self.inverses, i),
                [lane(&self.near, i), lane(&self.far, i)],
                self.limits[i],
                self.scales[i],
            );
            let (exact, hit) = (self.exact(i), self.hit(i));
            self.flights[flight].restart(tree, ray, exact, hit, child);
        }
        interleaved::finish::<I>(tree, &mut self.flights[..n]);
        let mut rest = mask;
        for flight in &self.flights[..n] {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let hit = flight.walk.hit;
            (self.ranges[i], self.triangles[i]) = (hit.range, hit.triangle);
            self.limits[i] = flight.walk.ray.limit;
        }
    }

    #[inline(always)]
    fn hit(&self, i: usize) -> Hit {
        Hit { range: self.ranges[i], triangle: self.triangles[i] }
    }
}
