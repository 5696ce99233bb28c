//! The scenes in the repository are what `scenes/generate` writes.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::helpers::program::Folder;

#[test]
fn committed_scenes_are_byte_for_byte_what_their_program_writes() {
    let folder = Folder::new();
    // Built together with the tests; this only finds it.
    let status = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--locked", "--example", "make_scenes", "--"])
        .arg(&*folder)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status()
        .unwrap();
    assert!(status.success());
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    for part in ["", "study"] {
        let names = files(&folder.join(part));
        for name in &names {
            let read = |root: &Path| fs::read(root.join(part).join(name)).unwrap();
            let same = read(&folder) == read(&committed);
            assert!(same, "{name} differs: run `cargo run --release --example make_scenes` and look at what changed");
        }
        // And none of them is left from an older program.
        for name in files(&committed.join(part)) {
            let made = names.contains(&name) || !(name.ends_with(".glb") || name.ends_with(".hdr"));
            assert!(made, "{name} is not made by the program");
        }
    }
}

/// Names of the files in a folder.
fn files(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
    let files = entries.filter(|entry| entry.file_type().unwrap().is_file());
    files.map(|entry| entry.file_name().into_string().unwrap()).collect()
}
