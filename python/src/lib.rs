//! The native half of the Python package `bismar` (`python/bismar`): scenes and pictures, over
//! [`bismar::job`] and [`bismar::cli::in_memory`]. The Python half has the public functions, with their types and documentation.

mod errors;
mod log;
mod look;
mod picture;
mod run;
mod scene;

use std::path::PathBuf;

use pyo3::prelude::*;

use bismar::cli::in_memory;
use bismar::film;
use bismar::job::compare as compare_pictures;

use picture::Picture;
use run::json;
use scene::{Scene, load};

/// A picture in memory or a picture file.
#[derive(FromPyObject)]
enum AnyPicture {
    Rendered(Py<Picture>),
    File(PathBuf),
}

impl AnyPicture {
    fn open(&self, layer: Option<&str>) -> bismar::Result<film::Picture> {
        match self {
            Self::Rendered(picture) => Ok(picture.get().0.picture()),
            Self::File(path) => film::Picture::open(path, layer),
        }
    }
}

/// Errors of picture A against reference B, as JSON.
#[pyfunction]
fn compare(py: Python, a: AnyPicture, b: AnyPicture, layer: Option<String>) -> PyResult<String> {
    run::work(py, None, || {
        let [a, b] = [a.open(layer.as_deref())?, b.open(layer.as_deref())?];
        json(&compare_pictures(&a, &b)?)
    })
}

#[pyfunction]
fn merge(py: Python, parts: Vec<PathBuf>, options: &str) -> PyResult<()> {
    run::work(py, None, || in_memory::merge(&run::options(options)?, &parts))
}

#[pyfunction]
fn labels(py: Python, pictures: Vec<PathBuf>, options: &str) -> PyResult<()> {
    run::work(py, None, || in_memory::labels(&run::options(options)?, &pictures))
}

#[pyfunction]
fn develop(py: Python, input: PathBuf, options: &str) -> PyResult<()> {
    run::work(py, None, || in_memory::develop(&run::options(options)?, &input))
}

/// Names the folder of the package pyoidn.
#[pyfunction]
fn look_for_denoiser(package: PathBuf) {
    film::denoise::look_into(&package);
}

/// Panics, for the test that a panic is an exception.
#[pyfunction]
fn _panic(py: Python) -> PyResult<()> {
    run::work(py, None, || panic!("on purpose"))
}

#[pymodule]
fn _bismar(module: &Bound<PyModule>) -> PyResult<()> {
    // Before anything that the compiler may have vectorised.
    bismar::console::host::check_isa().map_err(|e| errors::raise(module.py(), &e))?;
    bismar::console::panics::install_hook();
    log::start();
    module.add("version", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<Scene>()?;
    module.add_class::<Picture>()?;
    module.add_class::<look::Look>()?;
    module.add_function(wrap_pyfunction!(look::look, module)?)?;
    module.add_function(wrap_pyfunction!(load, module)?)?;
    module.add_function(wrap_pyfunction!(compare, module)?)?;
    module.add_function(wrap_pyfunction!(merge, module)?)?;
    module.add_function(wrap_pyfunction!(labels, module)?)?;
    module.add_function(wrap_pyfunction!(develop, module)?)?;
    module.add_function(wrap_pyfunction!(look_for_denoiser, module)?)?;
    module.add_function(wrap_pyfunction!(_panic, module)?)
}
