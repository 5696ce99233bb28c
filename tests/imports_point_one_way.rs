//! Imports follow the data flow of `docs/architecture.md`: a room sees those before it, never those after.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Each room and the rooms that it may see. `error`, `guard`, `lanes` and `color` are tools that all may use.
const SEES: [(&str, &[&str]); 19] = [
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
    ("job", &["scene", "rays", "light", "sampling", "balance", "film", "integrator", "render", "console"]),
    ("batch", ALL),
    ("farm", ALL),
    ("cli", ALL),
];
/// All but the command line.
const ALL: &[&str] = &["all"];
const TOOLS: [&str; 4] = ["error", "guard", "lanes", "color"];

/// Names that only some folders or files may use.
const KEPT_IN: [(&str, &[&str]); 7] = [
    ("unsafe ", &["rays/embree", "film/denoise.rs", "console/memory"]),
    ("libloading::", &["film/denoise.rs"]),
    ("embree4_sys", &["rays/embree"]),
    ("obvhs::", &["rays/cwbvh"]),
    ("clap::", &["cli", "console", "job/request"]),
    ("std::fs", &["scene/import/source", "film", "console", "job", "cli", "batch", "farm"]),
    ("std::process", &["cli", "console", "job", "batch", "farm", "main.rs"]),
];

/// Where the rooms are: three crates hold them.
const SOURCES: [&str; 3] = ["src", "crates/scene/src", "crates/transport/src"];

/// All files and folders below a folder.
fn below(folder: &Path) -> Vec<PathBuf> {
    glob::glob(&format!("{}/**/*", folder.display())).unwrap().map(Result::unwrap).collect()
}

/// Relative path and text without comments of a folder's source files.
fn files(source: &str) -> Vec<(String, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(source);
    let rust = below(&folder).into_iter().filter(|path| path.extension().is_some_and(|extension| extension == "rs"));
    let name = |path: &Path| path.strip_prefix(&folder).unwrap().to_str().unwrap().to_owned();
    rust.map(|path| (name(&path), without_comments(&fs::read_to_string(&path).unwrap()))).collect()
}

/// The sources of all crates.
fn crates() -> impl Iterator<Item = &'static str> {
    SOURCES.into_iter().chain(["study/src", "python/src"])
}

fn sources() -> Vec<(String, String)> {
    let all: Vec<_> = SOURCES.into_iter().flat_map(files).collect();
    assert!(all.len() > 50, "{} source files", all.len());
    all
}

fn without_comments(text: &str) -> String {
    let code = |line: &str| line.find("//").map_or(line.len(), |at| at);
    text.lines().map(|line| line[..code(line)].to_owned() + "\n").collect()
}

/// What a text imports, as (what is before `use`, the name that it binds, its path), and the rest of the text.
fn imports(text: &str) -> (Vec<(&str, String, String)>, String) {
    let (mut found, mut body) = (Vec::new(), String::new());
    let mut rest = text;
    while let Some((line, _)) = rest.split_once('\n') {
        let import = line.split_once("use ");
        let import = import.filter(|(before, _)| matches!(before.trim(), "" | "pub" | "pub(crate)" | "pub(super)"));
        let end = import.and_then(|_| rest.find(';')).unwrap_or(line.len());
        match import {
            Some((before, tree)) => write_out("", &rest[line.len() - tree.len()..end], &mut |name, path| {
                found.push((before, name, path));
            }),
            None => body += &rest[..=end],
        }
        rest = &rest[end + 1..];
    }
    (found, body)
}

/// Writes out the lists of `a::{b, c::d as e}`, as names and their paths: `b` for `a::b`, `e` for `a::c::d`.
fn write_out(prefix: &str, tree: &str, found: &mut dyn FnMut(String, String)) {
    let Some((head, list)) = tree.split_once('{') else {
        let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
        let path = format!("{prefix}{}", path.trim()).trim_end_matches("::self").to_owned();
        let name = if alias.is_empty() { path.rsplit("::").next().unwrap() } else { alias.trim() };
        return found(name.to_owned(), path);
    };
    let mut depth = 0;
    let at_comma = |c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    };
    let items = list[..list.rfind('}').unwrap()].split(at_comma).filter(|item| !item.trim().is_empty());
    items.for_each(|item| write_out(&format!("{prefix}{}", head.trim()), item, found));
}

/// Names, and paths of names.
fn paths(body: &str) -> BTreeSet<&str> {
    body.split(|c: char| !(c.is_alphanumeric() || "_:".contains(c))).map(|path| path.trim_matches(':')).collect()
}

/// First names of all paths that start with `crate::`, whether in a list or alone.
fn names_in_crate(text: &str) -> BTreeSet<String> {
    let (imported, body) = imports(text);
    let all = imported.into_iter().map(|(.., path)| path).chain(paths(&body).into_iter().map(str::to_owned));
    all.filter_map(|path| Some(path.strip_prefix("crate::")?.split("::").next()?.to_owned())).collect()
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
            let sees_all = *sees == ALL && name != "cli" && SEES.iter().any(|rule| rule.0 == name);
            if !at_root && name != room && !TOOLS.contains(&&*name) && !sees.contains(&&*name) && !sees_all {
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

/// The modules of a crate by path (`crate::rays::embree`), without what is compiled for tests only.
type Modules = BTreeMap<String, Module>;

struct Module {
    file: String,
    /// By the name that is bound: is it only re-exported, and its path from the root, empty for what is of another crate.
    imports: BTreeMap<String, (bool, String)>,
    body: String,
}

fn modules(files: Vec<(String, String)>) -> Modules {
    let (mut modules, mut written) = (Modules::new(), Vec::new());
    for (file, text) in files.into_iter().filter(|(file, _)| file != "main.rs") {
        let path = format!("crate::{}", file.trim_end_matches(".rs").replace('/', "::"));
        let path = path.trim_end_matches("::mod").trim_end_matches("::lib").to_owned();
        let mut parts = text.split("#[cfg(test)]\n");
        let mut code = parts.next().unwrap().to_owned();
        for part in parts {
            let line = part.find('\n').unwrap_or(0);
            code += &part[if part[..line].ends_with(';') { line } else { part.find("\n}\n").unwrap_or(line) }..];
        }
        let code: String = code.split_inclusive('\n').filter(|line| !line.contains("mod ")).collect();
        let (imports, body) = imports(&code);
        // `super` of a module within the file is another one.
        let imports = imports.into_iter().filter(|(before, ..)| !before.starts_with(' '));
        written
            .push((path.clone(), imports.map(|(before, name, at)| (name, before.is_empty(), at)).collect::<Vec<_>>()));
        modules.insert(path, Module { file, imports: BTreeMap::new(), body });
    }
    for (path, imports) in written {
        let body = paths(&modules[&path].body);
        let kept = |(name, own, at): (String, bool, String)| {
            let only_shown = !own && !body.contains(&*name);
            let at = from_root(&at, &path, &modules).unwrap_or_default();
            (name, (only_shown, at))
        };
        let imports = imports.into_iter().map(kept).collect();
        modules.get_mut(&path).unwrap().imports = imports;
    }
    modules
}

/// A path in a module, from the crate's root; `None` if it is of another crate.
fn from_root(path: &str, module: &str, modules: &Modules) -> Option<String> {
    let (first, rest) = path.split_once("::").unwrap_or((path, ""));
    let join = |at: &str, rest: &str| format!("{at}::{rest}").trim_end_matches("::").to_owned();
    let below = |at: &str| from_root(rest, at, modules).unwrap_or(join(at, rest));
    match first {
        "crate" => Some(path.to_owned()),
        "self" => Some(below(module)),
        "super" => Some(below(module.rsplit_once("::")?.0)),
        _ if modules.contains_key(&join(module, first)) => Some(join(module, path)),
        _ => Some(join(&modules.get(module)?.imports.get(first).filter(|(_, at)| !at.is_empty())?.1, rest)),
    }
}

/// The file that defines what a path from the root names, behind all re-exports, and the name.
fn home<'a>(path: &str, modules: &'a Modules) -> Option<(&'a str, String)> {
    let mut ends = path.rmatch_indices("::").map(|(end, _)| end).filter(|_| !modules.contains_key(path));
    let (module, rest) = ends.find_map(|end| Some((modules.get(&path[..end])?, &path[end + 2..])))?;
    let name = rest.split("::").next().unwrap();
    let again = module.imports.get(name).map(|(_, path)| home(path, modules));
    again.unwrap_or_else(|| Some((&module.file, name.to_owned())))
}

/// A circle of files, each with what the one before takes from it.
fn circle(files: Vec<(String, String)>) -> Option<String> {
    let modules = modules(files);
    let mut sees: BTreeMap<&str, BTreeMap<&str, BTreeSet<String>>> = BTreeMap::new();
    for (path, Module { file, imports, body }) in &modules {
        let imported = imports.values().filter(|(only_shown, _)| !only_shown).map(|(_, at)| at.clone());
        let named = paths(body).into_iter().filter(|name| name.contains("::"));
        for at in imported.chain(named.filter_map(|name| from_root(name, path, &modules))) {
            if let Some((other, name)) = home(&at, &modules).filter(|(other, _)| other != file) {
                sees.entry(file).or_default().entry(other).or_default().insert(name);
            }
        }
    }
    // What sees none of the rest is in no circle; what then sees none is neither.
    let mut before = 0;
    while before != sees.len() {
        before = sees.len();
        let left: BTreeSet<_> = sees.keys().copied().collect();
        sees.values_mut().for_each(|others| others.retain(|other, _| left.contains(other)));
        sees.retain(|_, others| !others.is_empty());
    }
    let mut walked = vec![*sees.keys().next()?];
    loop {
        let (next, _) = sees[walked.last().unwrap()].first_key_value().unwrap();
        let start = walked.iter().position(|file| file == next);
        walked.push(next);
        if let Some(start) = start {
            let step = |two: &[&str]| format!(" -> {} {:?}", two[1], sees[two[0]][two[1]]);
            return Some((*next).to_owned() + &walked[start..].windows(2).map(step).collect::<String>());
        }
    }
}

#[test]
fn files_import_each_other_in_no_circle() {
    let circles = crates().map(|source| circle(files(source)));
    assert_eq!(circles.flatten().collect::<Vec<_>>(), [""; 0]);
}

#[test]
fn a_circle_is_found_through_re_exports_and_in_bodies() {
    let of =
        |files: &[(&str, &str)]| circle(files.iter().map(|(file, text)| ((*file).into(), (*text).into())).collect());
    let shown = ("a/mod.rs", "mod b;\nmod c;\npub use b::{B, c as d};\n#[cfg(test)]\nmod tests;\nuse std::fs;\n");
    let b = ("a/b.rs", "use super::c::{self, C};\n#[cfg(test)]\nmod tests {\n    use crate::x::X;\n}\n");
    assert_eq!(of(&[("lib.rs", "mod a;\n"), shown, b, ("a/c.rs", "use fs::x;\n")]), None);
    let found = of(&[("lib.rs", "mod a;\n"), shown, b, ("a/c.rs", "fn f() { crate::a::B::new() }\n")]);
    assert_eq!(found.unwrap(), "a/b.rs -> a/c.rs {\"C\"} -> a/b.rs {\"B\"}");
    let found = of(&[("lib.rs", ""), ("a.rs", "mod b;\npub use b::B;\nstruct A(B);\n"), ("a/b.rs", "use super::A;\n")]);
    assert_eq!(found.unwrap(), "a.rs -> a/b.rs {\"B\"} -> a.rs {\"A\"}");
}

/// Folders within a room, in order: each imports only what stands before it.
const LAYERS: [(&str, &[&str]); 3] = [
    ("scene/import", &["source", "document", "build", "summary"]),
    ("render", &["settings", "pass", "prepass", "record", "driver"]),
    ("integrator", &["surface", "data", "events", "stages", "through", "clients", "reuse", "guides", "wave"]),
];

#[test]
fn layers_within_a_room_import_only_what_comes_before_them() {
    let mut seen = 0;
    for (file, text) in sources() {
        for (room, layers) in LAYERS {
            let Some(rest) = file.strip_prefix(room) else { continue };
            let layer = rest.trim_start_matches('/').split(['/', '.']).next().unwrap();
            let Some(number) = layers.iter().position(|other| *other == layer) else { continue };
            seen += 1;
            let parent = room.rsplit('/').next().unwrap();
            for later in &layers[number + 1..] {
                for from in [parent, "super", "super::super"] {
                    let named = format!("{from}::{later}");
                    let goes_on = |rest: &str| rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
                    let seen = text.split(&named).skip(1).any(|rest| !goes_on(rest));
                    assert!(!seen, "{file}: `{layer}` must not see `{later}`");
                }
            }
        }
    }
    assert!(seen > 60, "{seen} files in layers");
}

#[test]
fn what_only_some_rooms_may_do_is_done_there() {
    for (file, text) in sources() {
        for (word, places) in KEPT_IN {
            let kept = !text.contains(word) || places.iter().any(|place| file.starts_with(place));
            assert!(kept, "{file}: `{}` belongs into {places:?}", word.trim_end());
        }
    }
}

#[test]
fn the_architecture_names_files_types_and_functions_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = ["src", "crates", "study", "tests", "scripts", "lab", "examples", "python"];
    let paths: Vec<_> = folders.iter().flat_map(|folder| below(&root.join(folder))).collect();
    let text = fs::read_to_string(root.join("docs/architecture.md")).unwrap();
    // What is between backticks, with one list in braces written out.
    let variants = |name: &str| match name.split_once('{').and_then(|(a, rest)| Some((a, rest.split_once('}')?))) {
        Some((before, (list, after))) => list.split(',').map(|word| format!("{before}{word}{after}")).collect(),
        None => vec![name.to_owned()],
    };
    let quoted: Vec<_> = text.lines().flat_map(|line| line.split('`').skip(1).step_by(2)).collect();
    let named =
        quoted.iter().flat_map(|name| variants(name)).filter(|name| name.ends_with(".rs") || name.ends_with(".py"));
    let named: Vec<_> = named.filter(|name| !name.contains("NAME")).collect();
    let missing: Vec<_> = named.iter().filter(|name| !paths.iter().any(|path| path.ends_with(name))).collect();
    assert!(named.len() > 40 && missing.is_empty(), "{} files, missing {missing:?}", named.len());

    let code: String = crates().flat_map(files).map(|(_, text)| text).collect();
    let words: BTreeSet<_> = code.split(|c: char| !(c.is_alphanumeric() || c == '_')).collect();
    let is_name = |name: &&&str| {
        name.starts_with(char::is_uppercase) && name.chars().all(|c| c.is_alphanumeric() || "_:".contains(c))
    };
    let names: Vec<_> = quoted.iter().filter(is_name).flat_map(|name| name.split("::")).collect();
    let missing: Vec<_> = names.iter().filter(|name| **name != "NAME" && !words.contains(*name)).collect();
    assert!(names.len() > 40 && missing.is_empty(), "{} names, missing {missing:?}", names.len());
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
