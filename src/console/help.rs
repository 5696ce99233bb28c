//! `completions SHELL`, `man FOLDER` and `options`: shell completions, manual pages and a description as JSON, made from the
//! flags.

use std::any::TypeId;
use std::path::{Path, PathBuf};

use clap::{Arg, Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use serde_json::{Map, Value, json};

use super::{Verdict, print, print_json, say};
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

/// Print the flags of all commands as JSON, from which `npm/` is made.
#[derive(Debug, Args)]
pub struct OptionsArgs {}

impl OptionsArgs {
    /// Prints them: of each command its flags; of each flag its name, its name in libraries (that of its alias, if it has one),
    /// its values and its help.
    pub fn run(&self, program: &Command) -> Result<Verdict> {
        let shown = |command: &&Command| !command.is_hide_set();
        let options = |command: &Command| command.get_arguments().filter_map(described).collect::<Value>();
        let commands = program.get_subcommands().filter(shown);
        print_json(&commands.map(|command| (command.get_name().to_owned(), options(command))).collect::<Map<_, _>>())?;
        Ok(Verdict::Done)
    }
}

/// The description of a flag; `None` for hidden ones and for arguments without a name.
fn described(arg: &Arg) -> Option<Value> {
    let long = arg.get_long().filter(|_| !arg.is_hide_set())?;
    let aliases = arg.get_all_aliases().unwrap_or_default();
    let values: Vec<_> = arg.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect();
    let parsed = arg.get_value_parser().type_id();
    let numbers =
        [TypeId::of::<f32>(), TypeId::of::<f64>(), TypeId::of::<u32>(), TypeId::of::<u64>(), TypeId::of::<usize>()];
    let takes_value = arg.get_action().takes_values();
    Some(json!({
        "flag": long,
        "name": aliases.first().unwrap_or(&long).replace('-', "_"),
        "value": takes_value.then(|| arg.get_value_names().and_then(|names| names.first()).map(|name| name.to_string())).flatten(),
        "switch": !takes_value,
        "number": numbers.iter().any(|number| parsed == *number),
        "choices": if takes_value { values } else { Vec::new() },
        "heading": arg.get_help_heading(),
        "help": arg.get_help().map(ToString::to_string),
    }))
}

impl CompletionsArgs {
    /// Prints the completions of a program.
    pub fn run(&self, mut program: Command) -> Result<Verdict> {
        let (name, mut script) = (program.get_name().to_owned(), Vec::new());
        clap_complete::generate(self.shell, &mut program, name, &mut script);
        print(String::from_utf8_lossy(&script).trim_end())?;
        Ok(Verdict::Done)
    }
}

impl ManArgs {
    /// Writes the pages of a program and of all its commands.
    /// Errors: [`Error::CannotCreate`] for the folder; those of [`atomic::write`].
    pub fn run(&self, program: Command) -> Result<Verdict> {
        let folder = &self.folder;
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", folder.display())))?;
        atomic::confine(std::slice::from_ref(folder));
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
