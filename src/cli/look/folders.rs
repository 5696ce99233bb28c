//! Two folders of scenes: what was added, removed and changed.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::args::LookArgs;
use super::direction::Direction;
use super::looked::{Looked, SCHEMA};
use super::pair::Pair;
use super::sheet::Sheet;
use super::shots::Subject;
use crate::cli::flag_values::has_ending;
use crate::console::{Paths, Verdict};
use crate::scene::import::SceneFiles;
use crate::{Error, Result};

/// Changed scenes that the sheet shows at most; the JSON has all.
const MAX_ON_SHEET: usize = 32;
/// Depth of folders in folders.
const MAX_DEPTH: usize = 16;

/// Looks at two folders, old and new.
///
/// # Errors
/// [`Error::Missing`] if neither has a scene; [`Error::Usage`] for `--page`; [`Error::Interrupted`]. Errors of single scenes are in
/// the JSON and in the lines, and decide the exit code.
pub fn look(args: &LookArgs, folders: [&Path; 2], paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    if args.page.is_some() {
        return Err(Error::Usage("--page shows one pair of scenes, not two folders of them".into()));
    }
    let [old, new] = [scenes(folders[0])?, scenes(folders[1])?];
    if old.is_empty() && new.is_empty() {
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
            Ok(_) => added.push(name.display().to_string()),
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
    for name in old.intersection(&new) {
        let pair = folders.map(|folder| folder.join(name));
        let name = name.display().to_string();
        let mut looked = || -> Result<Option<Pair>> {
            // Their files say the same.
            let hash = |scene: &Path| SceneFiles::open(scene).map(|files| files.survey().hash);
            if hash(&pair[0])? == hash(&pair[1])? {
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
    let counts = [("added", added.len()), ("removed", removed.len()), ("changed", changed.len())];
    let counts = counts.into_iter().chain([("unchanged", unchanged.len()), ("failed", failed.len())]);
    let counts = counts.map(|(what, n)| format!("{n} {what}")).collect::<Vec<_>>().join(", ");
    let title = [folders.map(|folder| folder.display().to_string()).join(" -> "), counts.clone()];
    let sheet = Sheet::of(&title, cells, 3, [args.size.0, args.size.1]);
    lines.push(counts);
    let verdict = match codes.iter().max() {
        None => Verdict::Done,
        Some(1) => Verdict::Beyond,
        Some(code) => Verdict::Worst(*code),
    };
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
        "max_flip": args.max_flip,
        "within": codes.is_empty(),
    });
    Ok(Looked { sheet, shots: Vec::new(), report, lines, verdict, page: None })
}

fn failure(name: &str, error: &Error) -> Value {
    json!({ "name": name, "error": error.to_string(), "exit_code": error.exit_code() })
}

/// The scenes below a folder, relative to it. Links to folders are not followed.
fn scenes(folder: &Path) -> Result<BTreeSet<PathBuf>> {
    let mut found = BTreeSet::new();
    let mut open = vec![(folder.to_owned(), 0)];
    while let Some((inside, depth)) = open.pop() {
        let entries = fs::read_dir(&inside).map_err(|e| Error::reading(&inside, &e))?;
        for entry in entries.flatten() {
            let path = entry.path();
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                open.extend((depth < MAX_DEPTH).then_some((path, depth + 1)));
            } else if has_ending(&path, &["glb", "gltf"]) {
                found.extend(path.strip_prefix(folder).map(Path::to_owned).ok());
            }
        }
    }
    Ok(found)
}
