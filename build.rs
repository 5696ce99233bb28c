//! Stamps the commit and the compiler that the program was built from into it.

use std::env;
use std::fs;
use std::process::Command;

/// Where `cargo package` says which commit it packed.
const PACKAGED: &str = ".cargo_vcs_info.json";

/// What goes into the program: changes of other files do not make it another one.
const STAMPED: &[&str] = &["src", "crates", "embree4-sys", "build.rs", "Cargo.toml", "Cargo.lock", ".cargo"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=BISMAR_COMMIT={}", commit());
    let compiler = env::var("RUSTC").ok().and_then(|rustc| output_of(&rustc, &["--version"]));
    println!("cargo::rustc-env=BISMAR_COMPILER={}", compiler.unwrap_or("unknown".into()));
}

/// The commit that an optimised build is made of, `-dirty` if what goes into it was changed since; `BISMAR_COMMIT` where there
/// is no git. Others are not stamped: every commit would have them built again.
fn commit() -> String {
    println!("cargo::rerun-if-env-changed=BISMAR_COMMIT");
    if let Ok(commit) = env::var("BISMAR_COMMIT") {
        return commit;
    }
    if env::var("PROFILE").as_deref() != Ok("release") {
        return "development".into();
    }
    // A package's sources have no git, and are often inside of a repository that is somebody else's.
    if fs::exists(PACKAGED).unwrap_or(false) {
        let info = fs::read_to_string(PACKAGED).unwrap_or_default();
        let sha = info.split("\"sha1\": \"").nth(1).and_then(|rest| rest.get(..12)).unwrap_or("unknown");
        return sha.to_owned() + if info.contains("\"dirty\": true") { "-dirty" } else { "" };
    }
    // A checkout changes HEAD, a commit the log of it; the index, which looking at the repository writes anew, tells nothing.
    for name in ["HEAD", "logs/HEAD"] {
        let path = output_of("git", &["rev-parse", "--git-path", name]);
        let path = path.filter(|path| fs::exists(path).unwrap_or(false));
        path.iter().for_each(|path| println!("cargo::rerun-if-changed={path}"));
    }
    STAMPED.iter().for_each(|path| println!("cargo::rerun-if-changed={path}"));
    let Some(commit) = output_of("git", &["rev-parse", "--short=12", "HEAD"]) else {
        return "unknown".into();
    };
    let changed =
        output_of("git", &[&["--no-optional-locks", "status", "--porcelain", "-uno", "--"], STAMPED].concat())
            .is_some();
    commit + if changed { "-dirty" } else { "" }
}

/// What a program prints, if it is there and succeeds.
fn output_of(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned()).filter(|text| !text.is_empty())
}
