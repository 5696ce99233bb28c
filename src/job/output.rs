//! Writing the outputs of a render: the EXR with its record, the PNG, the statistics.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::{DMat4, DVec3, Mat4};

use super::denoise::denoised_elsewhere;
use super::inputs::Inputs;
use super::loaded::Loaded;
use super::request::RenderRequest;
use super::stats::{Seconds, Stats};
use crate::film::aov::{MATERIALS, OBJECTS};
use crate::film::denoise::{DENOISED, Denoiser, denoised_layers};
use crate::film::exr_file::{CALIBRATION, Header, HeaderValue, WORLD_TO_CAMERA, WORLD_TO_NDC};
use crate::film::{Aov, Background, Look, Picture, ViewTransform, colors, cryptomatte, exr_file, preview};
use crate::render::record::checkpoint::{self, Host, json};
use crate::render::{Identity, Record, Rendered, StopReason, camera};
use crate::scene::{Projection, Scene};
use crate::{Error, Result};

/// Writes the outputs of one render, at each checkpoint and at its end.
pub struct OutputWriter<'a> {
    request: &'a RenderRequest,
    inputs: &'a Inputs,
    threads: usize,
    loaded: &'a Loaded,
    identity: &'a Identity,
    view: ViewTransform,
    /// Whether the finished picture holds the state to continue from.
    resumable: bool,
    /// The denoised layers of the finished picture, row by row.
    denoised: RefCell<Vec<(String, Vec<[f32; 3]>)>>,
    seconds: Cell<Seconds>,
}

impl<'a> OutputWriter<'a> {
    /// Loads the denoiser and the LUT once, so that a missing one is an error before the render.
    ///
    /// # Errors
    /// Those of [`Denoiser::load`] and [`ViewOptions::transform`](super::ViewOptions::transform).
    pub fn new(
        request: &'a RenderRequest,
        inputs: &'a Inputs,
        loaded: &'a Loaded,
        threads: usize,
        identity: &'a Identity,
        resumable: bool,
    ) -> Result<Self> {
        request.denoise.map(|_| Denoiser::load()).transpose()?;
        let view = request.view.transform()?;
        let (denoised, seconds) = (RefCell::default(), Cell::new(loaded.seconds()));
        Ok(Self { request, inputs, threads, loaded, identity, view, resumable, denoised, seconds })
    }

    /// Writes EXR and PNG of a render that continues.
    ///
    /// # Errors
    /// Those of the files.
    pub fn checkpoint(&self, rendered: &Rendered) -> Result<()> {
        let stats = self.write_picture(rendered, true)?;
        self.write_preview(rendered, &stats)
    }

    /// Writes all outputs of a render that has ended. If requested, a finished picture is written first as it is, then
    /// denoised and written again; `stop` ends the denoiser. `began` is the start of the command.
    pub(crate) fn write_final(
        &self,
        rendered: &Rendered,
        with_statistics: bool,
        began: Instant,
        stop: &AtomicBool,
    ) -> Result<Stats> {
        if self.request.denoise.is_some() && rendered.stop != StopReason::Interrupted {
            self.write_picture(rendered, true)?;
            let start = Instant::now();
            let denoised = denoised_layers(&rendered.pixels(), |noisy| denoised_elsewhere(noisy, stop));
            *self.denoised.borrow_mut() = denoised.map_err(|error| self.not_denoised(error))?;
            self.add_write_seconds(start);
        }
        let mut stats = self.write_picture(rendered, with_statistics)?;
        let start = Instant::now();
        self.write_preview(rendered, &stats)?;
        self.add_write_seconds(start);
        stats.seconds.write = self.seconds.get().write;
        stats.seconds.total = began.elapsed().as_secs_f64();
        if let Some(path) = &self.request.stats {
            stats.picture = exr_file::checksum(&self.request.output)?;
            stats.write(path)?;
        }
        Ok(stats)
    }

    /// The error of a picture that is written, but not denoised.
    fn not_denoised(&self, error: Error) -> Error {
        let output = self.request.output.display();
        let left =
            format!("{output} is saved with all its paths, not denoised; the same command with --resume denoises it");
        match error {
            Error::Interrupted(why) => Error::Interrupted(format!("{why}: {left}")),
            Error::Host(why) => Error::Host(format!("{why}: {left}")),
            other => other,
        }
    }

    fn write_picture(&self, rendered: &Rendered, with_statistics: bool) -> Result<Stats> {
        let start = Instant::now();
        let (scene, backend) = (&self.loaded.prepared.scene, self.loaded.prepared.rays.info());
        let seconds = Seconds { render: rendered.stats.render_seconds, ..self.seconds.get() };
        let mut stats = Stats::new(&self.request.scene, scene, backend, self.threads, rendered, seconds);
        stats.exposure = self.request.exposure.of(colors(&rendered.pixels()));
        let requested = self.request.requested();
        let mut record = Record::new(self.identity, &requested, rendered, Host::of(backend), self.resumable);
        let header = self.header(&stats)?;
        let denoised = self.denoised.borrow();
        if self.request.denoise.is_some() && denoised.is_empty() {
            // `--resume` denoises it.
            record.stop = StopReason::Interrupted;
        }
        checkpoint::write(&self.request.output, rendered, &record, header, &denoised, with_statistics)?;
        self.add_write_seconds(start);
        Ok(stats)
    }

    /// Header attributes: statistics, camera matrices, names of objects and materials.
    fn header(&self, stats: &Stats) -> Result<Header> {
        let (scene, settings) = (&self.loaded.prepared.scene, &self.identity.settings);
        let mut header = stats.header()?;
        let (to_camera, to_picture) = camera(scene, settings).matrices();
        let of_file = |matrix: [f32; 16]| match scene.origin {
            DVec3::ZERO => HeaderValue::Matrix(matrix),
            origin => {
                let matrix = Mat4::from_cols_array(&matrix).as_dmat4() * DMat4::from_translation(-origin);
                HeaderValue::Matrix(matrix.as_mat4().to_cols_array())
            }
        };
        header.push((WORLD_TO_CAMERA.into(), of_file(to_camera)));
        header.extend(to_picture.map(|matrix| (WORLD_TO_NDC.into(), of_file(matrix))));
        if let Projection::Calibrated(of) = scene.cameras[settings.camera].projection {
            header.push((CALIBRATION.into(), json(&of.scaled(settings.width, settings.height))?));
        }
        header.extend(names(scene, &self.request.aovs())?);
        self.request.write(&mut header)?;
        Ok(header)
    }

    fn write_preview(&self, rendered: &Rendered, stats: &Stats) -> Result<()> {
        let Some(path) = &self.request.preview else { return Ok(()) };
        let mark = preview_mark(self.request, &self.view, self.inputs, rendered.stats.paths);
        if !self.denoised.borrow().is_empty() {
            return develop_file(self.request, &self.view, path, rendered.background, &mark).map(drop);
        }
        preview::write(path, &rendered.pixels(), &Look { view: self.view.clone(), exposure: stats.exposure }, &mark)
    }

    fn add_write_seconds(&self, start: Instant) {
        let seconds = self.seconds.get();
        self.seconds.set(Seconds { write: seconds.write + start.elapsed().as_secs_f64(), ..seconds });
    }
}

/// Header attributes with the names that these AOVs refer to.
fn names(scene: &Scene, aovs: &[Aov]) -> Result<Header> {
    let objects = || scene.instances.iter().map(|instance| instance.name.as_str());
    let materials = || scene.materials.iter().map(|material| material.name.as_str());
    let mut header = Header::new();
    for aov in aovs {
        match aov {
            Aov::Object => {
                header.push(("bismar.objects".into(), json(&objects().collect::<Vec<_>>())?));
                let categories: Vec<_> = scene.instances.iter().map(|instance| instance.category.as_deref()).collect();
                if categories.iter().any(Option::is_some) {
                    header.push(("bismar.categories".into(), json(&categories)?));
                }
            }
            Aov::Material => header.push(("bismar.materials".into(), json(&materials().collect::<Vec<_>>())?)),
            Aov::CryptoObject => header.extend(cryptomatte::header(OBJECTS, objects())),
            Aov::CryptoMaterial => header.extend(cryptomatte::header(MATERIALS, materials())),
            _ => {}
        }
    }
    Ok(header)
}

/// Writes a PNG from the command's EXR, denoised if requested; returns its exposure in stops.
pub(crate) fn develop_file(
    request: &RenderRequest,
    view: &ViewTransform,
    png: &Path,
    background: Background,
    mark: &str,
) -> Result<f32> {
    let output = &request.output;
    let mut picture = Picture::open(output, None)?;
    let exposure = request.exposure.of(picture.colors());
    if request.denoise.is_some() {
        picture.rgb = Picture::open(output, Some(DENOISED))?.rgb;
    }
    let opaque = background != Background::Transparent;
    preview::write_picture(png, &picture, opaque, &Look { view: view.clone(), exposure }, mark)?;
    Ok(exposure)
}

/// Text stored in a PNG, which differs for PNGs of other renders, views, exposures and numbers of paths.
pub fn preview_mark(request: &RenderRequest, view: &ViewTransform, inputs: &Inputs, paths: u64) -> String {
    let key = inputs.identity(request, &request.settings()).request(&request.requested());
    format!("view {}, exposure {}, {paths} paths of {key}", view.key(), request.exposure)
}
