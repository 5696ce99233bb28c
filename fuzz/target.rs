//! Every target of libFuzzer: it goes through the door of its name.
#![no_main]

mod doors;

libfuzzer_sys::fuzz_target!(
    init: prepare(),
    |bytes: &[u8]| {
        let door = doors::DOORS.iter().find(|(name, _)| *name == env!("CARGO_BIN_NAME"));
        door.expect("a door of this name").1(&folder(), bytes);
    }
);

/// libFuzzer ends at every panic; those of decoders that are caught are not counted.
fn prepare() {
    let end = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !bismar::guard::is_decoding() {
            end(info);
        }
    }));
    std::fs::create_dir_all(folder()).expect("a temporary folder");
}

/// For a process's own files.
fn folder() -> std::path::PathBuf {
    std::env::temp_dir().join(format!("bismar-fuzz-{}", std::process::id()))
}
