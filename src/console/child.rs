//! A child process that its parent stops, and that ends with its parent.
//!
//! Signals of a terminal or a scheduler may reach both processes or only the parent. The child therefore ignores them
//! ([`Signals::from_parent`]) and listens to its standard input: a byte stands for a signal, the end of input for the parent's end.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;
use std::{env, thread};

use rustix::process::{Pid, Signal, getppid, kill_process, set_parent_process_death_signal};
use signal_hook::low_level;

use super::Signals;
use super::signals::ORPHANED_EXIT_CODE;
use crate::{Error, Result};

/// A command that runs this program, even if its file has been replaced since it started.
pub fn this_program() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.arg0("bismar");
    command
}

/// Environment variables of the npm package: the process whose end is a SIGTERM for this one; and the folder of a call, which goes at
/// once with whoever reads standard output.
const CALLER: &str = "BISMAR_CALLER";
const CALL_FOLDER: &str = "BISMAR_CALL_FOLDER";

/// Ends with the process that the npm package says, however that ends.
pub fn end_with_caller() {
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
}

/// Runs a command that listens with [`Signals::from_parent`] until it ends, and forwards the first signal. `first` is written to its
/// standard input; a command without one does not listen, and is ended by SIGTERM. `line` is called with each line of its standard
/// output if that is piped, `often` at least every 30 ms.
///
/// # Errors
/// [`Error::Host`] if it cannot be started or waited for.
pub fn lead(
    command: &mut Command,
    first: Option<&[u8]>,
    signals: &Signals,
    line: &(dyn Fn(&str) + Sync),
    often: &mut dyn FnMut(),
) -> Result<ExitStatus> {
    let mut child = command.stdin(Stdio::piped()).spawn().map_err(|e| {
        let program = command.get_program().display();
        Error::Host(format!("cannot run {program}: {e}"))
    })?;
    thread::scope(|scope| {
        if let Some(out) = child.stdout.take() {
            let read =
                move || BufReader::new(out).lines().map_while(std::result::Result::ok).for_each(|text| line(&text));
            if let Err(e) = thread::Builder::new().spawn_scoped(scope, read) {
                // It has done nothing yet.
                let _ = child.kill().and_then(|()| child.wait());
                return Err(Error::Host(format!("cannot start a thread: {e}")));
            }
        }
        wait(&mut child, first, signals, often)
            .map_err(|e| Error::Host(format!("cannot wait for a child process: {e}")))
    })
}

fn wait(
    child: &mut Child,
    first: Option<&[u8]>,
    signals: &Signals,
    often: &mut dyn FnMut(),
) -> std::io::Result<ExitStatus> {
    let mut input = child.stdin.take();
    // Errors are those of a child that has ended, which is handled below.
    let mut send = |bytes: &[u8]| input.as_mut().map(|input| input.write_all(bytes).and_then(|()| input.flush()));
    first.map(&mut send);
    let mut notified = false;
    let mut pause = Duration::from_millis(1);
    loop {
        // `wait` would close the input.
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if signals.stopped() && !notified {
            match (first, i32::try_from(child.id()).ok().and_then(Pid::from_raw)) {
                (None, Some(child)) => drop(kill_process(child, Signal::TERM)),
                _ => drop(send(b".")),
            }
            notified = true;
        }
        often();
        thread::sleep(pause);
        pause = (2 * pause).min(Duration::from_millis(30));
    }
}
