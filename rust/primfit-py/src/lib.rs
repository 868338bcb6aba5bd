//! The Python door of primfit-core: arrays in, GIL released, arrays out.
//!
//! The Python package checks what users pass and says what is wrong with it; here only the
//! shapes that memory safety rests on are looked at again.

// PyO3 hands over the arguments of a function as owned values.
#![allow(clippy::needless_pass_by_value)]

mod arrays;
mod caster;
mod clustering;
mod crossings;
mod door;
mod family;
mod likelihood;
mod lines;
mod neighbors;
mod outlines;
mod planes;
mod poses;
mod surfaces;
mod tables;

use pyo3::prelude::*;

#[pymodule]
mod _primfit {
    #[pymodule_export]
    use crate::caster::{RayCaster, turned};
    #[pymodule_export]
    use crate::clustering::dbscan;
    #[pymodule_export]
    use crate::crossings::{passages, residuals};
    #[pymodule_export]
    use crate::family::Family;
    #[pymodule_export]
    use crate::likelihood::{BeamBlocks, Local, carve, sample};
    #[pymodule_export]
    use crate::lines::LevelLines;
    #[pymodule_export]
    use crate::neighbors::{PointTree, segmentation_settings};
    #[pymodule_export]
    use crate::outlines::{laid_out, outlines, thinned};
    #[pymodule_export]
    use crate::planes::{fit_parts, fit_plane, fit_plane_to_ranges, score_planes, segment_image};
    #[pymodule_export]
    use crate::poses::PoseBeams;
    #[pymodule_export]
    use crate::surfaces::{
        correlation_area, detect_surfaces, first_surface, fit_surface, surface_distances,
        surface_normals,
    };
    #[pymodule_export]
    use crate::tables::{format_rows, parse_rows, ply_bytes, ply_words};
}
