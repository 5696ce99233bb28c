//! Messages and logs on stderr, as text or as JSON.

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

use super::{Verbosity, escaped, screen};

/// Format of lines on stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line: `timestamp`, `level`, `message`, and what else is known.
    Json,
}

static FORMAT: OnceLock<Format> = OnceLock::new();

/// Starts logging. The variable `RUST_LOG` (for example `warn,bismar::render=debug`) overrides `verbosity`.
pub fn start(verbosity: Verbosity) {
    let level = match verbosity {
        Verbosity { quiet: true, .. } => Level::ERROR,
        Verbosity { verbose: 0, .. } => Level::WARN,
        Verbosity { verbose: 1, .. } => Level::INFO,
        Verbosity { verbose: 2, .. } => Level::DEBUG,
        _ => Level::TRACE,
    };
    let rust_log = std::env::var("RUST_LOG").ok().filter(|text| !text.trim().is_empty());
    let chosen = rust_log.as_ref().map(|text| Targets::from_str(text));
    let targets = match &chosen {
        Some(Ok(targets)) => targets.clone(),
        _ => Targets::new().with_default(level),
    };
    // Times and module names are printed at higher verbosity.
    let (with_time, with_module) =
        (verbosity.verbose > 0 || rust_log.is_some(), verbosity.verbose > 1 || rust_log.is_some());
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| screen::Above)
        .with_ansi(io::stderr().is_terminal() && verbosity.log == Format::Text)
        .with_target(with_module)
        .log_internal_errors(false);
    let lines = match (verbosity.log, with_time) {
        (Format::Json, _) => lines.json().flatten_event(true).with_current_span(false).with_span_list(false).boxed(),
        (Format::Text, true) => lines.boxed(),
        (Format::Text, false) => lines.without_time().boxed(),
    };
    let _ = FORMAT.set(verbosity.log);
    // This fails only for a second call in one process, which keeps the first level.
    let _ = tracing_subscriber::registry().with(lines.with_filter(targets)).try_init();
    if let (Some(text), Some(Err(why))) = (rust_log, chosen) {
        tracing::warn!("RUST_LOG is '{text}', which cannot be used ({why}); as in: warn,bismar::render=debug");
    }
}

/// Prints a line on stderr, above any bar, without waiting for the reader. Control characters, which may come from files,
/// are escaped.
pub fn say(text: impl Display) {
    line(Level::INFO, &text.to_string());
}

/// Prints an error on stderr.
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
        _ => escaped(text),
    };
    screen::write(format!("{text}\n").as_bytes());
}
