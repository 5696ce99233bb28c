//! Scenes in which guiding may fail, and the adversarial fields that guide it there.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::Balance;
use bismar::guiding::{Field, TrainingSample, learn};
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::prepass::guiding::learned;
use bismar::render::{Choice, RenderSettings, Technique, transport};
use bismar::sampling::SplitMix64;
use bismar::scene::build::{Shape, add_shape, area_light, lambert, look, metal, quad};
use bismar::scene::{Environment, Material, Scene};
use glam::{DVec3, Vec3};

use crate::stability::scenes::{PATHS, ceiling, plate};

/// Pixels along a side of the whole picture.
const WHOLE: u32 = 64;
/// The pixels that are rendered.
pub(super) const WINDOW: [u32; 4] = [30, 30, 34, 34];
/// Maximum number of path segments. Russian roulette begins after the second surface.
const MAX_DEPTH: u32 = 4;
/// A failure mode on a scene.
pub struct Case {
    /// F19 … F23, F33.
    pub mode: &'static str,
    pub name: &'static str,
    pub construct: &'static str,
    pub scene: PreparedScene<'static>,
    /// A field that was learned from wrong samples; `None`: the field of the case's own pre-pass.
    pub adversarial: Option<Field>,
}

pub(crate) const CASES: usize = 6;
/// Height of the rooms in metres; they reach from −2 to 2 in x and z.
const HEIGHT: f32 = 2.5;
/// Height of the light coves in metres.
const COVE_HEIGHT: f32 = 2.0;

/// The material, double-sided.
fn both(material: Material) -> Material {
    Material { double_sided: true, ..material }
}

/// Four walls around the axis, at a distance of `side`, from height `low` up by `high`.
fn fence(scene: &mut Scene, side: f32, [low, high]: [f32; 2], material: &Material) {
    for (from, along) in [
        ([-side, low, -side], [2.0 * side, 0.0, 0.0]),
        ([-side, low, side], [2.0 * side, 0.0, 0.0]),
        ([-side, low, -side], [0.0, 0.0, 2.0 * side]),
        ([side, low, -side], [0.0, 0.0, 2.0 * side]),
    ] {
        plate(scene, from, along, [0.0, high, 0.0], both(material.clone()));
    }
}

/// A floor and four walls.
fn walls(scene: &mut Scene, material: &Material) {
    plate(scene, [-2.0, 0.0, 2.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0], both(material.clone()));
    fence(scene, 2.0, [0.0, HEIGHT], material);
}

fn room() -> Scene {
    let mut scene = Scene::default();
    let white = lambert(0.6);
    walls(&mut scene, &white);
    ceiling(&mut scene, [0.0, HEIGHT, 0.0], 2.0, white);
    scene
}

/// An area light in a cove that lights only the ceiling.
fn cove(scene: &mut Scene, x: f32, radiance: f32) {
    plate(scene, [x - 0.3, COVE_HEIGHT, 0.8], [0.6, 0.0, 0.0], [0.0, 0.0, -1.6], both(lambert(0.6)));
    plate(scene, [x - 0.1, COVE_HEIGHT + 0.05, 0.3], [0.2, 0.0, 0.0], [0.0, 0.0, -0.6], area_light(radiance));
}

fn coves(left: f32, right: f32) -> Scene {
    let mut scene = room();
    cove(&mut scene, -1.6, left);
    cove(&mut scene, 1.6, right);
    look(&mut scene, [0.0, 1.5, 1.9], [0.0, 0.0, 0.0], 0.8);
    scene
}

/// Hidden area lights over a floor whose shading normal leans by 37°: fields draw directions that it cannot scatter.
fn bumps() -> Scene {
    let mut scene = coves(4.0, 40.0);
    let corners = [[-2.0, 2.0], [2.0, 2.0], [2.0, -2.0], [-2.0, -2.0]].map(|[x, z]| DVec3::new(x, 0.01, z));
    let floor = Shape { normals: vec![DVec3::new(-0.6, 0.8, 0.0); 4], ..quad(corners) };
    add_shape(&mut scene, &floor, lambert(0.6));
    scene
}

/// A mirror reflects an area light onto the floor; a screen blocks all direct light. Half of the window's pixels show the
/// caustic; the others are lit by a dim environment only.
fn caustic() -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([0.05; 3])), ..Default::default() };
    plate(&mut scene, [-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], lambert(0.6));
    ceiling(&mut scene, [0.0, 1.0, 0.0], 0.05, area_light(900.0));
    ceiling(&mut scene, [0.0, 0.6, -0.045], 0.13, both(lambert(0.0)));
    plate(&mut scene, [-0.25, 0.05, -0.5], [0.5, 0.0, 0.0], [0.0, 0.3, 0.0], metal(0.1));
    look(&mut scene, [0.0, 1.2, 3.0], [0.0, 0.0, -0.22], 0.5);
    scene
}

/// A thin wall between a bright and a dim half of a room, which are joined behind the camera. The wall's foot is in the middle
/// of the picture. The wall is not in the middle of the room, where the tree splits cells anyway.
fn divided() -> Scene {
    let mut scene = coves(60.0, 4.0);
    plate(&mut scene, [0.3, 0.0, 1.2], [0.0, 0.0, -3.2], [0.0, HEIGHT, 0.0], both(lambert(0.6)));
    scene.cameras.clear();
    look(&mut scene, [0.3, 1.5, 1.9], [0.3, 0.0, 0.0], 0.9);
    scene
}

/// All light comes through a small hole in the ceiling, from a chamber whose area light faces up.
fn almost_black() -> Scene {
    let (mut scene, dark, hole) = (Scene::default(), lambert(0.3), 0.06);
    walls(&mut scene, &dark);
    for x in [-2.0, hole] {
        plate(&mut scene, [x, HEIGHT, -2.0], [2.0 - hole, 0.0, 0.0], [0.0, 0.0, 4.0], both(dark.clone()));
    }
    for z in [-2.0, hole] {
        plate(&mut scene, [-hole, HEIGHT, z], [2.0 * hole, 0.0, 0.0], [0.0, 0.0, 2.0 - hole], both(dark.clone()));
    }
    let (side, high) = (0.5, 0.4);
    fence(&mut scene, side, [HEIGHT, high], &lambert(0.6));
    ceiling(&mut scene, [0.0, HEIGHT + high, 0.0], side, both(lambert(0.6)));
    plate(&mut scene, [0.2, HEIGHT + 0.02, 0.2], [0.2, 0.0, 0.0], [0.0, 0.0, -0.4], area_light(1e-3));
    look(&mut scene, [0.0, 1.5, 1.9], [0.0, 0.0, 0.0], 0.8);
    scene
}

/// A field of two cells: the cell of ceilings learned nothing; the cell of floors learned from one training sample that is a
/// million times as bright as the others.
fn firefly() -> Field {
    let mut random = SplitMix64(7);
    let training_sample = |i: u32| {
        let normal = if i.is_multiple_of(2) { Vec3::Y } else { Vec3::NEG_Y };
        let position = Vec3::new(4.0 * random.f32() - 2.0, 0.0, 4.0 * random.f32() - 2.0);
        let (found, field_pdf) = if i == 500 { (1e6, 100.0) } else { (1.0, 0.0) };
        let (wi, weight) = (Vec3::new(0.9, 0.1, 0.2).normalize(), found * found);
        TrainingSample {
            position,
            normal,
            wi,
            contribution: found,
            weight,
            pdf: 0.2,
            bsdf_pdf: 0.2,
            field_pdf,
            light_pdf: 0.0,
            distance: f32::INFINITY,
        }
    };
    // Normals count more than positions.
    learn(&(0..2000).map(training_sample).collect::<Vec<_>>(), 0, true, 100.0, 2).0
}

fn build(scene: Scene) -> Result<PreparedScene<'static>> {
    PreparedScene::build(Arc::new(scene), Backend::Embree)
}

/// The field that a pre-pass learns in a scene.
fn learned_in(scene: Scene) -> Result<Option<Field>> {
    Ok(field(&build(scene)?, &settings(0, Choice::On)))
}

pub fn cases() -> Result<[Case; CASES]> {
    let case = |mode, name, construct, scene, adversarial| {
        Ok(Case { mode, name, construct, scene: build(scene)?, adversarial })
    };
    let half_lit =
        "a small mirror reflects an area light onto the floor; half of the pixels are outside of the caustic";
    let unseen = "two hidden area lights; the field was learned with the stronger one switched off";
    let thin = "a wall without thickness between a bright and a dim half of a room";
    let rare = "light of radiance 1/1000 through a small hole: one path in a thousand finds it";
    let made_up = "two hidden area lights; one made-up training sample, a million times as bright as the others, draws seven of \
                   eight samples on the floor to a wall";
    let leaning = "two hidden area lights; the floor's shading normal leans by 37°";
    let learned = learned_in(coves(4.0, 0.0))?;
    Ok([
        case("F19", "bright caustic", half_lit, caustic(), None)?,
        case("F20", "a light that the pre-pass never saw", unseen, coves(4.0, 40.0), learned)?,
        case("F21", "cells across a thin wall", thin, divided(), None)?,
        case("F22", "almost black", rare, almost_black(), None)?,
        case("F23", "one firefly", made_up, coves(4.0, 40.0), Some(firefly()))?,
        case("F33", "bumps", leaning, bumps(), None)?,
    ])
}

/// Settings of every render here.
pub fn settings(seed: u32, guiding: Choice) -> RenderSettings {
    RenderSettings {
        width: WHOLE,
        height: WHOLE,
        crop: Some(WINDOW),
        spp: Some(PATHS),
        max_depth: MAX_DEPTH,
        balance: Balance::Half,
        seed,
        ..RenderSettings::even().with(Technique::Guiding, guiding)
    }
}

/// The field that guides a render with these settings, if any.
pub fn field(scene: &PreparedScene, settings: &RenderSettings) -> Option<Field> {
    learned(scene, settings, &transport(scene, settings), &AtomicBool::new(false))?.0
}

#[cfg(test)]
mod tests {
    use bismar::lanes::V3;

    use super::*;

    #[test]
    fn cells_of_the_prepass_reach_across_the_wall() {
        let scene = build(divided()).unwrap();
        // Probes around the pixels' surface points, which are at z = 0.
        let reaches_across = |seed: &u32| {
            let field = field(&scene, &settings(*seed, Choice::On)).unwrap();
            let cell = |x, z| field.cells_at(V3::splat(Vec3::new(x, 0.0, z)), V3::splat(Vec3::Y))[0];
            (-20..=20).map(|i| i as f32 / 100.0).any(|z| cell(0.28, z) == cell(0.32, z))
        };
        let across = (0..16).filter(reaches_across).count();
        assert!(across >= 8, "in {across} of 16 pre-passes");
    }
}
