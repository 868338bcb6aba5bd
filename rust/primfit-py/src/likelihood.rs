//! The likelihood of prisms.

use crate::arrays::{rows, same_length};
use crate::door;
use numpy::{
    IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use primfit_core::{Beams, Candidate};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

#[pyfunction]
#[pyo3(signature = (
    origins, directions, ranges, background, sigmas, max_range, cap, footprints, bottoms, tops,
    n_jobs=None,
))]
// One array a row of the model.
#[allow(clippy::too_many_arguments)]
pub fn prism_costs<'py>(
    py: Python<'py>,
    origins: PyReadonlyArray2<f64>,
    directions: PyReadonlyArray2<f64>,
    ranges: PyReadonlyArray1<f64>,
    background: PyReadonlyArray1<f64>,
    sigmas: PyReadonlyArray1<f64>,
    max_range: f64,
    cap: f64,
    footprints: PyReadonlyArray3<f64>,
    bottoms: PyReadonlyArray1<f64>,
    tops: PyReadonlyArray1<f64>,
    n_jobs: Option<usize>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let beams = Beams {
        origins: rows("origins", &origins)?,
        directions: rows("directions", &directions)?,
        ranges: ranges.as_slice()?,
        background: background.as_slice()?,
        sigmas: sigmas.as_slice()?,
        max_range,
        cap,
    };
    let n_beams = beams.origins.len();
    same_length("directions", beams.directions.len(), "origins", n_beams)?;
    same_length("ranges", beams.ranges.len(), "origins", n_beams)?;
    same_length("background", beams.background.len(), "origins", n_beams)?;
    same_length("sigmas", beams.sigmas.len(), "origins", n_beams)?;
    let &[n, n_corners, 2] = footprints.shape() else {
        return Err(PyValueError::new_err("footprints must have shape (k, m, 2)"));
    };
    let (bottoms, tops) = (bottoms.as_slice()?, tops.as_slice()?);
    same_length("bottoms", bottoms.len(), "footprints", n)?;
    same_length("tops", tops.len(), "footprints", n)?;
    let corners: &[[f64; 2]] = footprints.as_slice()?.as_chunks().0;
    let candidates: Vec<Candidate> = (0..n)
        .map(|k| Candidate {
            footprint: &corners[k * n_corners..(k + 1) * n_corners],
            bottom: bottoms[k],
            top: tops[k],
        })
        .collect();
    let costs =
        door::enter(py, n_jobs, |workers| primfit_core::prism_costs(beams, &candidates, workers))?;
    Ok(costs.into_pyarray(py))
}
