//! Rays against spheres, capped cylinders and cones, and tori, in closed form.
//!
//! Each is solved from the point of the ray that is nearest to the centre, so that a far origin
//! costs no digits. A sphere and a capped cone are convex: where a ray is within them is one
//! interval, that of a capped cone what the slab between its caps and the quadric share. So cap
//! and side never leave a gap at the rim, and a ray from within always ends.

#![allow(clippy::inline_always)]
// Lazy operators would be branches; lanes are counted, so that the compiler sees whole vectors.
#![allow(clippy::needless_bitwise_bool, clippy::needless_range_loop)]

use super::torus;
use crate::Vector;

/// Numbers of a row: the kind, centre, axis and three lengths.
pub const ROW: usize = 10;

/// A round solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Round {
    /// A ball.
    Sphere {
        /// Its centre.
        center: Vector,
        /// Of its surface.
        radius: f64,
    },
    /// Between two discs: a cylinder, a cone, or one that is cut off.
    Frustum {
        /// In the middle between the discs.
        center: Vector,
        /// Of unit length, from the base to the top.
        axis: Vector,
        /// Half of the height.
        half: f64,
        /// Of the disc at the base.
        base_radius: f64,
        /// Of the disc at the top; either may be 0.
        top_radius: f64,
    },
    /// A ring.
    Torus {
        /// Its centre.
        center: Vector,
        /// Of unit length.
        axis: Vector,
        /// Of the circle in the middle of the tube.
        major_radius: f64,
        /// Of the tube, less than the other.
        radius: f64,
    },
}

impl Round {
    /// The solid of a row: 0, a sphere of a radius; 1, a frustum of half a height, base and top
    /// radius; 2, a torus of major radius and radius. None for another kind.
    #[must_use]
    pub fn from_row(row: &[f64; ROW]) -> Option<Self> {
        let [kind, cx, cy, cz, ax, ay, az, one, two, three] = *row;
        let (center, axis) = ([cx, cy, cz], [ax, ay, az]);
        if kind == 0.0 {
            Some(Self::Sphere { center, radius: one })
        } else if kind == 1.0 {
            Some(Self::Frustum { center, axis, half: one, base_radius: two, top_radius: three })
        } else if kind == 2.0 {
            Some(Self::Torus { center, axis, major_radius: one, radius: two })
        } else {
            None
        }
    }

    /// The row that it came from.
    #[must_use]
    pub fn row(&self) -> [f64; ROW] {
        let (kind, [cx, cy, cz], [ax, ay, az], [one, two, three]) = match *self {
            Self::Sphere { center, radius } => (0.0, center, [0.0; 3], [radius, 0.0, 0.0]),
            Self::Frustum { center, axis, half, base_radius, top_radius } => {
                (1.0, center, axis, [half, base_radius, top_radius])
            }
            Self::Torus { center, axis, major_radius, radius } => {
                (2.0, center, axis, [major_radius, radius, 0.0])
            }
        };
        [kind, cx, cy, cz, ax, ay, az, one, two, three]
    }

    /// Lower and upper corner of the box around it.
    pub(super) fn bounds(&self) -> [Vector; 2] {
        match *self {
            Self::Sphere { center, radius } => {
                [center.map(|x| x - radius), center.map(|x| x + radius)]
            }
            Self::Frustum { center, axis, half, base_radius, top_radius } => {
                let wide = across(axis);
                let ends = [(-half, base_radius), (half, top_radius)];
                let [base, top] = ends.map(|(along, radius)| {
                    std::array::from_fn::<_, 3, _>(|k| {
                        let (middle, off) = (center[k] + along * axis[k], radius * wide[k]);
                        [middle - off, middle + off]
                    })
                });
                [
                    std::array::from_fn(|k| base[k][0].min(top[k][0])),
                    std::array::from_fn(|k| base[k][1].max(top[k][1])),
                ]
            }
            Self::Torus { center, axis, major_radius, radius } => {
                let wide = across(axis).map(|x| major_radius * x + radius);
                [
                    std::array::from_fn(|k| center[k] - wide[k]),
                    std::array::from_fn(|k| center[k] + wide[k]),
                ]
            }
        }
    }

    /// Distances to it, at zero or beyond, along unit directions by axis; infinite for none.
    ///
    /// Rays without a bit in `mask` need no answer, but get a right or an infinite one.
    #[inline(always)]
    pub(super) fn cast<const N: usize>(
        &self,
        origin: Vector,
        directions: &[[f64; N]; 3],
        mask: u32,
    ) -> [f64; N] {
        match *self {
            Self::Sphere { center, radius } => {
                let from = minus(origin, center);
                each(directions, |direction| sphere(from, direction, radius))
            }
            Self::Frustum { center, axis, half, base_radius, top_radius } => {
                let frustum = Frustum {
                    from: minus(origin, center),
                    axis,
                    half,
                    radius: f64::midpoint(base_radius, top_radius),
                    slope: (top_radius - base_radius) / (2.0 * half),
                };
                each(directions, |direction| frustum.cast(direction))
            }
            Self::Torus { center, axis, major_radius, radius } => {
                let from = minus(origin, center);
                let mut ranges = [f64::INFINITY; N];
                for i in 0..N {
                    if mask >> i & 1 != 0 {
                        let direction = [0, 1, 2].map(|k| directions[k][i]);
                        ranges[i] = torus::cast(from, direction, axis, major_radius, radius);
                    }
                }
                ranges
            }
        }
    }

    /// The same for one ray.
    #[inline(always)]
    pub(super) fn cast_one(&self, origin: Vector, direction: Vector) -> f64 {
        let [range] = self.cast(origin, &direction.map(|x| [x]), 1);
        range
    }
}

/// How far a unit disc across `axis` reaches along each axis.
fn across(axis: Vector) -> Vector {
    let [x, y, z] = axis.map(|x| x * x);
    [y + z, z + x, x + y].map(f64::sqrt)
}

#[inline(always)]
fn each<const N: usize>(directions: &[[f64; N]; 3], range: impl Fn(Vector) -> f64) -> [f64; N] {
    let mut ranges = [0.0; N];
    for i in 0..N {
        ranges[i] = range([directions[0][i], directions[1][i], directions[2][i]]);
    }
    ranges
}

#[inline(always)]
pub(super) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a + scale * b`.
#[inline(always)]
pub(super) fn along(a: Vector, scale: f64, b: Vector) -> Vector {
    [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]]
}

#[inline(always)]
pub(super) fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn greatest(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Where a ray from a distance of `start` before position zero first meets the ends of an interval.
#[inline(always)]
fn first(start: f64, enter: f64, leave: f64) -> f64 {
    let (enter, leave, is_met) = (start + enter, start + leave, enter <= leave);
    let range = if enter >= 0.0 { enter } else { leave };
    if is_met & (range >= 0.0) { range } else { f64::INFINITY }
}

#[inline(always)]
fn sphere(from: Vector, direction: Vector, radius: f64) -> f64 {
    let start = -dot(from, direction);
    let place = along(from, start, direction);
    let distance = dot(place, place).sqrt();
    let square = (radius - distance) * (radius + distance);
    // The root of a negative square is no number, which meets nothing.
    let half = square.sqrt();
    first(start, -half, half)
}

/// A capped cone as a ray sees it that starts at `from`, its centre being the origin.
struct Frustum {
    from: Vector,
    axis: Vector,
    half: f64,
    /// At the centre.
    radius: f64,
    slope: f64,
}

impl Frustum {
    #[inline(always)]
    fn cast(&self, direction: Vector) -> f64 {
        let start = -dot(self.from, direction);
        let place = along(self.from, start, direction);
        let (height, rise) = (dot(place, self.axis), dot(direction, self.axis));
        let (near, far) = self.slab(height, rise);
        let (enter, leave) = self.quadric(place, direction, height, rise);
        first(start, greatest(near, enter), least(far, leave))
    }

    /// Where a ray is between the caps.
    #[inline(always)]
    fn slab(&self, height: f64, rise: f64) -> (f64, f64) {
        let (below, above) = (-self.half - height, self.half - height);
        let (one, other) = (below / rise, above / rise);
        let (near, far) = if rise > 0.0 { (one, other) } else { (other, one) };
        let is_between = (below <= 0.0) & (above >= 0.0);
        let level = if is_between { f64::INFINITY } else { f64::NEG_INFINITY };
        if rise == 0.0 { (-level, level) } else { (near, far) }
    }

    /// Where a ray is within the cone that goes on beyond the caps, on this side of its apex.
    #[inline(always)]
    fn quadric(&self, place: Vector, direction: Vector, height: f64, rise: f64) -> (f64, f64) {
        let arm = along(place, -height, self.axis);
        let step = along(direction, -rise, self.axis);
        let (radius, widening) = (self.radius + self.slope * height, self.slope * rise);
        // Within, a s^2 + 2 b s + c <= 0.
        let arms = dot(arm, arm);
        // A zero with a sign would turn around what it divides.
        let a = dot(step, step) - widening * widening + 0.0;
        let b = dot(arm, step) - radius * widening;
        let c = (arms.sqrt() - radius.abs()) * (arms.sqrt() + radius.abs());
        // b^2 - a c as the difference of two squares (Lagrange), which does not cancel.
        let [x, y, z] = along(step.map(|x| radius * x), -widening, arm);
        let wide = (x * x + y * y + z * z).sqrt();
        let [ax, ay, az] = self.axis;
        let twist = (ax * (arm[1] * step[2] - arm[2] * step[1])
            + ay * (arm[2] * step[0] - arm[0] * step[2])
            + az * (arm[0] * step[1] - arm[1] * step[0]))
            .abs();
        let discriminant = (wide - twist) * (wide + twist);
        let root = greatest(discriminant, 0.0).sqrt();
        let q = -(b + root.copysign(b));
        let (one, other) = (q / a, if q == 0.0 { q / a } else { c / q });
        let (low, high) = (least(one, other), greatest(one, other));
        let (mut enter, mut leave) = (low, high);
        // Steeper than the side, a ray crosses it once on this side of the apex.
        let (is_steep, widens) = (a < 0.0, widening > 0.0);
        enter = if is_steep { if widens { high } else { f64::NEG_INFINITY } } else { enter };
        leave = if is_steep { if widens { f64::INFINITY } else { low } } else { leave };
        let is_outside = (discriminant < 0.0) & !is_steep;
        // Along the side, a ray is within everywhere or nowhere.
        let (is_along, is_within) = ((a == 0.0) & (q == 0.0), c <= 0.0);
        let end = if is_within { f64::INFINITY } else { f64::NEG_INFINITY };
        (enter, leave) = if is_along { (-end, end) } else { (enter, leave) };
        if is_outside & !is_along { (f64::INFINITY, f64::NEG_INFINITY) } else { (enter, leave) }
    }
}
