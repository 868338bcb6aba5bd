//! Beams from above.

use crate::arrays::{rows, same_length};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;

/// Level lines of beams.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct LevelLines(primfit_core::LevelLines);

impl LevelLines {
    fn some(&self, rows: &PyReadonlyArray1<i64>) -> PyResult<Vec<usize>> {
        let n = self.0.len();
        let row = |&row: &i64| {
            usize::try_from(row).ok().filter(|&row| row < n).ok_or_else(|| {
                PyIndexError::new_err(format!("rows must be from 0 up to {n}, not {row}"))
            })
        };
        rows.as_slice()?.iter().map(row).collect()
    }
}

#[pymethods]
impl LevelLines {
    #[new]
    fn new(
        py: Python,
        origins: PyReadonlyArray2<f64>,
        directions: PyReadonlyArray2<f64>,
    ) -> PyResult<Self> {
        let (origins, directions) = (rows("origins", &origins)?, rows("directions", &directions)?);
        same_length("directions", directions.len(), "origins", origins.len())?;
        Ok(Self(py.detach(|| primfit_core::LevelLines::new(origins, directions))))
    }

    fn near<'py>(
        &self,
        py: Python<'py>,
        place: [f64; 2],
        radius: f64,
        reach: f64,
        stride: usize,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        if stride == 0 {
            return Err(PyValueError::new_err("stride must be at least 1, not 0"));
        }
        let rows = py.detach(|| self.0.near(place, radius, reach, stride));
        Ok(rows.into_iter().map(|row| row as i64).collect::<Vec<_>>().into_pyarray(py))
    }

    fn entries<'py>(
        &self,
        py: Python<'py>,
        rows: PyReadonlyArray1<i64>,
        place: [f64; 2],
        radius: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let rows = self.some(&rows)?;
        Ok(py.detach(|| self.0.entries(rows, place, radius)).into_pyarray(py))
    }

    fn bundles<'py>(
        &self,
        py: Python<'py>,
        rows: PyReadonlyArray1<i64>,
        place: [f64; 2],
        radius: f64,
        shape: [usize; 2],
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let rows = self.some(&rows)?;
        let bundles = py.detach(|| self.0.bundles(rows, place, radius, shape));
        Ok(bundles.into_iter().map(|bundle| bundle as i64).collect::<Vec<_>>().into_pyarray(py))
    }
}
