//! Progress of a batch: bars on a terminal, lines elsewhere.

use std::io::{self, IsTerminal};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use serde_json::{Value, json};

use crate::batch::report::{Entry, Status};
use crate::console::progress::{Style, samples};
use crate::console::screen::{self, clock};
use crate::console::{print, say};
use crate::render::Progress;

/// Shows progress, which any thread may report.
pub struct Overview {
    quiet: bool,
    style: Style,
    terminal: bool,
    all: ProgressBar,
    state: Mutex<State>,
    began: Instant,
}

struct State {
    jobs: Vec<Fraction>,
    failed: usize,
    ended: usize,
    printed: Option<Instant>,
    percent: u32,
}

#[derive(Clone, Default)]
struct Fraction {
    /// Fraction done, in [0, 1].
    done: f64,
    /// Whether it took no time: finished before this command, or not begun.
    before: bool,
    bar: Option<ProgressBar>,
}

impl Overview {
    /// Progress of `jobs` jobs; `Style::Auto` is silent when `quiet`.
    pub fn new(jobs: usize, style: Style, quiet: bool) -> Self {
        let terminal = match style {
            Style::Auto => io::stderr().is_terminal() && !quiet,
            style => style == Style::Bar,
        };
        let all = match terminal {
            true => screen::bar(jobs as u64, "{wide_bar} {pos}/{len} jobs  {msg}"),
            false => ProgressBar::hidden(),
        };
        let state = State { jobs: vec![Fraction::default(); jobs], failed: 0, ended: 0, printed: None, percent: 0 };
        Self { quiet, style, terminal, all, state: Mutex::new(state), began: Instant::now() }
    }

    pub fn begins(&self, index: usize, name: &str) {
        if !self.terminal {
            return;
        }
        let bar = screen::bar(1000, "  {wide_bar} {prefix}  {msg}");
        bar.set_prefix(short(name));
        self.lock().jobs[index].bar = Some(bar);
    }

    pub fn progress(&self, index: usize, progress: &Progress) {
        let Ok(mut state) = self.state.try_lock() else { return };
        let job = &mut state.jobs[index];
        job.done = progress.fraction.clamp(job.done, 1.0);
        if let Some(bar) = &job.bar {
            bar.set_position((1000.0 * job.done) as u64);
            let mrays = progress.rays as f64 / progress.seconds.max(1e-9) / 1e6;
            let percent = 100.0 * job.done.min(0.999);
            bar.set_message(format!("{percent:.1}%  {}  {mrays:.1} Mrays/s", samples(progress)));
        }
        self.show(&mut state);
    }

    /// Call when a job has ended; `line` is its result as text.
    pub fn ended(&self, index: usize, entry: &Entry, line: Option<String>) {
        let mut state = self.lock();
        state.ended += 1;
        state.failed += usize::from(entry.status == Status::Failed);
        let job = &mut state.jobs[index];
        job.done = 1.0;
        job.before = matches!(entry.status, Status::Before | Status::Pending);
        if let Some(bar) = job.bar.take() {
            screen::remove(&bar);
        }
        self.all.set_position(state.ended as u64);
        // Errors are printed even with --quiet.
        if let Some(line) = line.filter(|_| !self.quiet || entry.error.is_some()) {
            say(line);
        }
        self.show(&mut state);
    }

    pub fn finish(&self) {
        screen::remove(&self.all);
        let state = self.lock();
        if !self.silent() && !self.terminal && state.jobs.iter().all(|j| j.done == 1.0) {
            self.line(100, &state);
        }
    }

    fn silent(&self) -> bool {
        self.style == Style::None || self.style == Style::Auto && self.quiet
    }

    /// Prints a line for programs and logs.
    fn line(&self, percent: u32, state: &State) {
        // A reader that has gone away must not stop the render.
        let _ = match self.style {
            Style::Openjd => print(format_args!("openjd_progress: {percent}")),
            Style::Json => print(json!({ "phase": "jobs", "fraction": f64::from(percent) / 100.0,
                "jobs": state.jobs.len(), "ended": state.ended, "failed": state.failed })),
            _ => {
                say(format_args!("PROGRESS: {percent}%"));
                Ok(())
            }
        };
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show(&self, state: &mut State) {
        if self.silent() {
            return;
        }
        // Jobs that took no time say nothing about the time left.
        let new = state.jobs.iter().filter(|j| !j.before);
        let (sum, count) = new.fold((0.0, 0), |(sum, n), j| (sum + j.done, n + 1));
        let fraction = if count == 0 { 1.0 } else { sum / f64::from(count) };
        if self.terminal {
            let seconds = self.began.elapsed().as_secs_f64();
            let (now, left) = (clock(seconds), clock(seconds * (1.0 - fraction) / fraction));
            let running = state.jobs.iter().filter(|j| j.bar.is_some()).count();
            self.all.set_message(format!("{running} running, {} failed  {now}, {left} left", state.failed));
        } else if state.printed.is_none_or(|t| t.elapsed() >= Duration::from_secs(1)) {
            state.printed = Some(Instant::now());
            let all: f64 = state.jobs.iter().map(|j| j.done).sum();
            state.percent = state.percent.max((100.0 * all / state.jobs.len() as f64) as u32).min(99);
            self.line(state.percent, state);
        }
    }
}

/// A job's name in at most 24 characters: its beginning and its end.
fn short(name: &str) -> String {
    let all: Vec<char> = name.chars().collect();
    match all.len() {
        0..=24 => name.into(),
        n => all[..8].iter().chain(&['…']).chain(&all[n - 15..]).collect(),
    }
}

/// Paths per pixel, noise, Mrays/s and MiB of a job's statistics; empty where unknown.
fn columns(stats: &Value) -> [String; 4] {
    let number = |value: &Value, digits: usize| value.as_f64().map_or(String::new(), |x| format!("{x:.digits$}"));
    let memory = stats["peak_memory_bytes"].as_u64().map_or(String::new(), |bytes| (bytes >> 20).to_string());
    let (spp, speed) = (number(&stats["samples"]["pixel_mean"], 0), number(&stats["mrays_per_second"], 2));
    [spp, number(&stats["noise"], 4), speed, memory]
}

/// Table of the results of all jobs.
pub fn table(entries: &[Entry]) -> String {
    let mut rows = vec![["job", "status", "seconds", "spp", "noise", "Mrays/s", "MiB"].map(str::to_owned)];
    for entry in entries {
        let status = serde_json::to_value(entry.status).ok().and_then(|s| s.as_str().map(str::to_owned));
        let status = status.unwrap_or_default();
        let stats = entry.statistics();
        let seconds = stats.as_ref().map(|_| format!("{:.2}", entry.seconds)).unwrap_or_default();
        let [spp, noise, speed, memory] = stats.as_ref().map(columns).unwrap_or_default();
        rows.push([entry.job.clone(), status, seconds, spp, noise, speed, memory]);
    }
    let width = |c: usize| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
    let widths: [usize; 7] = std::array::from_fn(width);
    let line = |row: &[String; 7]| {
        let cell = |c: usize| match c {
            0 | 1 => format!("{:<w$}", row[c], w = widths[c]),
            _ => format!("{:>w$}", row[c], w = widths[c]),
        };
        let text = (0..7).map(cell).collect::<Vec<_>>().join("  ");
        format!("{}\n", text.trim_end().replace(char::is_control, "?"))
    };
    rows.iter().map(line).collect()
}
