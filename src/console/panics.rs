//! The panic hook.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::panic;

use super::say;
use crate::guard;

/// Installs a hook that prints one sentence for a panic and asks for a report; with `RUST_BACKTRACE=1` also the backtrace.
pub fn install_hook() {
    panic::set_hook(Box::new(|info| {
        // A panic inside a third-party decoder means a corrupt file and is reported as such.
        if guard::is_decoding() {
            return;
        }
        let payload = info.payload();
        let message = payload.downcast_ref::<&str>().copied();
        let message = message.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
        let place = info.location().map(|l| format!(" ({}:{})", l.file(), l.line())).unwrap_or_default();
        say(format_args!(
            "internal error: {}{place}; please report it with the command and the scene",
            message.unwrap_or("unknown")
        ));
        let trace = Backtrace::capture();
        if trace.status() == BacktraceStatus::Captured {
            say(trace);
        }
    }));
}
