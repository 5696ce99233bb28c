//! One command's render: from a scene in memory, or from what the output file holds, to the output file.

use std::cell::{Cell, RefCell};
use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use tracing::{info, warn};

use super::choose::settings;
use super::identity::Inputs;
use super::keep::Keeper;
use super::loaded::Loaded;
use super::names::names;
use super::{RenderArgs, warnings};
use crate::cli::memory::{self, Need};
use crate::cli::stats::{self, Seconds, Stats};
use crate::console::tev::Tev;
use crate::film::denoise::Denoiser;
use crate::film::exr_file::{HeaderValue, WORLD_TO_CAMERA, WORLD_TO_NDC};
use crate::film::{Background, Look, Picture, colors, denoised, exr_file, preview};
use crate::render::checkpoint::{self, Earlier, Host};
use crate::render::camera::lens;
use crate::render::prepass::{guiding::MEMORY, learned_lights};
use crate::render::{
    Guiding, Identity, Pause, Progress, Record, RenderSettings, Rendered, RunOptions, Saved, StopReason, camera, run,
};
use crate::{Error, Result};

/// Seconds between pictures for a viewer.
const SECONDS_BETWEEN_SHOWS: f64 = 2.0;
/// The layer without noise.
const DENOISED: &str = "denoised";

/// What came of it.
pub enum Done {
    /// Rendered; all that is known of it.
    Rendered(PathBuf, Box<Stats>),
    /// The file was there already, with so many paths a pixel; the exposure of a PNG that has been developed anew.
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
                    Some(exposure) => write!(f, "the PNG is developed anew, exposure {exposure} EV"),
                }
            }
        }
    }
}

/// One command's render.
#[derive(Clone, Copy)]
pub struct Session<'a> {
    /// The command's flags.
    pub args: &'a RenderArgs,
    /// The contents that they name.
    pub inputs: &'a Inputs,
    /// Threads that render.
    pub threads: usize,
    /// When `--time` began to count.
    pub began: Instant,
    /// When `--resume` finds another render in the output file, or one that cannot go on: begin anew, or refuse?
    pub replaces: bool,
}

impl Session<'_> {
    /// With `--resume`: is there nothing left to do? Judged by files alone, and every byte of the picture's.
    ///
    /// # Errors
    /// As [`Earlier::read`] and, unless it replaces what is there, [`Earlier::verify`].
    pub fn done_before(&self) -> Result<Option<Earlier>> {
        let output = self.args.output();
        if !self.args.resume {
            return Ok(None);
        }
        let Some(earlier) = Earlier::read(&output)? else { return Ok(None) };
        let settings = self.args.settings();
        let answers = earlier.record.matches(&self.inputs.identity(self.args, &settings), &self.args.asked());
        if !answers || !self.is_done(&earlier, &settings) {
            return Ok(None);
        }
        match earlier.verify() {
            Err(Error::Data(why)) if self.replaces => {
                warn!("{why}: it is rendered anew");
                Ok(None)
            }
            verified => verified.map(|()| Some(earlier)),
        }
    }

    /// What is left to do for a finished picture: its PNG is developed from the file if it is not there or was made with
    /// another view, exposure or number of paths; its statistics are written anew if they are not those of this file.
    ///
    /// # Errors
    /// As [`Picture::open`], [`preview::write_picture`] and [`stats::write_again`].
    pub fn develop(&self, earlier: &Earlier) -> Result<Done> {
        let (args, output, record) = (self.args, self.args.output(), &earlier.record);
        if let Some(path) = &args.stats {
            stats::write_again(path, &earlier.header, &exr_file::checksum(&output)?)?;
        }
        let mark = self.mark(record.stats.paths);
        let Some(png) = args.preview.as_ref().filter(|png| preview::mark(png).as_ref() != Some(&mark)) else {
            return Ok(Done::Before(output, record.spp(), None));
        };
        let exposure = self.develop_file(png, record.background, &mark)?;
        Ok(Done::Before(output, record.spp(), Some(exposure)))
    }

    /// Develops a PNG from the picture's file, without noise if the command wants that; its exposure.
    fn develop_file(&self, png: &Path, background: Background, mark: &str) -> Result<f32> {
        let (args, output) = (self.args, self.args.output());
        let mut picture = Picture::open(&output, None)?;
        let exposure = args.exposure.of(picture.rgb.iter().copied());
        if args.denoise.is_some() {
            picture.rgb = Picture::open(&output, Some(DENOISED))?.rgb;
        }
        let opaque = background != Background::Transparent;
        preview::write_picture(png, &picture, opaque, Look { view: args.view, exposure }, mark)?;
        Ok(exposure)
    }

    /// What a PNG says of its making, so that one that was made otherwise is known.
    fn mark(&self, paths: u64) -> String {
        let args = self.args;
        let request = self.inputs.identity(args, &args.settings()).request(&args.asked());
        format!("view {}, exposure {}, {paths} paths of {request}", args.view.name(), args.exposure)
    }

    /// Are its stop rule and its wishes for other files fulfilled?
    fn is_done(&self, earlier: &Earlier, settings: &RenderSettings) -> bool {
        let (a, record) = (self.args, &earlier.record);
        // A PNG is developed from the picture, and so are statistics, which older files do not carry.
        let others = a.stats.as_ref().is_none_or(|path| stats::are_in(&earlier.header) || path.exists());
        // A picture that is to be gone on from later must be able to.
        let carries = a.checkpoint.is_none() || record.resumable;
        others && carries && record.is_done(settings)
    }

    /// Fails if there is not enough memory, by what the files say of themselves; else how much there is.
    ///
    /// # Errors
    /// [`Error::Host`].
    pub fn check_memory(&self) -> Result<memory::Limit> {
        // Where the size follows from the camera, which is not known yet, the default's share of the whole is small.
        let (width, height) = self.args.size.map_or((960, 540), |s| (s.0, s.1));
        let pixels = match self.args.crop {
            Some(crop) => {
                crop.inside(u32::MAX, u32::MAX).map_or(0, |[x0, y0, x1, y1]| u64::from(x1 - x0) * u64::from(y1 - y0))
            }
            None => u64::from(width) * u64::from(height),
        };
        let settings = self.args.settings();
        let guiding = match settings.guiding {
            Guiding::Off => 0,
            _ => settings.guiding_memory.unwrap_or(MEMORY),
        };
        let need = Need {
            scene: &self.inputs.scene,
            environment_bytes: self.inputs.environment.1,
            pixels,
            columns: settings.columns(),
            saves: self.saves(),
            pilots: guiding + learned_lights::bytes(&settings),
            rays: self.args.rays,
            threads: self.threads,
        };
        let limit = memory::limit(self.args.memory_limit)?;
        info!("needs about {} MiB of memory; {} allows {}", need.bytes() >> 20, limit.1, limit.0 >> 20);
        memory::check(&self.args.scene.display().to_string(), need.bytes(), limit).map(|()| limit)
    }

    fn saves(&self) -> bool {
        self.args.checkpoint.is_some() || self.args.part.is_some()
    }

    /// Renders, saving now and then if that was asked for, and writes what the command asks for.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once what there is has been saved; those of outputs; [`Error::Data`] for an output file
    /// that holds something else, with `--resume`.
    pub fn render(
        &self,
        loaded: &Loaded,
        stop: &AtomicBool,
        progress: &(dyn Fn(Progress) + Sync),
        rendering_ends: &dyn Fn(bool),
    ) -> Result<Done> {
        let args = self.args;
        let output = args.output();
        let settings = settings(args, &loaded.prepared.scene)?;
        lens(&loaded.prepared, &settings)?;
        let backend = loaded.prepared.rays.info();
        let identity = self.inputs.identity(args, &settings);
        let (from, kept) = match self.go_on_from(&identity, loaded)? {
            Some((saved, kept)) => (Some(saved), kept),
            None => (None, false),
        };
        let keeps = kept || args.checkpoint.is_some();
        let before = from.as_ref().map_or(0, |f| f.stats.paths);
        let asked = args.asked();
        let seconds =
            Cell::new(Seconds { read: loaded.read_seconds, build: loaded.build_seconds, ..Default::default() });
        // Before the work, not after it.
        let denoiser = args.denoise.map(|_| Denoiser::load()).transpose()?;
        let clean = RefCell::new(None);
        let write = |rendered: &Rendered, with_statistics: bool, last: bool| -> Result<Stats> {
            let start = Instant::now();
            let render = rendered.stats.render_seconds;
            let mut stats = Stats::new(
                &args.scene,
                &loaded.prepared.scene,
                backend,
                self.threads,
                rendered,
                Seconds { render, ..seconds.get() },
            );
            let record = Record::new(&identity, &asked, rendered, Host::of(backend), keeps);
            stats.exposure = args.exposure.of(colors(&rendered.pixels()));
            let mut header = stats.header()?;
            let matrices = camera(&loaded.prepared.scene, &settings).matrices();
            let named = [WORLD_TO_CAMERA, WORLD_TO_NDC].into_iter().zip(matrices);
            header.extend(named.map(|(name, matrix)| (name.into(), HeaderValue::Matrix(matrix))));
            header.extend(names(&loaded.prepared.scene, &args.aovs())?);
            if let Some(denoiser) = denoiser.as_ref().filter(|_| last) {
                *clean.borrow_mut() = Some(denoised(denoiser, &rendered.pixels())?);
            }
            checkpoint::write(&output, rendered, &record, header, clean.borrow().as_deref(), with_statistics)?;
            let write = seconds.get().write + start.elapsed().as_secs_f64();
            seconds.set(Seconds { write, ..seconds.get() });
            Ok(stats)
        };
        let mut keeper = Keeper::new(&output, args.keep, args.on_checkpoint.as_deref());
        let preview = |rendered: &Rendered, stats: &Stats| {
            let Some(path) = &args.preview else { return Ok(()) };
            let mark = self.mark(rendered.stats.paths);
            if clean.borrow().is_some() {
                return self.develop_file(path, rendered.background, &mark).map(drop);
            }
            preview::write(path, &rendered.pixels(), Look { view: args.view, exposure: stats.exposure }, &mark)
        };
        let save_both = |rendered: &Rendered| write(rendered, true, false).and_then(|stats| preview(rendered, &stats));
        let mut save = |rendered: &Rendered| match save_both(rendered) {
            Ok(()) => {
                info!("saved {} with {} paths", output.display(), rendered.stats.paths);
                keeper.saved();
            }
            Err(e) => warn!("not saved; rendering goes on: {e}"),
        };
        let mut viewer = args.tev.as_ref().and_then(|address| {
            let name = output.display().to_string();
            Tev::open(address, &name, settings.window()).inspect_err(|e| warn!("{e}; rendering goes on without")).ok()
        });
        let mut show = |rendered: &Rendered| {
            if let Some(Err(e)) = viewer.as_mut().map(|tev| tev.show(&rendered.pixels())) {
                warn!("{e}; rendering goes on without");
                viewer = None;
            }
        };
        let save = args.checkpoint.map(|seconds| Pause { seconds, at: &mut save });
        let mut pauses: Vec<Pause> = save.into_iter().collect();
        if args.tev.is_some() {
            pauses.push(Pause { seconds: SECONDS_BETWEEN_SHOWS, at: &mut show });
        }
        let rendered = run(
            &loaded.prepared,
            &settings,
            RunOptions { began: self.began, from, pauses, ..RunOptions::new(stop, progress) },
        )?;
        show(&rendered);
        let interrupted = rendered.stop == StopReason::Interrupted;
        rendering_ends(!interrupted);

        let (fewest, most) = rendered.paths_range();
        let shown = output.display();
        if most == 0 {
            return Err(match interrupted {
                true => Error::Interrupted(format!("interrupted before the first path: {shown} is not written")),
                false => Error::Usage(format!(
                    "--time is over before the first path: {shown} is not written; give it longer"
                )),
            });
        }
        if interrupted && rendered.stats.paths == before {
            let why = format!("interrupted before another tile was done: {shown} is as it was");
            return Err(Error::Interrupted(why));
        }
        if !interrupted {
            warnings::of_darkness(&output, &rendered, args.part.is_some());
        }
        let mut stats = write(&rendered, interrupted || keeps || args.part.is_some(), true)?;
        if interrupted {
            keeper.saved();
        }
        let writing = Instant::now();
        preview(&rendered, &stats)?;
        stats.seconds.write = seconds.get().write + writing.elapsed().as_secs_f64();
        stats.seconds.total = self.began.elapsed().as_secs_f64();
        if let Some(path) = &args.stats {
            stats.picture = exr_file::checksum(&output)?;
            stats.write(path)?;
        }
        if interrupted {
            let spp = if fewest == most { fewest.to_string() } else { format!("{fewest} to {most}") };
            let again = if self.replaces { "the same command" } else { "the same command with --resume" };
            return Err(Error::Interrupted(format!(
                "interrupted: {shown} is saved with {spp} paths a pixel; {again} goes on from there"
            )));
        }
        stats.shown = args.preview.is_some();
        if fewest == 0 {
            let (empty, all) = rendered.pixels_without_paths();
            let share = 100.0 * empty as f64 / all as f64;
            warn!(
                "{shown}: {empty} of {all} pixels ({share:.0} %) have no paths and are black: --time was over; give it longer, or \
                 make the picture smaller"
            );
        }
        Ok(Done::Rendered(output.clone(), Box::new(stats)))
    }

    /// With `--resume`, what the output file holds, and whether it shall still do so when it is done.
    fn go_on_from(&self, ours: &Identity, loaded: &Loaded) -> Result<Option<(Saved, bool)>> {
        let output = self.args.output();
        let earlier = if self.args.resume { Earlier::read(&output)? } else { None };
        let Some(earlier) = earlier else { return Ok(None) };
        let saved = match earlier.saved(ours) {
            Err(Error::Data(why)) if self.replaces => {
                info!("{why}");
                return Ok(None);
            }
            other => other?,
        };
        warnings::of_another_making(&output, &earlier.record, &saved, loaded.prepared.rays.info(), &ours.settings);
        info!("goes on from {} with {} paths", output.display(), saved.stats.paths);
        Ok(Some((saved, earlier.record.resumable)))
    }
}
