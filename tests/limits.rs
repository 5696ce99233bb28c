//! Limits of the system and of formats: they end a command cleanly, with a code and a text that say what to do.

use std::fs;
use std::process::Command;

use crate::helpers::glb;
use crate::helpers::program::{Folder, expect, names, program, stderr};

fn folder() -> Folder {
    Folder::new().with("s.glb", glb::triangle())
}

#[test]
fn devices_without_end_are_refused_and_lost_events_are_an_error() {
    let path = &folder();
    expect(path, "render s.glb --cameras /dev/zero -o a.#.exr", 65);
    expect(path, "render s.glb --path-mapping /dev/zero -o a.exr", 65);
    expect(path, "farm task 1 --plan /dev/zero", 65);
    fs::write(path.join("jobs.toml"), "[[job]]\nscene = 's.glb'\nsize = '8x8'\nspp = 1\noutput = 'a.exr'\n").unwrap();
    assert!(expect(path, "batch jobs.toml --events /dev/full", 74).contains("--events"));
    assert!(path.join("a.exr").exists());
}

#[test]
fn names_as_long_as_the_system_allows_are_written() {
    let folder = folder();
    let name = format!("{}.exr", "n".repeat(251));
    expect(&folder, &format!("render s.glb --size 8x8 --spp 1 -o {name}"), 0);
    assert_eq!(names(&folder), [name.clone(), "s.glb".into()]);
    // A name of ours that would be longer is shortened, or refused before the work.
    expect(&folder, &format!("check {name}"), 0);
    fs::rename(folder.join("s.glb"), folder.join(format!("{}.glb", "s".repeat(251)))).unwrap();
    let line = format!("look {}.glb --size 32x32 --spp 1", "s".repeat(251));
    assert!(expect(&folder, &line, 73).contains("too long"));
}

/// Root has no limit of processes, so another user runs the program.
#[test]
fn threads_that_the_system_refuses_are_a_limit_of_the_host() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    let path = &folder();
    if fs::metadata(path).unwrap().uid() != 0 || Command::new("setpriv").arg("--version").output().is_err() {
        return crate::helpers::skipped::skipped("not root, or without setpriv");
    }
    fs::set_permissions(path, fs::Permissions::from_mode(0o777)).unwrap();
    fs::copy(program(), path.join("bismar")).unwrap();
    let jobs = "[[matrix]]\nname = '{seed}'\nscene = 's.glb'\nsize = '8x8'\nspp = 1\nseed = [1, 2]\n";
    fs::write(path.join("jobs.toml"), jobs).unwrap();
    for line in
        ["render s.glb --size 8x8 --spp 1 -o a.exr --threads 2", "inspect s.glb", "batch jobs.toml --isolate --jobs 2"]
    {
        for processes in 1..12 {
            let line = format!("ulimit -u {processes}; exec ./bismar {line}");
            let user = ["--reuid=65521", "--regid=65521", "--clear-groups", "bash", "-c", &line];
            let ran = Command::new("setpriv").args(user).current_dir(path).output().unwrap();
            assert!([Some(0), Some(76)].contains(&ran.status.code()), "{line}: {:?} {}", ran.status, stderr(&ran));
        }
    }
}

#[test]
fn an_ending_with_a_folder_is_refused() {
    let folder = folder();
    expect(&folder, "render s.glb --size 8x8 --spp 1 --aov object -o a.exr", 0);
    assert!(expect(&folder, "labels a.exr -o a.json --images a/b", 64).contains("--images"));
}

#[test]
fn a_program_after_a_checkpoint_that_hangs_does_not_keep_the_render() {
    let path = &folder().with("hang.sh", "#!/bin/sh\nsleep 1000 &\nwait\n");
    assert!(Command::new("chmod").arg("+x").arg(path.join("hang.sh")).status().unwrap().success());
    let line = "render s.glb --size 64x64 --spp 4096 --checkpoint 0.001 --on-checkpoint ./hang.sh -o a.exr";
    assert!(expect(path, line, 0).contains("still runs"));
}
