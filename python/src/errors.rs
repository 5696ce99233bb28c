//! Errors of the library as Python's exceptions.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use bismar::Error;
use bismar::cli::in_memory::with_keywords;

/// The exception of an error: the class of its exit code in `bismar._errors`.
pub fn raise(py: Python, error: &Error) -> PyErr {
    let made = || -> PyResult<PyErr> {
        let class_of = py.import("bismar._errors")?.getattr("of")?;
        Ok(PyErr::from_value(class_of.call1((error.exit_code(), with_keywords(&error.to_string())))?))
    };
    made().unwrap_or_else(|_| PyRuntimeError::new_err(error.to_string()))
}
