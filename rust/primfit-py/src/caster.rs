//! Ray casting.

use crate::arrays::{rows, same_length};
use crate::door;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

type Hits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

/// A triangle mesh ready for rays.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct RayCaster(primfit_core::RayCaster);

#[pymethods]
impl RayCaster {
    #[new]
    fn new(
        py: Python,
        vertices: PyReadonlyArray2<f64>,
        triangles: PyReadonlyArray2<i64>,
    ) -> PyResult<Self> {
        let (vertices, triangles) = (rows("vertices", &vertices)?, rows("triangles", &triangles)?);
        py.detach(|| primfit_core::RayCaster::new(vertices, triangles))
            .map(Self)
            .map_err(door::to_python)
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    #[pyo3(signature = (origins, directions, n_jobs=None))]
    fn cast<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<f64>,
        directions: PyReadonlyArray2<f64>,
        n_jobs: Option<usize>,
    ) -> PyResult<Hits<'py>> {
        let (origins, directions) = (rows("origins", &origins)?, rows("directions", &directions)?);
        same_length("directions", directions.len(), "origins", origins.len())?;
        let (ranges, triangles): (Vec<f64>, Vec<i64>) = door::enter(py, n_jobs, |workers| {
            let hits = self.0.cast(origins, directions, workers)?;
            Ok(hits.iter().map(|hit| (hit.range, hit.triangle)).unzip())
        })?;
        Ok((ranges.into_pyarray(py), triangles.into_pyarray(py)))
    }
}
