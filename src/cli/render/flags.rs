//! The flags given on a command line, to pass on to other processes.

use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Command};

use crate::Result;
use crate::farm::utf8;

/// Flags of `command` that were given explicitly, without dashes, with their values; `None` for switches.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage) for values that are not UTF-8.
pub fn given(command: &Command, matches: &ArgMatches) -> Result<Vec<(String, Option<String>)>> {
    let mut flags = Vec::new();
    for arg in command.get_arguments() {
        let (id, Some(name)) = (arg.get_id().as_str(), arg.get_long()) else { continue };
        if matches.try_contains_id(id).is_err() || matches.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        let value = match arg.get_action() {
            ArgAction::SetTrue => None,
            _ => matches.get_raw(id).and_then(|mut values| values.next()),
        };
        let value = value.map(|value| utf8(value.as_ref()).map(str::to_owned)).transpose()?;
        flags.push((name.to_owned(), value));
    }
    Ok(flags)
}
