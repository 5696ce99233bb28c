//! The render of one command, new or resumed, and whether there is anything left to do.

use std::fmt::{self, Display};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use tracing::{info, warn};

use super::checkpoints::Checkpoints;
use super::inputs::Inputs;
use super::loaded::Loaded;
use super::memory::{self, Need};
use super::output::{OutputWriter, develop_file, preview_mark};
use super::request::RenderRequest;
use super::settings::{settings, size_of_aspect};
use super::stats::{self, Stats};
use super::warnings;
use crate::console::tev::Tev;
use crate::film::{exr_file, preview};
use crate::render::record::checkpoint::Earlier;
use crate::render::settings::camera::lens;
use crate::render::settings::part::TILE;
use crate::render::{Identity, Pause, Progress, RenderSettings, Rendered, RunOptions, Saved, StopReason, run};
use crate::{Error, Result};

/// Seconds between updates of the viewer.
const VIEWER_INTERVAL_SECONDS: f64 = 2.0;

/// Number of instances or lights from which they are named where memory is too little.
const MANY: u64 = 10_000;

/// Result of a render command.
pub enum Done {
    /// The picture was rendered: its path and statistics.
    Rendered(PathBuf, Box<Stats>),
    /// The picture was finished before: its path, paths per pixel, and the exposure of the PNG if that was written again.
    Before(PathBuf, u32, Option<f32>),
}

impl Display for Done {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Done::Rendered(path, stats) => write!(f, "{}: {}", path.display(), stats.summary()),
            Done::Before(path, spp, png) => {
                write!(f, "{}: finished before, with {spp} spp: ", path.display())?;
                match png {
                    None => write!(f, "nothing to do"),
                    Some(exposure) => write!(f, "the PNG is written again, exposure {exposure} EV"),
                }
            }
        }
    }
}

/// A render command with its inputs.
#[derive(Clone, Copy)]
pub struct Session<'a> {
    /// What is asked for.
    pub request: &'a RenderRequest,
    /// Files that it names.
    pub inputs: &'a Inputs,
    /// Number of render threads.
    pub threads: usize,
    /// Start of the time that `--time` limits.
    pub began: Instant,
    /// What `--resume` does with an output file that holds another render or cannot be resumed: true starts again, false
    /// is an error.
    pub replaces: bool,
}

impl Session<'_> {
    /// The finished picture in the output file, if `--resume` is given and nothing is left to render. Reads files only, and
    /// verifies the picture's checksum.
    pub(crate) fn finished_before(&self) -> Result<Option<Earlier>> {
        let output = &self.request.output;
        if !self.request.resume {
            return Ok(None);
        }
        let Some(earlier) = Earlier::read(output)? else { return Ok(None) };
        let settings = &self.request.settings();
        let answers = earlier.record.matches(&self.inputs.identity(self.request, settings), &self.request.requested());
        if !answers || !self.is_done(&earlier, settings) {
            return Ok(None);
        }
        match earlier.verify() {
            Err(Error::Data(why)) if self.replaces => {
                warn!("{why}: rendering it again");
                Ok(None)
            }
            verified => verified.map(|()| Some(earlier)),
        }
    }

    /// Completes the other outputs of a finished picture: writes the PNG from the EXR if it is missing or was made with
    /// another view, exposure or number of paths, and the statistics if they are not those of this EXR.
    ///
    /// # Errors
    /// Those of reading the EXR and of writing the PNG and the statistics.
    pub fn develop(&self, earlier: &Earlier) -> Result<Done> {
        let (request, output, record) = (self.request, self.request.output.clone(), &earlier.record);
        if let Some(path) = &request.stats {
            stats::write_again(path, &earlier.header, &exr_file::checksum(&output)?)?;
        }
        let view = request.view.transform()?;
        let mark = preview_mark(request, &view, self.inputs, record.stats.paths);
        let Some(png) = request.preview.as_ref().filter(|png| preview::mark(png).as_ref() != Some(&mark)) else {
            return Ok(Done::Before(output, record.spp(), None));
        };
        let exposure = develop_file(request, &view, png, record.background, &mark)?;
        Ok(Done::Before(output, record.spp(), Some(exposure)))
    }

    /// Whether the picture meets the command's stop rule and its other requests.
    fn is_done(&self, earlier: &Earlier, settings: &RenderSettings) -> bool {
        let (request, record) = (self.request, &earlier.record);
        // Statistics can be written from the header, except for pictures whose header has none.
        let has_stats = request.stats.as_ref().is_none_or(|path| stats::are_in(&earlier.header) || path.exists());
        let is_resumable = request.checkpoint.is_none() || record.resumable;
        has_stats && is_resumable && record.is_done(settings)
    }

    /// Compares the estimated memory with the limit, before anything is decoded; returns the limit.
    /// Errors: [`Error::Host`] if the render needs more.
    pub(crate) fn check_memory(&self) -> Result<memory::Limit> {
        let (request, scene) = (self.request, &self.inputs.scene);
        let (width, height) = request.size.map_or_else(|| self.size_by_camera(), |s| (s.0, s.1));
        let settings = RenderSettings { width, height, ..request.settings() };
        let [x0, y0, x1, y1] = settings.window().map(u64::from);
        // A window that is not inside the picture is an error once the camera is known.
        let window_pixels = if x1 <= width.into() && y1 <= height.into() { (x1 - x0) * (y1 - y0) } else { 0 };
        // Parts differ by at most one tile.
        let pixels = match request.part {
            Some(part) => window_pixels.div_ceil(part.of.into()) + u64::from(TILE * TILE),
            None => window_pixels,
        };
        let need = Need {
            scene,
            environment: self.inputs.environment.1,
            settings: &settings,
            pixels,
            window_pixels,
            saves: request.checkpoint.is_some() || request.part.is_some(),
            denoises: request.denoise.is_some(),
            rays: request.rays,
            threads: self.threads,
        };
        let limit = memory::limit(request.memory_limit)?;
        info!("needs about {} MiB of memory; {} allows {}", need.bytes().div_ceil(1 << 20), limit.1, limit.0 >> 20);
        let (instances, lights) = (scene.census.instances, scene.census.emissive_triangles);
        let mut what = request.scene.display().to_string();
        if instances.max(lights) > MANY {
            what += &format!(" with {instances} instances and {lights} emissive triangles in them");
        }
        memory::check(&what, need.bytes(), limit).map(|()| limit)
    }

    /// Resolution of a picture without `--size`, by the document's cameras.
    fn size_by_camera(&self) -> (u32, u32) {
        let cameras = &self.inputs.scene.census.cameras;
        let chosen = match self.request.camera.as_deref() {
            None => cameras.first(),
            Some(wanted) => {
                let by_index = || cameras.get(wanted.parse::<usize>().ok()?);
                cameras.iter().find(|camera| camera.0 == wanted).or_else(by_index)
            }
        };
        size_of_aspect(chosen.and_then(|camera| camera.1))
    }

    /// Renders, saves checkpoints, and writes the outputs.
    ///
    /// `rendering_ends` is called once before the outputs are written; its argument tells whether the render is complete.
    ///
    /// # Errors
    /// [`Error::Interrupted`] after the picture so far has been saved; [`Error::Data`] for an output file that holds
    /// another render, with `--resume`; those of writing the outputs.
    pub fn render(
        &self,
        loaded: &Loaded,
        stop: &AtomicBool,
        progress: &(dyn Fn(Progress) + Sync),
        rendering_ends: &dyn Fn(bool),
    ) -> Result<Done> {
        let request = self.request;
        let output = &request.output;
        let placed = loaded.placed(request)?;
        let loaded = placed.as_ref().unwrap_or(loaded);
        let settings = settings(request, &loaded.prepared.scene)?;
        if let Some(lens) = lens(&loaded.prepared, &settings)? {
            warnings::wide_lens(request, lens.radius, lens.focus);
        }
        if settings.clip {
            warnings::clipped(request, &loaded.prepared, settings.camera);
        }
        let identity = self.inputs.identity(request, &settings);
        let (resumed, was_resumable) = self.resume(&identity, loaded)?.unzip();
        let resumable = was_resumable == Some(true) || request.checkpoint.is_some();
        let paths_before = resumed.as_ref().map_or(0, |saved| saved.stats.paths);
        let writer = OutputWriter::new(request, self.inputs, loaded, self.threads, &identity, resumable)?;
        let mut checkpoints = Checkpoints::new(output, request.keep, request.on_checkpoint.as_deref());
        let rendered = {
            let mut save = |rendered: &Rendered| match writer.checkpoint(rendered) {
                Ok(()) => {
                    info!("saved {} with {} paths", output.display(), rendered.stats.paths);
                    checkpoints.saved();
                }
                Err(e) => warn!("checkpoint not saved, rendering continues: {e}"),
            };
            let mut viewer = self.viewer(&settings);
            let mut show = |rendered: &Rendered| {
                if let Some(Err(e)) = viewer.as_mut().map(|tev| tev.show(&rendered.pixels())) {
                    warn!("{e}; rendering continues without the viewer");
                    viewer = None;
                }
            };
            let save = request.checkpoint.map(|seconds| Pause { seconds, at: &mut save });
            let mut pauses: Vec<Pause> = save.into_iter().collect();
            if request.tev.is_some() {
                pauses.push(Pause { seconds: VIEWER_INTERVAL_SECONDS, at: &mut show });
            }
            let options = RunOptions { began: self.began, from: resumed, pauses, ..RunOptions::new(stop, progress) };
            let rendered = run(&loaded.prepared, &settings, options)?;
            show(&rendered);
            rendered
        };
        let interrupted = rendered.stop == StopReason::Interrupted;
        rendering_ends(!interrupted);
        self.check_paths(&rendered, paths_before)?;
        if !interrupted {
            let (part, lights) = (request.part.is_some(), &loaded.prepared.scene.lights);
            warnings::black_picture(output, &rendered, part, lights, request.light_unit);
        }
        let mut stats =
            writer.write_final(&rendered, interrupted || resumable || request.part.is_some(), self.began, stop)?;
        if interrupted {
            checkpoints.saved();
            return Err(self.interrupted(&rendered));
        }
        stats.has_preview = request.preview.is_some();
        warnings::empty_pixels(output, &rendered);
        Ok(Done::Rendered(output.clone(), Box::new(stats)))
    }

    /// The connection to tev, if there is one.
    fn viewer(&self, settings: &RenderSettings) -> Option<Tev> {
        let address = self.request.tev.as_ref()?;
        let name = self.request.output.display().to_string();
        let viewer = Tev::open(address, &name, settings.window());
        viewer.inspect_err(|e| warn!("{e}; rendering continues without the viewer")).ok()
    }

    /// Fails for a render without paths, and for an interrupted one without new paths.
    fn check_paths(&self, rendered: &Rendered, paths_before: u64) -> Result<()> {
        let interrupted = rendered.stop == StopReason::Interrupted;
        let output = self.request.output.display();
        match (rendered.paths_range(), interrupted) {
            ((_, 0), true) => {
                Err(Error::Interrupted(format!("interrupted before the first path: {output} is not written")))
            }
            ((_, 0), false) => Err(Error::Usage(format!(
                "--time ended before the first path: {output} is not written; give it more time"
            ))),
            (_, true) if rendered.stats.paths == paths_before => {
                Err(Error::Interrupted(format!("interrupted before another tile was done: {output} is unchanged")))
            }
            _ => Ok(()),
        }
    }

    /// The error of an interrupted render that has been saved.
    fn interrupted(&self, rendered: &Rendered) -> Error {
        let (fewest, most) = rendered.paths_range();
        let spp = if fewest == most { fewest.to_string() } else { format!("{fewest} to {most}") };
        let again = if self.replaces { "the same command" } else { "the same command with --resume" };
        let output = &self.request.output;
        Error::Interrupted(format!(
            "interrupted: {} is saved with {spp} paths per pixel; {again} continues from there",
            output.display()
        ))
    }

    /// With `--resume`, the state that the output file holds, and whether the finished picture shall hold it too.
    fn resume(&self, identity: &Identity, loaded: &Loaded) -> Result<Option<(Saved, bool)>> {
        let output = &self.request.output;
        let earlier = if self.request.resume { Earlier::read(output)? } else { None };
        let Some(earlier) = earlier else { return Ok(None) };
        let saved = match earlier.saved(identity) {
            Err(Error::Data(why)) if self.replaces => {
                info!("{why}");
                return Ok(None);
            }
            other => other?,
        };
        warnings::resumed_differently(output, &earlier.record, &saved, loaded.prepared.rays.info(), &identity.settings);
        info!("continuing {} with {} paths", output.display(), saved.stats.paths);
        Ok(Some((saved, earlier.record.resumable)))
    }
}
