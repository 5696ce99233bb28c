//! Failure modes that need the renderer: small scenes, rendered many times.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::Balance;
use bismar::film::Pixels;
use bismar::integrator::{PreparedScene, Reuse};
use bismar::rays::Backend;
use bismar::render::{Integrator, RenderSettings, Technique, render};
use bismar::scene::build::{self, area_light, lambert, look, metal};
use bismar::scene::{Environment, Material, PunctualKind, PunctualLight, Scene};
use glam::Vec3;
use rayon::prelude::*;

use super::judge::Outcome;
use super::renders::Renders;

pub(super) const SIDE: u32 = 4;
pub(crate) const SCENES: usize = 10;
pub const PATHS: u32 = 64;
/// First seed of the renders that estimate the true means.
pub(crate) const OTHER_SEEDS: u32 = 1 << 30;

/// A failure mode on a scene.
pub struct SceneCase {
    /// F1 … F18, F24 … F32, F34.
    pub mode: &'static str,
    pub name: &'static str,
    pub construct: &'static str,
    scene: PreparedScene<'static>,
    integrator: Integrator,
}

/// An environment with a dimmer left half and a bright sun low on the right.
fn sun_environment() -> Environment {
    let (width, height) = (16, 8);
    let texel = |i: u32| match (i % width, i / width) {
        (8, 2) => [60.0; 3],
        (x, _) => [if x < 8 { 0.2 } else { 0.4 }; 3],
    };
    let pixels = (0..width * height).map(texel).collect();
    Environment { name: "sun".into(), width, height, pixels, rotation: 0.0, strength: 1.0 }
}

/// Adds a parallelogram with the edges `u` and `v`; it faces `u` × `v`.
pub(super) fn plate(scene: &mut Scene, corner: [f32; 3], u: [f32; 3], v: [f32; 3], material: Material) {
    let [corner, u, v] = [corner, u, v].map(Vec3::from_array);
    let corners = [corner, corner + u, corner + u + v, corner + v];
    build::add_shape(scene, &build::quad(corners.map(Vec3::as_dvec3)), material);
}

/// A floor over x in `[x0, x1]`, facing up.
pub(super) fn floor(scene: &mut Scene, [x0, x1]: [f32; 2], material: Material) {
    plate(scene, [x0, 0.0, 3.0], [x1 - x0, 0.0, 0.0], [0.0, 0.0, -6.0], material);
}

/// A square at height `y` of half width `w` around (`x`, `z`), facing down.
pub(super) fn ceiling(scene: &mut Scene, [x, y, z]: [f32; 3], w: f32, material: Material) {
    plate(scene, [x - w, y, z - w], [2.0 * w, 0.0, 0.0], [0.0, 0.0, 2.0 * w], material);
}

/// A point light, or a sphere of a radius.
fn point_light(position: [f32; 3], size: f32) -> PunctualLight {
    PunctualLight {
        motion: Vec::new(),
        name: "point".into(),
        kind: PunctualKind::Point,
        intensity: Vec3::splat(0.5),
        position: position.into(),
        direction: Vec3::NEG_Y,
        range: f32::INFINITY,
        size,
    }
}

pub(crate) fn scene_cases() -> Result<[SceneCase; SCENES]> {
    let lit_from_infinity = || Scene { environment: Some(Environment::constant([0.4; 3])), ..Default::default() };
    let build = SceneCase::new;
    let mut caustic = Scene::default();
    floor(&mut caustic, [-3.0, 3.0], lambert(0.6));
    ceiling(&mut caustic, [0.0, 1.0, 0.0], 0.15, area_light(10.0));
    plate(&mut caustic, [-0.25, 0.05, -0.5], [0.5, 0.0, 0.0], [0.0, 0.3, 0.0], metal(0.1));

    let mut delta = Scene::default();
    floor(&mut delta, [-3.0, 0.0], metal(0.0));
    floor(&mut delta, [0.0, 3.0], lambert(0.6));
    ceiling(&mut delta, [0.0, 1.0, -0.6], 0.3, area_light(6.0));
    delta.lights.push(point_light([0.5, 1.0, 0.5], 0.0));

    let mut sobol = lit_from_infinity();
    floor(&mut sobol, [-3.0, 3.0], metal(0.4));
    ceiling(&mut sobol, [0.0, 1.0, -0.6], 0.4, area_light(6.0));

    let mut edge = lit_from_infinity();
    floor(&mut edge, [-3.0, 0.0], metal(0.2));
    floor(&mut edge, [0.0, 3.0], lambert(0.6));
    ceiling(&mut edge, [0.0, 1.0, -0.6], 0.4, area_light(6.0));

    let mut shadow = lit_from_infinity();
    floor(&mut shadow, [-3.0, 3.0], metal(0.5));
    ceiling(&mut shadow, [0.0, 1.0, -0.6], 0.3, area_light(6.0));
    ceiling(&mut shadow, [-0.52, 0.2, -0.1], 0.5, lambert(0.0));

    // The sun is in +x. In the first scene a wall shades half of the floor; in the second a wall shades all of it.
    let under = |wall: [f32; 3]| {
        let mut scene = Scene { environment: Some(sun_environment()), ..Default::default() };
        floor(&mut scene, [-3.0, 0.0], metal(0.3));
        floor(&mut scene, [0.0, 3.0], lambert(0.6));
        plate(&mut scene, [1.0, 0.0, wall[0]], [0.0, 0.0, wall[1]], [0.0, wall[2], 0.0], lambert(0.2));
        scene
    };
    let (sunny, shady) = (under([0.0, -3.0, 2.0]), under([3.0, -6.0, 5.0]));
    // Light selection is learned over all pixels at once: a wall hides the brighter light from all but the last column.
    let mut walled = Scene::default();
    floor(&mut walled, [-3.0, 3.0], lambert(0.6));
    ceiling(&mut walled, [0.8, 1.0, -0.2], 0.3, area_light(20.0));
    ceiling(&mut walled, [-0.5, 1.2, 0.0], 0.2, area_light(2.0));
    let black = Material { double_sided: true, ..lambert(0.0) };
    plate(&mut walled, [0.36, 0.0, -3.0], [0.0, 0.0, 6.0], [0.0, 0.9, 0.0], black);

    // Beside the place where the sphere touches the floor it covers half of the directions.
    let mut touching = Scene::default();
    floor(&mut touching, [-3.0, 3.0], metal(0.5));
    touching.lights.push(point_light([0.0, 0.2, 0.0], 0.2));

    // Mirror images of the lamp pass the back of the sheet, other light does not.
    let mut backs = lit_from_infinity();
    floor(&mut backs, [-3.0, 3.0], metal(0.3));
    ceiling(&mut backs, [0.0, 1.0, -0.6], 0.3, area_light(6.0));
    plate(&mut backs, [-1.0, 0.5, 0.4], [1.0, 0.0, 0.0], [0.0, 0.0, -1.4], lambert(0.5));

    let (direct, path) = (Integrator::Direct, Integrator::Path);
    let mirrored = "an area light, and its reflection in a small mirror that only BSDF samples find";
    let glossy = "a glossy floor under an area light and an environment";
    let hidden = "a bright area light that one column sees past a wall, and a dim one";
    Ok([
        build("F6", "deltas", "a mirror, a diffuse floor, a point light, an area light", direct, delta, 0.3)?,
        build("F8", "caustic", mirrored, path, caustic, 0.2)?,
        build("F11", "low-discrepancy points", glossy, direct, sobol, 0.5)?,
        build("F14", "material edge, rendered", "a near mirror next to a diffuse floor", direct, edge, 0.3)?,
        build("F15", "shadow edge, rendered", "a hard shadow across a glossy floor", direct, shadow, 0.2)?,
        build("F18", "compensation, in the sun", "an environment with a sun, a wall's shadow", path, sunny, 0.3)?,
        build("F18", "compensation, in the shade", "an environment whose sun a wall hides", path, shady, 0.3)?,
        build("F24", "learned light selection", hidden, direct, walled, 0.3)?,
        build("F25", "a sphere that touches a surface", "a lamp on a glossy floor", direct, touching, 0.2)?,
        build("F34", "backs", "half of a polished floor has the back of a sheet over it", direct, backs, 0.3)?,
    ])
}

/// An estimator of the renderer.
#[derive(Debug, Clone)]
pub struct Estimator {
    pub name: String,
    pub balance: Balance,
    /// Sizes of groups that share their paths.
    pub reuse: Option<Reuse>,
}

impl From<Balance> for Estimator {
    fn from(balance: Balance) -> Self {
        Self { name: balance.name().to_owned(), balance, reuse: None }
    }
}

impl SceneCase {
    /// A mode: the scene with a camera that looks down at the origin with this vertical field of view, in radians.
    pub(super) fn new(
        mode: &'static str,
        name: &'static str,
        construct: &'static str,
        integrator: Integrator,
        mut scene: Scene,
        yfov: f32,
    ) -> Result<Self> {
        look(&mut scene, [0.0, 1.2, 3.0], [0.0; 3], yfov);
        Ok(Self { mode, name, construct, scene: PreparedScene::build(Arc::new(scene), Backend::Embree)?, integrator })
    }

    fn renders(&self, estimator: &Estimator, replicas: u32, seed: u32, stop: &AtomicBool) -> Result<Renders> {
        let one = |r: u32| -> Result<_> {
            let settings = RenderSettings {
                width: SIDE,
                height: SIDE,
                spp: Some(PATHS),
                max_depth: 3,
                integrator: self.integrator,
                balance: estimator.balance,
                reuse_sizes: estimator.reuse,
                seed: seed + r,
                ..RenderSettings::even()
            };
            let settings = settings.with(Technique::PathReuse, estimator.reuse.is_some().into());
            let rendered = render(&self.scene, &settings, stop, &|_| ())?;
            let green = rendered.film().pixels.iter().map(|p| p.sum[1] / f64::from(p.samples)).collect();
            let pixels = rendered.pixels();
            let positions = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
            Ok((green, positions.map(|(x, y)| pixels.light_share(x, y)).collect()))
        };
        let renders = (0..replicas).into_par_iter().map(one).collect::<Result<Vec<_>>>()?;
        let (green, shares) = renders.into_iter().unzip();
        Ok(Renders { green, shares })
    }

    /// Compares the variance of every estimator with that of `half` with the same seeds, and its mean with that of `half` with
    /// other seeds. Calls `done` after each; it must return an error once `stop` is raised.
    pub fn outcomes(
        &self,
        estimators: &[Estimator],
        replicas: u32,
        stop: &AtomicBool,
        done: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Vec<Outcome>> {
        let plain = Estimator::from(Balance::Half);
        let truth = self.renders(&plain, replicas, OTHER_SEEDS, stop)?;
        let half = self.renders(&plain, replicas, 0, stop)?;
        done()?;
        let mut outcomes = Vec::new();
        for estimator in estimators {
            let is_plain = estimator.name == plain.name;
            let own = if is_plain { None } else { Some(self.renders(estimator, replicas, 0, stop)?) };
            outcomes.push(own.as_ref().unwrap_or(&half).outcome(estimator.name.clone(), &half, &truth));
            done()?;
        }
        Ok(outcomes)
    }
}
