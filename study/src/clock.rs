//! Processor seconds, which other programs on the same cores do not count into.

use rustix::time::{ClockId, clock_gettime};

pub fn thread_seconds() -> f64 {
    seconds(ClockId::ThreadCPUTime)
}

pub fn process_seconds() -> f64 {
    seconds(ClockId::ProcessCPUTime)
}

fn seconds(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
