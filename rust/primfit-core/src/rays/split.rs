//! Where to cut a set of triangles and round solids in two: binned surface area heuristic.
//!
//! Wald: On fast Construction of SAH-based Bounding Volume Hierarchies, RT 2007.

#![allow(clippy::inline_always)]

use crate::Vector;
use crate::instructions::for_each_set;
use crate::lanes::{Eight, Isa};

/// Bins of a large set; small sets have fewer.
const MOST_BINS: usize = 16;
/// Nodes below the root from which sets are halved, so that the depth has a bound.
pub const DEEPEST: u32 = 40;

/// A box in float32: its low corner in lanes 0 to 2, its high corner with all signs turned in 4 to 6,
/// so that the least of each lane is a box around two. Lanes 3 and 7 do not count.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Bounds([f32; 8]);

impl Bounds {
    const NONE: Self = Self([f32::INFINITY; 8]);

    pub fn low(&self, axis: usize) -> f32 {
        self.0[axis]
    }

    pub fn high(&self, axis: usize) -> f32 {
        -self.0[4 + axis]
    }

    /// Half the surface.
    #[inline(always)]
    fn area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|k| self.high(k) - self.low(k));
        x * y + y * z + z * x
    }
}

/// The box of a triangle or round solid, rounded outward; its number is in lane 3.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Part([f32; 8]);

impl Part {
    /// Numbers get this bit, so that arithmetic on all lanes meets no subnormal number.
    const NORMAL: u32 = 1 << 30;

    pub fn new(id: u32, [low, high]: [Vector; 2]) -> Self {
        let [a, b, c] = low.map(|x| (x as f32).next_down());
        let [d, e, f] = high.map(|x| -(x as f32).next_up());
        Self([a, b, c, f32::from_bits(id | Self::NORMAL), d, e, f, 0.0])
    }

    /// Its box.
    #[cfg(test)]
    pub fn bounds(&self) -> Bounds {
        Bounds(self.0)
    }

    pub fn id(&self) -> u32 {
        self.0[3].to_bits() ^ Self::NORMAL
    }
}

/// Twice the middle of a box, and that with its sign turned.
#[inline(always)]
fn middle<E: Eight>(bounds: E) -> E {
    bounds - bounds.halves_swapped()
}

/// A run of parts, its box and the box of twice their middles.
#[derive(Clone, Copy)]
pub struct Range {
    pub first: usize,
    n: usize,
    pub bounds: Bounds,
    middles: Bounds,
    area: f32,
}

impl Range {
    #[inline(always)]
    fn over<E: Eight>(first: usize, parts: &[Part]) -> Self {
        let none = E::load(&Bounds::NONE.0);
        let (mut bounds, mut middles) = (none, none);
        for part in parts {
            let part = E::load(&part.0);
            bounds = part.min(bounds);
            middles = middle(part).min(middles);
        }
        Self::new(first, parts.len(), Bounds(bounds.store()), Bounds(middles.store()))
    }

    #[inline(always)]
    fn new(first: usize, n: usize, bounds: Bounds, middles: Bounds) -> Self {
        Self { first, n, bounds, middles, area: bounds.area() }
    }

    pub fn len(&self) -> usize {
        self.n
    }

    pub fn area(&self) -> f32 {
        self.area
    }
}

for_each_set! {
    /// That of all parts.
    pub fn range_of(parts: &[Part]) -> Range {
        Range::over::<<Set as Isa>::Eight>(0, parts)
    }
}

for_each_set! {
    /// Cuts `range`, whose parts are `parts`, where rays cost least.
    pub fn split(range: &Range, parts: &mut [Part], depth: u32) -> (Range, Range) {
        cut::<<Set as Isa>::Eight>(range, parts, depth)
    }
}

#[inline(always)]
fn cut<E: Eight>(range: &Range, parts: &mut [Part], depth: u32) -> (Range, Range) {
    let cut = if depth < DEEPEST { Cut::cheapest::<E>(range, parts) } else { None };
    let Some(Cut { intervals, axis, bin, bounds }) = cut else {
        let (left, right) = parts.split_at(parts.len() / 2);
        let first = range.first;
        return (Range::over::<E>(first, left), Range::over::<E>(first + left.len(), right));
    };
    let none = E::load(&Bounds::NONE.0);
    let mut middles = [none; 2];
    let mut n_left = 0;
    for i in 0..parts.len() {
        let is_right = intervals.place(&parts[i], axis) >= bin as f32;
        let part = parts[i];
        let twice = middle(E::load(&part.0));
        // No branch: half of them would be foreseen wrongly.
        let far = [[0.0, f32::INFINITY], [f32::INFINITY, 0.0]][usize::from(is_right)];
        for side in 0..2 {
            middles[side] = (twice + E::splat(far[side])).min(middles[side]);
        }
        parts[i] = parts[n_left];
        parts[n_left] = part;
        n_left += usize::from(!is_right);
    }
    let n_right = parts.len() - n_left;
    let [left, right] = middles;
    (
        Range::new(range.first, n_left, bounds[0], Bounds(left.store())),
        Range::new(range.first + n_left, n_right, bounds[1], Bounds(right.store())),
    )
}

/// Parts whose interval on `axis` is below `bin` go left.
struct Cut {
    intervals: Intervals,
    axis: usize,
    bin: usize,
    bounds: [Bounds; 2],
}

/// Equal intervals between the extreme middles.
struct Intervals {
    last: f32,
    low: [f32; 8],
    scale: [f32; 8],
}

impl Intervals {
    #[inline(always)]
    fn between(middles: &Bounds, n: usize) -> Self {
        let mut intervals = Self { last: (n - 1) as f32, low: [0.0; 8], scale: [0.0; 8] };
        for k in 0..3 {
            let extent = middles.high(k) - middles.low(k);
            intervals.low[k] = middles.low(k);
            intervals.scale[k] = if extent > 1e-30 { n as f32 / extent } else { 0.0 };
        }
        intervals
    }

    /// Those of all axes, in the first three lanes.
    #[inline(always)]
    fn of<E: Eight>(&self, part: E) -> [i32; 8] {
        let places = (middle(part) - E::load(&self.low)) * E::load(&self.scale);
        // In this order, what is no number stays none and goes left, as it does in a cut.
        E::splat(self.last).min(places).truncated()
    }

    /// The place on an axis, in intervals.
    #[inline(always)]
    fn place(&self, part: &Part, axis: usize) -> f32 {
        (part.0[axis] - part.0[4 + axis] - self.low[axis]) * self.scale[axis]
    }
}

/// What lies in an interval.
#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    n: u32,
}

impl Bin {
    const EMPTY: Self = Self { bounds: Bounds::NONE, n: 0 };
}

type Bins = [[Bin; MOST_BINS]; 3];

#[inline(always)]
fn put<E: Eight>(part: &Part, intervals: &Intervals, bins: &mut Bins) {
    let part = E::load(&part.0);
    let row = intervals.of(part);
    for k in 0..3 {
        let bin = &mut bins[k][row[k] as usize % MOST_BINS];
        bin.bounds = Bounds(part.min(E::load(&bin.bounds.0)).store());
        bin.n += 1;
    }
}

impl Cut {
    /// None when all middles agree.
    #[inline(always)]
    fn cheapest<E: Eight>(range: &Range, parts: &[Part]) -> Option<Self> {
        let n = (4 + parts.len() / 16).min(MOST_BINS);
        let intervals = Intervals::between(&range.middles, n);
        let mut bins = [[Bin::EMPTY; MOST_BINS]; 3];
        // Neighbours mostly share their bins, and would wait for each other.
        let (early, late) = parts.split_at(parts.len() / 2);
        let (later, last) = late.split_at(early.len());
        for (early, late) in early.iter().zip(later) {
            put::<E>(early, &intervals, &mut bins);
            put::<E>(late, &intervals, &mut bins);
        }
        for part in last {
            put::<E>(part, &intervals, &mut bins);
        }
        let mut best = (f32::INFINITY, 0, 0);
        for axis in (0..3).filter(|&k| intervals.scale[k] > 0.0) {
            let mut right = [f32::INFINITY; MOST_BINS];
            let mut side = Side::<E>::empty();
            for bin in (1..n).rev() {
                side.add(&bins[axis][bin]);
                right[bin] = side.cost();
            }
            let mut side = Side::<E>::empty();
            for bin in 1..n {
                side.add(&bins[axis][bin - 1]);
                let cost = side.cost() + right[bin];
                if cost < best.0 {
                    best = (cost, axis, bin);
                }
            }
        }
        let (cost, axis, bin) = best;
        let mut bounds = [Bounds::NONE; 2];
        for (bounds, some) in bounds.iter_mut().zip([0..bin, bin..n]) {
            let mut side = Side::<E>::empty();
            for bin in &bins[axis][some] {
                side.add(bin);
            }
            *bounds = Bounds(side.bounds.store());
        }
        (cost < f32::INFINITY).then_some(Self { intervals, axis, bin, bounds })
    }
}

/// What is on one side of a cut.
struct Side<E> {
    n: u32,
    bounds: E,
}

impl<E: Eight> Side<E> {
    #[inline(always)]
    fn empty() -> Self {
        Self { n: 0, bounds: E::load(&Bounds::NONE.0) }
    }

    #[inline(always)]
    fn add(&mut self, bin: &Bin) {
        self.n += bin.n;
        self.bounds = E::load(&bin.bounds.0).min(self.bounds);
    }

    /// Of rays through it; infinite when nothing is there.
    #[inline(always)]
    fn cost(&self) -> f32 {
        let cost = Bounds(self.bounds.store()).area() * self.n.next_multiple_of(4) as f32;
        if self.n == 0 { f32::INFINITY } else { cost }
    }
}
