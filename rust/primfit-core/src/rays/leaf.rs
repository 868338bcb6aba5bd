//! One ray against the eight triangles of a block, in float32: which may be hit.
//!
//! Moeller and Trumbore: Fast, Minimum Storage Ray/Triangle Intersection, 1997, each comparison
//! widened by more than its rounding. The bounds come from the lengths of the edges and not from
//! the corners, so they stay small for small triangles in large scenes.

#![allow(clippy::inline_always)]

use super::lanes::{Isa, Lanes, cross, dot, load, splat, subtract};
use super::ray::{Ray, ULP};
use super::tree::Block;

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
    let size = determinant.abs();
    let [margin, depth_margin] = margins::<I>(block, ray.reach);
    let zero = I::Eight::splat(0.0);
    // The least distance from a bound decides.
    let inside = (u + margin).min(v + margin).min(size - (u + v) + I::Eight::splat(3.0) * margin);
    let before = size.mul_add(I::Eight::splat(ray.limit), depth_margin) - depth;
    zero.le(inside.min(before.min(depth + depth_margin)))
}

/// How far rounding moves the edge functions and the depth of each triangle.
#[inline(always)]
pub fn margins<I: Isa>(block: &Block, reach: f32) -> [I::Eight; 2] {
    let extent = I::Eight::load(&block.extent);
    let edge = extent.mul_add(I::Eight::splat(FLAT), I::Eight::splat(EDGE * reach));
    [extent * edge, extent * extent * I::Eight::splat(DEPTH * reach)]
}
