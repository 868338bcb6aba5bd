//! Curved surfaces.

use crate::arrays::{from_rows, rows, same_length};
use crate::door;
use crate::neighbors::PointTree;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use primfit_core::{Kind, Measured, Oriented, Surface, SurfaceEffort};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Place (3), axis (3) and sizes (2).
type Numbers = [f64; 8];
type Fit<'py> = (Numbers, Bound<'py, PyArray2<f64>>, f64, Bound<'py, PyArray1<f64>>, bool);

/// The first surface of a kind through points with normals of either sign; None where there is none.
#[pyfunction]
pub fn first_surface(
    py: Python,
    kind: &str,
    points: PyReadonlyArray2<f64>,
    normals: PyReadonlyArray2<f64>,
) -> PyResult<Option<Numbers>> {
    let (points, normals) = (rows("points", &points)?, rows("normals", &normals)?);
    same_length("normals", normals.len(), "points", points.len())?;
    let kind = kind_of(kind)?;
    Ok(py.detach(|| Oriented { points, normals }.surface(kind)).map(to_numbers))
}

/// The surface, its covariance, the variance of its residuals, these, and whether it came to rest.
#[pyfunction]
#[pyo3(signature = (
    kind, start, points, sigma, beams=None, cutoff=f64::INFINITY, is_isotropic=true, n_steps=60,
    n_jobs=None
))]
#[allow(clippy::too_many_arguments)]
pub fn fit_surface<'py>(
    py: Python<'py>,
    kind: &str,
    start: Numbers,
    points: PyReadonlyArray2<f64>,
    sigma: PyReadonlyArray1<f64>,
    beams: Option<PyReadonlyArray2<f64>>,
    cutoff: f64,
    is_isotropic: bool,
    n_steps: usize,
    n_jobs: Option<usize>,
) -> PyResult<Fit<'py>> {
    let (points, sigma) = (rows("points", &points)?, sigma.as_slice()?);
    same_length("sigma", sigma.len(), "points", points.len())?;
    let beams = beams.as_ref().map(|beams| rows("beams", beams)).transpose()?;
    if let Some(beams) = beams {
        same_length("beams", beams.len(), "points", points.len())?;
    }
    let start = from_numbers(kind_of(kind)?, &start);
    let measured = Measured { points, sigma, beams };
    let how = SurfaceEffort { cutoff, n_steps, still: SurfaceEffort::STILL, is_isotropic };
    let fit = door::enter(py, n_jobs, |workers| {
        primfit_core::fit_surface(&start, &measured, &how, workers)
    })?;
    Ok((
        to_numbers(fit.surface),
        fit.covariance.into_pyarray(py).reshape([8, 8])?,
        fit.variance,
        fit.residuals.into_pyarray(py),
        fit.has_settled,
    ))
}

/// Signed distances of points.
#[pyfunction]
pub fn surface_distances<'py>(
    py: Python<'py>,
    kind: &str,
    surface: Numbers,
    points: PyReadonlyArray2<f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (surface, points) = (from_numbers(kind_of(kind)?, &surface), rows("points", &points)?);
    let distances = py.detach(|| points.iter().map(|p| surface.distance(p)).collect::<Vec<f64>>());
    Ok(distances.into_pyarray(py))
}

/// Unit normals at the feet of points.
#[pyfunction]
pub fn surface_normals<'py>(
    py: Python<'py>,
    kind: &str,
    surface: Numbers,
    points: PyReadonlyArray2<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (surface, points) = (from_numbers(kind_of(kind)?, &surface), rows("points", &points)?);
    from_rows(py, py.detach(|| points.iter().map(|p| surface.sight(p).normal).collect()))
}

/// Number of neighbouring points whose errors, in the order in which they were given, are one.
#[pyfunction]
#[pyo3(signature = (tree, errors, n_jobs=None))]
pub fn correlation_area(
    py: Python,
    tree: &PointTree,
    errors: PyReadonlyArray1<f64>,
    n_jobs: Option<usize>,
) -> PyResult<f64> {
    let errors = errors.as_slice()?;
    same_length("errors", errors.len(), "points", tree.core().points().len())?;
    door::enter(py, n_jobs, |workers| primfit_core::correlation_area(tree.core(), errors, workers))
}

type Detected<'py> =
    (Vec<(&'static str, Numbers)>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<bool>>);

/// Kind and numbers of each surface; of each point in the order of the tree its surface, and whether
/// that meets another there.
#[pyfunction]
#[pyo3(signature = (tree, sigma, parts, least, n_jobs=None))]
pub fn detect_surfaces<'py>(
    py: Python<'py>,
    tree: &PointTree,
    sigma: PyReadonlyArray1<f64>,
    parts: PyReadonlyArray1<i64>,
    least: usize,
    n_jobs: Option<usize>,
) -> PyResult<Detected<'py>> {
    let n = tree.core().points().len();
    let (sigma, parts) = (sigma.as_slice()?, parts.as_slice()?);
    same_length("sigma", sigma.len(), "points", n)?;
    same_length("parts", parts.len(), "points", n)?;
    if parts.iter().any(|&part| part < -1 || part >= n as i64) {
        return Err(PyValueError::new_err("parts must be from -1 to the number of points"));
    }
    let parts: Vec<i32> = parts.iter().map(|&part| part as i32).collect();
    let found = door::enter(py, n_jobs, |workers| {
        primfit_core::detect_surfaces(tree.core(), sigma, &parts, least, workers)
    })?;
    let labels: Vec<i64> = found.labels.into_iter().map(i64::from).collect();
    let named = |surface: Surface| (NAMES[surface.kind as usize], to_numbers(surface));
    let surfaces = found.surfaces.into_iter().map(named).collect();
    Ok((surfaces, labels.into_pyarray(py), found.is_shared.into_pyarray(py)))
}

/// Names of the kinds, in their order.
const NAMES: [&str; 5] = ["plane", "sphere", "cylinder", "cone", "torus"];

fn kind_of(name: &str) -> PyResult<Kind> {
    let number = NAMES.iter().position(|&known| known == name);
    number.map(|number| Kind::ALL[number]).ok_or_else(|| {
        PyValueError::new_err(format!("kind must be one of {}, not {name}", NAMES.join(", ")))
    })
}

fn to_numbers(surface: Surface) -> Numbers {
    let [x, y, z] = surface.place;
    let [a, b, c] = surface.axis;
    let [first, second] = surface.sizes;
    [x, y, z, a, b, c, first, second]
}

fn from_numbers(kind: Kind, numbers: &Numbers) -> Surface {
    let [x, y, z, a, b, c, first, second] = *numbers;
    Surface { kind, place: [x, y, z], axis: [a, b, c], sizes: [first, second] }
}
