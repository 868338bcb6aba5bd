//! The one way from Python into a long computation.

use primfit_core::{Error, Workers};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
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
    let work = || work(&Workers::new(n_jobs, &go_on)?);
    let result = py.detach(|| catch_unwind(AssertUnwindSafe(work)));
    if let Ok(Some(error)) = interrupt.into_inner() {
        return Err(error);
    }
    result.map_err(|panic| PyRuntimeError::new_err(said(&*panic)))?.map_err(to_python)
}

/// What a kernel that broke down said: a fault of primfit, but no end of the process.
fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    format!("a kernel of primfit broke down, which is a fault of primfit: {text}")
}

/// The exception that a Python caller expects for an error of the core.
pub fn to_python(error: Error) -> PyErr {
    match error {
        Error::VertexOutOfRange { .. }
        | Error::NotFinite { .. }
        | Error::NoDirection { .. }
        | Error::TooWide { .. }
        | Error::TooMany { .. }
        | Error::Word { .. }
        | Error::Width { .. }
        | Error::Short { .. }
        | Error::List { .. } => PyValueError::new_err(error.to_string()),
        // Threads are refused where there is no memory for their stacks.
        Error::Memory { .. } | Error::Threads { .. } => PyMemoryError::new_err(error.to_string()),
        Error::Stopped => PyRuntimeError::new_err(error.to_string()),
    }
}
