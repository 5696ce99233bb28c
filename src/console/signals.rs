//! SIGINT, SIGTERM and SIGUSR1: the first saves and ends, the second ends at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};

use super::{logging, screen};
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

impl Signals {
    /// Listens from now on.
    ///
    /// # Errors
    /// [`Error::Host`] if the system does not let it.
    pub fn listen() -> Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGUSR1] {
            // In this order: the first signal finds the flag still down and raises it.
            signal_hook::flag::register_conditional_default(signal, Arc::clone(&stop))
                .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
                .map_err(|e| Error::Host(format!("cannot listen to signal {signal}: {e}")))?;
        }
        Ok(Self { stop, phase: Arc::new(AtomicU8::new(WORKING)) })
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
                    let error = no_progress("interrupted while loading: nothing was rendered, and no file is changed");
                    screen::clear();
                    logging::say_error(&error);
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

/// Restarts by Slurm without any progress after which a task is not worth another.
const FRUITLESS: u32 = 3;

/// What a session that got nowhere ends with: interrupted (75), so that a farm tries again, but not for ever.
pub fn no_progress(text: &str) -> Error {
    let restarts = std::env::var("SLURM_RESTART_COUNT").ok().and_then(|n| n.trim().parse::<u32>().ok());
    match restarts {
        Some(n) if n >= FRUITLESS => {
            Error::Host(format!("{text}; this is restart {n}, and it got nowhere: give it more time or a faster host"))
        }
        _ => Error::Interrupted(text.into()),
    }
}
