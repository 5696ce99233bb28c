//! `bismar.Picture`.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use bismar::cli::in_memory;
use bismar::job::{RenderedPicture, Values};

use crate::run::{self, json};

/// A rendered picture in memory.
#[pyclass(frozen, module = "bismar._bismar")]
pub struct Picture(pub Arc<RenderedPicture>);

#[pymethods]
impl Picture {
    fn layers(&self) -> Vec<&'static str> {
        self.0.layers()
    }

    fn interrupted(&self) -> bool {
        self.0.is_interrupted()
    }

    /// Width and height in pixels.
    fn size(&self) -> [usize; 2] {
        self.0.size()
    }

    /// An array (H, W, C) and the names of its channels. The array takes the memory over in which the values were made.
    fn layer<'py>(&self, py: Python<'py>, name: &str) -> PyResult<(Bound<'py, PyAny>, Vec<String>)> {
        let (channels, values) = run::work(py, None, || self.0.layer(name))?;
        let [width, height] = self.0.size();
        let shape = [height, width, channels.len()];
        let array = match values {
            Values::Floats(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
            Values::Uints(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
        };
        Ok((array, channels))
    }

    fn denoised<'py>(&self, py: Python<'py>, layer: &str) -> PyResult<Bound<'py, PyAny>> {
        let values = run::work(py, None, || self.0.denoised(layer).map(<[_]>::to_vec))?;
        let [width, height] = self.0.size();
        Ok(values.into_flattened().into_pyarray(py).reshape([height, width, 3])?.into_any())
    }

    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        run::work(py, None, || self.0.png()).map(|png| PyBytes::new(py, &png))
    }

    fn stats(&self, py: Python) -> PyResult<String> {
        run::work(py, None, || json(&self.0.stats()))
    }

    /// Camera to world, row by row, and the vertical field of view in radians.
    fn view(&self) -> ([[f64; 4]; 4], Option<f64>) {
        self.0.view()
    }

    fn save(&self, py: Python, path: PathBuf, options: &str) -> PyResult<()> {
        run::work(py, None, || in_memory::save(&self.0, &path, &run::options(options)?))
    }
}
