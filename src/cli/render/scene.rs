//! The scene of a command: imported, with the light and the camera that the flags ask for.

use tracing::{debug, warn};

use super::args::RenderArgs;
use super::identity::Files;
use super::values::OnByDefault;
use crate::Result;
use crate::scene::import::NoteKind;
use crate::scene::{Environment, Scene};

/// Imports the scene.
///
/// # Errors
/// Those of the import and of the environment map.
pub fn make_scene(args: &RenderArgs, files: Files) -> Result<Scene> {
    let imported = files.scene.import(&args.selection.options(args.strict, args.has_velocities()))?;
    drop(files.scene);
    let inexact = imported.report.notes.iter().filter(|n| matches!(n.kind, NoteKind::Approximated | NoteKind::Ignored));
    let inexact = inexact.map(|n| n.text.as_str()).collect::<Vec<_>>();
    inexact.iter().for_each(|note| debug!("{note}"));
    if let [first, rest @ ..] = &inexact[..] {
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        warn!("{} is not rendered exactly: {first}{more} (`bismar inspect` lists everything)", args.scene.display());
    }
    let mut scene = imported.scene;
    let unit = args.light_unit.factor();
    for light in &mut scene.lights {
        light.intensity *= unit;
        light.motion.iter_mut().for_each(|key| key.intensity *= unit);
    }
    if args.energy_compensation == OnByDefault::Off {
        scene.materials.iter_mut().for_each(|material| material.energy_compensation = false);
    }
    if args.no_env {
        scene.environment = None;
    } else if args.sky {
        scene.environment = Some(Environment { strength: args.env_strength, ..Environment::constant([1.0; 3]) });
    } else if let Some(file) = &files.environment {
        scene.environment = Some(file.decode(args.env_rotate, args.env_strength)?);
    }
    let name = args.scene.display();
    if args.no_env {
        if !scene.is_lit() {
            warn!("{name} has no light and --no-env removes the environment: the picture will be black");
        }
    } else if scene.light_if_dark() {
        warn!("{name} has no light: soft studio light is added (--env FILE or --sky replace it)");
    }
    if args.is_framed() {
        scene.frame();
    }
    Ok(scene)
}
