//! Rays against triangles: the nearest hit, the same bits on every machine.
//!
//! A wide tree in float32 finds the triangles that a ray may hit; its tests are widened by more
//! than their rounding. Each of these is decided in float64, the nearest hit counts, and of
//! equal ones that of the lower triangle. So the order in which triangles come up does not
//! matter, and neither do instruction sets, packets and threads.

mod beam;
mod bundle;
mod caster;
mod depth;
mod interleaved;
mod leaf;
mod memory;
mod packet;
mod query;
mod ray;
mod scan;
mod split;
mod supply;
#[cfg(test)]
mod tests;
mod tiles;
mod tree;
mod triangle;
mod walk;

pub use caster::{Hits, RayCaster};
pub use depth::{DepthGate, Eye};
pub use scan::{Gate, RangeGate, Readings, Transform, turned};
