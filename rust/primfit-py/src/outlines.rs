//! Outlines of points in a plane.

use crate::arrays::{from_rows, rows};
use crate::door;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use primfit_core::Place;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Drawn<'py> = (Vec<Bound<'py, PyArray2<f64>>>, f64);

/// Places along the axes, and what they are counted from.
type LaidOut<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

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

/// Some of the points (n, 3) along two axes of a plane near them, and the place (3,) that they are
/// counted from.
#[pyfunction]
pub fn laid_out<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    numbers: PyReadonlyArray1<i64>,
    equation: [f64; 4],
    axes: [[f64; 3]; 2],
) -> PyResult<LaidOut<'py>> {
    let (points, numbers) = (rows("points", &points)?, numbers.as_slice()?);
    let is_row = |&i: &i64| usize::try_from(i).is_ok_and(|i| i < points.len());
    if !numbers.iter().all(is_row) {
        return Err(PyValueError::new_err(format!(
            "numbers must be rows of {} points",
            points.len()
        )));
    }
    let (places, place) = py.detach(|| {
        let own = numbers.iter().map(|&i| &points[i as usize]);
        primfit_core::laid_out(own, equation, &axes)
    });
    Ok((from_rows(py, places)?, PyArray1::from_slice(py, &place)))
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
