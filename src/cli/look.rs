//! `bismar look SCENE`, `bismar look OLD NEW`

mod args;
mod contents;
mod direction;
mod folders;
mod looked;
mod pair;
mod sheet;
mod shots;

use std::io::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use serde_json::json;

use self::contents::decimal;
use self::looked::SCHEMA;
use self::sheet::Sheet;
use self::shots::{Subject, exposure_of, hash_of};
use super::flag_values::check_ending;
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
        atomic::write(path, |file| Ok(Ok(file.write_all(page.as_bytes())?)))?;
    }
    print_json(&looked.report)?;
    if !verbosity.quiet {
        looked.lines.iter().for_each(say);
        say(format_args!("{}", output.display()));
    }
    Ok(looked.verdict)
}

/// Looks at the scenes of a command, on the current rayon pool, and writes nothing.
///
/// # Errors
/// [`Error::Usage`] for flags that do not fit the scenes; those of the import and of the build; [`Error::Host`] if memory does not
/// suffice; [`Error::Interrupted`] soon after `stop` is raised.
pub fn look(args: &LookArgs, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    args.check()?;
    match &args.scenes[..] {
        [scene] => one(args, scene, paths, stop),
        [old, new] if old.is_dir() && new.is_dir() => folders::look(args, [old, new], paths, stop),
        [old, new] => pair::look(args, [old, new], paths, stop),
        _ => Err(Error::Usage("give one scene, or two to compare".into())),
    }
}

fn one(args: &LookArgs, scene: &Path, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    let mut subject = Subject::open(args, scene, paths)?;
    let views = args.views(subject.contents.bounds.as_ref());
    let shots = subject.shots(&views, args.frames.as_ref(), subject.sphere, stop)?;
    let exposure = exposure_of(shots.iter());
    let columns = if args.frames.is_some() { views.len() } else { (views.len() as f64).sqrt().ceil() as usize };
    let cells = shots.iter().map(|shot| (shot.label(), shot.developed(exposure))).collect();
    let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let title = [name, subject.contents.line()];
    let sheet = Sheet::of(&title, cells, columns, [args.size.0, args.size.1]);
    let mut report = json!({ "schema": SCHEMA, "size": [args.size.0, args.size.1], "spp": args.spp });
    report["hash"] = json!(hash_of(&shots));
    report["exposure"] = json!(decimal(exposure));
    report["views"] = shots.iter().map(|shot| shot.report(exposure)).collect();
    report["scene"] = subject.contents.report()?;
    let mut lines = vec![format!("{}: {}", scene.display(), subject.contents.line())];
    if subject.contents.bounds.is_some() && shots.iter().all(|shot| shot.shown() == 0.0) {
        lines.push("the views show nothing: all surfaces face away or are transparent; try --views bottom,left".into());
    }
    Ok(Looked { sheet, shots, report, lines, verdict: Verdict::Done, page: None })
}
