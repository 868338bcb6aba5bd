//! How well upright prisms explain the ranges of many beams.

mod beams;
mod carving;
mod climbing;
mod costs;
mod ellipse;
mod expansion;
mod family;
mod lines;
mod local;
mod meeting;
mod poses;
mod sampling;
mod student;

pub use beams::{BeamBlocks, Beams, Candidate, Limits, Prices};
pub use carving::{Grid, Spans, carve};
pub use climbing::{Climb, Slope};
pub use costs::prism_costs;
pub use family::Family;
pub use lines::LevelLines;
pub use local::{Local, Region};
pub use poses::{PoseBeams, PoseSums, RIGID, Robust, Surroundings};
pub use sampling::{Effort, Posterior, sample};

use crate::instructions::widest;
use crate::lanes::{Isa, Lanes};
use beams::BLOCK;
use meeting::{Real, Walls};

/// How far along each beam it first meets the upright walls over a footprint, however high they
/// are; infinite for never.
#[must_use]
pub fn wall_depths(beams: &BeamBlocks, footprint: &[[f64; 2]]) -> Vec<f64> {
    let (bottom, top) = (f64::NEG_INFINITY, f64::INFINITY);
    prism_ranges(beams, &Candidate { footprint, is_round: false, bottom, top, is_open: true })
}

/// How far along each beam it first meets a prism; infinite for never.
#[must_use]
pub fn prism_ranges(beams: &BeamBlocks, candidate: &Candidate) -> Vec<f64> {
    let mut ranges = walls_ranges(beams, &beams.walls(candidate));
    ranges.truncate(beams.len());
    ranges
}

widest! {
fn walls_ranges(beams: &BeamBlocks, walls: &Walls<Real>) -> Vec<f64> {
    type Lane = <Set as Isa>::Sixteen;
    let mut ranges = Vec::with_capacity(beams.blocks.len() * BLOCK);
    for block in &beams.blocks {
        let nearest = block.meet(walls, Lane::splat(Real::INFINITY));
        ranges.extend(Lane::store(nearest).map(f64::from));
    }
    ranges
}
}
