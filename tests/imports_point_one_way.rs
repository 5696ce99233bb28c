//! Imports follow the data flow of `docs/architecture.md`: a room sees those before it, never those after.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Each room and the rooms that it may see. `error`, `guard`, `lanes` and `color` are tools that all may use.
const SEES: [(&str, &[&str]); 18] = [
    ("error", &[]),
    ("guard", &[]),
    ("lanes", &[]),
    ("color", &[]),
    ("sampling", &[]),
    ("balance", &["sampling"]),
    ("bsdf", &["sampling"]),
    ("scene", &["film"]),
    ("rays", &["scene"]),
    ("light", &["scene", "sampling"]),
    ("film", &[]),
    ("guiding", &["sampling"]),
    ("integrator", &["scene", "rays", "light", "bsdf", "sampling", "balance", "film", "guiding"]),
    ("render", &["scene", "rays", "light", "sampling", "balance", "film", "guiding", "integrator"]),
    ("console", &["film", "render"]),
    ("batch", ALL),
    ("farm", ALL),
    ("cli", ALL),
];
const ALL: &[&str] = &[
    "scene",
    "rays",
    "light",
    "bsdf",
    "sampling",
    "balance",
    "film",
    "guiding",
    "integrator",
    "render",
    "console",
    "batch",
    "farm",
];
const TOOLS: [&str; 4] = ["error", "guard", "lanes", "color"];

/// Names that only some folders or files may use.
const KEPT_IN: [(&str, &[&str]); 7] = [
    ("unsafe ", &["rays/embree", "film/denoise.rs", "console/memory"]),
    ("libloading::", &["film/denoise.rs"]),
    ("embree4_sys", &["rays/embree"]),
    ("obvhs::", &["rays/cwbvh"]),
    ("clap::", &["cli", "console"]),
    ("std::fs", &["scene/import/source", "film", "console", "cli", "batch", "farm"]),
    ("std::process", &["cli", "console", "batch", "farm", "main.rs"]),
];

/// Where the rooms are: three crates hold them.
const SOURCES: [&str; 3] = ["src", "crates/scene/src", "crates/transport/src"];

/// All files below a folder.
fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { walk(&path, found) } else { found.push(path) }
    }
}

/// Relative path and text without comments of every source file.
fn sources() -> Vec<(String, String)> {
    let mut all = Vec::new();
    for folder in SOURCES.map(|source| Path::new(env!("CARGO_MANIFEST_DIR")).join(source)) {
        let mut paths = Vec::new();
        walk(&folder, &mut paths);
        for path in paths.iter().filter(|path| path.extension().is_some_and(|extension| extension == "rs")) {
            let name = path.strip_prefix(&folder).unwrap().to_str().unwrap().to_owned();
            all.push((name, without_comments(&fs::read_to_string(path).unwrap())));
        }
    }
    assert!(all.len() > 50, "{} source files", all.len());
    all
}

fn without_comments(text: &str) -> String {
    let code = |line: &str| line.find("//").map_or(line.len(), |at| at);
    text.lines().map(|line| line[..code(line)].to_owned() + "\n").collect()
}

/// First names of all paths that start with `crate::`, whether in a list or alone.
fn names_in_crate(text: &str) -> BTreeSet<String> {
    let name = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut names = BTreeSet::new();
    for (at, found) in text.match_indices("crate::") {
        let rest = &text[at + found.len()..];
        let Some(list) = rest.strip_prefix('{') else {
            names.insert(name(rest));
            continue;
        };
        let mut depth = 1;
        let mut at_start = true;
        for (at, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => at_start = true,
                c if at_start && depth == 1 && !c.is_whitespace() => {
                    names.insert(name(&list[at..]));
                    at_start = false;
                }
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }
    names
}

/// `rays` for `rays/embree/device.rs`, `color` for `color.rs`.
fn room(file: &str) -> &str {
    file.split('/').next().unwrap().trim_end_matches(".rs")
}

#[test]
fn rooms_import_only_what_comes_before_them() {
    let mut failures = Vec::new();
    for (file, text) in sources() {
        let room = room(&file);
        if matches!(room, "lib" | "main") {
            continue;
        }
        let Some((_, sees)) = SEES.iter().find(|rule| rule.0 == room) else {
            failures
                .push(format!("{file}: no rule says what `{room}` may see; docs/architecture.md tells how to add one"));
            continue;
        };
        for name in names_in_crate(&text) {
            // Names of the crate's root itself: `Error`, `Result`.
            let at_root = name.starts_with(char::is_uppercase);
            if !at_root && name != room && !TOOLS.contains(&&*name) && !sees.contains(&&*name) {
                failures.push(format!("{file}: `{room}` must not see `{name}`"));
            }
        }
        // `super::` at a file's outermost level climbs from its own module; it must not climb out of the room.
        let depth = file.trim_end_matches("/mod.rs").split('/').count();
        for line in text.lines().filter(|line| line.starts_with("use ") || line.starts_with("pub use ")) {
            if line.matches("super::").count() >= depth {
                failures.push(format!("{file}: `{line}` leaves the room; write `crate::`"));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn the_importer_goes_from_source_to_document_to_build() {
    // Names that each of its rooms must not use.
    let later = [("source", ["document", "build"]), ("document", ["build", "summary"])];
    let mut seen = 0;
    for (file, text) in sources() {
        for (room, rooms) in later {
            if file.starts_with(&format!("scene/import/{room}/")) {
                seen += 1;
                for name in rooms {
                    let named = ["import", "super", "super::super"].map(|from| format!("{from}::{name}"));
                    assert!(!named.iter().any(|path| text.contains(path)), "{file}: `{room}` must not see `{name}`");
                }
            }
        }
    }
    assert!(seen > 10, "{seen} files in the importer's rooms");
}

#[test]
fn what_only_some_rooms_may_do_is_done_there() {
    let mut failures = Vec::new();
    for (file, text) in sources() {
        for (word, places) in KEPT_IN {
            if text.contains(word) && !places.iter().any(|place| file.starts_with(place)) {
                failures.push(format!("{file}: `{}` belongs into {places:?}", word.trim_end()));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn the_architecture_names_files_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    ["src", "crates", "study", "tests", "scripts", "lab", "examples"]
        .iter()
        .for_each(|folder| walk(&root.join(folder), &mut paths));
    let text = fs::read_to_string(root.join("docs/architecture.md")).unwrap();
    // What is between backticks, with one list in braces written out.
    let variants = |name: &str| match name.split_once('{').and_then(|(a, rest)| Some((a, rest.split_once('}')?))) {
        Some((before, (list, after))) => list.split(',').map(|word| format!("{before}{word}{after}")).collect(),
        None => vec![name.to_owned()],
    };
    let quoted = text.lines().flat_map(|line| line.split('`').skip(1).step_by(2).collect::<Vec<_>>());
    let files = quoted.flat_map(variants).filter(|name| name.ends_with(".rs") || name.ends_with(".py"));
    let files: Vec<_> = files.filter(|name| !name.contains("NAME")).collect();
    let missing: Vec<_> = files.iter().filter(|name| !paths.iter().any(|path| path.ends_with(name))).collect();
    assert!(files.len() > 40 && missing.is_empty(), "{} files, missing {missing:?}", files.len());
}

#[test]
fn every_form_of_an_import_is_seen() {
    let text = without_comments(
        "use crate::scene::{Mesh, Scene};\n/// [`crate::cli`]\nuse crate::{\n    Error, film::{self, Film},\n    rays,\n};\n\
         fn f() -> crate::render::Rendered { todo!() } // crate::farm\n",
    );
    let names: Vec<_> = names_in_crate(&text).into_iter().collect();
    assert_eq!(names, ["Error", "film", "rays", "render", "scene"]);
    assert_eq!([room("rays/embree/device.rs"), room("color.rs")], ["rays", "color"]);
}
