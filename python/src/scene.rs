//! `bismar.Scene`.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{IntoPyArray, PyReadonlyArray1};
use pyo3::prelude::*;
use rayon::ThreadPool;

use bismar::Error;
use bismar::batch::views;
use bismar::cli::in_memory::{Options, request};
use bismar::job::{CameraInfo, LoadedScene, PixelMoments};
use bismar::scene::{FieldOfView, PlacedCamera};

use crate::errors;
use crate::picture::Picture;
use crate::run::{self, json};

/// A camera: name, projection, vertical, aspect, matrix, intrinsics as JSON if it was calibrated.
type Camera = (String, &'static str, f64, Option<f64>, [[f64; 4]; 4], Option<String>);

/// A scene in memory, and the threads that render it.
#[pyclass(frozen, module = "bismar._bismar")]
pub struct Scene {
    scene: Mutex<Arc<LoadedScene>>,
    path: PathBuf,
    /// Options of all its pictures.
    options: Options,
    pool: Arc<ThreadPool>,
}

#[pyfunction]
pub fn load(py: Python, path: PathBuf, options: &str, threads: Option<usize>) -> PyResult<Scene> {
    let (pool, mut options) = run::unlocked(py, || Ok((run::pool(threads)?, run::options(options)?)))?;
    let scene = run::work(py, Some(&pool), || LoadedScene::load(request(&path, &options)?))?;
    options.remove("aovs");
    Ok(Scene { scene: Mutex::new(Arc::new(scene)), path, options, pool })
}

impl Scene {
    fn current(&self) -> Arc<LoadedScene> {
        Arc::clone(&self.scene.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The light shares by a callable of paths, light shares and moments, flat arrays.
fn ask(py: Python, heuristic: &Py<PyAny>, moments: PixelMoments) -> PyResult<Vec<f32>> {
    let PixelMoments { paths, light_shares, moments } = moments;
    let arrays = (paths.into_pyarray(py), light_shares.into_pyarray(py), moments.into_flattened().into_pyarray(py));
    let shares = heuristic.call1(py, arrays)?;
    let shares: PyReadonlyArray1<f32> = shares.bind(py).extract()?;
    Ok(shares.as_array().to_vec())
}

#[pymethods]
impl Scene {
    fn cameras(&self, py: Python) -> PyResult<Vec<Camera>> {
        let one = |c: CameraInfo| -> bismar::Result<Camera> {
            let calibration = c.calibration.as_ref().map(views::intrinsics).transpose()?;
            Ok((c.name, c.projection, c.vertical, c.aspect, c.to_world, calibration))
        };
        run::unlocked(py, || self.current().cameras().into_iter().map(one).collect())
    }

    fn add_camera(
        &self,
        py: Python,
        name: String,
        matrix: [[f64; 4]; 4],
        fov: Option<f64>,
        intrinsics: Option<String>,
    ) -> PyResult<usize> {
        run::unlocked(py, || {
            let measured = intrinsics.as_deref().map(views::field_of_view).transpose()?;
            let fov = measured.unwrap_or_else(|| fov.map_or(FieldOfView::Panorama, FieldOfView::Vertical));
            let mut scene = self.scene.lock().unwrap_or_else(PoisonError::into_inner);
            // A render in another thread keeps the scene as it was.
            let mut next = LoadedScene::clone(&scene);
            let added = next.add_camera(&PlacedCamera { name, to_world: matrix, fov });
            *scene = Arc::new(next);
            added
        })
    }

    fn bounds(&self, py: Python) -> PyResult<Option<[[f32; 3]; 2]>> {
        run::unlocked(py, || {
            let current = self.current();
            let scene = current.scene();
            let bounds = scene.bounds();
            Ok(bounds.map(|corners| corners.map(|corner| (corner.as_dvec3() + scene.origin).as_vec3().to_array())))
        })
    }

    fn inspect(&self, py: Python) -> PyResult<String> {
        let scene = self.current();
        run::work(py, Some(&self.pool), || json(&scene.inspect()?))
    }

    /// The picture, if there is one, and the exception that stopped the render, if one did.
    fn render(
        &self,
        py: Python,
        options: &str,
        progress: Option<Py<PyAny>>,
        heuristic: Option<Py<PyAny>>,
    ) -> PyResult<(Option<Picture>, Option<PyErr>)> {
        let scene = self.current();
        let mut options = run::unlocked(py, || run::options(options))?;
        // The passes of a heuristic are those of this method.
        options.extend(heuristic.iter().map(|_| ("balance".to_owned(), "kl".into())));
        options.extend(self.options.clone());
        let raised = Mutex::new(None);
        let outcome = run::stoppable(py, &self.pool, heuristic.is_some(), progress.as_ref(), |stop, progress| {
            let request = request(&self.path, &options)?;
            let Some(heuristic) = &heuristic else { return scene.render(request, stop, progress) };
            let shares = |moments: PixelMoments| {
                let asked = run::call_back(|| Python::attach(|py| ask(py, heuristic, moments)));
                asked.map_err(|exception| {
                    *raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(exception);
                    Error::Interrupted("the heuristic raised an exception".into())
                })
            };
            scene.render_by(&shares, request, stop, progress)
        });
        if let Some(exception) = raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(exception);
        }
        match outcome {
            (Ok(picture), exception) => Ok((Some(Picture(Arc::new(picture))), exception)),
            (Err(bismar::Error::Interrupted(_)), Some(exception)) => Ok((None, Some(exception))),
            (Err(error), _) => Err(errors::raise(py, &error)),
        }
    }
}
