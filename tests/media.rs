//! Absorption inside of bodies: closed forms for cameras, lights and surfaces in one another's bodies.

use std::f32::consts::PI;
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::settings::lens::{Aperture, Focus, LensSettings};
use bismar::render::{Balance, Choice, GlassShadows, Integrator, RenderSettings, Technique};
use bismar::scene::{Camera, Environment, Material, Motion, Projection, PunctualKind, Scene};
use glam::{Affine3A, DAffine3, Vec3, vec3};

use crate::closed_forms::{BALANCES, agrees_with, settings};
use crate::helpers::random::Random;
use crate::helpers::stage::{
    Stage, add_sphere, area_light, closed_box, glass, lambert, look, pool, punctual, rectangle,
};
use crate::helpers::statistics::z_limit;

/// A box of index 1 with an absorption per metre.
#[derive(Debug, Clone, Copy)]
struct Body {
    low: Vec3,
    high: Vec3,
    absorption: f32,
}

/// Boxes in one another, each of whose faces may lie in that of the box around it or of the one beside it. The outer ones come first.
fn nested(random: &mut Random, around: Body, levels: u32, all: &mut Vec<Body>) {
    all.push(around);
    if levels == 0 {
        return;
    }
    // Slabs across the box, of which neighbours touch.
    let count = 1 + (random.f32() * 3.0) as u32;
    let mut cuts: Vec<f32> = (0..=count).map(|i| (i as f32 + 0.6 * random.f32()) / (count as f32 + 0.6)).collect();
    if random.f32() < 0.5 {
        (cuts[0], cuts[count as usize]) = (0.0, 1.0);
    }
    // No box is the one around it.
    let side = [0.0, 0.2][usize::from(count == 1 || random.f32() < 0.5)];
    for cut in cuts.windows(2) {
        let at = |x: f32, z: f32| around.low + (around.high - around.low) * vec3(x, x, z);
        let absorption = [0.0, 0.1, 0.25, 0.4][(random.f32() * 4.0) as usize];
        let inside = Body { low: at(side, cut[0]), high: at(1.0 - side, cut[1]), absorption };
        nested(random, inside, levels - 1, all);
    }
}

/// Optical depth from `eye` along a unit direction, by the innermost box on each piece.
fn optical_depth(bodies: &[Body], eye: Vec3, direction: Vec3) -> f32 {
    let planes = bodies.iter().flat_map(|body| [body.low, body.high]);
    let mut ends: Vec<f32> = planes.flat_map(|p| ((p - eye) / direction).to_array()).filter(|t| *t > 0.0).collect();
    ends.push(0.0);
    ends.sort_by(f32::total_cmp);
    let piece = |ends: &[f32]| {
        let p = eye + direction * (0.5 * (ends[0] + ends[1]));
        let innermost = bodies.iter().rfind(|body| p.cmpge(body.low).all() && p.cmple(body.high).all());
        innermost.map_or(0.0, |body| body.absorption) * (ends[1] - ends[0])
    };
    ends.windows(2).map(piece).sum()
}

#[test]
fn bodies_in_one_another_absorb_as_the_innermost_one_whatever_their_order() {
    let mut random = Random(65);
    for case in 0..200 {
        let mut bodies = Vec::new();
        nested(&mut random, Body { low: -Vec3::ONE, high: Vec3::ONE, absorption: 0.2 }, 2, &mut bodies);
        let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
        let mut order: Vec<_> = bodies.iter().collect();
        for i in (1..order.len()).rev() {
            order.swap(i, (random.f32() * (i + 1) as f32) as usize);
        }
        for &&Body { low, high, absorption } in &order {
            closed_box(&mut scene, low, high, Material { absorption: Vec3::splat(absorption), ..glass(1.0, 0.0) });
        }
        // From outside and from within; near to no face.
        let eye = random.point() * if case % 3 == 0 { 4.0 } else { 0.9 };
        let target = random.point() * 0.5;
        look(&mut scene, eye, target, 1e-4);
        let expected = (-optical_depth(&bodies, eye, (target - eye).normalize())).exp();
        for backend in [Backend::Embree, Backend::Obvhs] {
            let mean = Stage::new(Arc::new(scene.clone()), backend).mean_green(&settings(), 1).mean;
            assert!((mean / f64::from(expected) - 1.0).abs() < 3e-3, "{case} {backend:?}: {mean} for {expected}");
        }
    }
}

/// Two touching boxes of water with an absorption of 0.5, from z = 1 down to −2, seen by `camera` from (0, 0, 0.5) along −z.
fn water(camera: Camera, moves: Option<[f64; 2]>) -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    let medium = || Material { absorption: Vec3::splat(0.5), ..glass(1.0, 0.0) };
    closed_box(&mut scene, vec3(-1.0, -1.0, -1.0), vec3(1.0, 1.0, 1.0), medium());
    closed_box(&mut scene, vec3(-1.0, -1.0, -2.0), vec3(1.0, 1.0, -1.0), medium());
    let at = |z: f64| DAffine3::from_translation(glam::dvec3(0.0, 0.0, z));
    let motion = moves.and_then(|[from, to]| Motion::new(&[at(from), at(to)]).map(Arc::new));
    let to_world = Affine3A::from_translation(vec3(0.0, 0.0, 0.5));
    scene.cameras.push(Camera { to_world, motion, ..camera });
    scene
}

#[test]
fn the_media_of_a_camera_ray_are_those_of_its_own_start() {
    let perspective = || Camera::new("camera", Projection::Perspective { yfov: 1e-3 }, Affine3A::IDENTITY);
    let expect = |name: &str, scene: Scene, more: RenderSettings, backends: &[Backend], expected: f64| {
        for &backend in backends {
            let settings = RenderSettings { width: 8, height: 8, spp: Some(256), ..more.clone() };
            let mean = Stage::new(Arc::new(scene.clone()), backend).mean_green(&settings, 4).mean;
            assert!((mean / expected - 1.0).abs() < 5e-3, "{name} {backend:?}: {mean} for {expected}");
        }
    };
    let both = [Backend::Embree, Backend::Obvhs];
    expect("pinhole", water(perspective(), None), settings(), &both, (-1.25f64).exp());
    // A quarter of the rays begin in the water.
    let projection = Projection::Orthographic { xmag: 1.0, ymag: 2.0 };
    let camera = Camera::new("camera", projection, Affine3A::IDENTITY);
    expect("orthographic", water(camera, None), settings(), &both, 0.75 + 0.25 * (-1.25f64).exp());
    // The near plane hides surfaces, and cuts bodies open: from within the water, and from air in front of it.
    let planes = |near| Camera { clip: Some([near, f32::INFINITY]), ..perspective() };
    expect("near plane", water(planes(1.0), None), settings(), &both, (-1.25f64).exp());
    let mut outside = water(planes(1.0), None);
    outside.cameras[0].to_world.translation.z = 1.5;
    expect("near plane in front", outside, settings(), &both, (-1.25f64).exp());
    // From z = 0.8 out of the water to z = 1.4 while the shutter is open: a third of the time in it.
    let moving = water(perspective(), Some([0.8, 1.4]));
    let inside = (1.0 - (-0.1f64).exp()) / 0.1 * (-1.4f64).exp();
    expect("motion", moving, settings(), &both[..1], inside / 3.0 + 2.0 / 3.0 * (-1.5f64).exp());
    let mut body = water(perspective(), None);
    body.cameras[0].to_world.translation.z = 2.0;
    let rise = [0.0, 4.0].map(|z| DAffine3::from_translation(glam::dvec3(0.0, 0.0, z)));
    for instance in &mut body.instances {
        (instance.transform, instance.motion) = (Some(Affine3A::IDENTITY), Motion::new(&rise).map(Arc::new));
    }
    // The water's far side, at z − 2 for a rise of z, is 4 − z away; its near side reaches the camera at 1 and passes it at 4.
    let at = |z: f64| (0.5 * if z < 1.0 { -3.0 } else { z - 4.0 }).exp();
    let mean = (0..4000).map(|i| at((f64::from(i) + 0.5) / 1000.0)).sum::<f64>() / 4000.0;
    expect("moving water", body, settings(), &both[..1], mean);
    // A lens of half a metre, of which a part is beside the water.
    let mut lens = water(Camera::new("camera", Projection::Perspective { yfov: 1e-3 }, Affine3A::IDENTITY), None);
    lens.cameras[0].to_world.translation.x = 1.0;
    lens.cameras[0].to_world.translation.z = 0.999;
    let lens_settings = LensSettings { aperture: Aperture::Radius(0.5), focus: Focus::Distance(1e5), blades: 0 };
    let wide = RenderSettings { lens: Some(lens_settings), ..settings() };
    expect("lens", lens, wide, &both, 0.5 + 0.5 * (-1.4995f64).exp());
}

#[test]
fn light_goes_from_glass_into_the_water_that_touches_it() {
    // At 45 degrees the glass would reflect all of it, were there air between. The lower side of the water shines.
    let (glass_above, water_below) = (glass(1.5, 0.0), glass(1.33, 0.0));
    let bodies = [
        (vec3(-9.0, 0.0, -9.0), vec3(9.0, 3.0, 9.0), glass_above),
        (vec3(-9.0, -3.0, -9.0), vec3(9.0, 0.0, 9.0), water_below),
    ];
    // Touching and overlapping: where both are, the one that was entered last counts.
    for (first, overlap) in [(0, 0.0), (1, 0.0), (0, 0.2), (1, 0.2)] {
        let mut scene = Scene::default();
        for at in [first, 1 - first] {
            let (low, high, ref material) = bodies[at];
            let high = if at == 1 { high + Vec3::Y * overlap } else { high };
            closed_box(&mut scene, low, high, material.clone());
        }
        rectangle(&mut scene, -1.0, [-9.0, 9.0], [-9.0, 9.0], true, area_light(1.0));
        // What is reflected is lost.
        rectangle(&mut scene, 2.0, [-9.0, 9.0], [-9.0, 9.0], false, lambert(0.0));
        look(&mut scene, vec3(0.0, 1.0, 1.0), Vec3::ZERO, 1e-3);
        let fresnel = crate::glass::fresnel(1.33 / 1.5, std::f64::consts::FRAC_PI_4);
        agrees_with(&settings(), 60, scene, 1.0 - fresnel, &[Integrator::Path]);
    }
}

#[test]
fn straight_shadow_rays_pass_touching_and_nested_bodies() {
    // A floor in the lower of two touching slabs, lit by a point in a box within the upper one.
    let [below, above, within] = [0.8f32, 0.3, 1.5];
    let expected = f64::from(0.5 / PI / 4.0 * (-(below + 0.5 * above + 0.5 * within)).exp());
    for order in [[0, 1, 2], [2, 0, 1], [1, 2, 0], [2, 1, 0]] {
        let mut scene = Scene::default();
        rectangle(&mut scene, 0.0, [-9.0, 9.0], [-9.0, 9.0], true, lambert(0.5));
        for at in order {
            let (low, high, absorption) = [
                (vec3(-9.0, -1.0, -9.0), vec3(9.0, 1.0, 9.0), below),
                (vec3(-9.0, 1.0, -9.0), vec3(9.0, 3.0, 9.0), above),
                (vec3(-1.0, 1.5, -1.0), vec3(1.0, 3.0, 1.0), within),
            ][at];
            closed_box(&mut scene, low, high, Material { absorption: Vec3::splat(absorption), ..glass(1.0, 0.0) });
        }
        scene.lights.push(punctual(PunctualKind::Point, 1.0, vec3(0.0, 2.0, 0.0), Vec3::NEG_Y));
        // Next to the floor: 1 mm of the way is absorbed twice.
        look(&mut scene, vec3(0.001, 0.001, 0.0), Vec3::ZERO, 1e-4);
        for backend in [Backend::Embree, Backend::Obvhs] {
            let settings = RenderSettings { glass_shadows: GlassShadows::Straight, ..settings() };
            let mean = Stage::new(Arc::new(scene.clone()), backend).mean_green(&settings, 1).mean;
            assert!((mean / expected - 1.0).abs() < 5e-3, "{backend:?} {order:?}: {mean} for {expected}");
        }
    }
}

#[test]
fn lights_and_surfaces_in_water_have_one_mean() {
    let stage = Stage::new(pool(), Backend::Embree);
    let settings = RenderSettings { width: 8, height: 6, max_depth: 6, ..settings() };
    for glass_shadows in GlassShadows::ALL {
        let settings = RenderSettings { glass_shadows, ..settings.clone() };
        let reference = RenderSettings { balance: Balance::Half, seed: 900_000, spp: Some(128), ..settings.clone() };
        let reference = stage.mean_green(&reference, 60);
        assert!(reference.mean > 0.01, "{}", reference.mean);
        let all = BALANCES.map(|balance| (balance, Choice::Off)).into_iter();
        let all: Vec<_> = all.chain([(Balance::Half, Choice::On), (Balance::Progressive, Choice::On)]).collect();
        for &(balance, reuse) in &all {
            let with = RenderSettings { balance, ..settings.clone() }.with(Technique::PathReuse, reuse);
            let mean = stage.mean_green(&with, 120);
            let z = mean.z_to(&reference);
            assert!(
                z.abs() < z_limit(2 * all.len()),
                "{balance:?} {reuse:?}: {} for {}, z = {z}",
                mean.mean,
                reference.mean
            );
        }
    }
}

#[test]
fn a_surface_in_a_globe_in_water_gets_what_both_leave() {
    // A small floor in a globe of a clear medium within water; camera and lamp are in the globe, in the water above it, or outside.
    let scene = |lamp: f32, eye: f32| {
        let mut scene = Scene::default();
        let medium = |absorption: f32| Material { absorption: Vec3::splat(absorption), ..glass(1.0, 0.0) };
        closed_box(&mut scene, vec3(-2.0, -2.0, -2.0), vec3(2.0, 4.0, 2.0), medium(0.5));
        add_sphere(&mut scene, 32, 1.0, Vec3::ZERO, medium(0.0));
        rectangle(&mut scene, 0.0, [-0.5, 0.5], [-0.5, 0.5], true, lambert(0.5));
        scene.lights.push(punctual(PunctualKind::Point, 1.0, vec3(-0.2, lamp, 0.0), Vec3::NEG_Y));
        look(&mut scene, vec3(0.13, eye, 0.0), vec3(0.13, 0.0, 0.0), 1e-4);
        scene
    };
    for (lamp, eye) in [(0.4f32, 0.6f32), (0.4, 3.0), (0.4, 5.0), (3.0, 0.6), (3.0, 2.5), (3.0, 6.0)] {
        let floor = vec3(0.13, 0.0, 0.0);
        // The way to a point, less what is in the globe (of which facets cut a little off) and beyond the water.
        let in_water = |to: Vec3| {
            let (way, towards) = ((to - floor).length(), (to - floor).normalize());
            let x = floor.dot(towards);
            let globe = (x * x - floor.length_squared() + 0.9985 * 0.9985).sqrt() - x;
            (way.min(4.0 / towards.y) - globe).max(0.0)
        };
        let (to_lamp, to_eye) = (vec3(-0.2, lamp, 0.0), vec3(0.13, eye, 0.0));
        let way = to_lamp - floor;
        let irradiance = way.normalize().y / way.length_squared();
        let expected = 0.5 / PI * irradiance * (-0.5 * (in_water(to_lamp) + in_water(to_eye))).exp();
        for backend in [Backend::Embree, Backend::Obvhs] {
            let settings = RenderSettings { glass_shadows: GlassShadows::Straight, ..settings() };
            let mean = Stage::new(Arc::new(scene(lamp, eye)), backend).mean_green(&settings, 1).mean;
            assert!((mean / f64::from(expected) - 1.0).abs() < 5e-3, "{backend:?} {lamp} {eye}: {mean} for {expected}");
        }
    }
}
