//! `bismar look SCENE...`, `bismar look OLD NEW`

mod args;
mod contents;
mod direction;
mod folders;
mod looked;
mod many;
mod pair;
mod sheet;
mod shots;

use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::compare::page::save;
use super::options::check_ending;
use crate::console::{Paths, Signals, Verbosity, Verdict, host, print_json, say};
use crate::film::{atomic, preview};
use crate::job::memory;
use crate::{Error, Result};
pub use args::LookArgs;
pub use looked::Looked;
pub use shots::Shot;

pub fn run(args: &LookArgs, verbosity: Verbosity) -> Result<Verdict> {
    let output = args.output();
    let mut paths = Paths::default();
    check_ending("-o", &output, &preview::ENDINGS)?;
    args.page.iter().try_for_each(|page| check_ending("--page", page, &["html"]))?;
    [&args.output, &args.page].into_iter().flatten().for_each(|path| atomic::named(path));
    atomic::confine(&[]);
    args.scenes.iter().try_for_each(|scene| paths.reads("the scene", scene))?;
    paths.writes("-o", &output)?;
    args.page.iter().try_for_each(|page| paths.writes("--page", page))?;
    let outputs = [Some(&output), args.page.as_ref()];
    outputs.into_iter().flatten().try_for_each(|path| atomic::check(path))?;
    let (threads, _) = host::threads(args.threads)?;
    memory::hold(memory::limit(args.memory_limit)?);
    let signals = Signals::listen()?;
    let mut looked =
        signals.nothing_to_save(|| host::pool(threads)?.install(|| look(args, &mut paths, &signals.stop)))?;
    atomic::sweep(&output);
    looked.sheet.write(&output)?;
    looked.report["sheet"] = json!(output.display().to_string());
    if let Some((path, page)) = args.page.as_ref().zip(looked.page) {
        save(path, &page)?;
    }
    print_json(&looked.report)?;
    if !verbosity.quiet {
        looked.lines.iter().for_each(say);
        say(format_args!("{}", output.display()));
    }
    Ok(looked.verdict)
}

/// Looks at the scenes of a command, on the current rayon pool, and writes nothing.
/// Errors: [`Error::Usage`] for flags that do not fit the scenes; those of the import and of the build; [`Error::Host`] if
/// memory does not suffice; [`Error::Interrupted`] soon after `stop` is raised.
pub fn look(args: &LookArgs, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    args.check()?;
    match &args.scenes[..] {
        [scene] => many::one(args, scene, paths, stop),
        [old, new] if old.is_dir() && new.is_dir() => folders::look(args, [old, new], paths, stop),
        [old, new] => pair::look(args, [old, new], paths, stop),
        [] => Err(Error::Usage("give a scene, two to compare, or more".into())),
        _ => many::look(args, paths, stop),
    }
}
