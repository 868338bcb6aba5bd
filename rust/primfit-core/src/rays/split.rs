//! Where to cut a set of triangles and round solids in two: binned surface area heuristic.
//!
//! Wald: On fast Construction of SAH-based Bounding Volume Hierarchies, RT 2007.

use crate::Vector;

/// Bins of a large set; small sets have fewer.
const MOST_BINS: usize = 16;
/// Nodes below the root from which sets are halved, so that the depth has a bound.
pub const DEEPEST: u32 = 40;

/// A box in float32.
#[derive(Clone, Copy)]
pub struct Bounds {
    pub low: [f32; 3],
    pub high: [f32; 3],
}

impl Bounds {
    const NONE: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    #[inline]
    fn add(&mut self, low: [f32; 3], high: [f32; 3]) {
        for k in 0..3 {
            self.low[k] = if low[k] < self.low[k] { low[k] } else { self.low[k] };
            self.high[k] = if high[k] > self.high[k] { high[k] } else { self.high[k] };
        }
    }

    /// Half the surface.
    fn area(&self) -> f32 {
        let [x, y, z] = std::array::from_fn(|k| self.high[k] - self.low[k]);
        x * y + y * z + z * x
    }
}

/// The box of a triangle or round solid, rounded outward.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Part {
    low: [f32; 3],
    pub id: u32,
    high: [f32; 3],
}

impl Part {
    pub fn new(id: u32, corners: [Vector; 3]) -> Self {
        let [a, b, c] = corners;
        Self {
            low: std::array::from_fn(|k| (a[k].min(b[k]).min(c[k]) as f32).next_down()),
            id,
            high: std::array::from_fn(|k| (a[k].max(b[k]).max(c[k]) as f32).next_up()),
        }
    }

    /// One with a given box.
    pub fn around(id: u32, [low, high]: [Vector; 2]) -> Self {
        Self {
            low: low.map(|x| (x as f32).next_down()),
            id,
            high: high.map(|x| (x as f32).next_up()),
        }
    }

    /// Twice the middle of the box.
    #[inline]
    fn middle(&self) -> [f32; 3] {
        std::array::from_fn(|k| self.low[k] + self.high[k])
    }
}

/// A run of parts, its box and the box of their middles.
#[derive(Clone)]
pub struct Range {
    pub first: usize,
    n: usize,
    pub bounds: Bounds,
    middles: Bounds,
}

impl Range {
    pub fn all(parts: &[Part]) -> Self {
        Self::over(0, parts)
    }

    fn over(first: usize, parts: &[Part]) -> Self {
        let (mut bounds, mut middles) = (Bounds::NONE, Bounds::NONE);
        for part in parts {
            bounds.add(part.low, part.high);
            middles.add(part.middle(), part.middle());
        }
        Self { first, n: parts.len(), bounds, middles }
    }

    pub fn len(&self) -> usize {
        self.n
    }

    pub fn area(&self) -> f32 {
        self.bounds.area()
    }
}

/// Cuts `range`, whose parts are `parts`, where rays cost least.
pub fn split(range: &Range, parts: &mut [Part], depth: u32) -> (Range, Range) {
    let cut = if depth < DEEPEST { Cut::cheapest(range, parts) } else { None };
    let Some(cut) = cut else {
        let (left, right) = parts.split_at(parts.len() / 2);
        let first = range.first;
        return (Range::over(first, left), Range::over(first + left.len(), right));
    };
    let mut middles = [Bounds::NONE; 2];
    let (mut i, mut end) = (0, parts.len());
    while i < end {
        let middle = parts[i].middle();
        let is_right = cut.bins.of(middle)[cut.axis] >= cut.bin;
        middles[usize::from(is_right)].add(middle, middle);
        if is_right {
            end -= 1;
            parts.swap(i, end);
        } else {
            i += 1;
        }
    }
    let [left, right] = cut.bounds;
    (
        Range { first: range.first, n: i, bounds: left, middles: middles[0] },
        Range { first: range.first + i, n: parts.len() - i, bounds: right, middles: middles[1] },
    )
}

/// Parts whose bin on `axis` is below `bin` go left.
struct Cut {
    bins: Bins,
    axis: usize,
    bin: usize,
    bounds: [Bounds; 2],
}

/// Equal intervals between the extreme middles.
struct Bins {
    n: usize,
    low: [f32; 3],
    scale: [f32; 3],
}

impl Bins {
    #[inline]
    fn of(&self, middle: [f32; 3]) -> [usize; 3] {
        std::array::from_fn(|k| {
            (((middle[k] - self.low[k]) * self.scale[k]) as usize).min(self.n - 1)
        })
    }
}

impl Cut {
    /// None when all middles agree.
    fn cheapest(range: &Range, parts: &[Part]) -> Option<Self> {
        let n = (4 + parts.len() / 16).min(MOST_BINS);
        let Bounds { low, high } = range.middles;
        let bins = Bins {
            n,
            low,
            scale: std::array::from_fn(|k| {
                let extent = high[k] - low[k];
                if extent > 1e-30 { n as f32 / extent } else { 0.0 }
            }),
        };
        let mut counts = [[0_u32; MOST_BINS]; 3];
        let mut boxes = [[Bounds::NONE; MOST_BINS]; 3];
        for part in parts {
            let row = bins.of(part.middle());
            for k in 0..3 {
                counts[k][row[k]] += 1;
                boxes[k][row[k]].add(part.low, part.high);
            }
        }
        let mut best: Option<(f32, usize, usize, [Bounds; 2])> = None;
        for axis in (0..3).filter(|&k| bins.scale[k] > 0.0) {
            let mut right = [(0, Bounds::NONE); MOST_BINS];
            let mut sum = (0, Bounds::NONE);
            for bin in (1..n).rev() {
                sum.0 += counts[axis][bin];
                sum.1.add(boxes[axis][bin].low, boxes[axis][bin].high);
                right[bin] = sum;
            }
            let mut left = (0, Bounds::NONE);
            for bin in 1..n {
                left.0 += counts[axis][bin - 1];
                left.1.add(boxes[axis][bin - 1].low, boxes[axis][bin - 1].high);
                let right = right[bin];
                if left.0 == 0 || right.0 == 0 {
                    continue;
                }
                let cost = [left, right]
                    .iter()
                    .map(|(count, bounds)| bounds.area() * count.next_multiple_of(4) as f32)
                    .sum();
                if best.as_ref().is_none_or(|best| cost < best.0) {
                    best = Some((cost, axis, bin, [left.1, right.1]));
                }
            }
        }
        best.map(|(_, axis, bin, bounds)| Self { bins, axis, bin, bounds })
    }
}
