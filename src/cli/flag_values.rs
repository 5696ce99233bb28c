//! Options by name and value, parsed as the command line does, and endings of file names.

use std::ffi::{OsStr, OsString};
use std::path::Path;

use clap::{Args, Command};

use crate::film::preview;
use crate::{Error, Result};

/// Options of a command: the names of flags without dashes, and their values; `None` for switches.
pub type Options = [(String, Option<OsString>)];

/// Parses options as the command line does.
///
/// # Errors
/// [`Error::Usage`] with clap's first lines.
pub fn parse<T: Args>(name: &'static str, options: &Options, inputs: &[impl AsRef<OsStr>]) -> Result<T> {
    let command = T::augment_args(Command::new(name));
    let mut line = vec![name.into()];
    line.extend(options.iter().map(|(name, value)| match value {
        Some(value) => [format!("--{name}=").as_ref(), value.as_os_str()].into_iter().collect(),
        None => OsString::from(format!("--{name}")),
    }));
    line.push("--".into());
    line.extend(inputs.iter().map(|path| path.as_ref().to_owned()));
    let parsed = command.try_get_matches_from(line).and_then(|matches| T::from_arg_matches(&matches));
    parsed.map_err(|e| Error::Usage(reason(&e)))
}

/// The first lines of clap's error, which say why.
pub(super) fn reason(error: &clap::Error) -> String {
    let text = error.to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    text.split("\n\n").next().unwrap_or(text).trim_end().to_owned()
}

/// Has a path one of these endings, in any case?
pub(super) fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|own| endings.iter().any(|ending| own.eq_ignore_ascii_case(ending)))
}

/// Fails for a path without one of these endings. Devices have none and are allowed, for benchmarks.
pub(super) fn check_ending(flag: &str, path: &Path, endings: &[&str]) -> Result<()> {
    if has_ending(path, endings) || path.starts_with("/dev") {
        return Ok(());
    }
    let hint = match (flag, preview::has_ending(path)) {
        ("-o", true) => {
            let exr = path.with_extension("exr");
            format!(": -o {} --preview {} writes both", exr.display(), path.display())
        }
        _ => String::new(),
    };
    // .png, .jpg or .webp
    let shown: Vec<_> = endings.iter().filter(|ending| **ending != "jpeg").copied().collect();
    let mut list = shown.join(", .");
    if let Some(last) = list.rfind(", ") {
        list.replace_range(last..last + 2, " or ");
    }
    Err(Error::Usage(format!("{flag} {}: the name must end in .{list}{hint}", path.display())))
}
