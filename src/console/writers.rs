//! Writing from threads of their own, so that rendering and saving never wait for the reader.

use std::io::{self, Write};
use std::sync::OnceLock;
use std::sync::mpsc::{Sender, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Duration;

use super::screen::write_now;

enum Request {
    Write(Vec<u8>),
    /// Notify the sender when all before this is written.
    Notify(SyncSender<()>),
}

/// A thread that writes; `None` if it cannot be started.
type Writer = Option<Sender<Request>>;

/// Standard error.
static STDERR: OnceLock<Writer> = OnceLock::new();
/// Standard output, as far as it shows progress.
static STDOUT: OnceLock<Writer> = OnceLock::new();

fn started(name: &str, write: fn(&[u8])) -> Writer {
    let (requests, received) = channel();
    let run = move || {
        for request in received {
            match request {
                Request::Write(bytes) => write(&bytes),
                Request::Notify(sender) => drop(sender.try_send(())),
            }
        }
    };
    thread::Builder::new().name(name.into()).spawn(run).ok().map(|_| requests)
}

/// Errors are ignored: rendering continues even if progress cannot be written.
fn write_progress(bytes: &[u8]) {
    let mut stdout = io::stdout().lock();
    let _ = stdout.write_all(bytes).and_then(|()| stdout.flush());
}

/// Queues bytes for standard error, above the bars, in the order of the calls.
pub fn write(bytes: Vec<u8>) {
    match STDERR.get_or_init(|| started("stderr", write_now)) {
        Some(writer) => drop(writer.send(Request::Write(bytes))),
        None => write_now(&bytes),
    }
}

/// A text whose further lines are indented, as ours are. What comes from files thus begins no line, which a scheduler could take for
/// a report of this program (`openjd_fail: …`).
pub(super) fn message(text: &str) -> String {
    let mut lines = text.split('\n');
    let first = lines.next().unwrap_or_default().to_owned();
    lines.fold(first, |all, line| all + if line.starts_with(' ') { "\n" } else { "\\n" } + line)
}

/// Queues a line of progress for standard output, in the order of the calls.
pub fn progress(line: &str) {
    let bytes = format!("{line}\n").into_bytes();
    match STDOUT.get_or_init(|| started("stdout", write_progress)) {
        Some(writer) => drop(writer.send(Request::Write(bytes))),
        None => write_progress(&bytes),
    }
}

/// Waits until all is written, at most a second for each, as the reader may be stuck.
pub fn flush() {
    const MAX_WAIT: Duration = Duration::from_secs(1);
    // What was never written to has no thread.
    for writer in [&STDOUT, &STDERR].into_iter().filter_map(|writer| writer.get()?.as_ref()) {
        let (notify, notified) = sync_channel(1);
        if writer.send(Request::Notify(notify)).is_ok() {
            let _ = notified.recv_timeout(MAX_WAIT);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_begins_no_line() {
        assert_eq!(
            message("there are:\n  0  x\nopenjd_fail: y\n  1  z"),
            "there are:\n  0  x\\nopenjd_fail: y\n  1  z"
        );
    }
}
