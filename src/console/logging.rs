//! Messages and logs on stderr, as text or as JSON.

use std::fmt::Display;
use std::io::{self, IsTerminal};
use std::str::FromStr;
use std::sync::OnceLock;

use clap::Args;
use serde_json::json;
use tracing::Level;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};
use tracing_subscriber::prelude::*;

use super::writers;

/// Format of lines on stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line: `timestamp`, `level`, `message`, and what else is known.
    Json,
}

/// Verbosity of the log on stderr.
#[derive(Debug, Clone, Copy, Args)]
pub struct Verbosity {
    /// Print errors only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Print what is done, with times; twice for more, three times for all. The variable RUST_LOG selects modules.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Format of lines on stderr.
    #[arg(long, global = true, value_enum, default_value_t, value_name = "FORMAT")]
    pub log: Format,
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
        .with_writer(|| Above)
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

/// Prints an error on stderr, no longer than a screen.
pub(crate) fn say_error(text: impl Display) {
    let text = shortened(&text.to_string());
    match FORMAT.get() {
        Some(Format::Json) => line(Level::ERROR, &text),
        _ => say(format_args!("error: {text}")),
    }
}

/// A text without the middle of what does not fit on a screen of 24 lines of 80 characters: it may quote a whole file.
fn shortened(text: &str) -> String {
    const FIRST: usize = 18;
    const LAST: usize = 4;
    let (mut rows, mut column) = (Vec::new(), 0);
    for (at, c) in text.char_indices() {
        rows.extend((column % 80 == 0).then_some(at));
        column = if c == '\n' { 0 } else { column + 1 };
    }
    if rows.len() <= FIRST + LAST + 1 {
        return text.into();
    }
    let (start, end) = (&text[..rows[FIRST]], &text[rows[rows.len() - LAST]..]);
    format!("{}\n  …\n  {}", start.trim_end(), end.trim_start())
}

fn line(level: Level, text: &str) {
    let text = match FORMAT.get() {
        Some(Format::Json) => {
            let mut now = String::new();
            let _ = SystemTime.format_time(&mut Writer::new(&mut now));
            escaped_json(&json!({ "timestamp": now, "level": level.as_str(), "message": text }).to_string())
        }
        _ => writers::message(&escaped(text)),
    };
    writers::write(format!("{text}\n").into_bytes());
}

/// Does a character change the direction of the text around it (Unicode Standard Annex 9)? A terminal would show other words than
/// those that are there.
fn turns(c: char) -> bool {
    matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn replaced(text: &str, is_escaped: impl Fn(char) -> bool, escape: impl Fn(char) -> String) -> String {
    text.chars().fold(String::with_capacity(text.len()), |all, c| {
        if is_escaped(c) { all + &escape(c) } else { all + &*c.encode_utf8(&mut [0; 4]) }
    })
}

/// Escapes control characters except newlines and tabs, and those that turn the text around them.
pub fn escaped(text: &str) -> String {
    replaced(text, |c| (c.is_control() && c != '\n' && c != '\t') || turns(c), |c| c.escape_default().to_string())
}

/// Where the log's lines go, one at a time, above the bars.
struct Above;

impl io::Write for Above {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        let text = writers::message(text.strip_suffix('\n').unwrap_or(&text));
        // Control characters are escaped already, or our own.
        let text = match FORMAT.get() {
            Some(Format::Json) => escaped_json(&text),
            _ => replaced(&text, turns, |c| c.escape_default().to_string()),
        };
        writers::write(format!("{text}\n").into_bytes());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The same JSON, with such characters, which only its strings have, and control characters as its own escapes.
pub fn escaped_json(json: &str) -> String {
    replaced(json, |c| (c.is_control() && c > '\u{1f}') || turns(c), |c| format!("\\u{:04x}", u32::from(c)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown() {
        assert_eq!(escaped("a\nb\tc"), "a\nb\tc");
        assert_eq!(escaped("\u{1b}[2J\r\u{85}é"), "\\u{1b}[2J\\r\\u{85}é");
        assert_eq!(escaped("a\u{202e}glb.\u{2066}b\u{200f}"), "a\\u{202e}glb.\\u{2066}b\\u{200f}");
        assert_eq!(escaped("مرحبا"), "مرحبا");
        let value = json!({ "مرحبا": "a\u{202e}b\u{9b}\u{7f}\u{200f}\u{1b}\n" });
        let text = escaped_json(&serde_json::to_string_pretty(&value).unwrap());
        assert!(!text.contains(|c: char| turns(c) || c.is_control() && c != '\n') && text.contains("مرحبا"), "{text}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
    }

    #[test]
    fn an_error_is_no_longer_than_a_screen() {
        let list = |n: usize| (0..n).map(|i| format!("\n  {i}")).collect::<String>();
        for short in ["", "é", &"x".repeat(1800), &list(22)] {
            assert_eq!(shortened(short), short);
        }
        for long in [
            "x".repeat(1 << 20),
            "é".repeat(1920),
            list(99),
            "\n".repeat(99),
            format!("{}{}", list(21), "x".repeat(99)),
        ] {
            let text = format!("start {long} the end");
            let rows: usize = shortened(&text).lines().map(|line| line.chars().count().div_ceil(80).max(1)).sum();
            assert!(
                rows <= 24 && shortened(&text).starts_with("start") && shortened(&text).ends_with("the end"),
                "{rows}"
            );
        }
    }
}
