//! Loads a scene, renders it, writes an EXR and a PNG: `cargo run --release --example render -- SCENE.glb [OUT]`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::{Aov, Exposure, Look, View, ViewTransform, exr_file, preview};
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{RenderSettings, render};
use bismar::scene::import;
use bismar::{Error, Result};

fn main() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let path = arguments.next().ok_or_else(|| Error::Usage("which scene?".into()))?;
    let out = arguments.next().unwrap_or("out".into());

    let mut scene = import::import(&path, &Default::default())?.scene;
    scene.light_if_dark();
    let scene = PreparedScene::build(Arc::new(scene), Backend::Embree)?;

    let settings = RenderSettings { spp: Some(128), aovs: true, ..Default::default() };
    let progress = |p: bismar::render::Progress| eprint!("\r{:3.0} %", 100.0 * p.fraction);
    let rendered = render(&scene, &settings, &AtomicBool::new(false), &progress)?;
    eprintln!("\n{} paths a pixel, noise {:.4}", rendered.paths_range().0, rendered.stats.noise);

    // Guides for a denoiser, in addition to the picture.
    let aovs = [Aov::Albedo, Aov::Normal, Aov::Variance];
    exr_file::write(&out.with_extension("exr"), &rendered.pixels(), &aovs, &Vec::new(), None)?;
    let exposure = Exposure::Auto.of(bismar::film::colors(&rendered.pixels()));
    let look = Look { view: ViewTransform::Named(View::Agx), exposure };
    preview::write(&out.with_extension("png"), &rendered.pixels(), &look, "")
}
