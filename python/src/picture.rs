//! `bismar.Picture`.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use bismar::cli::in_memory;
use bismar::color::ColorSpace;
use bismar::film::Exposure;
use bismar::job::{RenderedPicture, Values};

use crate::run::{self, Flag, json};

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

    /// `view` has the options of the view transform.
    #[allow(clippy::too_many_arguments)]
    fn save(
        &self,
        py: Python,
        path: PathBuf,
        view: Vec<Flag>,
        exposure: &str,
        resumable: bool,
        half: bool,
        colorspace: &str,
    ) -> PyResult<()> {
        let wrong = |what, value: &str, why| bismar::Error::Usage(format!("{what} {value}: {why}"));
        run::work(py, None, || {
            let names = || ColorSpace::ALL.map(ColorSpace::name).join(", ");
            let known = ColorSpace::ALL.into_iter().find(|known| known.name() == colorspace);
            let colorspace = known.ok_or_else(|| wrong("colorspace", colorspace, format!("there are {}", names())))?;
            let exposure: Exposure = exposure.parse().map_err(|why| wrong("exposure", exposure, why))?;
            self.0.save(&path, (in_memory::view(&view)?, exposure), resumable, (half, colorspace))
        })
    }
}
