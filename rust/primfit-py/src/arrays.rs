//! Arrays as slices of rows, and back.

use numpy::{Element, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The rows of a C-contiguous `(n, N)` array, without a copy.
pub fn rows<'a, T: Element, const N: usize>(
    name: &str,
    array: &'a PyReadonlyArray2<T>,
) -> PyResult<&'a [[T; N]]> {
    let shape = array.shape();
    if shape[1] != N {
        return Err(PyValueError::new_err(format!(
            "{name} must have shape (n, {N}), not ({}, {})",
            shape[0], shape[1]
        )));
    }
    let flat = array
        .as_slice()
        .map_err(|_| PyValueError::new_err(format!("{name} must be C-contiguous")))?;
    Ok(flat.as_chunks().0)
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
