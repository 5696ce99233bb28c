//! Work of the library without Python's lock (GIL): on a thread pool, with panics caught, and with signals seen.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use rayon::ThreadPool;

use bismar::cli::in_memory::Options;
use bismar::console::{host, panics};
use bismar::render::Progress;
use bismar::{Error, Result};

use crate::{errors, log};

/// The options that JSON holds.
pub fn options(json: &str) -> Result<Options> {
    serde_json::from_str(json).map_err(|e| Error::Usage(format!("options: {e}")))
}

/// Time between looks at signals and calls of the progress callback.
const INTERVAL: Duration = Duration::from_millis(50);

thread_local! {
    /// Does this thread call back into Python?
    static IN_CALLBACK: Cell<bool> = const { Cell::new(false) };
}

/// Calls into Python from a render. What the callable renders itself then has a pool of its own: the pool of the render may wait
/// for the callable.
pub fn call_back<T>(call: impl FnOnce() -> T) -> T {
    let before = IN_CALLBACK.replace(true);
    let result = call();
    IN_CALLBACK.set(before);
    result
}

/// Another pool of the same size inside of a callable, and for work that `waits` for one, which may render by other threads.
fn own_pool(on: &ThreadPool, waits: bool) -> Result<Option<ThreadPool>> {
    (waits || IN_CALLBACK.get()).then(|| host::pool(on.current_num_threads())).transpose()
}

/// The process whose threads were started, 0 before.
static PROCESS: AtomicU32 = AtomicU32::new(0);
static DEFAULT_POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// A pool of `threads` threads; without a number the one that the whole process shares.
pub fn pool(threads: Option<usize>) -> Result<Arc<ThreadPool>> {
    check_process()?;
    if let Some(threads) = threads {
        return host::pool(threads).map(Arc::new);
    }
    let mut shared = DEFAULT_POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = &*shared {
        return Ok(Arc::clone(pool));
    }
    let pool = Arc::new(host::pool(host::threads(None)?.0)?);
    *shared = Some(Arc::clone(&pool));
    Ok(pool)
}

/// Threads do not survive a fork: work in the child would wait for ever.
fn check_process() -> Result<()> {
    match PROCESS.compare_exchange(0, process::id(), Ordering::SeqCst, Ordering::SeqCst) {
        Err(first) if first != process::id() => Err(Error::Host(
            "this process was forked from one that had used bismar, whose threads it lacks: fork before the first use, or \
             start processes by multiprocessing.get_context('spawn')"
                .into(),
        )),
        _ => Ok(()),
    }
}

fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    // Nothing that a panic could leave half done is used afterwards: each call makes its own state.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(panics::error(&*panic)))
}

/// Does work on a pool, without the lock.
///
/// # Errors
/// The work's error, and a panic, as exceptions.
pub fn work<T: Send>(py: Python, on: Option<&ThreadPool>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    let done = py.detach(|| {
        check_process()?;
        let shared;
        let on = match on {
            Some(on) => on,
            None => {
                shared = pool(None)?;
                &*shared
            }
        };
        own_pool(on, false)?.as_ref().unwrap_or(on).install(|| guarded(work))
    });
    log::deliver(py)?;
    done.map_err(|error| errors::raise(py, &error))
}

/// Does work that needs no pool without the lock: a thread that holds it stops all of Python.
/// Errors: Those of [`work`].
pub fn unlocked<T: Send>(py: Python, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    py.detach(|| guarded(work)).map_err(|error| errors::raise(py, &error))
}

/// Does work that can be stopped and reports progress. The calling thread sees signals and calls `callback` meanwhile; the
/// work stops if a signal handler or the callback raises an exception, which is returned beside the result, or the callback
/// returns False. Work that `waits` for another callable has threads of its own.
pub fn stoppable<T: Send>(
    py: Python,
    on: &ThreadPool,
    waits: bool,
    callback: Option<&Py<PyAny>>,
    work: impl FnOnce(&AtomicBool, &(dyn Fn(Progress) + Sync)) -> Result<T> + Send,
) -> (Result<T>, Option<PyErr>) {
    let (stop, latest) = (AtomicBool::new(false), Mutex::new(None));
    let look = |py: Python| -> PyResult<()> {
        py.check_signals()?;
        log::deliver(py)?;
        let progress: Option<Progress> = latest.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let (Some(callback), Some(p)) = (callback, progress) {
            let noise = Some(p.noise).filter(|noise| noise.is_finite());
            let answer = call_back(|| callback.call1(py, (p.fraction, p.seconds, p.mean_spp, noise)))?;
            // NumPy's too.
            if matches!(answer.extract::<bool>(py), Ok(false)) {
                stop.store(true, Ordering::Relaxed);
            }
        }
        Ok(())
    };
    let mut exception = None;
    let result = py.detach(|| {
        check_process()?;
        let own = own_pool(on, waits)?;
        let on = own.as_ref().unwrap_or(on);
        thread::scope(|scope| {
            let (done, ends) = channel();
            let progress = |p: Progress| *latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(p);
            let stop = &stop;
            let render = thread::Builder::new().name("bismar".into()).spawn_scoped(scope, move || {
                let result = on.install(|| guarded(|| work(stop, &progress)));
                // The receiver waits for it.
                let _ = done.send(result);
            });
            if let Err(e) = render {
                return Err(Error::Host(format!("cannot start a thread: {e}")));
            }
            loop {
                match ends.recv_timeout(INTERVAL) {
                    Ok(result) => return result,
                    Err(RecvTimeoutError::Disconnected) => return Err(Error::Bug("a render without a result".into())),
                    Err(RecvTimeoutError::Timeout) => {}
                }
                if exception.is_none() {
                    exception = Python::attach(look).err();
                    if exception.is_some() {
                        stop.store(true, Ordering::Relaxed);
                    }
                }
            }
        })
    });
    // The last progress, and signals of the last moment.
    if exception.is_none() {
        exception = look(py).err();
    }
    (result, exception)
}

pub fn json(value: &impl serde::Serialize) -> bismar::Result<String> {
    serde_json::to_string(value).map_err(|e| bismar::Error::Bug(format!("JSON: {e}")))
}
