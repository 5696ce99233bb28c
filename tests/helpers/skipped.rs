//! Tests that cannot run on this machine say so here: `make test` counts them at its end.

use std::fs::OpenOptions;
use std::io::Write;

/// Notes that the current test is skipped, and why: on its output, and as a line of the file that `BISMAR_SKIPPED_TESTS` names.
pub fn skipped(why: &str) {
    let thread = std::thread::current();
    let line = format!("{}: {why}\n", thread.name().unwrap_or("a test"));
    print!("skipped: {line}");
    if let Some(path) = std::env::var_os("BISMAR_SKIPPED_TESTS") {
        let file = OpenOptions::new().create(true).append(true).open(path);
        file.and_then(|mut file| file.write_all(line.as_bytes())).expect("BISMAR_SKIPPED_TESTS must name a file");
    }
}
