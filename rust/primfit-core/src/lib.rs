//! The kernels of primfit: casting rays, scoring and fitting planes, clustering points.
//!
//! Nothing here knows of Python. Every result depends on the input alone: not on the number
//! of threads, nor on the instruction set that the machine offers, as long as the logarithm, the sine
//! and the like of the system do not either.

mod agglomeration;
mod bounds;
mod crossings;
mod dbscan;
mod error;
mod fit;
mod instructions;
mod lanes;
mod likelihood;
mod neighbors;
mod organised;
mod outlines;
mod parts;
pub mod ply;
mod rays;
mod scoring;
mod segmentation;
mod spread;
mod surfaces;
pub mod text;
mod workers;

pub use crossings::{passages, residuals};
pub use dbscan::dbscan;
pub use error::Error;
pub use fit::{PlaneFit, fit_plane, fit_plane_to_ranges};
pub use likelihood::{
    BeamBlocks, Beams, Candidate, Climb, Effort, Family, Grid, LevelLines, Limits, Local,
    PoseBeams, PoseSums, Posterior, Prices, RIGID, Region, Robust, Slope, Spans, Surroundings,
    carve, prism_costs, prism_ranges, sample, wall_depths,
};
pub use neighbors::{LocalPlane, Neighbor, PointTree};
pub use organised::{ImageSegmentation, segment_image};
pub use outlines::{Outline, Place, laid_out, outlines, thinned};
pub use parts::{PartPlane, Wanted, fit_parts};
pub use rays::{
    DepthGate, Eye, Gate, Hits, RangeGate, RayCaster, Readings, Round, Transform, turned,
};
pub use scoring::{Score, score_planes};
pub use segmentation::{Segmentation, SegmentationSettings, segment};
pub use surfaces::{
    Kind, Measured, Oriented, Sight, Surface, SurfaceEffort, SurfaceFit, Surfaces,
    correlation_area, detect_surfaces, fit_surface,
};
pub use workers::Workers;

/// A point or a direction: x, y, z.
pub type Vector = [f64; 3];
