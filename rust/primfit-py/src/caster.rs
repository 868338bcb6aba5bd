//! Ray casting.

use crate::arrays::{rows, same_length};
use crate::door;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

type Hits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);
type Scan<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

/// A triangle mesh ready for rays.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct RayCaster(primfit_core::RayCaster);

#[pymethods]
impl RayCaster {
    #[new]
    #[pyo3(signature = (vertices, triangles, names=None))]
    fn new(
        py: Python,
        vertices: PyReadonlyArray2<f64>,
        triangles: PyReadonlyArray2<i64>,
        names: Option<PyReadonlyArray1<i64>>,
    ) -> PyResult<Self> {
        let (vertices, triangles) = (rows("vertices", &vertices)?, rows("triangles", &triangles)?);
        let names = names.map(|names| names.as_slice().map(<[i64]>::to_vec)).transpose()?;
        if let Some(names) = &names {
            same_length("names", names.len(), "triangles", triangles.len())?;
        }
        py.detach(|| {
            let caster = primfit_core::RayCaster::new(vertices, triangles)?;
            Ok(match names {
                Some(names) => caster.named(names),
                None => caster,
            })
        })
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
        let hits = door::enter(py, n_jobs, |workers| self.0.cast(origins, directions, workers))?;
        Ok((hits.ranges.into_pyarray(py), hits.ids.into_pyarray(py)))
    }

    /// Directions, ranges and ids of `beams` (m, 3) from each of `poses` (p, 16).
    #[pyo3(signature = (poses, beams, n_jobs=None))]
    fn scan<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<f64>,
        beams: PyReadonlyArray2<f64>,
        n_jobs: Option<usize>,
    ) -> PyResult<Scan<'py>> {
        let (poses, beams) = (rows("poses", &poses)?, rows("beams", &beams)?);
        let (directions, hits) =
            door::enter(py, n_jobs, |workers| self.0.scan(poses, beams, workers))?;
        let n = directions.len();
        let directions = directions.into_flattened().into_pyarray(py).reshape([n, 3])?;
        Ok((directions, hits.ranges.into_pyarray(py), hits.ids.into_pyarray(py)))
    }
}
