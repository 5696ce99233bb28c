//! What all targets are but for their door.

#[path = "doors.rs"]
pub mod doors;

/// A target of libFuzzer that goes through a door by its name.
macro_rules! target {
    ($door:ident) => {
        libfuzzer_sys::fuzz_target!(
            init: crate::target::prepare(),
            |bytes: &[u8]| { crate::target::doors::$door(&crate::target::folder(), bytes); }
        );
    };
}

/// libFuzzer ends at every panic; those of decoders that are caught are not counted.
pub fn prepare() {
    let end = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !bismar::guard::is_decoding() {
            end(info);
        }
    }));
    std::fs::create_dir_all(folder()).expect("a temporary folder");
}

/// For a process's own files.
pub fn folder() -> std::path::PathBuf {
    std::env::temp_dir().join(format!("bismar-fuzz-{}", std::process::id()))
}
