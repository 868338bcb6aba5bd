//! A ray in the frame of the tree, in float32, with bounds of what rounding can do to it.
//!
//! The direction is scaled to a largest component of 1, so that a position along the ray is at
//! most the distance on that axis. With `u` the rounding of float32 and `reach` the largest
//! component of the origin plus that of the scene, no float32 test below is off by more than the
//! margin it is widened by: what float64 may call a hit always passes.

#![allow(clippy::inline_always)]

use super::tree::Frame;
use crate::Vector;
use std::cmp::Ordering;

/// Half the distance from 1 to the next float32.
pub const ULP: f32 = f32::EPSILON / 2.0;
/// Half sizes of the scene from its centre beyond which an origin is moved to the scene.
pub const FAR: f64 = 4.0;

/// An origin in the frame of the tree.
#[derive(Clone, Copy, Default)]
pub struct Start {
    pub origin: [f32; 3],
    pub reach: f32,
    /// Rays from here start where they enter the scene.
    pub is_far: bool,
}

impl Start {
    /// The same for a reach of 1.
    pub const SLACK: f32 = 16.0 * ULP;

    #[inline(always)]
    pub fn new(origin: Vector, frame: &Frame) -> Self {
        let placed = frame.place(origin);
        let distance = placed[0].abs().max(placed[1].abs()).max(placed[2].abs());
        Self {
            origin: placed.map(|x| x as f32),
            reach: distance as f32 + 1.0,
            is_far: distance > FAR,
        }
    }

    /// How far a plane must be moved so that rounding does not matter.
    #[inline(always)]
    pub fn slack(&self) -> f32 {
        Self::SLACK * self.reach
    }

    /// A position that no triangle lies beyond.
    #[inline(always)]
    pub fn limit(&self) -> f32 {
        2.0 * self.reach
    }
}

/// What the tests of boxes and triangles need of one ray.
#[derive(Clone, Copy, Default)]
pub struct Ray {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    pub inverse: [f32; 3],
    /// Added to a plane times the inverse: where it is crossed, at the earliest and the latest.
    pub near: [f32; 3],
    pub far: [f32; 3],
    /// Rows of a node's planes that the ray meets first, and last.
    pub near_rows: [usize; 3],
    pub far_rows: [usize; 3],
    pub reach: f32,
    /// Nothing beyond this position counts.
    pub limit: f32,
    /// From ranges in units of the direction to positions.
    scale: f64,
    offset: f64,
}

/// What is known of a ray from far away before the tree is asked.
pub enum Approach {
    Enters(Ray),
    Passes,
    /// From so far away that float32 cannot tell.
    Unclear,
}

impl Ray {
    /// A ray from far away begins where it enters the scene.
    #[cold]
    pub fn approach(origin: Vector, direction: Vector, frame: &Frame) -> Approach {
        let largest = direction[0].abs().max(direction[1].abs()).max(direction[2].abs());
        far(frame.place(origin), direction.map(|d| d / largest), largest * frame.scale)
    }

    #[inline(always)]
    fn from_start(start: Start, direction: Vector, scale: f64, offset: f64) -> Self {
        let direction = direction.map(steep);
        let inverse = direction.map(|d| 1.0 / d);
        let place: [f32; 3] = std::array::from_fn(|k| -start.origin[k] * inverse[k]);
        let slack = inverse.map(|inverse| start.slack() * inverse.abs());
        let near = std::array::from_fn(|k| place[k] - slack[k]);
        let far = std::array::from_fn(|k| place[k] + slack[k]);
        let ray = Self::ready(start, direction, inverse, [near, far], start.limit(), scale);
        Self { offset, ..ray }
    }

    /// A ray all of whose numbers are known, from an origin that was not moved.
    #[inline(always)]
    pub fn ready(
        start: Start,
        direction: [f32; 3],
        inverse: [f32; 3],
        [near, far]: [[f32; 3]; 2],
        limit: f32,
        scale: f64,
    ) -> Self {
        Self {
            origin: start.origin,
            direction,
            inverse,
            near,
            far,
            near_rows: std::array::from_fn(|k| if direction[k] < 0.0 { k + 3 } else { k }),
            far_rows: std::array::from_fn(|k| if direction[k] < 0.0 { k } else { k + 3 }),
            reach: start.reach,
            limit,
            scale,
            offset: 0.0,
        }
    }

    /// Lets nothing count that is farther than `range`.
    #[inline(always)]
    pub fn stop_at(&mut self, range: f64) {
        let position = (range * self.scale - self.offset) as f32;
        self.limit = (position + 8.0 * ULP * self.reach).min(self.limit);
    }
}

/// The least component of a direction, so that its inverse is finite.
pub const STEEPEST: f32 = 1e-18;

#[inline(always)]
fn steep(component: f64) -> f32 {
    let component = component as f32;
    if component.abs() < STEEPEST { STEEPEST.copysign(component) } else { component }
}

fn far(origin: Vector, direction: Vector, scale: f64) -> Approach {
    let distance = origin[0].abs().max(origin[1].abs()).max(origin[2].abs());
    if distance.partial_cmp(&2.0_f64.powi(60)).is_none_or(Ordering::is_ge) {
        return Approach::Unclear;
    }
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    let half = 1.001 + distance * 2.0_f64.powi(-46);
    for k in 0..3 {
        if direction[k] == 0.0 {
            if origin[k].abs() > half {
                return Approach::Passes;
            }
            continue;
        }
        let (one, other) = ((-half - origin[k]) / direction[k], (half - origin[k]) / direction[k]);
        enter = enter.max(one.min(other));
        leave = leave.min(one.max(other));
    }
    if enter > leave {
        return Approach::Passes;
    }
    let origin: Vector = std::array::from_fn(|k| origin[k] + enter * direction[k]);
    let moved = origin[0].abs().max(origin[1].abs()).max(origin[2].abs());
    // The origin is known to some roundings of its distance in float64.
    let reach = moved + 1.0 + distance * f64::from(ULP);
    let start = Start { origin: origin.map(|x| x as f32), reach: reach as f32, is_far: true };
    Approach::Enters(Ray::from_start(start, direction, scale, enter))
}
