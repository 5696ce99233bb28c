//! The doors by which strangers' bytes come in. The targets of `cargo fuzz` go through them, and so does
//! `tests/mutations.rs`, which needs no nightly compiler.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use bismar::batch::file::{self, Flag};
use bismar::farm::{PathMapping, Plan};
use bismar::film::{Picture, exr_file};
use bismar::render::checkpoint::{Earlier, unpack};
use bismar::scene::import::{EnvironmentFile, ImportOptions, SceneFiles};

/// Takes bytes in as the program does, in a folder for its files. Whatever comes of them but a panic, an abort, a hang or
/// much memory is right.
pub type Door = fn(&Path, &[u8]);

/// All of them, by name.
pub const DOORS: [(&str, Door); 8] = [
    ("scene", scene),
    ("picture", picture),
    ("environment", environment),
    ("exr", exr),
    ("checkpoint", checkpoint),
    ("statistics", statistics),
    ("batch", batch),
    ("farm", farm),
];

fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).expect("a folder that can be written");
    path
}

/// glTF as JSON or GLB, with all that is inside it: accessors, pictures.
pub fn scene(folder: &Path, bytes: &[u8]) {
    let Ok(files) = SceneFiles::open(&put(folder, "scene.glb", bytes)) else { return };
    let _ = files.survey();
    let _ = files.import(&ImportOptions::default());
}

/// PNG, JPEG, HDR and EXR for `compare` and `develop`.
pub fn picture(folder: &Path, bytes: &[u8]) {
    let _ = Picture::open(&put(folder, "picture", bytes), None);
}

/// HDR and EXR for `--env`.
pub fn environment(folder: &Path, bytes: &[u8]) {
    let Ok(file) = EnvironmentFile::open(&put(folder, "sky", bytes)) else { return };
    let _ = file.memory_bytes();
    let _ = file.decode(0.0, 1.0);
}

/// EXR and its header.
pub fn exr(folder: &Path, bytes: &[u8]) {
    let path = put(folder, "a.exr", bytes);
    let _ = exr_file::read(&path);
    let _ = exr_file::read_header(&path);
    let _ = exr_file::read_statistics(&path);
    let _ = exr_file::check(&path);
}

/// A picture of ours that a render goes on from.
pub fn checkpoint(folder: &Path, bytes: &[u8]) {
    let Ok(Some(earlier)) = Earlier::read(&put(folder, "a.exr", bytes)) else { return };
    let _ = earlier.verify();
    let settings = &earlier.record.identity.settings;
    // What a file says of its size is compared with what the scene and the command say before tiles are made of it.
    if settings.width <= 256 && settings.height <= 256 {
        let _ = earlier.tiles(settings);
    }
}

/// Packed tiles whose hash is right.
pub fn statistics(_: &Path, bytes: &[u8]) {
    let _ = unpack(bytes);
}

/// A batch file.
pub fn batch(folder: &Path, bytes: &[u8]) {
    let flags = [("spp", Flag::Value), ("no-env", Flag::Switch), ("preview", Flag::File), ("seed", Flag::Value)];
    let flags: HashMap<_, _> = flags.into_iter().map(|(name, flag)| (name.to_owned(), flag)).collect();
    let _ = file::read(&put(folder, "jobs.toml", bytes), &flags);
}

/// The plan of a farm, and rules for its paths.
pub fn farm(folder: &Path, bytes: &[u8]) {
    let path = put(folder, "farm.json", bytes);
    let _ = Plan::read(folder);
    let _ = PathMapping::read(&path);
}
