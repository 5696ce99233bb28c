#![no_main]

#[path = "../doors.rs"]
#[allow(dead_code, reason = "one of several")]
mod doors;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let folder = std::env::temp_dir().join(format!("bismar-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    doors::scene(&folder, bytes);
});
