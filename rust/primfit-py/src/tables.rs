//! Tables of numbers in files.

use crate::arrays::same_length;
use crate::door;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use primfit_core::ply::{self, Kind, Property};
use primfit_core::text::{self, Lines};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// A column of one of the types that a table is written from.
#[derive(FromPyObject)]
pub enum Column<'py> {
    F64(PyReadonlyArray1<'py, f64>),
    F32(PyReadonlyArray1<'py, f32>),
    I64(PyReadonlyArray1<'py, i64>),
    U64(PyReadonlyArray1<'py, u64>),
}

impl Column<'_> {
    fn view(&self) -> PyResult<text::Column<'_>> {
        Ok(match self {
            Self::F64(values) => text::Column::F64(values.as_slice()?),
            Self::F32(values) => text::Column::F32(values.as_slice()?),
            Self::I64(values) => text::Column::I64(values.as_slice()?),
            Self::U64(values) => text::Column::U64(values.as_slice()?),
        })
    }
}

/// The rows of contiguous columns as text.
#[pyfunction]
pub fn format_rows<'py>(
    py: Python<'py>,
    columns: Vec<Column<'py>>,
    separator: u8,
) -> PyResult<Bound<'py, PyBytes>> {
    let views = columns.iter().map(Column::view).collect::<PyResult<Vec<_>>>()?;
    if let Some((first, others)) = views.split_first() {
        for other in others {
            same_length("columns", other.len(), "the first", first.len())?;
        }
    }
    let text = door::enter(py, Some(1), |workers| text::format(&views, separator, workers))?;
    Ok(PyBytes::new(py, &text))
}

/// The columns (n, k) of text from `start` on, where every line has `n_columns`; they are floats, or
/// whole numbers, with a sign ("i") or without ("u").
#[pyfunction]
#[pyo3(signature = (text, start, first_line, n_columns, columns, kind="f", separator=None, has_remarks=false))]
#[allow(clippy::too_many_arguments)]
pub fn parse_rows<'py>(
    py: Python<'py>,
    text: &[u8],
    start: usize,
    first_line: usize,
    n_columns: usize,
    columns: Vec<usize>,
    kind: &str,
    separator: Option<u8>,
    has_remarks: bool,
) -> PyResult<Bound<'py, PyAny>> {
    if !columns.is_sorted_by(|a, b| a < b) || columns.last().is_none_or(|&last| last >= n_columns) {
        return Err(PyValueError::new_err("columns must rise, and be less than n_columns"));
    }
    let text = text.get(start..).unwrap_or_default();
    let lines = Lines { separator, n_columns, columns: &columns, has_remarks, first: first_line };
    let k = columns.len();
    match kind {
        "f" => table::<f64>(py, text, &lines, k).map(Bound::into_any),
        "i" => table::<i64>(py, text, &lines, k).map(Bound::into_any),
        "u" => table::<u64>(py, text, &lines, k).map(Bound::into_any),
        _ => Err(PyValueError::new_err(format!("kind must be 'f', 'i' or 'u', not {kind:?}"))),
    }
}

fn table<'py, T: numpy::Element + std::str::FromStr + Send>(
    py: Python<'py>,
    text: &[u8],
    lines: &Lines,
    width: usize,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let numbers: Vec<T> = door::enter(py, Some(1), |workers| text::parse(text, lines, workers))?;
    let n = numbers.len() / width;
    numbers.into_pyarray(py).reshape([n, width])
}

/// The single numbers of PLY rows in bytes, packed, and where the rows end; each property is the
/// types of the length of a list, "" for none, and of its numbers, as "u1".
#[pyfunction]
pub fn ply_bytes<'py>(
    py: Python<'py>,
    content: &[u8],
    start: usize,
    n_rows: usize,
    properties: Vec<(String, String)>,
    is_big_endian: bool,
) -> PyResult<(Bound<'py, PyBytes>, usize)> {
    let (content, properties) = (content.get(start..).unwrap_or_default(), all(&properties)?);
    let (rows, length) = py
        .detach(|| ply::rows_of_bytes(content, n_rows, &properties, is_big_endian))
        .map_err(door::to_python)?;
    Ok((PyBytes::new(py, &rows), start + length))
}

/// The same of rows in words, as numbers one after another.
#[pyfunction]
pub fn ply_words<'py>(
    py: Python<'py>,
    content: &[u8],
    start: usize,
    n_rows: usize,
    properties: Vec<(String, String)>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, usize)> {
    let (content, properties) = (content.get(start..).unwrap_or_default(), all(&properties)?);
    let (numbers, length) =
        py.detach(|| ply::rows_of_words(content, n_rows, &properties)).map_err(door::to_python)?;
    Ok((numbers.into_pyarray(py), start + length))
}

fn all(properties: &[(String, String)]) -> PyResult<Vec<Property>> {
    let kind = |code: &str| {
        let is_whole = !code.starts_with('f');
        match code {
            "i1" | "u1" => Ok(Kind { size: 1, is_whole }),
            "i2" | "u2" => Ok(Kind { size: 2, is_whole }),
            "i4" | "u4" | "f4" => Ok(Kind { size: 4, is_whole }),
            "f8" => Ok(Kind { size: 8, is_whole }),
            _ => Err(PyValueError::new_err(format!("properties must not be of type {code:?}"))),
        }
    };
    let property = |(length, code): &(String, String)| {
        let length = if length.is_empty() { None } else { Some(kind(length)?) };
        Ok(Property { length, kind: kind(code)? })
    };
    properties.iter().map(property).collect()
}
