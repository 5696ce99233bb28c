//! Stamps what the program was built from into it, and refuses an Embree that `src/rays` was not written for.

use std::env;
use std::fs;
use std::process::Command;

/// Embree's C API is the same within a major version.
const EMBREE_MAJOR: &str = "4";

/// Where `cargo package` says which commit it packed.
const PACKAGED: &str = ".cargo_vcs_info.json";

/// What goes into the program: changes of other files do not make it another one.
const STAMPED: &[&str] = &["src", "crates", "embree4-sys", "build.rs", "Cargo.toml", "Cargo.lock", ".cargo"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=Cargo.lock");
    // From embree4-sys/build.rs: the version of the header that the bindings were made from.
    let embree = env::var("DEP_EMBREE4_VERSION").unwrap_or_default();
    if embree.split('.').next() != Some(EMBREE_MAJOR) {
        println!("cargo::error=found Embree {embree:?}, but this program is written for Embree {EMBREE_MAJOR}");
    }
    println!("cargo::rustc-env=BISMAR_EMBREE_HEADER_VERSION={embree}");
    println!("cargo::rustc-env=BISMAR_ISA_BASELINE={}", isa_baseline());
    println!("cargo::rustc-env=BISMAR_COMMIT={}", commit());
    let compiler = env::var("RUSTC").ok().and_then(|rustc| output_of(&rustc, &["--version"]));
    println!("cargo::rustc-env=BISMAR_COMPILER={}", compiler.unwrap_or("unknown".into()));
    println!("cargo::rustc-env=BISMAR_OBVHS_VERSION={}", locked_version("obvhs"));
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

/// The x86-64 level that rustc may use without asking the CPU.
fn isa_baseline() -> String {
    let features = env::var("CARGO_CFG_TARGET_FEATURE").unwrap_or_default();
    let has = |all: &[&str]| all.iter().all(|one| features.split(',').any(|feature| feature == *one));
    let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
    let level = match arch.as_str() {
        "x86_64" if has(&["avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"]) => "-v4",
        "x86_64" if has(&["avx2", "bmi1", "bmi2", "f16c", "fma", "lzcnt", "movbe"]) => "-v3",
        "x86_64" if has(&["popcnt", "sse4.2", "ssse3"]) => "-v2",
        _ => "",
    };
    arch.replace('_', "-") + level
}

/// A dependency's version in Cargo.lock.
fn locked_version(name: &str) -> String {
    let lock = fs::read_to_string("Cargo.lock").unwrap_or_default();
    let entry = lock.split(&format!("name = \"{name}\"\nversion = \"")).nth(1).unwrap_or("unknown\"");
    entry.split('"').next().unwrap_or("unknown").to_owned()
}
