//! Families of footprints.

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Corners (m, 2) and how they change with each parameter (2m, d).
type Frame<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Corners by parameters.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct Family(primfit_core::Family);

impl Family {
    pub fn core(&self) -> &primfit_core::Family {
        &self.0
    }

    /// The family may look at fewer parameters than there are.
    fn check(&self, n_parameters: usize) -> PyResult<()> {
        let least = self.0.n_parameters();
        if n_parameters >= least {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "there must be at least {least} parameters, not {n_parameters}"
        )))
    }

    /// Parameters (n, d) row by row.
    pub fn rows<'a>(&self, parameters: &'a PyReadonlyArray2<f64>) -> PyResult<Vec<&'a [f64]>> {
        let width = parameters.shape()[1];
        self.check(width)?;
        Ok(parameters.as_slice()?.chunks(width).collect())
    }
}

/// A polygon has three corners at the least, an ellipse four ends of its axes.
pub fn check_corners(n_corners: usize, is_round: bool) -> PyResult<()> {
    if is_round && n_corners != 4 {
        let message = format!("an ellipse must have 4 ends of axes, not {n_corners}");
        return Err(PyValueError::new_err(message));
    }
    if n_corners < 3 {
        let message = format!("a footprint must have 3 corners, not {n_corners}");
        return Err(PyValueError::new_err(message));
    }
    Ok(())
}

#[pymethods]
impl Family {
    /// Of axes (k, m, 2), the last size at most `slimmest` times the first. The corners of a round
    /// one are the four ends of the axes of an ellipse; the angle may be no parameter.
    #[staticmethod]
    #[pyo3(signature = (axes, slimmest, is_round=false, has_angle=true))]
    fn template(
        axes: PyReadonlyArray3<f64>,
        slimmest: f64,
        is_round: bool,
        has_angle: bool,
    ) -> PyResult<Self> {
        let &[n_sizes, n_corners, 2] = axes.shape() else {
            return Err(PyValueError::new_err("axes must have shape (k, m, 2)"));
        };
        if n_sizes == 0 {
            return Err(PyValueError::new_err("axes must have a size"));
        }
        check_corners(n_corners, is_round)?;
        let corners: &[[f64; 2]] = axes.as_slice()?.as_chunks().0;
        let axes = corners.chunks(n_corners).map(<[_]>::to_vec).collect();
        Ok(Self(primfit_core::Family::Template { axes, slimmest, is_round, has_angle }))
    }

    /// Of all polygons with so many corners.
    #[staticmethod]
    fn polygon(n_corners: usize) -> PyResult<Self> {
        check_corners(n_corners, false)?;
        Ok(Self(primfit_core::Family::Polygon(n_corners)))
    }

    fn footprints<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let rows = self.rows(&parameters)?;
        let corners: Vec<f64> =
            rows.iter().flat_map(|row| self.0.footprint(row).flatten()).collect();
        corners.into_pyarray(py).reshape([rows.len(), self.0.n_corners(), 2])
    }

    fn frame<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray1<f64>,
    ) -> PyResult<Frame<'py>> {
        let parameters = parameters.as_slice()?;
        self.check(parameters.len())?;
        let corners: Vec<f64> = self.0.footprint(parameters).flatten().collect();
        let changes = self.0.changes(parameters).transpose();
        let (d, n) = changes.shape();
        Ok((
            corners.into_pyarray(py).reshape([n / 2, 2])?,
            changes.as_slice().to_vec().into_pyarray(py).reshape([n, d])?,
        ))
    }

    fn is_proper<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let rows = self.rows(&parameters)?;
        let proper: Vec<bool> = rows.iter().map(|row| self.0.is_proper(row)).collect();
        Ok(proper.into_pyarray(py))
    }
}
