//! `bismar.look`.

use std::path::PathBuf;

use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use bismar::cli::in_memory::{self, Looked, Shot};
use bismar::console::Paths;

use crate::{errors, json, run};

/// A contact sheet and what it shows.
#[pyclass(frozen, module = "bismar._bismar")]
pub struct Look {
    looked: Looked,
    /// The files that it was made of.
    paths: Paths,
}

#[pyfunction]
pub fn look(py: Python, scenes: Vec<PathBuf>, options: &str, threads: Option<usize>) -> PyResult<Look> {
    let pool = run::unlocked(py, || run::pool(threads))?;
    let outcome = run::stoppable(py, &pool, false, None, |stop, _| {
        let mut paths = Paths::default();
        Ok(Look { looked: in_memory::look(&run::options(options)?, &scenes, &mut paths, stop)?, paths })
    });
    match outcome {
        (_, Some(exception)) => Err(exception),
        (Ok(look), None) => Ok(look),
        (Err(error), None) => Err(errors::raise(py, &error)),
    }
}

#[pymethods]
impl Look {
    fn report(&self, py: Python) -> PyResult<String> {
        run::work(py, None, || json(&self.looked.report))
    }

    /// The sheet, an array (H, W, 3).
    fn sheet<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let [width, height] = self.looked.sheet.size.map(|n| n as usize);
        let bytes = run::unlocked(py, || Ok(self.looked.sheet.bytes.clone()))?;
        Ok(bytes.into_pyarray(py).reshape([height, width, 3])?.into_any())
    }

    /// The views, arrays (H, W, 4).
    fn views<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let view = |shot: &Shot| {
            let pixels = run::unlocked(py, || Ok(shot.pixels.clone().into_flattened()))?;
            Ok(pixels.into_pyarray(py).reshape([shot.size[1] as usize, shot.size[0] as usize, 4])?.into_any())
        };
        self.looked.shots.iter().map(view).collect()
    }

    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        run::work(py, None, || self.looked.sheet.png()).map(|png| PyBytes::new(py, &png))
    }

    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        run::work(py, None, || {
            self.paths.clone().writes("the sheet", &path)?;
            self.looked.sheet.write(&path)
        })
    }
}
