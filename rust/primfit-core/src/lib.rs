//! The kernels of primfit: casting rays, scoring and fitting planes, clustering points.
//!
//! Nothing here knows of Python. Every result depends on the input alone: not on the number
//! of threads, nor on the instruction set that the machine offers.

mod caster;
mod curvature;
mod dbscan;
mod error;
mod fit;
mod graph;
mod growth;
mod likelihood;
mod merging;
mod neighbors;
mod normals;
mod regions;
mod roughness;
mod scoring;
mod segmentation;
mod spread;
mod triangle;
mod workers;

pub use caster::{Hit, RayCaster};
pub use dbscan::dbscan;
pub use error::Error;
pub use fit::{PlaneFit, fit_plane, fit_plane_to_ranges};
pub use likelihood::{Beams, Candidate, prism_costs};
pub use neighbors::{Neighbor, PointTree};
pub use normals::LocalPlane;
pub use scoring::{Score, score_planes};
pub use segmentation::segment;
pub use workers::Workers;

/// A point or a direction: x, y, z.
pub type Vector = [f64; 3];
