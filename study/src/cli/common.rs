//! What the command lines of all studies share.

use std::path::{Path, PathBuf};
use std::time::Instant;

use bismar::Result;
use bismar::console::args::threads;
use bismar::console::progress::Style;
use bismar::console::{Reporter, Verbosity};
use bismar::film::atomic;
use bismar::render::Progress;
use clap::Args;

use crate::files;

/// Flags of every study.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(super) threads: Option<usize>,
    /// Progress display.
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    pub(super) progress: Style,
}

impl RunArgs {
    pub(super) fn reporter(&self, verbosity: Verbosity) -> Reporter {
        Reporter::new(self.progress, verbosity.quiet)
    }
}

/// Progress of a study without pictures of its own: only the fraction that is done and the time.
pub(super) fn progress(fraction: f64, start: Instant) -> Progress {
    let seconds = start.elapsed().as_secs_f64();
    Progress { fraction, seconds, rays: 0, noise: f64::INFINITY, spp: 0, mean_spp: 0.0 }
}

/// Creates a study's folder and checks that its page can be written, before hours of work; returns the page's path.
pub(super) fn open(folder: &Path) -> Result<PathBuf> {
    atomic::confine(&[folder.into()]);
    files::folder(folder)?;
    let page = folder.join("report.html");
    atomic::check(&page)?;
    Ok(page)
}
