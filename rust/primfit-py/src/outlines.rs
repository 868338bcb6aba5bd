//! Outlines of points in a plane.

use crate::arrays::{from_rows, rows};
use crate::door;
use numpy::{PyArray2, PyReadonlyArray2};
use primfit_core::Place;
use pyo3::prelude::*;

type Drawn<'py> = (Vec<Bound<'py, PyArray2<f64>>>, f64);

/// For each plane's points (n, 2) the rings of its outline and its radius alpha.
#[pyfunction]
#[pyo3(signature = (planes, n_jobs=None))]
pub fn outlines<'py>(
    py: Python<'py>,
    planes: Vec<PyReadonlyArray2<f64>>,
    n_jobs: Option<usize>,
) -> PyResult<Vec<Drawn<'py>>> {
    let planes: Vec<&[Place]> =
        planes.iter().map(|points| rows("points", points)).collect::<PyResult<_>>()?;
    let drawn = door::enter(py, n_jobs, |workers| primfit_core::outlines(&planes, workers))?;
    let to_arrays = |outline: primfit_core::Outline| {
        let rings = outline.rings.into_iter().map(|ring| from_rows(py, ring));
        Ok((rings.collect::<PyResult<_>>()?, outline.alpha))
    };
    drawn.into_iter().map(to_arrays).collect()
}

/// The points (n, 2), or, of many, as many of them as their outline needs.
#[pyfunction]
pub fn thinned<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = rows("points", &points)?;
    from_rows(py, py.detach(|| primfit_core::thinned(points)))
}
