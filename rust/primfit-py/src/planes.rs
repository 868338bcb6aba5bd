//! Plane scoring and fitting.

use crate::arrays::{rows, same_length};
use crate::door;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use primfit_core::{PartPlane, PlaneFit, Score, Vector, Wanted};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Fit<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, f64);

type Labelled<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);

#[pyfunction]
#[pyo3(signature = (points, equations, threshold, directions=None, msac=false, n_jobs=None))]
pub fn score_planes<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    equations: PyReadonlyArray2<f64>,
    threshold: f64,
    directions: Option<PyReadonlyArray2<f64>>,
    msac: bool,
    n_jobs: Option<usize>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (points, equations) = (rows("points", &points)?, rows("equations", &equations)?);
    let directions =
        directions.as_ref().map(|directions| rows("directions", directions)).transpose()?;
    if let Some(directions) = directions {
        same_length("directions", directions.len(), "points", points.len())?;
    }
    let score = if msac { Score::Msac } else { Score::Count };
    let scores = door::enter(py, n_jobs, |workers| {
        primfit_core::score_planes(points, directions, equations, threshold, score, workers)
    })?;
    Ok(scores.into_pyarray(py))
}

#[pyfunction]
pub fn fit_plane<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    weights: PyReadonlyArray1<f64>,
    normal_space: PyReadonlyArray2<f64>,
) -> PyResult<Option<Fit<'py>>> {
    let (points, weights) = (rows("points", &points)?, weights.as_slice()?);
    same_length("weights", weights.len(), "points", points.len())?;
    let normal_space = space(&normal_space)?;
    let fit = py.detach(|| primfit_core::fit_plane(points, weights, normal_space));
    fit.map(|fit| to_arrays(py, fit)).transpose()
}

#[pyfunction]
pub fn fit_plane_to_ranges<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    directions: PyReadonlyArray2<f64>,
    sigmas: PyReadonlyArray1<f64>,
    equation: [f64; 4],
    normal_space: PyReadonlyArray2<f64>,
) -> PyResult<Option<Fit<'py>>> {
    let (points, directions) = (rows("points", &points)?, rows("directions", &directions)?);
    let sigmas = sigmas.as_slice()?;
    same_length("directions", directions.len(), "points", points.len())?;
    same_length("sigmas", sigmas.len(), "points", points.len())?;
    let normal_space = space(&normal_space)?;
    let fit = py.detach(|| {
        primfit_core::fit_plane_to_ranges(points, directions, sigmas, equation, normal_space)
    });
    fit.map(|fit| to_arrays(py, fit)).transpose()
}

/// The plane of each pixel of an image whose rows are `width` long, -1 for none; the noise around each.
#[pyfunction]
#[pyo3(signature = (points, width, sigma=None, n_jobs=None))]
pub fn segment_image<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    width: usize,
    sigma: Option<PyReadonlyArray1<f64>>,
    n_jobs: Option<usize>,
) -> PyResult<Labelled<'py>> {
    let points = rows("points", &points)?;
    if width == 0 || !points.len().is_multiple_of(width) || points.len() >= u32::MAX as usize {
        let n = points.len();
        return Err(PyValueError::new_err(format!("{n} points are no rows of {width} pixels")));
    }
    let sigma = sigma.as_ref().map(|sigma| sigma.as_slice()).transpose()?;
    if let Some(sigma) = sigma {
        same_length("sigma", sigma.len(), "points", points.len())?;
    }
    let found = door::enter(py, n_jobs, |workers| {
        primfit_core::segment_image(points, width, sigma, workers)
    })?;
    let labels: Vec<i64> = found.labels.into_iter().map(i64::from).collect();
    Ok((labels.into_pyarray(py), found.sigma.into_pyarray(py)))
}

type Part<'py> = (Fit<'py>, f64, Bound<'py, PyArray1<i64>>);

/// The wanted plane of each label, -1 being none: its fit, the reach and rows of its inliers.
#[pyfunction]
#[pyo3(signature = (
    points, directions, labels, sigma, normal_space, axis, cosines, limit=None, n_jobs=None
))]
#[allow(clippy::too_many_arguments)]
pub fn fit_parts<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f64>,
    directions: Option<PyReadonlyArray2<f64>>,
    labels: PyReadonlyArray1<i64>,
    sigma: PyReadonlyArray1<f64>,
    normal_space: PyReadonlyArray2<f64>,
    axis: [f64; 3],
    cosines: [f64; 2],
    limit: Option<f64>,
    n_jobs: Option<usize>,
) -> PyResult<Vec<Option<Part<'py>>>> {
    let (points, labels, sigma) = (rows("points", &points)?, labels.as_slice()?, sigma.as_slice()?);
    same_length("labels", labels.len(), "points", points.len())?;
    same_length("sigma", sigma.len(), "points", points.len())?;
    let directions =
        directions.as_ref().map(|directions| rows("directions", directions)).transpose()?;
    if let Some(directions) = directions {
        same_length("directions", directions.len(), "points", points.len())?;
    }
    let wanted = Wanted { normal_space: space(&normal_space)?, axis, cosines };
    let fitted = door::enter(py, n_jobs, |workers| {
        primfit_core::fit_parts(points, directions, labels, sigma, &wanted, limit, workers)
    })?;
    let to_python = |part: PartPlane| {
        let inliers: Vec<i64> = part.inliers.into_iter().map(i64::from).collect();
        Ok((to_arrays(py, part.fit)?, part.reach, inliers.into_pyarray(py)))
    };
    fitted.into_iter().map(|part| part.map(to_python).transpose()).collect()
}

fn space<'a>(normal_space: &'a PyReadonlyArray2<f64>) -> PyResult<&'a [Vector]> {
    let space = rows("normal_space", normal_space)?;
    if (1..=3).contains(&space.len()) {
        return Ok(space);
    }
    Err(PyValueError::new_err(format!("normal_space must have 1 to 3 rows, not {}", space.len())))
}

fn to_arrays(py: Python<'_>, fit: PlaneFit) -> PyResult<Fit<'_>> {
    let covariance = PyArray1::from_slice(py, &fit.covariance).reshape([4, 4])?;
    Ok((PyArray1::from_slice(py, &fit.equation), covariance, fit.rms))
}
