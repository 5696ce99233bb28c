//! Log events of the library, handed to Python's `logging` under the name `bismar`.

use std::fmt::Debug;
use std::mem::take;
use std::sync::{Mutex, PoisonError};

use bismar::cli::in_memory::with_keywords;
use pyo3::prelude::*;
use tracing::field::Field;
use tracing::level_filters::LevelFilter;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};

/// Events that Python has not been told of: Python's level and the text.
static EVENTS: Mutex<Vec<(u8, String)>> = Mutex::new(Vec::new());
/// Most events that wait; later ones are dropped.
const MOST: usize = 1000;

struct Collector;

impl<S: Subscriber> Layer<S> for Collector {
    fn max_level_hint(&self) -> Option<LevelFilter> {
        Some(LevelFilter::INFO)
    }

    fn on_event(&self, event: &Event, _: Context<S>) {
        let level = match *event.metadata().level() {
            Level::ERROR => 40,
            Level::WARN => 30,
            Level::INFO => 20,
            _ => return,
        };
        let mut text = String::new();
        event.record(&mut |field: &Field, value: &dyn Debug| {
            if field.name() == "message" {
                text = format!("{value:?}");
            }
        });
        let text = with_keywords(&text);
        let mut events = EVENTS.lock().unwrap_or_else(PoisonError::into_inner);
        if events.len() < MOST {
            events.push((level, text));
        }
    }
}

/// Collects events from now on. Any thread can make one, so none calls Python.
pub fn start() {
    let _ = tracing::subscriber::set_global_default(tracing_subscriber::registry().with(Collector));
}

/// Hands the collected events to `logging.getLogger("bismar")`.
/// Errors: The exception of a handler.
pub fn deliver(py: Python) -> PyResult<()> {
    let events = take(&mut *EVENTS.lock().unwrap_or_else(PoisonError::into_inner));
    if events.is_empty() {
        return Ok(());
    }
    let logger = py.import("logging")?.call_method1("getLogger", ("bismar",))?;
    events.into_iter().try_for_each(|(level, text)| logger.call_method1("log", (level, "%s", text)).map(drop))
}
