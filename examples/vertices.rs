//! Every triangle's corners in world space, `x y z` a line, at a moment of the scene's animations:
//! `cargo run --release --example vertices -- SCENE.glb SECONDS [ANIMATION]`.

use std::io::Write;
use std::path::PathBuf;

use bismar::scene::import::{ImportOptions, Pose, import};
use bismar::{Error, Result};
use glam::Vec3;

fn main() -> Result<()> {
    let usage = || Error::Usage("vertices SCENE SECONDS [ANIMATION]".into());
    let mut arguments = std::env::args_os().skip(1);
    let scene = PathBuf::from(arguments.next().ok_or_else(usage)?);
    let seconds = arguments.next().and_then(|text| text.to_str()?.parse().ok()).ok_or_else(usage)?;
    let animation = arguments.next().and_then(|text| text.into_string().ok());
    let pose = Some(Pose { seconds, animation, shutter: None, frame: None });
    let scene = import(&scene, &ImportOptions { pose, ..Default::default() })?.scene;
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for instance in &scene.instances {
        let meshes = scene.objects[instance.object as usize].meshes.clone();
        for mesh in &scene.meshes[meshes.start as usize..meshes.end as usize] {
            for &corner in mesh.indices.iter().flatten() {
                let p = Vec3::from(mesh.positions[corner as usize]);
                let p = instance.transform.map_or(p, |to_world| to_world.transform_point3(p));
                writeln!(out, "{} {} {}", p.x, p.y, p.z).map_err(|e| Error::Io(e.to_string()))?;
            }
        }
    }
    Ok(())
}
