//! The scenes in the repository are what the program beside them writes.

use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn committed_scenes_are_byte_for_byte_what_their_program_writes() {
    let folder = tempfile::tempdir().unwrap();
    // Built together with the tests; this only finds it.
    let status = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--locked", "--example", "make_scenes", "--"])
        .arg(folder.path())
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status()
        .unwrap();
    assert!(status.success());
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut names = Vec::new();
    for entry in fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let same = fs::read(folder.path().join(&name)).unwrap() == fs::read(committed.join(&name)).unwrap();
        assert!(same, "{name} differs: run `cargo run --release --example make_scenes` and look at what changed");
        names.push(name);
    }
    // And none of them is left from an older program.
    for entry in fs::read_dir(committed).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let made = names.contains(&name) || !(name.ends_with(".glb") || name.ends_with(".hdr"));
        assert!(made, "{name} is not made by the program");
    }
}
