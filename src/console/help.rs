//! `completions SHELL` and `man FOLDER`: shell completions and manual pages, made from the flags.

use std::path::{Path, PathBuf};

use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;

use super::{Verdict, print, say};
use crate::film::atomic;
use crate::{Error, Result};

/// Print completions for a shell.
///
/// bash: bismar completions bash > ~/.local/share/bash-completion/completions/bismar
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell.
    shell: Shell,
}

/// Write manual pages, one per command.
///
/// Where man looks for them: bismar man ~/.local/share/man/man1
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Output folder; created if it does not exist.
    folder: PathBuf,
}

impl CompletionsArgs {
    /// Prints the completions of a program.
    ///
    /// # Errors
    /// Those of [`print()`].
    pub fn run(&self, mut program: Command) -> Result<Verdict> {
        let (name, mut script) = (program.get_name().to_owned(), Vec::new());
        clap_complete::generate(self.shell, &mut program, name, &mut script);
        print(String::from_utf8_lossy(&script).trim_end())?;
        Ok(Verdict::Done)
    }
}

impl ManArgs {
    /// Writes the pages of a program and of all its commands.
    ///
    /// # Errors
    /// [`Error::CannotCreate`] for the folder; those of [`atomic::write`].
    pub fn run(&self, program: Command) -> Result<Verdict> {
        let folder = &self.folder;
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", folder.display())))?;
        let mut program = program.disable_help_subcommand(true);
        program.build();
        let pages = write_pages(&program, folder)?;
        say(format_args!("wrote {pages} pages to {}", folder.display()));
        Ok(Verdict::Done)
    }
}

/// Writes the pages of a command and returns their number.
fn write_pages(command: &Command, folder: &Path) -> Result<usize> {
    let man = Man::new(command.clone());
    atomic::write(&folder.join(man.get_filename()), |mut file| man.render(&mut file).map(Ok))?;
    let commands = command.get_subcommands().filter(|command| !command.is_hide_set());
    commands.map(|command| write_pages(command, folder)).try_fold(1, |sum, pages| Ok(sum + pages?))
}
