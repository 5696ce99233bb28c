//! Work queue over a list of jobs, and a cache of what jobs share.

use std::collections::HashMap;
use std::iter::repeat_with;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

/// Calls `work` once with each of 0, 1, … `jobs` − 1, begun in this order, on `workers` threads, of which this is one; on fewer if
/// the system refuses to start them.
pub fn each(jobs: usize, workers: usize, work: &(dyn Fn(usize) + Sync)) {
    let next = AtomicUsize::new(0);
    let run = || repeat_with(|| next.fetch_add(1, Ordering::Relaxed)).take_while(|job| *job < jobs).for_each(work);
    thread::scope(|scope| {
        for _ in 1..workers.min(jobs) {
            let _ = thread::Builder::new().spawn_scoped(scope, run);
        }
        run();
    });
}

/// Values that several jobs share: made for the first job that needs them, dropped after the last.
pub struct Cache<V> {
    slots: HashMap<String, Slot<V>>,
}

struct Slot<V> {
    /// Jobs that are not done with the value.
    left: AtomicUsize,
    value: Mutex<Option<Arc<V>>>,
}

impl<V> Cache<V> {
    /// A cache for jobs with these keys, one key per job.
    pub fn new(keys: impl Iterator<Item = String>) -> Self {
        let mut slots: HashMap<String, Slot<V>> = HashMap::new();
        for key in keys {
            let slot = slots.entry(key).or_insert(Slot { left: AtomicUsize::new(0), value: Mutex::new(None) });
            *slot.left.get_mut() += 1;
        }
        Self { slots }
    }

    /// The value of a key, made by `make` if necessary; other jobs that need it wait. After a failure the next job tries
    /// again.
    pub fn get<E>(&self, key: &str, make: impl FnOnce() -> Result<V, E>) -> Result<Arc<V>, E> {
        let Some(slot) = self.slots.get(key) else { return make().map(Arc::new) };
        // A panic in `make` leaves the slot empty, which is a valid state.
        let mut value = slot.value.lock().unwrap_or_else(PoisonError::into_inner);
        match &*value {
            Some(value) => Ok(Arc::clone(value)),
            None => Ok(Arc::clone(value.insert(Arc::new(make()?)))),
        }
    }

    /// Number of jobs that are not done with the value.
    pub fn left(&self, key: &str) -> usize {
        self.slots.get(key).map_or(0, |slot| slot.left.load(Ordering::Acquire))
    }

    /// Marks one job as done with the value; returns whether it was the last one.
    pub fn done(&self, key: &str) -> bool {
        let Some(slot) = self.slots.get(key) else { return false };
        let last = slot.left.fetch_sub(1, Ordering::AcqRel) == 1;
        if last {
            slot.value.lock().unwrap_or_else(PoisonError::into_inner).take();
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_job_is_done_once_on_many_threads() {
        let seen: Vec<AtomicUsize> = (0..100).map(|_| AtomicUsize::new(0)).collect();
        each(100, 7, &|job| {
            seen[job].fetch_add(1, Ordering::Relaxed);
        });
        assert!(seen.iter().all(|n| n.load(Ordering::Relaxed) == 1));
    }

    #[test]
    fn a_shared_thing_is_made_once_and_gone_after_its_last_user() {
        let cache = Cache::new(["a", "b", "a", "a"].map(str::to_owned).into_iter());
        let made = AtomicUsize::new(0);
        let make = || {
            made.fetch_add(1, Ordering::Relaxed);
            Ok::<_, ()>(7)
        };
        assert_eq!(cache.get("a", || Err("broken")), Err("broken"));
        let first = cache.get("a", make).unwrap();
        let second = cache.get("a", make).unwrap();
        assert_eq!((made.load(Ordering::Relaxed), Arc::strong_count(&first)), (1, 3));
        drop(second);
        assert_eq!((cache.left("a"), cache.left("b"), cache.left("c")), (3, 1, 0));
        assert_eq!([0, 1, 2].map(|_| cache.done("a")), [false, false, true]);
        assert_eq!(Arc::strong_count(&first), 1);
    }
}
