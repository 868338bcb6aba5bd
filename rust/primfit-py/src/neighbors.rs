//! Neighbours and planes of bare clouds.

use crate::arrays::{rows, same_length};
use crate::door;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use primfit_core::{LocalPlane, SegmentationSettings};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Neighbors<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray2<f64>>);
type Segments<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, usize, usize);
type LocalPlanes<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<bool>>,
);

/// A cloud sorted for questions of nearness.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct PointTree(primfit_core::PointTree);

impl PointTree {
    pub fn core(&self) -> &primfit_core::PointTree {
        &self.0
    }
}

#[pymethods]
impl PointTree {
    #[new]
    #[pyo3(signature = (points, n_jobs=None))]
    fn new(py: Python, points: PyReadonlyArray2<f64>, n_jobs: Option<usize>) -> PyResult<Self> {
        let points = rows("points", &points)?;
        if points.len() > i32::MAX as usize {
            return Err(PyValueError::new_err("points must be fewer than 2 ** 31"));
        }
        door::enter(py, n_jobs, |workers| {
            primfit_core::PointTree::within_memory(points, workers).map(Self)
        })
    }

    fn __len__(&self) -> usize {
        self.0.points().len()
    }

    /// The row of each point as it was given, in the order of the tree.
    fn order<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        let rows: Vec<i64> = self.0.rows().iter().map(|&row| i64::from(row)).collect();
        rows.into_pyarray(py)
    }

    #[pyo3(signature = (queries, k, n_jobs=None))]
    fn neighbors<'py>(
        &self,
        py: Python<'py>,
        queries: PyReadonlyArray2<f64>,
        k: usize,
        n_jobs: Option<usize>,
    ) -> PyResult<Neighbors<'py>> {
        let queries = rows("queries", &queries)?;
        let (found, distances): (Vec<i64>, Vec<f64>) = door::enter(py, n_jobs, |workers| {
            let found = self.0.neighbors(queries, k, workers)?;
            Ok(found.iter().map(|n| (i64::from(n.row), n.squared.sqrt())).unzip())
        })?;
        let shape = [queries.len(), k.min(self.0.points().len())];
        Ok((found.into_pyarray(py).reshape(shape)?, distances.into_pyarray(py).reshape(shape)?))
    }

    /// The normal of the `k` points nearest to each, in the order in which they were given.
    #[pyo3(signature = (k, n_jobs=None))]
    fn normals<'py>(
        &self,
        py: Python<'py>,
        k: usize,
        n_jobs: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let normals = door::enter(py, n_jobs, |workers| self.0.normals(k, workers))?;
        normals.into_flattened().into_pyarray(py).reshape([self.0.points().len(), 3])
    }

    /// Normal, noise, flatness and size of the plane around each point, and whether it is flat, in
    /// the order of the tree.
    #[pyo3(signature = (sigma=None, n_jobs=None))]
    fn local_planes<'py>(
        &self,
        py: Python<'py>,
        sigma: Option<PyReadonlyArray1<f64>>,
        n_jobs: Option<usize>,
    ) -> PyResult<LocalPlanes<'py>> {
        let sigma = sigma.as_ref().map(|sigma| sigma.as_slice()).transpose()?;
        if let Some(sigma) = sigma {
            same_length("sigma", sigma.len(), "points", self.0.points().len())?;
        }
        let planes = door::enter(py, n_jobs, |workers| self.0.local_planes(sigma, 1, workers))?;
        let normals: Vec<f64> = planes.iter().flat_map(|plane| plane.normal).collect();
        let column = |value: fn(&LocalPlane) -> f64| -> Bound<'py, PyArray1<f64>> {
            planes.iter().map(value).collect::<Vec<f64>>().into_pyarray(py)
        };
        let sizes: Vec<i64> = planes.iter().map(|plane| i64::from(plane.size)).collect();
        let is_flat: Vec<bool> = planes.iter().map(|plane| plane.is_flat).collect();
        Ok((
            normals.into_pyarray(py).reshape([planes.len(), 3])?,
            column(|plane| plane.sigma),
            column(|plane| plane.flatness),
            sizes.into_pyarray(py),
            is_flat.into_pyarray(py),
        ))
    }

    /// The plane of each point in the order of the tree, -1 for none; the noise around each; the
    /// number of nearest points that a point touches; one in how many points was enough. Settings
    /// by name times a factor, for those who ask what they are good for.
    #[pyo3(signature = (sigma=None, n_jobs=None, factors=None))]
    fn segment<'py>(
        &self,
        py: Python<'py>,
        sigma: Option<PyReadonlyArray1<f64>>,
        n_jobs: Option<usize>,
        factors: Option<Vec<(String, f64)>>,
    ) -> PyResult<Segments<'py>> {
        let sigma = sigma.as_ref().map(|sigma| sigma.as_slice()).transpose()?;
        if let Some(sigma) = sigma {
            same_length("sigma", sigma.len(), "points", self.0.points().len())?;
        }
        let mut settings = SegmentationSettings::default();
        for (name, factor) in factors.iter().flatten() {
            settings = settings
                .scaled(name, *factor)
                .ok_or_else(|| PyValueError::new_err(format!("no setting is called {name:?}")))?;
        }
        let found = door::enter(py, n_jobs, |workers| {
            primfit_core::segment(&self.0, sigma, &settings, workers)
        })?;
        let labels: Vec<i64> = found.labels.into_iter().map(i64::from).collect();
        Ok((labels.into_pyarray(py), found.sigma.into_pyarray(py), found.n_nearest, found.stride))
    }
}

/// Names and numbers of what the search for planes goes by.
#[pyfunction]
pub fn segmentation_settings() -> Vec<(&'static str, Vec<f64>)> {
    SegmentationSettings::default().numbers()
}
