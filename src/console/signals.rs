//! SIGINT, SIGTERM, SIGHUP and SIGUSR1: the first saves and ends, the second ends at once.

use std::fs;
use std::io::{self, ErrorKind, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::{flag, low_level};

use super::{fail, screen};
use crate::film::lock;
use crate::{Error, Result};

/// Raised by the first signal.
#[derive(Clone)]
pub struct Signals {
    /// Raised by the first signal; the second one ends the program as if nobody had listened.
    pub stop: Arc<AtomicBool>,
    phase: Arc<AtomicU8>,
}

const LOADING: u8 = 0;
const WORKING: u8 = 1;
const ENDING: u8 = 2;

/// What a child ends with when its parent is gone: as after a signal.
const ORPHANED: i32 = 75;

impl Signals {
    /// Listens from now on.
    ///
    /// # Errors
    /// [`Error::Host`] if the system does not let it.
    pub fn listen() -> Result<Self> {
        let signals = Self::silent();
        for signal in heard() {
            // In this order: the first signal finds the flag still down and raises it.
            flag::register_conditional_default(signal, Arc::clone(&signals.stop))
                .and_then(|_| flag::register(signal, Arc::clone(&signals.stop)))
                .map_err(|e| Error::Host(format!("cannot listen to signal {signal}: {e}")))?;
        }
        Ok(signals)
    }

    /// Listens to the parent instead, as [`lead`](super::child::lead) speaks to it: signals that reach this process are
    /// the parent's affair. A byte on standard input stands for the first one; at its end the parent is gone, and this
    /// process ends on the spot.
    ///
    /// # Errors
    /// As [`Signals::listen`].
    pub fn led() -> Result<Self> {
        let signals = Self::silent();
        for signal in heard() {
            flag::register(signal, Arc::default())
                .map_err(|e| Error::Host(format!("cannot listen to signal {signal}: {e}")))?;
        }
        let stop = Arc::clone(&signals.stop);
        thread::spawn(move || {
            let mut byte = [0];
            loop {
                match io::stdin().read(&mut byte) {
                    Ok(1..) => stop.store(true, Ordering::SeqCst),
                    Err(e) if e.kind() == ErrorKind::Interrupted => {}
                    _ => low_level::exit(ORPHANED),
                }
            }
        });
        Ok(signals)
    }

    fn silent() -> Self {
        Self { stop: Arc::default(), phase: Arc::new(AtomicU8::new(WORKING)) }
    }

    /// Was there a signal?
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Does `work` that cannot be interrupted in the middle and has nothing to save, as reading a scene and building an
    /// acceleration structure: a signal ends the program on the spot, with exit code 75.
    pub fn nothing_to_save<T>(&self, work: impl FnOnce() -> T) -> T {
        self.phase.store(LOADING, Ordering::SeqCst);
        let watched = self.clone();
        thread::spawn(move || {
            while watched.phase.load(Ordering::SeqCst) == LOADING {
                if watched.stopped()
                    && watched.phase.compare_exchange(LOADING, ENDING, Ordering::SeqCst, Ordering::SeqCst).is_ok()
                {
                    let why = "interrupted while loading: nothing was rendered, and no file is changed";
                    let error = Error::Interrupted(why.into());
                    screen::clear();
                    let _ = fail(&error);
                    lock::release_all();
                    std::process::exit(error.exit_code().into());
                }
                thread::sleep(Duration::from_millis(20));
            }
        });
        let result = work();
        if self.phase.compare_exchange(LOADING, WORKING, Ordering::SeqCst, Ordering::SeqCst).is_err() {
            // The other thread is ending the program.
            loop {
                thread::park();
            }
        }
        result
    }
}

/// Signals that are listened to: not SIGHUP where `nohup` has it ignored.
fn heard() -> impl Iterator<Item = i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    let is_heard = move |signal: &i32| *signal != SIGHUP || ignored >> (SIGHUP - 1) & 1 == 0;
    [SIGINT, SIGTERM, SIGHUP, SIGUSR1].into_iter().filter(is_heard)
}
