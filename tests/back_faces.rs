//! Back faces of single-sided materials: who sees them, sheets of two faces back to back, and one mean of all techniques.

use std::f64::consts::PI;
use std::sync::Arc;

use bismar::balance::Counts;
use bismar::film::PixelStats;
use bismar::integrator::clients::PixelSums;
use bismar::integrator::{PixelTask, Wave};
use bismar::rays::Backend;
use bismar::render::{BackFaces, Balance, GlassShadows, RenderSettings, transport};
use bismar::scene::build::{area_light, glass, lambert, look, metal};
use bismar::scene::{AlphaMode, Deformation, Environment, Material, PunctualKind, PunctualLight, Scene};
use glam::{Affine3A, DVec3, Mat3, Quat, Vec3, Vec4};

use crate::closed_forms::{BALANCES, BOTH, agrees, polygon_irradiance};
use crate::helpers::stage::{Stage, add, closed_box, punctual, rectangle, set_in_motion, turning};
use crate::helpers::statistics::{Mean, z_limit};
use crate::oracle;

const BACKENDS: [Backend; 2] = [Backend::Embree, Backend::Obvhs];

/// A white sky with a grey wall that shows its back to the camera and to a mirror, and a diffuse floor.
fn walls(double_sided: bool) -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    let wall = Material { double_sided, ..lambert(0.5) };
    // It faces up; the camera and the mirror see it from below.
    rectangle(&mut scene, 2.0, [-9.0, 9.0], [-9.0, 9.0], true, wall.clone());
    rectangle(&mut scene, 3.0, [-9.0, 9.0], [-9.0, 9.0], true, wall);
    rectangle(&mut scene, 0.0, [-1.0, 0.0], [-1.0, 1.0], true, metal(0.0));
    rectangle(&mut scene, 0.0, [0.0, 1.0], [-1.0, 1.0], true, lambert(0.5));
    look(&mut scene, Vec3::new(0.0, 1.5, 0.8), Vec3::ZERO, 1.0);
    scene
}

#[test]
fn the_camera_and_mirrors_do_not_see_back_faces_and_diffuse_light_does() {
    for backend in BACKENDS {
        let mean = |double_sided, back_faces| {
            let stage = Stage::new(walls(double_sided).into(), backend);
            let settings =
                RenderSettings { width: 32, height: 32, spp: Some(64), back_faces, ..RenderSettings::even() };
            let green = stage.green(&settings);
            let column = |x: usize| (12..20).map(|y| green[y * 32 + x]).sum::<f64>() / 8.0;
            [column(10), column(22)]
        };
        let [culled, shown] = [BackFaces::Cull, BackFaces::Show].map(|back_faces| mean(false, back_faces));
        // The mirror shows the white sky behind both walls; the floor lies in their shadow.
        let [tint, floor] = culled;
        assert!(tint > 0.5 && floor < 0.3, "{backend:?} {culled:?}");
        assert!(shown[0] < 0.6 * tint && (shown[1] - floor).abs() < 0.02, "{backend:?} {shown:?}");
        // Double-sided walls are seen in either case: the same bits.
        assert_eq!(mean(true, BackFaces::Cull), mean(true, BackFaces::Show));
    }
}

/// A quad around the z axis at `z`, as its corners and the triangles that one of its diagonals makes, facing +z or -z.
fn quad(half: f32, z: f32, diagonal: usize, front: bool) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let points = vec![[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
    let triangles = [[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]][diagonal];
    (points, triangles.map(|[a, b, c]| if front { [a, b, c] } else { [a, c, b] }).to_vec())
}

/// A sheet of two faces of these materials back to back, the first toward +z, under a white sky.
fn sheet(materials: [Material; 2], half: [f32; 2], z: f32, diagonal: usize) -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    for (i, material) in materials.into_iter().enumerate() {
        let (points, triangles) = quad(half[i], z, diagonal * i, i == 0);
        add(&mut scene, points, triangles, material);
    }
    scene
}

/// What the camera sees at points before and behind the sheet, looking at it.
fn sides(scene: &Scene, backend: Backend, z: f32, back_faces: BackFaces) -> [f64; 2] {
    [1.0, -1.0].map(|side| {
        let mut scene = scene.clone();
        look(&mut scene, Vec3::new(0.2, 0.1, z + 3.0 * side), Vec3::new(0.0, 0.0, z), 0.2);
        let settings = RenderSettings { width: 8, height: 8, spp: Some(64), back_faces, ..RenderSettings::even() };
        let green = Stage::new(scene.into(), backend).green(&settings);
        green.iter().sum::<f64>() / green.len() as f64
    })
}

#[test]
fn a_sheet_of_two_faces_back_to_back_has_the_colour_of_the_face_on_each_side() {
    let colours = [lambert(0.8), lambert(0.2)];
    for backend in BACKENDS {
        for back_faces in [BackFaces::Cull, BackFaces::Show] {
            // The same triangles, those of the other diagonal, a larger face behind, far away, large.
            for (half, z, diagonal) in [
                ([1.0; 2], 0.0, 0),
                ([1.0; 2], 0.0, 1),
                ([1.0, 2.0], 0.0, 1),
                ([1.0; 2], 1000.0, 1),
                ([300.0; 2], 0.0, 1),
            ] {
                let seen = sides(&sheet(colours.clone(), half, z, diagonal), backend, z, back_faces);
                let right = (seen[0] - 0.8).abs() < 0.02 && (seen[1] - 0.2).abs() < 0.02;
                assert!(right, "{backend:?} {back_faces:?} {half:?} {z} {diagonal}: {seen:?}");
            }
        }
        // Turned, mirrored; both faces in one mesh.
        let turn = Mat3::from_quat(Quat::from_rotation_y(0.4)) * Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 0.37));
        for (matrix, turned) in [(Mat3::from_rotation_y(0.3), false), (turn, false), (Mat3::from_rotation_y(2.9), true)]
        {
            let mut scene = sheet(colours.clone(), [1.0; 2], 0.0, 0);
            scene.instances.iter_mut().for_each(|i| i.transform = Some(Affine3A::from_mat3(matrix)));
            let [front, back] = sides(&scene, backend, 0.0, BackFaces::Cull);
            let seen = if turned { [back, front] } else { [front, back] };
            assert!((seen[0] - 0.8).abs() < 0.02 && (seen[1] - 0.2).abs() < 0.02, "{backend:?} {matrix}: {seen:?}");
        }
        let [(points, front), (_, back)] = [true, false].map(|side| quad(1.0, 0.0, 0, side));
        let mut scene = sheet(colours.clone(), [1.0; 2], 0.0, 0);
        scene.instances.clear();
        add(&mut scene, points, [front, back].concat(), lambert(0.5));
        let seen = sides(&scene, backend, 0.0, BackFaces::Cull);
        assert!(seen.iter().all(|side| (side - 0.5).abs() < 0.02), "{backend:?}: {seen:?}");
        // Alpha: of each side, the camera sees one layer. Behind it is the sky.
        for (alpha, alpha_mode, part) in
            [(0.5, AlphaMode::Blend, 0.5), (0.4, AlphaMode::Mask(0.5), 0.0), (0.6, AlphaMode::Mask(0.5), 1.0)]
        {
            let layer =
                |albedo| Material { base_color: Vec4::new(albedo, albedo, albedo, alpha), alpha_mode, ..lambert(0.0) };
            let seen = sides(&sheet([layer(0.8), layer(0.2)], [1.0; 2], 0.0, 1), backend, 0.0, BackFaces::Cull);
            let right = [0.8, 0.2].map(|albedo| part * albedo + 1.0 - part);
            assert!(
                seen.iter().zip(right).all(|(a, b)| (a - b).abs() < 0.03),
                "{backend:?} {alpha}: {seen:?} {right:?}"
            );
        }
    }
}

#[test]
fn a_mirroring_transform_keeps_the_front_where_the_winding_is_clockwise() {
    for (transform, motion) in [(Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)), false), (Affine3A::IDENTITY, true)] {
        let mut scene = Scene::default();
        let (points, triangles) = quad(1.0, 0.0, 0, true);
        add(&mut scene, points, triangles, area_light(0.5));
        scene.instances[0].transform = Some(transform);
        if motion {
            set_in_motion(&mut scene, turning(0.1, Vec3::ZERO));
        }
        for backend in BACKENDS.into_iter().filter(|backend| !motion || *backend == Backend::Embree) {
            assert_eq!(sides(&scene, backend, 0.0, BackFaces::Cull).map(|x| (x * 1e3).round()), [500.0, 0.0]);
        }
    }
}

#[test]
fn a_face_that_turns_over_while_the_shutter_is_open_is_seen_for_half_of_the_time() {
    let mut scene = Scene::default();
    let (points, triangles) = quad(1.0, 0.0, 0, true);
    add(&mut scene, points, triangles, area_light(1.0));
    let mesh = Arc::make_mut(&mut scene.meshes[0]);
    let mut turned = mesh.positions.clone();
    turned.as_mut_slice().iter_mut().for_each(|p| p[0] *= -1.0);
    mesh.motion = Some(Deformation { positions: vec![mesh.positions.clone(), turned], normals: Vec::new() });
    let [front, back] = sides(&scene, Backend::Embree, 0.0, BackFaces::Cull);
    // Near the middle of the time it is too narrow for the whole picture.
    assert!((front - back).abs() < 0.03 && (0.25..0.5).contains(&front), "{front} {back}");
}

#[test]
fn a_lamp_of_two_faces_back_to_back_gives_its_light_with_every_balance() {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    // The upper face comes first in the file, and has the other diagonal.
    let corners = [[-0.2, 1.5, -0.7], [1.0, 1.5, -0.7], [1.0, 1.5, 0.4], [-0.2, 1.5, 0.4]];
    add(&mut scene, corners.to_vec(), vec![[0, 3, 1], [1, 3, 2]], area_light(3.0));
    add(&mut scene, corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]], area_light(10.0));
    look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 1e-3);
    let corners = corners.map(|p| Vec3::from(p).as_dvec3());
    agrees(scene, 0.5 / PI * 10.0 * polygon_irradiance(DVec3::ZERO, &corners), &BOTH);
}

/// A room of two-skinned walls around glossy, rough and glass things, a lamp of two faces, and light of all kinds behind backs:
/// mirror images of the camera's rays see it, and so must light samples.
fn room() -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([0.3; 3])), ..Default::default() };
    let [low, high] = [Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 2.2, 2.0)];
    // Its faces look outside; those of the room within look inside, in the same planes.
    closed_box(&mut scene, low, high, lambert(0.7));
    closed_box(&mut scene, low, high, lambert(0.4));
    let inner = Arc::make_mut(&mut scene.meshes[1]);
    inner.normals = None;
    inner.indices.iter_mut().for_each(|t| t.swap(1, 2));
    // Its back hides the lights above it.
    rectangle(&mut scene, 1.8, [-2.0, 2.0], [-2.0, 2.0], true, lambert(0.5));
    rectangle(&mut scene, 0.1, [-1.5, 0.0], [-1.5, 1.5], true, metal(0.25));
    rectangle(&mut scene, 0.1, [0.0, 1.5], [-1.5, 0.0], true, metal(0.0));
    rectangle(
        &mut scene,
        0.1,
        [0.0, 1.5],
        [0.0, 1.5],
        true,
        Material { clearcoat: 0.8, clearcoat_roughness: 0.2, ..lambert(0.5) },
    );
    rectangle(&mut scene, 2.1, [-0.6, 0.6], [-1.2, 0.0], false, area_light(9.0));
    rectangle(&mut scene, 1.6, [-1.0, -0.5], [-0.5, 0.5], true, area_light(2.0));
    rectangle(&mut scene, 1.6, [-1.0, -0.5], [-0.5, 0.5], false, area_light(4.0));
    let pane = Material { bounds_medium: false, ..glass(1.5, 0.0) };
    rectangle(&mut scene, 1.2, [0.2, 0.9], [-0.9, 0.6], true, pane);
    closed_box(&mut scene, Vec3::new(0.8, 0.2, 0.6), Vec3::new(1.2, 0.6, 1.0), glass(1.5, 0.0));
    let lamp = punctual(PunctualKind::Point, 3.0, Vec3::new(0.5, 2.0, 0.6), Vec3::NEG_Y);
    scene.lights.extend([lamp.clone(), PunctualLight { size: 0.2, position: Vec3::new(-0.9, 2.0, 0.9), ..lamp }]);
    look(&mut scene, Vec3::new(0.3, 1.4, 1.9), Vec3::new(0.0, 0.2, -0.2), 1.0);
    scene
}

fn view(balance: Balance) -> RenderSettings {
    RenderSettings { width: 24, height: 18, spp: Some(16), max_depth: 5, balance, ..RenderSettings::even() }
}

#[test]
fn light_behind_back_faces_has_one_mean_with_every_balance() {
    let scene = Arc::new(room());
    let mut means = Vec::<(String, Mean)>::new();
    for backend in BACKENDS {
        let stage = Stage::new(scene.clone(), backend);
        for balance in BALANCES {
            means.push((format!("{backend:?} {balance:?}"), stage.mean_green(&view(balance), 24)));
        }
    }
    let limit = z_limit(means.len());
    for (name, mean) in &means {
        let z = mean.z_to(&means[0].1);
        assert!(z.abs() < limit, "{name}: {} ± {}, z {z}; {means:?}", mean.mean, mean.standard_error());
    }
}

#[test]
fn paths_through_back_faces_are_those_of_the_scalar_tracer() {
    for scene in [walls(false), room()] {
        let stage = Stage::new(scene.into(), Backend::Obvhs);
        let glass_shadows = GlassShadows::Straight;
        let settings = RenderSettings { width: 20, height: 15, glass_shadows, ..RenderSettings::even() };
        let transport = transport(&stage.scene, &settings);
        let counts = Counts::half(1);
        let tasks: Vec<_> = (0..300).map(|i| PixelTask::first([i % 20, i / 20], counts, i)).collect();
        let mut stats = vec![PixelStats::default(); tasks.len()];
        Wave::default().run(&transport, &tasks, &mut PixelSums::new(&mut stats));
        for (task, stats) in tasks.iter().zip(&stats) {
            let scalar = oracle::trace(&transport, task, 0);
            let wave = Vec3::from(stats.sum.map(|x| x as f32));
            // Sums of at most 100 terms, in another order.
            assert!(
                (wave - scalar).abs().max_element() <= 100.0 * f32::EPSILON * scalar.max_element().max(1.0),
                "{task:?}: {wave} {scalar}"
            );
        }
    }
}
