//! The directions of sixteen rays of one origin as a box: which children may any of them enter?

#![allow(clippy::inline_always)]

use super::ray::Start;
use super::tree::{Node, WIDTH};
use crate::lanes::{Isa, Lanes, splat};

/// The directions of all rays on one axis.
#[derive(Clone, Copy)]
pub enum Span {
    /// Of one sign: the rows of the planes met first and last, and the least and the largest
    /// inverse.
    OneWay { near_row: usize, far_row: usize, low: f32, high: f32, slack: f32 },
    /// Least and largest component.
    Both { low: f32, high: f32 },
}

impl Span {
    /// Of components from `low` to `high`.
    #[inline(always)]
    pub fn of(axis: usize, low: f32, high: f32, slack: f32) -> Self {
        if low < 0.0 && high > 0.0 {
            return Self::Both { low, high };
        }
        let (near_row, far_row) = if high < 0.0 { (axis + 3, axis) } else { (axis, axis + 3) };
        // The inverse falls as the component grows.
        let (low, high) = (1.0 / high, 1.0 / low);
        Self::OneWay { near_row, far_row, low, high, slack: slack * low.abs().max(high.abs()) }
    }
}

/// Where the earliest ray could enter each child, and a bit for each that one could enter before
/// the `last` limit of all.
#[inline(always)]
pub fn slabs<I: Isa>(
    node: &Node,
    start: Start,
    beam: &[Span; 3],
    last: f32,
) -> ([f32; WIDTH], u32) {
    let origin = splat::<I::Eight>(start.origin);
    let mut enter = I::Eight::splat(0.0);
    let mut leave = I::Eight::splat(last);
    for k in 0..3 {
        if let Span::OneWay { near_row, far_row, low, high, slack } = beam[k] {
            let near = I::Eight::load(&node.planes[near_row]) - origin[k];
            let far = I::Eight::load(&node.planes[far_row]) - origin[k];
            let (low, high) = (I::Eight::splat(low), I::Eight::splat(high));
            enter = enter.max((near * low).min(near * high) - I::Eight::splat(slack));
            leave = leave.min((far * low).max(far * high) + I::Eight::splat(slack));
        }
    }
    let mut mask = enter.le(leave);
    for k in 0..3 {
        if let Span::Both { low, high } = beam[k] {
            let slack = I::Eight::splat(start.slack());
            let below = I::Eight::load(&node.planes[k]) - origin[k] - slack;
            let above = I::Eight::load(&node.planes[k + 3]) - origin[k] + slack;
            mask &= below.le(leave * I::Eight::splat(high));
            mask &= (leave * I::Eight::splat(low)).le(above);
        }
    }
    (enter.store(), mask)
}
