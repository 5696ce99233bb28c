//! Command line in, exit code out.

use std::process::ExitCode;

fn main() -> ExitCode {
    bismar_study::cli::run()
}
