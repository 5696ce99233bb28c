//! The program `bismar`.

use std::process::ExitCode;

use bismar::console::memory::Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() -> ExitCode {
    bismar::cli::run()
}
