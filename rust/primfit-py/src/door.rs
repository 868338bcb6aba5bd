//! The one way from Python into a long computation.

use primfit_core::{Error, Workers};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::sync::Mutex;

/// Releases the GIL, runs `work`, lets Ctrl-C through between its chunks, and turns its error
/// into a Python exception.
pub fn enter<R: Send>(
    py: Python,
    n_jobs: Option<usize>,
    work: impl FnOnce(&Workers) -> Result<R, Error> + Send,
) -> PyResult<R> {
    let interrupt = Mutex::new(None);
    let go_on = || {
        let raised = Python::attach(|py| py.check_signals().err());
        let goes_on = raised.is_none();
        if let Ok(mut interrupt) = interrupt.lock() {
            *interrupt = raised;
        }
        goes_on
    };
    let result = py.detach(|| work(&Workers::new(n_jobs, &go_on)?));
    if let Ok(Some(error)) = interrupt.into_inner() {
        return Err(error);
    }
    result.map_err(to_python)
}

/// The exception that a Python caller expects for an error of the core.
pub fn to_python(error: Error) -> PyErr {
    match error {
        Error::VertexOutOfRange { .. }
        | Error::NotFinite { .. }
        | Error::NoDirection { .. }
        | Error::TooWide { .. }
        | Error::TooMany { .. } => PyValueError::new_err(error.to_string()),
        Error::Stopped | Error::Threads { .. } => PyRuntimeError::new_err(error.to_string()),
    }
}
