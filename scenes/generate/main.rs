//! Writes the scenes of this folder: `cargo run --release --example make_scenes [FOLDER]`.
//!
//! The committed files are byte for byte what this program writes; `tests/scenes.rs` holds it to that.

mod cornell;
mod field;
mod glb;
mod glossy_sun;
mod interiors;
mod many_lights;
mod mesh;
mod pictures;
mod random;
mod showpiece;
mod study;
mod veach;

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let here = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes"));
    let folder = std::env::args_os().nth(1).map_or_else(here, PathBuf::from);
    std::fs::create_dir_all(folder.join("study"))?;
    let files = [
        ("cornell.glb", cornell::scene().finish()),
        ("veach.glb", veach::scene().finish()),
        ("glossy-sun.glb", glossy_sun::scene().finish()),
        ("glossy-sun.hdr", glossy_sun::SKY.hdr(512, 256)?),
        ("many-lights.glb", many_lights::scene().finish()),
        ("field.glb", field::scene().finish()),
        ("field.hdr", field::SKY.hdr(512, 256)?),
        ("showpiece.glb", showpiece::scene()?.finish()),
        ("study/window.glb", study::window().finish()),
        ("study/window.hdr", study::WINDOW_SKY.hdr(256, 128)?),
        ("study/screen.glb", study::screen()?.finish()),
        ("study/slats.glb", study::slats().finish()),
        ("study/mirrors.glb", study::mirrors().finish()),
        ("study/night.glb", study::night().finish()),
        ("study/uplights.glb", study::uplights().finish()),
        ("study/brushed.glb", study::brushed()?.finish()),
        ("study/brushed.hdr", study::BRUSHED_SKY.hdr(256, 128)?),
        ("study/foliage.glb", study::foliage()?.finish()),
        ("study/foliage.hdr", study::FOLIAGE_SKY.hdr(256, 128)?),
        ("study/slit.glb", interiors::slit().finish()),
        ("study/slit.hdr", interiors::SLIT_SKY.hdr(128, 64)?),
        ("study/ajar.glb", interiors::ajar().finish()),
        ("study/shade.glb", interiors::shade().finish()),
    ];
    for (name, bytes) in files {
        std::fs::write(folder.join(name), &bytes)?;
        println!("{name}: {} KiB", bytes.len().div_ceil(1024));
    }
    Ok(())
}
