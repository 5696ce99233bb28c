//! Progress reports, for people on a terminal and for programs that start renders.

use std::io::{self, IsTerminal};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;
use std::time::Duration;

use indicatif::ProgressBar;
use serde_json::json;

use super::screen::{self, clock};
use super::writers::progress as out;
use super::{escaped, say};
use crate::Error;
use crate::render::Progress;

/// The format of progress reports.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Style {
    /// A bar if stderr is a terminal, else plain.
    #[default]
    Auto,
    /// A bar on stderr, with time, paths, noise and Mrays/s.
    Bar,
    /// `PROGRESS: 42%` on stderr, at most once a second; before it, while a long build lasts, `BUILD: 42%`.
    Plain,
    /// One JSON object a line on stdout, at most once a second; its `phase` is `build` or `render`.
    Json,
    /// `openjd_progress: 42` on stdout, at most once a second.
    Openjd,
    /// Nothing.
    None,
}

/// Accepts progress from any thread without blocking it. A thread of its own prints it.
pub struct Reporter {
    pending: Arc<(Mutex<Pending>, Condvar)>,
}

/// Progress that has not been printed yet.
#[derive(Default)]
struct Pending {
    render: Option<Progress>,
    build: Option<(f64, f64)>,
    /// The render has ended; is it complete?
    end: Option<bool>,
    /// All has been printed.
    printed: bool,
}

impl Reporter {
    /// A reporter; `auto` is silent when `quiet`.
    pub fn new(style: Style, quiet: bool) -> Self {
        let pending = Arc::new((Mutex::new(Pending::default()), Condvar::new()));
        let mut printer = Printer::new(style, quiet);
        if printer.style == Style::None {
            return Self::silent();
        }
        let theirs = Arc::clone(&pending);
        let show = move || {
            let (pending, changed) = &*theirs;
            let is_old =
                |pending: &mut Pending| pending.render.is_none() && pending.build.is_none() && pending.end.is_none();
            loop {
                let Ok(mut now) = pending.lock().and_then(|pending| changed.wait_while(pending, is_old)) else {
                    return;
                };
                let Pending { render, build, end, .. } = std::mem::take(&mut *now);
                drop(now);
                if let Some((done, seconds)) = build {
                    printer.building(done, seconds);
                }
                if let Some(progress) = render {
                    printer.update(progress);
                }
                if let Some(complete) = end {
                    printer.finish(complete);
                    if let Ok(mut pending) = pending.lock() {
                        pending.printed = true;
                    }
                    changed.notify_all();
                    return;
                }
            }
        };
        // Without a thread nothing is printed, but the render runs.
        let thread = thread::Builder::new().name("progress".into()).spawn(show);
        thread.map_or_else(|_| Self::silent(), |_| Self { pending })
    }

    fn silent() -> Self {
        let printed = Pending { printed: true, ..Pending::default() };
        Self { pending: Arc::new((Mutex::new(printed), Condvar::new())) }
    }

    fn notify(&self, change: impl FnOnce(&mut Pending)) {
        if let Ok(mut pending) = self.pending.0.lock() {
            change(&mut pending);
        }
        self.pending.1.notify_all();
    }

    /// Reports progress of the render. Cheap enough to be called for every tile.
    pub fn update(&self, progress: Progress) {
        self.notify(|pending| pending.render = Some(progress));
    }

    /// Reports progress of the build before the render: its finished fraction in [0, 1] and its seconds so far.
    pub fn building(&self, done: f64, seconds: f64) {
        self.notify(|pending| pending.build = Some((done, seconds)));
    }

    /// Ends the report. The last line of a complete render is that of 100 %. Waits at most a second for the reader.
    pub fn finish(&self, complete: bool) {
        const MAX_WAIT: Duration = Duration::from_secs(1);
        self.notify(|pending| pending.end = Some(complete));
        if let Ok(pending) = self.pending.0.lock() {
            let _ = self.pending.1.wait_timeout_while(pending, MAX_WAIT, |pending| !pending.printed);
        }
    }
}

struct Printer {
    style: Style,
    bar: ProgressBar,
    last: Last,
}

#[derive(Default)]
struct Last {
    progress: Option<Progress>,
    /// Seconds since rendering began when a line was last printed.
    printed: Option<f64>,
    /// Seconds since the build began when its last line was printed. The first is due after a second, so that short
    /// builds print nothing.
    printed_build: f64,
    /// Never decreases, even when the estimates do.
    permille: u32,
}

/// Steps of a bar: tenths of a percent.
const STEPS: u32 = 1000;

impl Printer {
    fn new(style: Style, quiet: bool) -> Self {
        let style = match style {
            Style::Auto if quiet => Style::None,
            Style::Auto if io::stderr().is_terminal() => Style::Bar,
            Style::Auto => Style::Plain,
            chosen => chosen,
        };
        let bar = match style {
            Style::Bar => screen::bar(STEPS.into(), "{wide_bar} {msg}"),
            _ => ProgressBar::hidden(),
        };
        Self { style, bar, last: Last::default() }
    }

    fn update(&mut self, progress: Progress) {
        let (permille, due) = self.last.advance(progress);
        match self.style {
            Style::Bar => {
                self.bar.set_message(message(&progress, permille));
                self.bar.set_position(permille.into());
            }
            _ if due => self.line(&progress, permille / 10),
            _ => {}
        }
    }

    fn building(&mut self, done: f64, seconds: f64) {
        let is_due = seconds - self.last.printed_build >= 1.0;
        let percent = (done * 100.0) as u32;
        match self.style {
            Style::Bar => {
                self.bar.set_position((done * f64::from(STEPS)) as u64);
                self.bar.set_message(format!("{percent}%  {}  building the acceleration structure", clock(seconds)));
            }
            _ if !is_due => {}
            Style::Plain => say(format_args!("BUILD: {percent}%")),
            Style::Json => out(&json!({ "phase": "build", "fraction": done, "seconds": seconds }).to_string()),
            // Percentages are those of the whole job, which must not decrease when rendering begins.
            Style::Openjd => out(&format!("openjd_status: building the acceleration structure, {percent}%")),
            Style::Auto | Style::None => {}
        }
        if is_due {
            self.last.printed_build = seconds;
        }
    }

    fn finish(&self, complete: bool) {
        screen::remove(&self.bar);
        if let (true, Some(progress)) = (complete, self.last.progress) {
            self.line(&Progress { fraction: 1.0, ..progress }, 100);
        }
    }

    fn line(&self, progress: &Progress, percent: u32) {
        match self.style {
            Style::Plain => say(format_args!("PROGRESS: {percent}%")),
            Style::Json => out(&json_line(progress)),
            Style::Openjd => out(&format!("openjd_progress: {percent}")),
            Style::Auto | Style::Bar | Style::None => {}
        }
    }
}

impl Last {
    /// Tenths of a percent to print, below 100 % before the end, and whether a line is due.
    fn advance(&mut self, progress: Progress) -> (u32, bool) {
        self.progress = Some(progress);
        self.permille = self.permille.max((progress.fraction * f64::from(STEPS)) as u32).min(STEPS - 1);
        let due = self.printed.is_none_or(|t| progress.seconds - t >= 1.0);
        if due {
            self.printed = Some(progress.seconds);
        }
        (self.permille, due)
    }
}

/// Tells the scheduler why a render has failed, where this style does so.
pub fn failed(style: Style, error: &Error) {
    if style == Style::Openjd {
        // Open Job Description shows this text for a failed task.
        out(&escaped(&format!("openjd_fail: {}", error.to_string().replace('\n', " "))));
    }
}

fn eta_seconds(progress: &Progress) -> Option<f64> {
    let left = progress.seconds * (1.0 - progress.fraction) / progress.fraction;
    (left.is_finite() && left >= 0.0).then_some(left)
}

fn mrays_per_second(progress: &Progress) -> f64 {
    progress.rays as f64 / progress.seconds.max(1e-9) / 1e6
}

/// The text next to the bar: usually at most 60 columns, so that both fit into 80.
fn message(progress: &Progress, permille: u32) -> String {
    let percent = f64::from(permille) / 10.0;
    let left = eta_seconds(progress).map_or("?".into(), clock);
    let times = format!("{percent:.1}%  {}, {left} left", clock(progress.seconds));
    if progress.rays == 0 {
        return times;
    }
    format!("{times}  {}  {:.1} Mrays/s", samples(progress), mrays_per_second(progress))
}

/// Mean paths per pixel, and the noise once it is known.
pub fn samples(progress: &Progress) -> String {
    let spp = progress.mean_spp;
    let spp = if spp < 100.0 { format!("{spp:.1} spp") } else { format!("{spp:.0} spp") };
    if progress.noise.is_finite() { format!("{spp}  noise {:.4}", progress.noise) } else { spp }
}

fn json_line(progress: &Progress) -> String {
    json!({
        "phase": "render",
        "fraction": progress.fraction,
        "seconds": progress.seconds,
        "eta_seconds": eta_seconds(progress),
        "spp": progress.mean_spp,
        "noise": progress.noise,
        "rays": progress.rays,
        "mrays_per_second": mrays_per_second(progress),
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64, fraction: f64) -> Progress {
        Progress { fraction, seconds, rays: 4_000_000, noise: f64::INFINITY, spp: 8, mean_spp: 12.25 }
    }

    #[test]
    fn lines_come_once_a_second_and_percent_never_falls_nor_ends_early() {
        let mut last = Last::default();
        let lines = [at(0.1, 0.2), at(0.5, 0.3), at(1.1, 0.1), at(1.2, 1.0), at(2.2, 1.0)].map(|p| last.advance(p));
        assert_eq!(lines, [(200, true), (300, false), (300, true), (999, false), (999, true)]);
    }

    #[test]
    fn a_bar_has_room_beside_its_text_in_80_columns() {
        let text = message(&at(252.0, 0.25), 250);
        assert_eq!(text, "25.0%  4:12, 12:36 left  12.2 spp  0.0 Mrays/s");
        let long = Progress { noise: 0.012345, mean_spp: 16384.0, rays: 9 << 40, ..at(7e4, 0.5) };
        let text = message(&long, 999);
        assert_eq!(text, "99.9%  19:26:40, 19:26:40 left  16384 spp  noise 0.0123  141.4 Mrays/s");
        assert!(text.len() <= 72);
    }

    #[test]
    fn json_has_null_for_what_is_not_known_yet() {
        let line: serde_json::Value = serde_json::from_str(&json_line(&at(2.0, 0.0))).unwrap();
        assert_eq!((&line["noise"], &line["eta_seconds"]), (&json!(null), &json!(null)));
        assert_eq!(line["mrays_per_second"], json!(2.0));
        let line: serde_json::Value = serde_json::from_str(&json_line(&at(2.0, 0.25))).unwrap();
        assert_eq!(line["eta_seconds"], json!(6.0));
    }
}
