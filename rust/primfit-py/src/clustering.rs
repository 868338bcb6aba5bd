//! Clustering.

use crate::arrays::rows;
use crate::door;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

#[pyfunction]
pub fn dbscan<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    eps: f64,
    min_samples: usize,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let points = rows("points", &points)?;
    let labels =
        door::enter(py, None, |workers| primfit_core::dbscan(points, eps, min_samples, workers))?;
    Ok(labels.into_pyarray(py))
}
