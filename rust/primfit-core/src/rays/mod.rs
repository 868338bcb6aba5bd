//! Rays against triangles and round solids: the nearest hit, the same bits on every machine.
//!
//! A wide tree in float32 finds the triangles that a ray may hit; its tests are widened by more
//! than their rounding. Each of these is decided in float64, the nearest hit counts, and of
//! equal ones that of the lower triangle. So the order in which triangles come up does not
//! matter, and neither do instruction sets, packets and threads.
//!
//! Round solids are leaves of the same tree by themselves, decided in closed form. Rays through a
//! tree without any are compiled apart (`ROUND`), so that they pay nothing for those.

mod beam;
mod bundle;
mod caster;
mod depth;
mod grow;
mod interleaved;
mod leaf;
mod memory;
mod packet;
mod query;
mod ray;
mod round;
mod scan;
mod split;
mod supply;
#[cfg(test)]
mod tests;
mod tiles;
mod torus;
mod tree;
mod triangle;
mod walk;

pub use caster::{Hits, RayCaster};
pub use depth::{DepthGate, Eye};
pub use round::Round;
pub use scan::{Gate, RangeGate, Readings, Transform, turned};
