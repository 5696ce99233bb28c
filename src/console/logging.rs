//! What is said on stderr, and how: lines for people, or JSON for machines.

use std::fmt::Display;
use std::io::{self, IsTerminal};
use std::str::FromStr;
use std::sync::OnceLock;

use serde_json::json;
use tracing::Level;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};
use tracing_subscriber::prelude::*;

use super::{Verbosity, screen, shown};

/// How lines on stderr look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line: `timestamp`, `level`, `message`, and what else is known.
    Json,
}

static FORMAT: OnceLock<Format> = OnceLock::new();

/// Starts logging, as loud as asked for. `RUST_LOG` (as in `warn,bismar::render=debug`) has the last word.
pub fn start(verbosity: Verbosity) {
    let level = match verbosity {
        Verbosity { quiet: true, .. } => Level::ERROR,
        Verbosity { verbose: 0, .. } => Level::WARN,
        Verbosity { verbose: 1, .. } => Level::INFO,
        Verbosity { verbose: 2, .. } => Level::DEBUG,
        _ => Level::TRACE,
    };
    let wish = std::env::var("RUST_LOG").ok().filter(|text| !text.trim().is_empty());
    let chosen = wish.as_ref().map(|text| Targets::from_str(text));
    let targets = match &chosen {
        Some(Ok(targets)) => targets.clone(),
        _ => Targets::new().with_default(level),
    };
    // Those who want to know much want to know when and from where.
    let (when, whence) = (verbosity.verbose > 0 || wish.is_some(), verbosity.verbose > 1 || wish.is_some());
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| screen::Above)
        .with_ansi(io::stderr().is_terminal() && verbosity.log == Format::Text)
        .with_target(whence)
        .log_internal_errors(false);
    let lines = match (verbosity.log, when) {
        (Format::Json, _) => lines.json().flatten_event(true).with_current_span(false).with_span_list(false).boxed(),
        (Format::Text, true) => lines.boxed(),
        (Format::Text, false) => lines.without_time().boxed(),
    };
    let _ = FORMAT.set(verbosity.log);
    // Only a second call in one process fails; the first one's level stays then.
    let _ = tracing_subscriber::registry().with(lines.with_filter(targets)).try_init();
    if let (Some(text), Some(Err(why))) = (wish, chosen) {
        tracing::warn!("RUST_LOG is '{text}', which cannot be used ({why}); as in: warn,bismar::render=debug");
    }
}

/// A line on stderr, above any bar, printed as soon as it is read. Names in it come from files: control characters are
/// shown, not sent.
pub fn say(text: impl Display) {
    line(Level::INFO, &text.to_string());
}

/// An error on stderr.
pub fn say_error(text: impl Display) {
    match FORMAT.get() {
        Some(Format::Json) => line(Level::ERROR, &text.to_string()),
        _ => say(format_args!("error: {text}")),
    }
}

fn line(level: Level, text: &str) {
    let text = match FORMAT.get() {
        Some(Format::Json) => {
            let mut now = String::new();
            let _ = SystemTime.format_time(&mut Writer::new(&mut now));
            json!({ "timestamp": now, "level": level.as_str(), "message": text }).to_string()
        }
        _ => shown(text),
    };
    screen::write(format!("{text}\n").as_bytes());
}
