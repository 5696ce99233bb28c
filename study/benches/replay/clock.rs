//! Processor time: another program on the same cores does not count.

use cpu_time::{ProcessTime, ThreadTime};

/// Seconds of the calling thread.
pub fn now() -> f64 {
    ThreadTime::now().as_duration().as_secs_f64()
}

/// Seconds of all threads of the process.
pub fn process() -> f64 {
    ProcessTime::now().as_duration().as_secs_f64()
}
