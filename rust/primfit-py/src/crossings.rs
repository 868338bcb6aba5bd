//! Beams and a plane.

use crate::arrays::{rows, same_length};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

#[pyfunction]
pub fn residuals<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    directions: Option<PyReadonlyArray2<f64>>,
    equation: [f64; 4],
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let points = rows("points", &points)?;
    let directions =
        directions.as_ref().map(|directions| rows("directions", directions)).transpose()?;
    if let Some(directions) = directions {
        same_length("directions", directions.len(), "points", points.len())?;
    }
    let distances = py.detach(|| primfit_core::residuals(points, directions, equation));
    Ok(distances.into_pyarray(py))
}

/// Lengths (n,) tell how far each beam went at the least.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn passages<'py>(
    py: Python<'py>,
    origins: PyReadonlyArray2<f64>,
    directions: PyReadonlyArray2<f64>,
    lengths: PyReadonlyArray1<f64>,
    equation: [f64; 4],
    axes: [[f64; 3]; 2],
    clear: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (origins, directions) = (rows("origins", &origins)?, rows("directions", &directions)?);
    let lengths = lengths.as_slice()?;
    same_length("directions", directions.len(), "origins", origins.len())?;
    same_length("lengths", lengths.len(), "origins", origins.len())?;
    let places = py.detach(|| {
        let lengths = lengths.iter().copied();
        primfit_core::passages(origins, directions, lengths, equation, axes, clear)
    });
    let n = places.len();
    places.into_flattened().into_pyarray(py).reshape([n, 2])
}
