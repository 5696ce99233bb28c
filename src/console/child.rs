//! A child process that hears from its parent when to stop, and dies with it.
//!
//! Signals of a terminal or a scheduler may reach parent and child alike, or the parent alone. So the child leaves them
//! to its parent ([`Signals::led`]) and listens to its standard input: a byte is a signal, the end is the parent's end.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::Duration;

use super::Signals;
use crate::{Error, Result};

/// This program, also where its file has been replaced since it began.
pub fn this_program() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.arg0("bismar");
    command
}

/// Runs a command that listens as [`Signals::led`] does, to its end; tells it of the first signal. `first` is what its
/// standard input begins with. `line` gets each line of its standard output, if that is piped; `often` is called now and
/// then.
///
/// # Errors
/// [`Error::Host`] if it cannot be started.
pub fn lead(
    command: &mut Command,
    first: &[u8],
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
            scope.spawn(move || {
                BufReader::new(out).lines().map_while(std::result::Result::ok).for_each(|text| line(&text))
            });
        }
        wait(&mut child, first, signals, often)
            .map_err(|e| Error::Host(format!("cannot wait for a child process: {e}")))
    })
}

fn wait(child: &mut Child, first: &[u8], signals: &Signals, often: &mut dyn FnMut()) -> std::io::Result<ExitStatus> {
    let mut input = child.stdin.take();
    // Whoever has ended already hears nothing; that is seen below.
    let mut tell = |bytes: &[u8]| input.as_mut().map(|input| input.write_all(bytes).and_then(|()| input.flush()));
    tell(first);
    let mut told = false;
    let mut pause = Duration::from_millis(1);
    loop {
        // Not by `wait`, which would close the input.
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if signals.stopped() && !told {
            tell(b".");
            told = true;
        }
        often();
        thread::sleep(pause);
        pause = (2 * pause).min(Duration::from_millis(30));
    }
}
