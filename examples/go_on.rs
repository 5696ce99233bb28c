//! Renders in sessions of a few seconds, each of which goes on from the file that the last one left, until it is done:
//! `cargo run --release --example go_on -- SCENE.glb OUT.exr`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::record::checkpoint::{self, Earlier, Host, Record};
use bismar::render::record::identity::RequestedOutputs;
use bismar::render::{Identity, RenderSettings, RunOptions, StopReason, run};
use bismar::scene::import;
use bismar::{Error, Result};

fn main() -> Result<()> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(path), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err(Error::Usage("which scene, and where to?".into()));
    };
    let mut scene = import::import(&path, &Default::default())?.scene;
    scene.light_if_dark();
    let scene = PreparedScene::build(Arc::new(scene), Backend::Embree)?;

    let settings = RenderSettings { spp: Some(256), ..Default::default() };
    // Two files with equal identities hold the same picture: a real program would hash the scene's content.
    let identity = Identity::new(&path.display().to_string(), "its own", Backend::Embree, &settings);
    let requested = RequestedOutputs { aovs: "variance,samples".into(), ..Default::default() };
    loop {
        let from = Earlier::read(&out)?.map(|earlier| earlier.saved(&identity)).transpose()?;
        let (began, stop) = (Instant::now(), AtomicBool::new(false));
        let progress = |_| stop.store(began.elapsed().as_secs_f64() > 5.0, Ordering::Relaxed);
        let options = RunOptions { began, from, ..RunOptions::new(&stop, &progress) };
        let rendered = run(&scene, &settings, options)?;
        let record = Record::new(&identity, &requested, &rendered, Host::of(scene.rays.info()), true);
        checkpoint::write(&out, &rendered, &record, Vec::new(), &[], true)?;
        eprintln!("{} paths so far", rendered.stats.paths);
        if rendered.stop != StopReason::Interrupted {
            return Ok(());
        }
    }
}
