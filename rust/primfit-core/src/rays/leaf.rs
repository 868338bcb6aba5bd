//! One ray, or sixteen of one origin, against the triangles of a block in float32: which may be
//! hit.
//!
//! Moeller and Trumbore: Fast, Minimum Storage Ray/Triangle Intersection, 1997, each comparison
//! widened by more than its rounding. The bounds come from the lengths of the edges and not from
//! the corners, so they stay small for small triangles in large scenes.

#![allow(clippy::inline_always)]

use super::ray::{Ray, Start, ULP};
use super::tree::{Block, WIDTH};
use crate::lanes::{Isa, Lanes, cross, dot, lane, load, splat, store, subtract};

/// How far rounding moves the edge functions, in terms of extent times reach.
const EDGE: f32 = 64.0 * ULP;
/// The same for a determinant near zero, whose sign is not known: in terms of extent squared.
const FLAT: f32 = 128.0 * ULP;
/// And for the position: in terms of extent squared times reach.
const DEPTH: f32 = 192.0 * ULP;

/// A bit for each triangle that the ray may hit before its limit.
#[inline(always)]
pub fn candidates<I: Isa>(block: &Block, ray: &Ray) -> u32 {
    let direction = splat::<I::Eight>(ray.direction);
    let (edge1, edge2) = (load(&block.edges[0]), load(&block.edges[1]));
    let p = cross(direction, edge2);
    let determinant = dot(p, edge1);
    let to_origin = subtract(splat(ray.origin), load(&block.vertex));
    let q = cross(to_origin, edge1);
    let u = dot(p, to_origin).flip(determinant);
    let v = dot(q, direction).flip(determinant);
    let depth = dot(q, edge2).flip(determinant);
    let limit = I::Eight::splat(ray.limit);
    within(determinant.abs(), u, v, depth, limit, margins::<I>(block, ray.reach))
}

/// How far rounding moves the edge functions and the depth of each triangle.
#[inline(always)]
fn margins<I: Isa>(block: &Block, reach: f32) -> [I::Eight; 2] {
    let extent = I::Eight::load(&block.extent);
    let edge = extent.mul_add(I::Eight::splat(FLAT), I::Eight::splat(EDGE * reach));
    [extent * edge, extent * extent * I::Eight::splat(DEPTH * reach)]
}

/// What all rays of one origin need of the triangles of a block.
pub struct Triangles {
    normal: [[f32; WIDTH]; 3],
    u: [[f32; WIDTH]; 3],
    v: [[f32; WIDTH]; 3],
    depth: [f32; WIDTH],
    margin: [f32; WIDTH],
    depth_margin: [f32; WIDTH],
}

impl Triangles {
    #[inline(always)]
    pub fn from<I: Isa>(block: &Block, start: Start) -> Self {
        let (edge1, edge2) = (load::<I::Eight>(&block.edges[0]), load(&block.edges[1]));
        let to_origin = subtract(splat(start.origin), load(&block.vertex));
        let v = cross(to_origin, edge1);
        let [margin, depth_margin] = margins::<I>(block, start.reach);
        Self {
            normal: store(cross(edge2, edge1)),
            u: store(cross(edge2, to_origin)),
            v: store(v),
            depth: dot(v, edge2).store(),
            margin: margin.store(),
            depth_margin: depth_margin.store(),
        }
    }

    /// A bit for each ray that may hit triangle `i` before its limit.
    #[inline(always)]
    pub fn candidates<I: Isa>(
        &self,
        i: usize,
        directions: [I::Sixteen; 3],
        limits: I::Sixteen,
    ) -> u32 {
        let determinant = dot(splat(lane(&self.normal, i)), directions);
        within(
            determinant.abs(),
            dot(splat(lane(&self.u, i)), directions).flip(determinant),
            dot(splat(lane(&self.v, i)), directions).flip(determinant),
            I::Sixteen::splat(self.depth[i]).flip(determinant),
            limits,
            [I::Sixteen::splat(self.margin[i]), I::Sixteen::splat(self.depth_margin[i])],
        )
    }
}

/// A bit for each lane whose edge functions and depth are in bounds or may be, by the margins.
#[inline(always)]
fn within<L: Lanes>(
    size: L,
    u: L,
    v: L,
    depth: L,
    limit: L,
    [margin, depth_margin]: [L; 2],
) -> u32 {
    // The least distance from a bound decides.
    let third = size - (u + v) + margin + margin + margin;
    let inside = (u + margin).min(v + margin).min(third);
    let before = size.mul_add(limit, depth_margin) - depth;
    L::splat(0.0).le(inside.min(before.min(depth + depth_margin)))
}
