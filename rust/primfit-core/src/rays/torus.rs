//! A ray against a torus: the first root of a quartic.
//!
//! Between the roots of its derivative the quartic has one root at most, and between those of its
//! second derivative the derivative has. So roots are bracketed, from the quadratic upwards, and
//! no root is lost. The last steps go by the distance to the circle of the tube, which is less
//! rounded than the quartic.

#![allow(clippy::inline_always)]

use super::round::{along, dot};
use crate::Vector;

/// Share of the size by which the stretch of the ray that is looked at goes beyond the torus.
const MARGIN: f64 = 1e-6;
/// Steps of a root: each halves its bracket or does better.
const STEPS: usize = 120;
/// A step of this share of the size is the last: a rounding or two.
const LAST: f64 = 4e-16;
/// The same for what is only a start: a quartic is flat at its crest by the square of this.
const NEAR: f64 = 1e-8;
/// Steps that bring a start to the last digit, where the ray does not graze the surface.
const POLISHED: usize = 4;

/// Distance to a torus about the origin, at zero or beyond; infinite for none.
pub fn cast(from: Vector, direction: Vector, axis: Vector, major_radius: f64, radius: f64) -> f64 {
    let size = major_radius + radius;
    let start = -dot(from, direction);
    let place = along(from, start, direction).map(|x| x / size);
    let square = dot(place, place);
    if square.partial_cmp(&(1.0 + MARGIN)).is_none_or(std::cmp::Ordering::is_gt) {
        return f64::INFINITY;
    }
    let (height, rise) = (dot(place, axis), dot(direction, axis));
    let tube = Tube {
        arm: along(place, -height, axis),
        step: along(direction, -rise, axis),
        height,
        rise,
        major_radius: major_radius / size,
        radius: radius / size,
    };
    // The stretch within the sphere around the torus and between its top and bottom.
    let half = (1.0 - square).max(0.0).sqrt() + MARGIN;
    let mut low = (-half).max(-start / size);
    let mut high = half;
    let (below, above) = (-tube.radius - MARGIN - height, tube.radius + MARGIN - height);
    if rise != 0.0 {
        low = low.max((below / rise).min(above / rise));
        high = high.min((below / rise).max(above / rise));
    } else if below > 0.0 || above < 0.0 {
        return f64::INFINITY;
    }
    if low > high {
        return f64::INFINITY;
    }
    let quartic = tube.quartic(place, direction);
    tube.first(&quartic, low, high).map_or(f64::INFINITY, |s| (start + s * size).max(0.0))
}

/// A torus of size 1 and a ray: both by what is across its axis and along it.
struct Tube {
    arm: Vector,
    step: Vector,
    height: f64,
    rise: f64,
    major_radius: f64,
    radius: f64,
}

impl Tube {
    /// How far outside the tube the ray is at `s`, in squares, and how fast that grows.
    fn outside(&self, s: f64) -> (f64, f64) {
        let arm = along(self.arm, s, self.step);
        let distance = dot(arm, arm).sqrt();
        let (off, height) = (distance - self.major_radius, self.height + s * self.rise);
        let outward = if distance > 0.0 { dot(arm, self.step) / distance } else { 0.0 };
        let square = off * off + height * height;
        let value = (square.sqrt() - self.radius) * (square.sqrt() + self.radius);
        (value, 2.0 * (off * outward + height * self.rise))
    }

    /// The coefficients of ((|p|^2 + R^2 - r^2)^2 - 4 R^2 |arm|^2), from the constant upwards.
    fn quartic(&self, place: Vector, direction: Vector) -> [f64; 5] {
        let (pp, pd, dd) = (dot(place, place), dot(place, direction), dot(direction, direction));
        let (aa, ab, bb) =
            (dot(self.arm, self.arm), dot(self.arm, self.step), dot(self.step, self.step));
        let major = 4.0 * self.major_radius * self.major_radius;
        let constant = pp + (self.major_radius - self.radius) * (self.major_radius + self.radius);
        [
            constant * constant - major * aa,
            4.0 * pd * constant - 2.0 * major * ab,
            2.0 * dd * constant + 4.0 * pd * pd - major * bb,
            4.0 * pd * dd,
            dd * dd,
        ]
    }

    /// The first place from `low` to `high` on the surface.
    fn first(&self, quartic: &[f64; 5], low: f64, high: f64) -> Option<f64> {
        let slope: [f64; 4] = derivative(quartic);
        let bend: [f64; 3] = derivative(&slope);
        let is_outside = |s| value(quartic, s) > 0.0;
        let (mut before, was_outside) = (low, self.outside(low).0 > 0.0);
        let (mut last, mut rose) = (low, value(&slope, low) > 0.0);
        for turn in turns_of(&bend).into_iter().chain([high]) {
            let turn = turn.clamp(last, high);
            let rises = value(&slope, turn) > 0.0;
            // Only at the end of a fall can what was outside be inside, and after a rise outside.
            if rises != rose {
                let with_bend = |s| (value(&slope, s), value(&bend, s));
                let crest = root(with_bend, last, turn, rises, NEAR);
                if is_outside(crest) != was_outside {
                    return Some(self.between(quartic, &slope, before, crest, !was_outside));
                }
                before = crest;
            }
            (last, rose) = (turn, rises);
        }
        (is_outside(high) != was_outside)
            .then(|| self.between(quartic, &slope, before, high, !was_outside))
    }

    /// The place on the surface between `low` and `high`, one of which is outside.
    fn between(
        &self,
        quartic: &[f64; 5],
        slope: &[f64; 4],
        low: f64,
        high: f64,
        rises: bool,
    ) -> f64 {
        let near = root(|s| (value(quartic, s), value(slope, s)), low, high, rises, NEAR);
        let mut s = near;
        for _ in 0..POLISHED {
            let (value, slope) = self.outside(s);
            let step = value / slope;
            s -= step;
            if step.abs() <= LAST {
                return s.clamp(low, high);
            }
        }
        // A ray that grazes the surface.
        root(|s| self.outside(s), low, high, rises, LAST)
    }
}

fn derivative<const N: usize, const M: usize>(polynomial: &[f64; N]) -> [f64; M] {
    std::array::from_fn(|k| (k + 1) as f64 * polynomial[k + 1])
}

fn value<const N: usize>(polynomial: &[f64; N], s: f64) -> f64 {
    polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * s + coefficient)
}

/// The roots of a quadratic in order; where there is none, its lowest place twice.
fn turns_of([c, b, a]: &[f64; 3]) -> [f64; 2] {
    let middle = -b / (2.0 * a);
    let off = (middle * middle - c / a).max(0.0).sqrt();
    [middle - off, middle + off]
}

/// Where a function (value, derivative) changes its sign between `low` and `high`, to a step of
/// `precision`.
#[inline(always)]
fn root(
    function: impl Fn(f64) -> (f64, f64),
    mut low: f64,
    mut high: f64,
    rises: bool,
    precision: f64,
) -> f64 {
    let mut s = f64::midpoint(low, high);
    for step in 0..STEPS {
        let (value, slope) = function(s);
        if (value > 0.0) == rises {
            high = s;
        } else {
            low = s;
        }
        let newton = s - value / slope;
        // Now and then a half, in case Newton's steps lead along a flat stretch.
        let is_newton = newton > low && newton < high && step % 8 != 7;
        let next = if is_newton { newton } else { f64::midpoint(low, high) };
        if (next - s).abs() <= precision {
            return next;
        }
        s = next;
    }
    s
}
