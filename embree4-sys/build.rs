//! Finds the installed Embree 4, generates the bindings from its header and hands the header's version on as
//! `DEP_EMBREE4_VERSION`. docs.rs has no Embree 4: there, `docs-rs/bindings.rs` is taken as it is.

use std::env;
use std::path::{Path, PathBuf};
use std::{fs, process};

use bindgen::Builder;

/// Bindings that documentation is made from where no Embree is installed, and the version of the header that they are of.
const DOCS_RS: (&str, &str) = ("docs-rs/bindings.rs", "4.3.3");

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=EMBREE_DIR");
    println!("cargo::rerun-if-env-changed=DOCS_RS");
    println!("cargo::rustc-check-cfg=cfg(embree_instance_array, embree_instance_stack)");
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("bindings.rs");
    if env::var_os("DOCS_RS").is_some() {
        let (bindings, version) = DOCS_RS;
        fs::copy(bindings, &out).unwrap_or_else(|error| fail(&format!("{bindings}: {error}")));
        println!("cargo::metadata=version={version}");
        println!("cargo::rustc-cfg=embree_instance_array");
        return;
    }
    let include = find_header().unwrap_or_else(|message| fail(&message));
    let headers = include.join("embree4");
    println!("cargo::rerun-if-changed={}", headers.display());
    let config = fs::read_to_string(headers.join("rtcore_config.h")).unwrap_or_else(|error| {
        fail(&format!("{}: {error}", headers.join("rtcore_config.h").display()));
    });
    println!("cargo::metadata=version={}", version(&config));
    if define(&config, "RTC_MAX_INSTANCE_LEVEL_COUNT") != Some("1") {
        println!("cargo::rustc-cfg=embree_instance_stack");
    }
    if define(&config, "EMBREE_GEOMETRY_INSTANCE_ARRAY").is_some() {
        println!("cargo::rustc-cfg=embree_instance_array");
    }
    link();
    // bindgen panics when it finds no libclang; a sentence is kinder.
    explain_panics();
    let bindings = Builder::default()
        .header_contents("embree.h", "#include <embree4/rtcore.h>")
        .clang_arg(format!("-I{}", include.display()))
        .allowlist_item("(rtc|RTC).*")
        .prepend_enum_name(false)
        // C enums stay integers: a Rust enum with a value that it does not list is undefined behaviour.
        .default_enum_style(bindgen::EnumVariation::Consts)
        .layout_tests(true)
        .derive_default(true)
        .generate()
        .unwrap_or_else(|error| fail(&format!("{}: {error}", headers.display())));
    bindings.write_to_file(&out).unwrap_or_else(|error| fail(&format!("{}: {error}", out.display())));
}

/// Says why in a line that cargo shows, and stops.
fn fail(message: &str) -> ! {
    println!("cargo::error={message}");
    process::exit(1);
}

/// The include directory with `embree4/rtcore.h` in it: below `EMBREE_DIR` when that is set, else the system's.
fn find_header() -> Result<PathBuf, String> {
    let multiarch = format!("/usr/include/{}-linux-gnu", env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default());
    let places = match env::var_os("EMBREE_DIR") {
        Some(dir) => vec![Path::new(&dir).join("include")],
        None => ["/usr/local/include", "/usr/include", &multiarch].map(PathBuf::from).to_vec(),
    };
    let having = |header: &str| places.iter().find(|place| place.join(header).is_file()).cloned();
    if let Some(include) = having("embree4/rtcore.h") {
        return Ok(include);
    }
    let looked = places.iter().map(|place| place.display().to_string()).collect::<Vec<_>>().join(", ");
    if let Some(include) = having("embree3/rtcore.h") {
        return Err(format!(
            "only Embree 3 is installed (in {}), Embree 4 is needed: run `make setup`, or set EMBREE_DIR to where \
             Embree 4 is unpacked",
            include.display()
        ));
    }
    Err(format!("no embree4/rtcore.h in {looked}: run `make setup`, or set EMBREE_DIR to where Embree 4 is unpacked"))
}

/// What a header defines a macro as; commented lines do not count.
fn define<'a>(header: &'a str, name: &str) -> Option<&'a str> {
    header.lines().find_map(|line| {
        let value = line.trim().strip_prefix("#define ")?.trim_start().strip_prefix(name)?;
        (value.is_empty() || value.starts_with(char::is_whitespace)).then(|| value.trim())
    })
}

fn version(config: &str) -> String {
    ["MAJOR", "MINOR", "PATCH"].map(|part| define(config, &format!("RTC_VERSION_{part}")).unwrap_or("?")).join(".")
}

fn link() {
    if let Some(dir) = env::var_os("EMBREE_DIR") {
        for lib in ["lib", "lib64"].map(|name| Path::new(&dir).join(name)).iter().filter(|lib| lib.is_dir()) {
            println!("cargo::rustc-link-search=native={}", lib.display());
        }
    }
    println!("cargo::rustc-link-lib=dylib=embree4");
}

/// Turns bindgen's panic about a missing libclang into what to do.
fn explain_panics() {
    std::panic::set_hook(Box::new(|panic| {
        let text = panic.to_string().replace('\n', " ");
        println!(
            "cargo::error=cannot make the Embree bindings: {text}: if that is about libclang, run `make setup`, or set \
             LIBCLANG_PATH to its directory"
        );
        process::exit(1);
    }));
}
