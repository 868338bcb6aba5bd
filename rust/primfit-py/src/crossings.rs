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

/// A beam without return went as far as `farthest`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn passages<'py>(
    py: Python<'py>,
    origins: PyReadonlyArray2<f64>,
    directions: PyReadonlyArray2<f64>,
    ranges: PyReadonlyArray1<f64>,
    farthest: f64,
    equation: [f64; 4],
    axes: [[f64; 3]; 2],
    clear: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (origins, directions) = (rows("origins", &origins)?, rows("directions", &directions)?);
    let ranges = ranges.as_slice()?;
    same_length("directions", directions.len(), "origins", origins.len())?;
    same_length("ranges", ranges.len(), "origins", origins.len())?;
    let lengths = ranges.iter().map(|&range| if range.is_finite() { range } else { farthest });
    let places =
        py.detach(|| primfit_core::passages(origins, directions, lengths, equation, axes, clear));
    let n = places.len();
    places.into_flattened().into_pyarray(py).reshape([n, 2])
}
