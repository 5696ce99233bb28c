//! Two folders of scenes: what was added, removed and changed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::{fs, io};

use serde_json::{Value, json};

use super::args::LookArgs;
use super::direction::Direction;
use super::looked::{Looked, SCHEMA};
use super::pair::Pair;
use super::sheet::Sheet;
use super::shots::Subject;
use crate::cli::options::has_ending;
use crate::console::{Paths, Verdict};
use crate::scene::import::SceneFiles;
use crate::{Error, Result};

/// Changed scenes that the sheet shows at most; the JSON has all.
const MAX_ON_SHEET: usize = 32;
/// Depth of folders in folders.
const MAX_DEPTH: usize = 16;
/// Why a scene was not compared in full.
const UNREAD: &str = "files that it names, which could not be read";
/// Exit code if anything was left out: that of data that cannot be used.
const LEFT_OUT: u8 = 65;

/// Looks at two folders, old and new.
/// Errors: [`Error::Missing`] if neither has a scene; [`Error::Usage`] for `--page`; [`Error::Interrupted`]. Errors of
/// single scenes are in the JSON and in the lines, and decide the exit code.
pub fn look(args: &LookArgs, folders: [&Path; 2], paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    if args.page.is_some() {
        return Err(Error::Usage("--page shows one pair of scenes, not two folders of them".into()));
    }
    let [(mut old, left), (mut new, left_new)] = [scenes(folders[0])?, scenes(folders[1])?];
    let mut left_out: BTreeMap<PathBuf, &str> = left.into_iter().chain(left_new).collect();
    // What was left out on one side was neither added nor removed.
    let is_known = |name: &PathBuf| !name.ancestors().any(|part| left_out.contains_key(part));
    [&mut old, &mut new].into_iter().for_each(|names| names.retain(is_known));
    if left_out.is_empty() && old.is_empty() && new.is_empty() {
        let [a, b] = folders.map(Path::display);
        return Err(Error::Missing(format!("{a} and {b}: there is no .glb or .gltf file in these folders")));
    }
    let views = if args.views.is_empty() { &[Direction::ThreeQuarters] } else { &args.views[..] };
    let (mut changed, mut unchanged, mut failed) = (Vec::new(), Vec::new(), Vec::new());
    let (mut cells, mut lines, mut codes) = (Vec::new(), Vec::new(), Vec::new());
    let mut added = Vec::new();
    for name in new.difference(&old) {
        // What cannot be shown is no new scene.
        match Subject::open(args, &folders[1].join(name), paths) {
            Ok(subject) => {
                added.push(name.display().to_string());
                left_out.extend((!subject.contents.whole).then(|| (name.clone(), UNREAD)));
            }
            Err(error) => {
                lines.push(error.to_string());
                codes.push(error.exit_code());
                failed.push(failure(&name.display().to_string(), &error));
            }
        }
    }
    let removed: Vec<String> = old.difference(&new).map(|name| name.display().to_string()).collect();
    for (what, names) in [("added", &added), ("removed", &removed)] {
        lines.extend(names.iter().map(|name| format!("{name}: {what}")));
    }
    for path in old.intersection(&new) {
        let pair = folders.map(|folder| folder.join(path));
        let name = path.display().to_string();
        let mut looked = || -> Result<Option<Pair>> {
            // Their files say the same, as far as all could be read.
            let survey = |scene: &Path| SceneFiles::open(scene).map(|files| files.survey());
            let [old, new] = [survey(&pair[0])?, survey(&pair[1])?];
            if old.is_whole && new.is_whole && old.hash == new.hash {
                return Ok(None);
            }
            Pair::look(args, [&pair[0], &pair[1]], views, paths, stop).map(Some)
        };
        match looked() {
            Ok(None) => unchanged.push(name),
            Ok(Some(pair)) => {
                lines.extend([&pair.words[..], &pair.failures].concat().iter().map(|text| format!("{name}: {text}")));
                if changed.len() < MAX_ON_SHEET {
                    cells.extend(pair.cells.into_iter().map(|(label, cell)| (format!("{name}: {label}"), cell)));
                }
                codes.extend((!pair.failures.is_empty()).then_some(1));
                let mut report = pair.report;
                let is_whole = ["old", "new"].iter().all(|side| report[side]["whole"] == true);
                left_out.extend((!is_whole).then(|| (path.clone(), UNREAD)));
                report["name"] = json!(name);
                changed.push(report);
            }
            Err(error @ Error::Interrupted(_)) => return Err(error),
            Err(error) => {
                lines.push(error.to_string());
                codes.push(error.exit_code());
                failed.push(failure(&name, &error));
            }
        }
    }
    for (name, why) in &left_out {
        lines.push(format!("{}: left out: {why}", name.display()));
        codes.push(LEFT_OUT);
    }
    let counts = [("added", added.len()), ("removed", removed.len()), ("changed", changed.len())];
    let counts = counts.into_iter().chain([("unchanged", unchanged.len()), ("failed", failed.len())]);
    let counts = counts.map(|(what, n)| format!("{n} {what}")).collect::<Vec<_>>().join(", ");
    let title = [folders.map(|folder| folder.display().to_string()).join(" -> "), counts.clone()];
    let sheet = Sheet::of(&title, cells, 3, [args.size.0, args.size.1]);
    lines.push(counts);
    let left_out = left_out.iter().map(|(name, why)| json!({ "name": name.display().to_string(), "why": why }));
    let report = json!({
        "schema": SCHEMA,
        "size": [args.size.0, args.size.1],
        "spp": args.spp,
        "added": added,
        "removed": removed,
        "unchanged": unchanged,
        "on_sheet": changed.len().min(MAX_ON_SHEET),
        "changed": changed,
        "failed": failed,
        "left_out": left_out.collect::<Vec<_>>(),
        "max_flip": args.max_flip,
        "within": codes.is_empty(),
    });
    Ok(Looked { sheet, shots: Vec::new(), report, lines, verdict: verdict(&codes), page: None })
}

fn failure(name: &str, error: &Error) -> Value {
    json!({ "name": name, "error": error.to_string(), "exit_code": error.exit_code() })
}

/// The verdict of these exit codes of scenes.
pub fn verdict(codes: &[u8]) -> Verdict {
    match codes.iter().max() {
        None => Verdict::Done,
        Some(1) => Verdict::Beyond,
        Some(code) => Verdict::Worst(*code),
    }
}

/// A scene that was left out, and why.
type LeftOut = (PathBuf, &'static str);

/// The scenes below a folder, and what was left out with why, relative to it. Links lead to files below the folder alone: those to
/// its own folders would show scenes twice.
fn scenes(folder: &Path) -> Result<(BTreeSet<PathBuf>, Vec<LeftOut>)> {
    let failed = |path: &Path, e: &io::Error| Error::reading(path, e);
    let place = folder.canonicalize().map_err(|e| failed(folder, &e))?;
    let (mut found, mut left_out) = (BTreeSet::new(), Vec::new());
    let mut open = vec![(folder.to_owned(), 0)];
    while let Some((inside, depth)) = open.pop() {
        for entry in fs::read_dir(&inside).map_err(|e| failed(&inside, &e))? {
            let entry = entry.map_err(|e| failed(&inside, &e))?;
            let (path, is_link) = (entry.path(), entry.file_type().is_ok_and(|kind| kind.is_symlink()));
            let name = path.strip_prefix(folder).unwrap_or(&path).to_owned();
            // Where it leads, if there is anything.
            let target = path.canonicalize().ok();
            let leads_out = is_link && target.as_ref().is_some_and(|target| !target.starts_with(&place));
            let is_scene = has_ending(&path, &["glb", "gltf"]);
            match path.is_dir() {
                true if leads_out => left_out.push((name, "a link to a folder elsewhere")),
                true if is_link => {}
                true if depth == MAX_DEPTH => left_out.push((name, "too deep in folders")),
                true => open.push((path, depth + 1)),
                false if is_scene && leads_out => left_out.push((name, "a link to a file elsewhere")),
                false if is_scene && !path.is_file() => left_out.push((name, "no file")),
                false => found.extend(is_scene.then_some(name)),
            }
        }
    }
    Ok((found, left_out))
}
