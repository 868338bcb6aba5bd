//! Planes, spheres, cylinders, cones and tori: distances, first guesses, fits, detection.

mod beams;
mod bending;
mod cloud;
mod competition;
mod contrast;
mod correlation;
mod detection;
mod growing;
mod hypotheses;
mod initial;
mod refinement;
mod surface;
mod vectors;

pub use correlation::correlation_area;
pub use detection::{Surfaces, detect as detect_surfaces};
pub use initial::Oriented;
pub use refinement::{Effort as SurfaceEffort, Measured, SurfaceFit, fit_surface};
pub use surface::{Kind, Sight, Surface};
