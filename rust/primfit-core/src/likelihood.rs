//! How well upright prisms explain the ranges of many beams.

mod beams;
mod carving;
mod climbing;
mod costs;
mod expansion;
mod family;
mod lines;
mod local;
mod meeting;
mod sampling;
mod student;

pub use beams::{BeamBlocks, Beams, Candidate, Prices};
pub use carving::{Grid, carve};
pub use climbing::{Climb, Slope};
pub use costs::prism_costs;
pub use family::Family;
pub use lines::LevelLines;
pub use local::{Local, Region};
pub use sampling::{Effort, Posterior, sample};

use crate::instructions::widest;
use crate::lanes::{Isa, Lanes};
use beams::BLOCK;
use meeting::{Real, Walls};

/// How far along each beam it first meets the upright walls over a footprint, however high they
/// are; infinite for never.
#[must_use]
pub fn wall_depths(beams: &BeamBlocks, footprint: &[[f64; 2]]) -> Vec<f64> {
    let endless = Candidate { footprint, bottom: f64::NEG_INFINITY, top: f64::INFINITY };
    let walls = beams.walls(&endless);
    let mut depths = walls_depths(beams, &walls);
    depths.truncate(beams.len());
    depths
}

widest! {
fn walls_depths(beams: &BeamBlocks, walls: &Walls<Real>) -> Vec<f64> {
    type Lane = <Set as Isa>::Sixteen;
    let mut depths = Vec::with_capacity(beams.blocks.len() * BLOCK);
    for block in &beams.blocks {
        let nearest = block.meet(walls, Lane::splat(Real::INFINITY));
        depths.extend(Lane::store(nearest).map(f64::from));
    }
    depths
}
}
