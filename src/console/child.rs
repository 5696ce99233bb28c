//! A child process that its parent stops, and that ends with its parent.
//!
//! Signals of a terminal or a scheduler may reach both processes or only the parent. The child therefore ignores them
//! ([`Signals::from_parent`]) and listens to its standard input: a byte stands for a signal, the end of input for the parent's end.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

use super::Signals;
use crate::{Error, Result};

/// A command that runs this program, even if its file has been replaced since it started.
pub(crate) fn this_program() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.arg0("bismar");
    command
}

/// Runs a command that listens with [`Signals::from_parent`] until it ends, and forwards the first signal. `first` is written to its
/// standard input; a command without one does not listen, and is ended by SIGTERM. `line` is called with each line of its standard
/// output if that is piped, `often` at least every 30 ms.
/// Errors: [`Error::Host`] if it cannot be started or waited for.
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
