//! The panic hook.

use std::any::Any;
use std::backtrace::{Backtrace, BacktraceStatus};
use std::panic;

use super::say;
use crate::{Error, guard};

fn message(payload: &dyn Any) -> Option<&str> {
    let message = payload.downcast_ref::<&str>().copied();
    message.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
}

/// The error of a panic that was caught: of a thread that the system has refused, or of a bug, which the hook has printed.
pub fn error(payload: &dyn Any) -> Error {
    match is_refused_thread(payload) {
        true => {
            Error::Host("the system refuses to start another thread (ulimit -u, or the limit of a container)".into())
        }
        false => Error::Bug(message(payload).unwrap_or("unknown").into()),
    }
}

/// Is it the panic of a thread that the system has refused, of the standard library or of rayon's own pool?
fn is_refused_thread(payload: &dyn Any) -> bool {
    message(payload)
        .is_some_and(|text| text.contains("failed to spawn thread") || text.contains("ThreadPoolBuildError"))
}

/// Installs a hook that prints one sentence for a panic and asks for a report; with `RUST_BACKTRACE=1` also the backtrace.
pub fn install_hook() {
    panic::set_hook(Box::new(|info| {
        // A panic inside a third-party decoder means a corrupt file and is reported as such.
        if guard::is_decoding() {
            return;
        }
        let message = message(info.payload());
        if is_refused_thread(info.payload()) {
            return;
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_thread_is_known_by_its_panic() {
        for (text, refused) in [
            ("failed to spawn thread: Os { code: 11, kind: WouldBlock }", true),
            ("The global thread pool has not been initialized.: ThreadPoolBuildError { kind: IOError }", true),
            ("index out of bounds", false),
        ] {
            assert_eq!(error(&text.to_owned()).exit_code(), if refused { 76 } else { 70 });
        }
    }
}
