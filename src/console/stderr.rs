//! Writing to stderr from a thread of its own, so that rendering and saving never wait for the reader.

use std::sync::LazyLock;
use std::sync::mpsc::{Sender, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Duration;

use super::screen::write_now;

enum Request {
    Write(Vec<u8>),
    /// Notify the sender when all before this is written.
    Notify(SyncSender<()>),
}

/// `None` if no thread can be started.
static WRITER: LazyLock<Option<Sender<Request>>> = LazyLock::new(|| {
    let (requests, received) = channel();
    let write = move || {
        for request in received {
            match request {
                Request::Write(bytes) => write_now(&bytes),
                Request::Notify(sender) => drop(sender.try_send(())),
            }
        }
    };
    thread::Builder::new().name("stderr".into()).spawn(write).ok().map(|_| requests)
});

/// Queues bytes for writing, in the order of the calls.
pub fn write(bytes: Vec<u8>) {
    match WRITER.as_ref() {
        Some(writer) => drop(writer.send(Request::Write(bytes))),
        None => write_now(&bytes),
    }
}

/// Waits until all is written, at most a second, as the reader may be stuck.
pub fn flush() {
    const MAX_WAIT: Duration = Duration::from_secs(1);
    let (notify, notified) = sync_channel(1);
    if WRITER.as_ref().is_some_and(|writer| writer.send(Request::Notify(notify)).is_ok()) {
        let _ = notified.recv_timeout(MAX_WAIT);
    }
}
