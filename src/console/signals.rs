//! Signals that would end the program: the first saves and ends it, one more after half a second ends it at once.

use std::fs;
use std::io::{self, ErrorKind, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGALRM, SIGHUP, SIGINT, SIGPROF, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGVTALRM, SIGXCPU};
use signal_hook::{flag, low_level};

use super::caller::ORPHANED_EXIT_CODE;
use super::{fail, screen};
use crate::film::lock;
use crate::{Error, Result};

#[derive(Clone)]
pub struct Signals {
    /// Raised by the first signal. One more has the default action of the system, half a second later.
    pub stop: Arc<AtomicBool>,
    phase: Arc<AtomicU8>,
}

const LOADING: u8 = 0;
const WORKING: u8 = 1;
const ENDING: u8 = 2;

/// All signals that ask for the end of a process. Others that end it tell of its own faults.
pub(crate) const HEARD: [i32; 10] =
    [SIGINT, SIGTERM, SIGHUP, SIGUSR1, SIGXCPU, SIGQUIT, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF];

/// Signals within this time are one: `timeout` and schedulers send one to the process and to its group, a terminal and `npx` one
/// each.
const MOMENT: Duration = Duration::from_millis(500);

impl Signals {
    /// Registers handlers of the signals.
    pub fn listen() -> Result<Self> {
        let (signals, ends_at_once) = (Self::silent(), Arc::new(AtomicBool::new(false)));
        for signal in handled() {
            // The system sends SIGXCPU in every further second.
            let by_default = (signal != SIGXCPU).then_some(&ends_at_once);
            let by_default = by_default.map(|flag| flag::register_conditional_default(signal, Arc::clone(flag)));
            by_default
                .transpose()
                .and_then(|_| flag::register(signal, Arc::clone(&signals.stop)))
                .map_err(|e| Error::Host(format!("cannot listen to signal {signal}: {e}")))?;
        }
        let stop = Arc::clone(&signals.stop);
        let watch = move || {
            while !stop.load(Ordering::SeqCst) {
                thread::sleep(MOMENT / 20);
            }
            thread::sleep(MOMENT);
            ends_at_once.store(true, Ordering::SeqCst);
        };
        thread::Builder::new().spawn(watch).map_err(|e| Error::Host(format!("cannot start a thread: {e}")))?;
        Ok(signals)
    }

    /// Listens to the parent process instead ([`lead`](super::child::lead)) and ignores signals. A byte on standard input
    /// stands for the first signal. At the end of the input, the parent has ended, and this process exits at once.
    pub fn from_parent() -> Result<Self> {
        let signals = Self::silent();
        for signal in handled() {
            // The parent's CPU time is another.
            let heard = if signal == SIGXCPU { Arc::clone(&signals.stop) } else { Arc::default() };
            flag::register(signal, heard).map_err(|e| Error::Host(format!("cannot listen to signal {signal}: {e}")))?;
        }
        let stop = Arc::clone(&signals.stop);
        let listener = thread::Builder::new().spawn(move || {
            let mut byte = [0];
            loop {
                match io::stdin().read(&mut byte) {
                    Ok(1..) => stop.store(true, Ordering::SeqCst),
                    Err(e) if e.kind() == ErrorKind::Interrupted => {}
                    _ => low_level::exit(ORPHANED_EXIT_CODE),
                }
            }
        });
        listener.map_err(|e| Error::Host(format!("cannot start a thread: {e}")))?;
        Ok(signals)
    }

    fn silent() -> Self {
        Self { stop: Arc::default(), phase: Arc::new(AtomicU8::new(WORKING)) }
    }

    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Does `work` that cannot be interrupted and has nothing to save, such as reading a scene or building an acceleration
    /// structure. A signal ends the program at once with exit code 75.
    pub(crate) fn nothing_to_save<T>(&self, work: impl FnOnce() -> T) -> T {
        self.phase.store(LOADING, Ordering::SeqCst);
        let watched = self.clone();
        // Where the system refuses another thread, the signal is heard after the work.
        let _ = thread::Builder::new().spawn(move || {
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

/// The handled signals: without those that whoever started the program ignores, as `nohup` does SIGHUP.
fn handled() -> impl Iterator<Item = i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    // A shell ignores SIGINT for what it runs in the background, where it still means the end.
    HEARD.into_iter().filter(move |signal| *signal == SIGINT || ignored >> (signal - 1) & 1 == 0)
}
