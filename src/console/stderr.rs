//! Standard error, where nobody who renders or saves waits for whoever reads it: a thread of its own writes.

use std::sync::LazyLock;
use std::sync::mpsc::{Sender, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Duration;

use super::screen::write_now;

enum Order {
    Write(Vec<u8>),
    /// Tell when all before this is written.
    Tell(SyncSender<()>),
}

/// None where the system gives no thread.
static WRITER: LazyLock<Option<Sender<Order>>> = LazyLock::new(|| {
    let (orders, taken) = channel();
    let write = move || {
        for order in taken {
            match order {
                Order::Write(bytes) => write_now(&bytes),
                Order::Tell(whom) => drop(whom.try_send(())),
            }
        }
    };
    thread::Builder::new().name("stderr".into()).spawn(write).ok().map(|_| orders)
});

/// Writes, sooner or later, in the order of the calls.
pub fn write(bytes: Vec<u8>) {
    match WRITER.as_ref() {
        Some(writer) => drop(writer.send(Order::Write(bytes))),
        None => write_now(&bytes),
    }
}

/// Waits until all is written; not for long, as nobody may be reading.
pub fn flush() {
    const PATIENCE: Duration = Duration::from_secs(1);
    let (tell, told) = sync_channel(1);
    if WRITER.as_ref().is_some_and(|writer| writer.send(Order::Tell(tell)).is_ok()) {
        let _ = told.recv_timeout(PATIENCE);
    }
}
