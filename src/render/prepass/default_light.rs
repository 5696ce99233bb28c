//! Decides whether a scene's own light lights what the camera sees, or the default light ([`Environment::studio`]) is added.
//! A first pass of very few pixels counts the surfaces that the light reaches. An emissive material alone says nothing: it
//! may be a display on a device, which lights nothing. Light reaches a surface if paths find it, or if straight shadow rays do that
//! pass all glass, rough or smooth: few paths find a lamp in a glass bulb, and which ones is chance. What shines behind smooth
//! glass is seen, and reaches nothing by that.
//!
//! The decision depends on the scene and the camera alone, with the camera's own aspect ratio: not on the size of the
//! picture, its seed, its stop rules, parts or threads.
//!
//! [`Environment::studio`]: crate::scene::Environment::studio

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::Serialize;

use super::low_resolution::{in_tiles, low_resolution};
use crate::color::luminance;
use crate::integrator::data::queues::{PathRays, ShadowRays};
use crate::integrator::events::{FoundEmission, UnoccludedLight};
use crate::integrator::{PathEvents, PixelTask, PreparedScene, Transport, Wave, WaveContext};
use crate::rays::{HitBatch, MISS};
use crate::render::settings::transport::transport;
use crate::render::settings::{GlassShadows, RenderSettings};
use crate::scene::{Environment, Scene, TextureSlot};

/// Pixels of the first pass: 32 x 18 for the usual aspect ratio.
const PIXELS: f64 = 576.0;
/// Its paths per pixel.
const PATHS: u32 = 8;
/// Segments of its paths: light from a lamp, after up to two reflections.
const MAX_DEPTH: u32 = 4;
/// Reflected radiance (luminance) from which a pixel is lit; more where it shines, as a display in its own cover glass does. White is
/// 1; a display shows a tenth of this as black.
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
    let pixels = |scene: &PreparedScene, glass_shadows| {
        let settings = RenderSettings { glass_shadows, ..settings.clone() };
        let transport = Transport { camera: camera.clone(), ..transport(scene, &settings) };
        let counts = transport.half(PATHS);
        let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
            let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
            let mut client = FirstPass(vec![PixelLight::default(); tasks.len()]);
            wave.run(&transport, &tasks, &mut client);
            client.0
        };
        // It takes a few milliseconds: nobody stops it.
        in_tiles(size, &AtomicBool::new(false), of_tile).unwrap_or_default().concat()
    };
    let mut found = pixels(scene, GlassShadows::Off);
    if scene.materials.transmits {
        for (pixel, clear) in found.iter_mut().zip(pixels(&with_clear_glass(scene), GlassShadows::Straight)) {
            pixel.reflected = pixel.reflected.max(clear.reflected);
        }
    }
    let mut all = OwnLight::default();
    for PixelLight { emitted, reflected, .. } in found.into_iter().filter(|pixel| 2 * pixel.covered >= PATHS) {
        let [emitted, reflected] = [emitted, reflected].map(|sum| sum / PATHS as f32);
        let is_lit = reflected >= LIT.max(0.5 * emitted);
        all.covered += 1;
        all.surfaces += u32::from(is_lit || emitted < SHINES);
        all.lit += u32::from(is_lit);
    }
    all
}

/// What the paths of a pixel find: sums of luminance, and how many meet a surface.
#[derive(Debug, Clone, Copy, Default)]
struct PixelLight {
    /// Seen directly, or through smooth glass.
    emitted: f32,
    reflected: f32,
    covered: u32,
}

/// Sums the light of the first pass, by pixel.
struct FirstPass(Vec<PixelLight>);

impl PathEvents for FirstPass {
    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        for (path, _) in rays.path.iter().zip(&hits.mesh[..rays.len]).filter(|(_, mesh)| **mesh != MISS) {
            self.0[at.pixel(*path)].covered += u32::from(at.depth == 0);
        }
    }

    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        let row = found.ray as usize;
        let pixel = &mut self.0[at.pixel(rays.path[row])];
        let is_seen = rays.history(row).has_met_only_glass(at.depth);
        *(if is_seen { &mut pixel.emitted } else { &mut pixel.reflected }) += luminance(found.radiance);
    }

    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        self.0[at.pixel(shadows.path[found.row])].reflected += luminance(found.radiance);
    }
}

/// The same scene with smooth glass instead of all that light passes, so that straight shadow rays do.
fn with_clear_glass<'a>(scene: &PreparedScene<'a>) -> PreparedScene<'a> {
    let mut clear = Scene::clone(&scene.scene);
    for material in clear.materials.iter_mut().filter(|material| material.transmits()) {
        // Half of what is diffuse, so that what it scatters is found too.
        material.transmission = material.transmission.max(0.5 * material.diffuse_transmission);
        (material.roughness, material.anisotropy) = (0.0, 0.0);
        material.textures[TextureSlot::SpecularGlossiness] = None;
    }
    PreparedScene::after(Arc::new(clear), Arc::clone(&scene.rays), None)
}

/// The same scene with the default light.
pub fn with_default_light<'a>(scene: &PreparedScene<'a>) -> PreparedScene<'a> {
    let lit = Scene { environment: Some(Environment::studio()), ..(*scene.scene).clone() };
    PreparedScene::after(Arc::new(lit), Arc::clone(&scene.rays), None)
}
