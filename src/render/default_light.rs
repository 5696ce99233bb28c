//! Decides whether a scene's own light lights what the camera sees, or the default light ([`Environment::studio`]) is added.
//! A first pass of very few pixels counts the surfaces that the light reaches. An emissive material alone says nothing: it
//! may be a display on a device, which lights nothing.
//!
//! The decision depends on the scene and the camera alone, with the camera's own aspect ratio: not on the size of the
//! picture, its seed, its stop rules, parts or threads.
//!
//! [`Environment::studio`]: crate::scene::Environment::studio

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use serde::Serialize;

use super::RenderSettings;
use super::prepass::low_resolution::{in_tiles, low_resolution};
use super::transport::transport;
use crate::color::luminance;
use crate::film::{ExtraSums, PixelStats};
use crate::integrator::clients::{AovColumns, Aovs, Contributions, PixelSums};
use crate::integrator::{PixelTask, PreparedScene, Transport, Wave};
use crate::scene::{Environment, Scene};

/// Pixels of the first pass: 32 x 18 for the usual aspect ratio.
const PIXELS: f64 = 576.0;
/// Its paths per pixel.
const PATHS: u32 = 8;
/// Segments of its paths: light from a lamp, after up to two reflections.
const MAX_DEPTH: u32 = 4;
/// Reflected radiance (luminance) from which a pixel is lit. White is 1; a display shows a tenth of this as black.
const LIT: f32 = 1e-3;
/// Emitted radiance (luminance) from which a pixel needs no other light.
const SHINES: f32 = 1e-2;
/// Largest fraction of surfaces in the picture that may be dark beside what shines by itself.
const MIN_SURFACES: f64 = 0.02;
/// Smallest fraction of the surfaces that the scene's own light must reach.
const MIN_LIT: f64 = 0.1;

/// What the first pass has found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct OwnLight {
    /// Pixels that show a surface.
    pub covered: u32,
    /// Those of them that do not shine by themselves.
    pub surfaces: u32,
    /// Those of `surfaces` that the scene's own light reaches.
    pub lit: u32,
}

impl OwnLight {
    /// Does the scene light what the camera sees? True also if nothing in the picture needs light.
    pub fn is_enough(&self) -> bool {
        let [covered, surfaces, lit] = [self.covered, self.surfaces, self.lit].map(f64::from);
        surfaces <= MIN_SURFACES * covered || lit >= MIN_LIT * surfaces
    }
}

/// Is there a decision to make? Not with an environment, not without any light (the default light is added anyway), and not
/// where all materials are unlit.
pub fn is_in_question(scene: &Scene) -> bool {
    scene.environment.is_none() && scene.is_lit() && !scene.materials.iter().all(|material| material.unlit)
}

/// Measures what the light of `scene` does in the view of camera `camera`, with the back faces and the clipping of `shown`.
pub fn own_light(scene: &PreparedScene, camera: usize, shown: &RenderSettings) -> OwnLight {
    let &RenderSettings { back_faces, clip, .. } = shown;
    let aspect = scene.scene.cameras[camera]
        .natural_aspect()
        .filter(|aspect| (0.1..=10.0).contains(aspect))
        .unwrap_or(16.0 / 9.0);
    let settings = RenderSettings {
        camera,
        width: (1024.0 * aspect) as u32,
        height: 1024,
        back_faces,
        clip,
        max_depth: MAX_DEPTH,
        ..RenderSettings::even()
    };
    let (size, camera) = low_resolution(scene, &settings, PIXELS);
    let transport = Transport { camera, ..transport(scene, &settings) };
    let counts = transport.half(PATHS);
    let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
        let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
        let mut stats = vec![PixelStats::default(); tasks.len()];
        let mut extras = vec![ExtraSums::default(); tasks.len()];
        let mut columns = AovColumns::default();
        let aovs =
            Aovs { sums: &mut [], extras: &mut extras, groups: &mut [], indirect: &mut [], columns: &mut columns };
        wave.run(&transport, &tasks, &mut (PixelSums::new(&mut stats), Some(aovs), None::<Contributions>));
        let mut found = OwnLight::default();
        for (stats, extras) in stats.iter().zip(&extras).filter(|(stats, _)| 2 * stats.covered >= PATHS) {
            let all = Vec3::from(stats.sum.map(|x| x as f32));
            let [all, emitted] = [all, extras.emission.into()].map(|sum| luminance(sum) / PATHS as f32);
            let is_lit = all - emitted >= LIT;
            found.covered += 1;
            found.surfaces += u32::from(is_lit || emitted < SHINES);
            found.lit += u32::from(is_lit);
        }
        found
    };
    // It takes a few milliseconds: nobody stops it.
    let tiles = in_tiles(size, &AtomicBool::new(false), of_tile).unwrap_or_default();
    tiles.into_iter().fold(OwnLight::default(), |all, tile| OwnLight {
        covered: all.covered + tile.covered,
        surfaces: all.surfaces + tile.surfaces,
        lit: all.lit + tile.lit,
    })
}

/// The same scene with the default light.
pub fn with_default_light<'a>(scene: &PreparedScene<'a>) -> PreparedScene<'a> {
    let lit = Scene { environment: Some(Environment::studio()), ..(*scene.scene).clone() };
    PreparedScene::after(Arc::new(lit), Arc::clone(&scene.rays), None)
}
