//! The process for which this one works: the npm package's.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::os::fd::AsFd;
use std::path::Path;
use std::{env, thread};

use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use signal_hook::low_level;

/// Exit code of a process whose parent or caller has ended, the same as after a signal.
pub(super) const ORPHANED_EXIT_CODE: i32 = 75;

/// Environment variables of the npm package: the process whose end is a SIGTERM for this one; and the folder of a call, which goes at
/// once with whoever reads standard output. It is there when a byte is on standard input, before the input itself.
const CALLER: &str = "BISMAR_CALLER";
const CALL_FOLDER: &str = "BISMAR_CALL_FOLDER";

/// Ends with the process that the npm package says, however that ends.
pub(crate) fn end_with_caller() {
    // Others may inherit the variable.
    let caller = env::var(CALLER).ok().and_then(|pid| pid.parse().ok());
    if caller.is_some() && caller == getppid().map(|pid| pid.as_raw_nonzero().get()) {
        let _ = set_parent_process_death_signal(Some(Signal::TERM));
    }
    let Some(folder) = env::var_os(CALL_FOLDER) else { return };
    // Standard output is a socket, on which nothing arrives but its end.
    let Ok(mut caller) = io::stdout().as_fd().try_clone_to_owned().map(File::from) else { return };
    let _ = thread::Builder::new().spawn(move || {
        loop {
            match caller.read(&mut [0]) {
                Ok(1..) => {}
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Ok(0) => break,
                Err(e) if e.kind() == ErrorKind::ConnectionReset => break,
                Err(_) => return,
            }
        }
        // Files are written in it until it is gone.
        let folder = Path::new(&folder);
        let is_own = folder.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"bismar-"));
        for _ in 0..100 {
            if !is_own || fs::remove_dir_all(folder).is_ok() || !folder.exists() {
                break;
            }
        }
        low_level::exit(ORPHANED_EXIT_CODE);
    });
    // Not by io::stdin, which would take more than that byte.
    if let Ok(mut stdin) = io::stdin().as_fd().try_clone_to_owned().map(File::from)
        && stdin.read_exact(&mut [0]).is_err()
    {
        // The caller has ended, and the thread ends this process.
        loop {
            thread::park();
        }
    }
}
