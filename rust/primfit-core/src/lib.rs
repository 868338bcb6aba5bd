//! The kernels of primfit: casting rays, scoring and fitting planes, clustering points.
//!
//! Nothing here knows of Python. Every result depends on the input alone: not on the number
//! of threads, nor on the instruction set that the machine offers.

mod acceptance;
mod beams;
mod bounds;
mod carving;
mod continuation;
mod crossings;
mod curvature;
mod dbscan;
mod error;
mod expansion;
mod fit;
mod gaps;
mod graph;
mod growth;
mod instructions;
mod lanes;
mod likelihood;
mod merging;
mod neighbors;
mod noise;
mod normals;
mod rays;
mod regions;
mod roughness;
mod scoring;
mod segmentation;
mod splitting;
mod spread;
mod vicinity;
mod workers;

pub use beams::{BeamBlocks, Beams, Prices};
pub use carving::{Grid, carve};
pub use crossings::{passages, residuals};
pub use dbscan::dbscan;
pub use error::Error;
pub use expansion::{Expansion, expand};
pub use fit::{PlaneFit, fit_plane, fit_plane_to_ranges};
pub use likelihood::{Candidate, prism_costs, wall_depths};
pub use neighbors::{Neighbor, PointTree};
pub use normals::LocalPlane;
pub use rays::{Gate, Hits, RayCaster, Readings, Transform, turned};
pub use scoring::{Score, score_planes};
pub use segmentation::{Segmentation, segment};
pub use workers::Workers;

/// A point or a direction: x, y, z.
pub type Vector = [f64; 3];
