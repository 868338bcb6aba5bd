//! Arrays as slices of rows, and back.

use numpy::{
    Element, IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadwriteArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The rows of a C-contiguous `(n, N)` array, without a copy.
pub fn rows<'a, T: Element, const N: usize>(
    name: &str,
    array: &'a PyReadonlyArray2<T>,
) -> PyResult<&'a [[T; N]]> {
    check_width(name, array.shape(), N)?;
    let flat = array.as_slice().map_err(|_| not_contiguous(name))?;
    Ok(flat.as_chunks().0)
}

/// The same, to be written to.
pub fn rows_mut<'a, T: Element, const N: usize>(
    name: &str,
    array: &'a mut PyReadwriteArray2<T>,
) -> PyResult<&'a mut [[T; N]]> {
    check_width(name, array.shape(), N)?;
    let flat = array.as_slice_mut().map_err(|_| not_contiguous(name))?;
    Ok(flat.as_chunks_mut().0)
}

/// Rows as an `(n, N)` array, without a copy.
pub fn from_rows<T: Element, const N: usize>(
    py: Python<'_>,
    rows: Vec<[T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let n = rows.len();
    rows.into_flattened().into_pyarray(py).reshape([n, N])
}

fn check_width(name: &str, shape: &[usize], width: usize) -> PyResult<()> {
    if shape[1] == width {
        return Ok(());
    }
    Err(PyValueError::new_err(format!(
        "{name} must have shape (n, {width}), not ({}, {})",
        shape[0], shape[1]
    )))
}

fn not_contiguous(name: &str) -> PyErr {
    PyValueError::new_err(format!("{name} must be C-contiguous"))
}

/// Says which argument is not as long as the first.
pub fn same_length(name: &str, length: usize, first: &str, expected: usize) -> PyResult<()> {
    if length == expected {
        return Ok(());
    }
    Err(PyValueError::new_err(format!(
        "{name} must have as many rows as {first}: expected {expected}, not {length}"
    )))
}
