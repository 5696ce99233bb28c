//! Motion blur against closed forms and against the mean of many still renders; the same bits however it is rendered; and
//! what stands still is as it was.

use std::f64::consts::{FRAC_PI_2, PI};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use bismar::Error;
use bismar::integrator::PreparedScene;
use bismar::rays::{Backend, HitBatch, MISS, RayBatch, RayOrder, build};
use bismar::render::{Balance, RenderSettings};
use bismar::scene::import::{ImportOptions, Pose, SceneFiles, Shutter};
use bismar::scene::{
    Camera, Deformation, Environment, LightKey, Motion, Positions, Projection, PunctualKind, PunctualLight, Scene,
};
use glam::{DAffine3, DQuat, DVec3, Vec3, vec3};

use crate::closed_forms::{self, BALANCES, polygon_irradiance};
use crate::helpers::glb;
use crate::helpers::program::{Folder, assert_same_bits, bits, expect, says};
use crate::helpers::random::Random;
use crate::helpers::ray_scenes::{box_room, camera_rays};
use crate::helpers::shared;
use crate::helpers::stage::{
    Stage, add, area_light, lambert, look, moving_hall, punctual, rectangle, set_in_motion, sphere,
};
use crate::helpers::statistics::{Mean, z_limit};
use crate::merge::in_parts;

const COLUMNS: u32 = 8;
/// Half of what an orthographic camera sees, in metres.
const HALF: f64 = 0.2;
const REPLICAS: u32 = 200;

fn settings() -> RenderSettings {
    RenderSettings { width: COLUMNS, height: 8, spp: Some(16), balance: Balance::Half, ..closed_forms::settings() }
}

fn along(x: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::X * x)
}

fn motion(moments: &[DAffine3]) -> Option<Arc<Motion>> {
    Motion::new(moments).map(Arc::new)
}

/// An area light of radiance 3 over x in [x0, x1], 2 m before an orthographic camera that looks along -z.
fn plate(x0: f32, [half_height, x1]: [f32; 2]) -> Scene {
    let mut scene = Scene::default();
    let (h, z) = (half_height, -2.0);
    let points = vec![[x0, -h, z], [x1, -h, z], [x1, h, z], [x0, h, z]];
    add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], area_light(3.0));
    look(&mut scene, Vec3::ZERO, Vec3::NEG_Z, 0.2);
    scene.cameras[0].projection = Projection::Orthographic { xmag: HALF as f32, ymag: HALF as f32 };
    scene
}

/// Mean green of each pixel over renders with seeds from 0 on.
pub fn pixel_means(stage: &Stage, settings: &RenderSettings, replicas: u32) -> Vec<Mean> {
    let mut means = vec![Mean::default(); (settings.width * settings.height) as usize];
    for seed in 0..replicas {
        let green = stage.green(&RenderSettings { seed, ..settings.clone() });
        means.iter_mut().zip(green).for_each(|(mean, green)| mean.add(green));
    }
    means
}

fn pixels(scene: Scene) -> Vec<Mean> {
    pixel_means(&Stage::new(Arc::new(scene), Backend::Embree), &settings(), REPLICAS)
}

#[track_caller]
fn all_agree(what: &str, means: &[Mean], expected: impl Fn(u32, u32) -> f64) {
    let limit = z_limit(6 * means.len());
    for (i, mean) in (0..).zip(means) {
        let expected = expected(i % COLUMNS, i / COLUMNS);
        // Where hardly a path meets it, or misses it, their number says how sure it is.
        let share = expected / 3.0;
        let rare = share.min(1.0 - share).max(0.0);
        let least = if rare < 0.01 { 3.0 * (rare / f64::from(16 * REPLICAS)).sqrt() } else { 0.0 };
        let z = (mean.mean - expected) / mean.standard_error().max(least).max(1e-6);
        assert!(z.abs() < limit, "{what}, pixel {i}: {} for {expected}, z = {z}", mean.mean);
    }
}

/// World x of a place in a pixel.
fn x_of(column: u32, inside: f64) -> f64 {
    HALF * (2.0 * (f64::from(column) + inside) / f64::from(COLUMNS) - 1.0)
}

#[test]
fn a_moving_edge_is_its_closed_form_whatever_moves() {
    // The edge goes from -0.12 to 0.1: what is at x is lit from the time on at which the edge has come by.
    const STEPS: u32 = 2000;
    let lit = |x: f64| (1.0 - (x + 0.12) / 0.22).clamp(0.0, 1.0);
    let mean =
        |column: u32| (0..STEPS).map(|i| lit(x_of(column, (f64::from(i) + 0.5) / f64::from(STEPS)))).sum::<f64>();
    let expected = |column: u32, _: u32| 3.0 * mean(column) / f64::from(STEPS);
    let mut carried = plate(-9.0, [9.0, 0.0]);
    carried.instances[0].transform = Some(along(0.0).as_affine3a());
    carried.instances[0].motion = motion(&[along(-0.12), along(0.1)]);
    all_agree("an instance moves", &pixels(carried), expected);
    // In steps of which only the last edge tells.
    let mut bent = plate(-9.0, [9.0, 0.0]);
    let mesh = Arc::make_mut(&mut bent.meshes[0]);
    let at = |edge: f32| {
        Positions::new(mesh.positions.iter().map(|p| if p[0] == 0.0 { [edge, p[1], p[2]] } else { *p }).collect())
    };
    let positions = vec![at(-0.12), at(-0.01), at(0.1)];
    mesh.motion = Some(Deformation { positions, normals: Vec::new() });
    all_agree("a form changes", &pixels(bent), expected);
    let mut passed = plate(-9.0, [9.0, 0.0]);
    passed.cameras[0].motion = motion(&[along(0.12), along(-0.1)]);
    all_agree("the camera moves", &pixels(passed), expected);
}

#[test]
fn a_rotating_bar_is_its_closed_form() {
    // A bar of half width 0.03 and half length 0.15 turns by 100° about the middle of the picture.
    let (half_width, half_length, begin, turn) = (0.03, 0.15, 0.3, 100_f64.to_radians());
    let mut scene = plate(-0.15, [0.03, 0.15]);
    let at = |angle: f64| DAffine3::from_quat(DQuat::from_rotation_z(angle));
    scene.instances[0].transform = Some(at(begin).as_affine3a());
    scene.instances[0].motion = motion(&[at(begin), at(begin + turn)]);
    assert!(scene.instances[0].motion.as_ref().unwrap().has_rotation());
    // The share of the time at which a place at (x, y) is in the bar, by midpoints in time.
    let share = |x: f64, y: f64| {
        const TIMES: u32 = 400;
        let inside = |i: u32| {
            let (s, c) = (begin + turn * (f64::from(i) + 0.5) / f64::from(TIMES)).sin_cos();
            f64::from(u8::from((c * x + s * y).abs() < half_length && (c * y - s * x).abs() < half_width))
        };
        (0..TIMES).map(inside).sum::<f64>() / f64::from(TIMES)
    };
    const GRID: u32 = 40;
    let expected = |column: u32, row: u32| {
        let place = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
        let sum =
            (0..GRID * GRID).map(|i| share(x_of(column, place(i % GRID)), -x_of(row, place(i / GRID)))).sum::<f64>();
        3.0 * sum / f64::from(GRID * GRID)
    };
    all_agree("a bar turns", &pixels(scene), expected);
}

/// A diffuse floor, seen in a small place at the origin.
fn floor() -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    look(&mut scene, Vec3::new(0.0, 2.0, 2.0), Vec3::ZERO, 1e-3);
    scene
}

#[test]
fn a_light_that_moves_over_a_diffuse_plane_is_its_closed_form() {
    // Irradiance of a point of intensity I at (x, h) is I h / (x² + h²)^1.5, whose integral is I x / (h √(x² + h²)).
    let (from, to, height, intensity) = (-0.7, 1.9, 0.8, 4.0);
    let mut scene = floor();
    let key = |x: f64| LightKey {
        intensity: Vec3::splat(intensity as f32),
        position: vec3(x as f32, height as f32, 0.0),
        direction: Vec3::NEG_Y,
    };
    let light = punctual(PunctualKind::Point, intensity as f32, key(from).position, Vec3::NEG_Y);
    scene.lights.push(PunctualLight { motion: vec![key(from), key(to)], ..light });
    let whole = |x: f64| intensity * x / (height * x.hypot(height));
    let expected = 0.5 / PI * (whole(to) - whole(from)) / (to - from);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let mean = stage.mean_green(&closed_forms::settings(), 300);
    assert!(mean.z(expected).abs() < z_limit(1), "{} for {expected}", mean.mean);
}

#[test]
fn a_lamp_that_moves_and_turns_over_a_diffuse_plane_is_its_closed_form_by_every_balance() {
    let corners = [(-0.4, -0.7), (0.6, -0.7), (0.6, 0.4), (-0.4, 0.4)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let at = |time: f64| {
        let by = DVec3::new(1.5 * time - 0.5, 1.4, 0.1);
        DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.9 * time - 0.3), by)
    };
    const TIMES: u32 = 4000;
    let irradiance = |i: u32| {
        let at = at((f64::from(i) + 0.5) / f64::from(TIMES));
        polygon_irradiance(DVec3::ZERO, &corners.map(|c| at.transform_point3(c)))
    };
    let expected = 0.5 / PI * 10.0 * (0..TIMES).map(irradiance).sum::<f64>() / f64::from(TIMES);
    let moments: Vec<_> = (0..=16).map(|i| at(f64::from(i) / 16.0)).collect();
    let limit = z_limit(2 * BALANCES.len());
    for environment in [false, true] {
        let mut scene = floor();
        // A negligible environment, so that both kinds share samples.
        scene.environment = environment.then(|| Environment::constant([1e-6; 3]));
        let points = corners.map(|c| c.as_vec3().to_array()).to_vec();
        add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], area_light(10.0));
        scene.instances[1].transform = Some(moments[8].as_affine3a());
        scene.instances[1].motion = motion(&moments);
        let stage = Stage::new(Arc::new(scene), Backend::Embree);
        for balance in BALANCES {
            let mean = stage.mean_green(&RenderSettings { balance, ..closed_forms::settings() }, 150);
            let z = mean.z(expected);
            assert!(z.abs() < limit, "{balance:?}, environment {environment}: {} for {expected}, z = {z}", mean.mean);
        }
    }
}

#[test]
fn what_embree_hits_is_where_shading_puts_it() {
    let mut scene = box_room();
    let (points, indices) = sphere(24, 1.0, Vec3::ZERO);
    add(&mut scene, points, indices, lambert(0.5));
    let key = |angle: f64| {
        let scale = DVec3::new(0.4, -0.3, 0.5 + 0.1 * angle);
        let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), angle);
        DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::new(0.2 * angle, 0.1, -0.2))
    };
    set_in_motion(&mut scene, motion(&[key(0.3), key(1.1), key(2.4)]));
    scene.instances.last_mut().unwrap().transform = Some(key(0.3).as_affine3a());
    let scene = Arc::new(scene);
    let rays = build(Backend::Embree, Arc::clone(&scene)).unwrap();
    let prepared = PreparedScene::new(Arc::clone(&scene), rays);
    let mut random = Random(5);
    let mut batch: RayBatch = camera_rays(96);
    batch.time = (0..batch.len()).map(|_| random.f32()).collect();
    let mut hits = HitBatch::default();
    prepared.rays.closest_hits(&batch, RayOrder::Coherent, &mut hits);
    let moving = scene.instances.len() as u32 - 1;
    let mut met = 0;
    for i in (0..batch.len()).filter(|&i| hits.mesh[i] != MISS) {
        let hit = hits.primitive(i);
        met += u32::from(hit.instance == moving);
        let point = prepared.geometry.point(&scene, hit, (hits.u[i], hits.v[i]), batch.time[i]);
        // Beyond it by less than rays keep off their surface, but for what the hit's own distance is wrong by.
        let along = batch.origin(i) + batch.direction(i) * hits.t[i];
        let off = (point.position - along).dot(point.ng.normalize());
        let size = point.position.abs().max_element().max(along.abs().max_element()) + batch.origin(i).length();
        assert!(off.abs() <= 16.0 * f32::EPSILON * size, "{hit:?} at {}: {off} off", batch.time[i]);
    }
    assert!(met > 200, "{met}");
}

/// A scene of these files at a pose.
fn posed(files: &SceneFiles, seconds: f64, shutter: Option<Shutter>) -> Scene {
    let pose = Some(Pose { seconds, animation: None, shutter, frame: None });
    let mut scene = files.import(&ImportOptions { pose, ..Default::default() }).unwrap().scene;
    scene.environment = Some(Environment::constant([0.8, 0.6, 0.4]));
    scene
}

/// A blurred picture has the mean of stills at random times: pixel by pixel, block by block.
#[track_caller]
fn is_mean_of_stills(file: &Path, seconds: f64, [opens, closes]: [f64; 2]) {
    const STILLS: u32 = 300;
    let files = SceneFiles::open(file).unwrap();
    let settings = RenderSettings { width: 24, height: 18, max_depth: 3, ..settings() };
    let blocks = |green: &[f64]| {
        let mut blocks = vec![0.0; 48];
        green.iter().enumerate().for_each(|(i, g)| blocks[i % 24 / 3 + i / 24 / 3 * 8] += g / 9.0);
        blocks
    };
    let blurred = posed(&files, seconds, Some(Shutter { opens, closes, steps: None }));
    assert!(blurred.moves(), "nothing moves");
    let view = blurred.camera(0, 24, 18);
    let blurred = Stage::new(Arc::new(blurred), Backend::Embree);
    let mut means = vec![[Mean::default(); 2]; 48];
    let mut random = Random(7);
    for seed in 0..STILLS {
        let time = seconds + opens + (closes - opens) * f64::from(random.f32());
        let mut still = posed(&files, time, None);
        if still.cameras[0].framing.is_some() {
            // The view that fits each pose is not the blurred picture's.
            still.cameras = vec![Camera { framing: None, ..view.clone() }];
        }
        let still = Stage::new(Arc::new(still), Backend::Embree);
        for (which, stage) in [&blurred, &still].into_iter().enumerate() {
            let green = stage.green(&RenderSettings { seed, spp: Some(4), ..settings.clone() });
            means.iter_mut().zip(blocks(&green)).for_each(|(means, green)| means[which].add(green));
        }
    }
    let limit = z_limit(4 * 48);
    let mut moved = 0;
    for (i, [blur, still]) in means.iter().enumerate() {
        let error = blur.standard_error().hypot(still.standard_error());
        let z = (blur.mean - still.mean) / error.max(1e-9);
        assert!(z.abs() < limit, "block {i}: {} blurred, {} of stills, z = {z}", blur.mean, still.mean);
        moved += u32::from(still.standard_error() > 1.5 * blur.standard_error());
    }
    assert!(moved > 2, "nothing to be seen moves: {moved}");
}

#[test]
fn blur_is_the_mean_of_stills_for_rigid_and_changing_forms_and_a_camera() {
    let folder = Folder::new().with("moving.glb", glb::moving());
    let file = folder.join("moving.glb");
    is_mean_of_stills(&file, 0.5, [-0.3, 0.4]);
    // Half of the time it stands.
    is_mean_of_stills(&file, 1.0, [-0.3, 0.3]);
}

#[test]
fn blur_is_the_mean_of_stills_for_skins() {
    let Some(folder) = shared::folder() else { return };
    is_mean_of_stills(&folder.join("geometry/Fox/Fox.glb"), 0.3, [-0.15, 0.15]);
}

#[test]
fn steps_are_as_many_as_motion_bends() {
    let folder = Folder::new().with("moving.glb", glb::moving());
    let files = SceneFiles::open(&folder.join("moving.glb")).unwrap();
    let keys = |seconds, closes, steps| {
        let scene = posed(&files, seconds, Some(Shutter { opens: 0.0, closes, steps }));
        let forms = scene.meshes.iter().filter_map(|mesh| Some(mesh.motion.as_ref()?.positions.len()));
        let placed = scene.instances.iter().filter_map(|instance| Some(instance.motion.as_ref()?.keys().len()));
        forms.chain(placed).collect::<Vec<_>>()
    };
    // On lines one step does; where they end within, more; else as many as are asked for, but for transforms on a line.
    assert_eq!(keys(0.2, 0.5, None), [2, 2]);
    assert!(keys(0.8, 0.33, None).iter().all(|n| (5..=65).contains(n)), "{:?}", keys(0.8, 0.33, None));
    assert_eq!(keys(0.2, 0.5, Some(7)), [8, 2]);
    assert_eq!(keys(0.8, 0.33, Some(7)), [8, 8]);
    assert_eq!(keys(1.0, 0.5, None), [0; 0]);
}

#[test]
fn what_is_asked_of_the_shutter_and_cannot_be_is_refused() {
    let path = &Folder::new().with("moving.glb", glb::moving());
    for (flags, words) in [
        ("--shutter -0.25,0.25", "needs a time"),
        ("--frame 2 --shutter 0.25,-0.25", "as in -0.25,0.25"),
        ("--frame 2 --shutter 0.25", "as in -0.25,0.25"),
        ("--frame 2 --shutter 0,1,2", "as in -0.25,0.25"),
        ("--frame 2 --shutter 0,nan", "as in -0.25,0.25"),
        ("--frame 2 --shutter 0,inf", "as in -0.25,0.25"),
        ("--frame 2 --motion-steps 4", "--shutter"),
        ("--frame 2 --shutter 0,1 --motion-steps 0", "1..=128"),
        ("--frame 2 --shutter 0,1 --motion-steps 129", "1..=128"),
        ("--frame 2 --shutter 0,1 --rays obvhs", "obvhs does not support motion blur"),
    ] {
        says(path, &format!("render moving.glb {flags} -o a.exr"), 64, words);
    }
    assert!(!path.join("a.exr").exists());
    let refused = build(Backend::Obvhs, moving_hall());
    assert!(matches!(refused, Err(Error::Usage(why)) if why.contains("obvhs")));
}

#[test]
fn blurred_pictures_have_the_same_bits_however_they_are_rendered() {
    let path = &Folder::new().with("moving.glb", glb::moving());
    let flags = "--fps 10 --shutter -2,2.5 --size 40x30 --sky --aov all";
    let line = |more: &str| format!("render moving.glb {flags} {more} -q");
    expect(path, &line("--frame 8 --spp 256 -o whole.exr"), 0);
    expect(path, &line("--frame 8 --spp 256 -o threads.exr --threads 3"), 0);
    assert_same_bits(&path.join("whole.exr"), &path.join("threads.exr"));
    assert_same_bits(&path.join("whole.exr"), &in_parts(path, &line("--frame 8 --spp 256"), 2));
    expect(path, &line("--frame 8 --spp 128 -o more.exr --checkpoint 100"), 0);
    expect(path, &line("--frame 8 --spp 256 -o more.exr --checkpoint 100 --resume"), 0);
    assert_same_bits(&path.join("whole.exr"), &path.join("more.exr"));
    // Another shutter is another picture, which is not gone on from.
    let other = line("--frame 8 --spp 256 -o more.exr --resume").replace("-2,2.5", "-2,2");
    says(path, &other, 65, "different scene");
    // Frames of sequences share what they can.
    expect(path, &line("--frames 7-10 --spp 8 -o frame.##.exr"), 0);
    for frame in 7..=10 {
        expect(path, &line(&format!("--frame {frame} --seed-per-frame --spp 8 -o single.exr")), 0);
        assert_same_bits(&path.join("single.exr"), &path.join(format!("frame.{frame:02}.exr")));
    }
    // In a batch.
    let file = "[[matrix]]\nscene = 'moving.glb'\nsize = '40x30'\nspp = 8\nframe = 8\nfps = 10\nsky = true\naov = 'all'\n\
                shutter = ['-2,2.5', '-1,1']\noutput = '{name}.exr'\n";
    fs::write(path.join("jobs.toml"), file).unwrap();
    expect(path, "batch jobs.toml -q", 0);
    expect(path, &line("--frame 8 --spp 8 -o single.exr"), 0);
    assert_same_bits(&path.join("single.exr"), &path.join("moving--2,2.5.exr"));
    assert_ne!(bits(&path.join("moving--1,1.exr")), bits(&path.join("single.exr")));
    // Two that look at the same moments, one for its shutter and one for velocities.
    let jobs = [("blur", "--shutter -1,1 --motion-steps 1"), ("speed", "--aov velocity")];
    let file = "[defaults]\nscene = 'moving.glb'\nsize = '40x30'\nspp = 8\nframe = 5\nfps = 10\nsky = true\n\
                [[job]]\nname = 'blur'\nshutter = '-1,1'\nmotion-steps = 1\n[[job]]\nname = 'speed'\naov = 'velocity'\n";
    fs::write(path.join("jobs.toml"), file).unwrap();
    expect(path, "batch jobs.toml -q", 0);
    for (name, flags) in jobs {
        let line = format!("render moving.glb --size 40x30 --spp 8 --frame 5 --fps 10 --sky {flags} -o single.exr -q");
        expect(path, &line, 0);
        assert_same_bits(&path.join("single.exr"), &path.join(format!("{name}.exr")));
    }
    // After all has come to rest, an open shutter changes nothing.
    expect(path, &line("--frame 13 --spp 8 -o open.exr"), 0);
    expect(path, &line("--frame 13 --spp 8 -o moment.exr").replace("--shutter -2,2.5", ""), 0);
    assert_same_bits(&path.join("open.exr"), &path.join("moment.exr"));
}

/// A channel's value in a pixel of a picture 80 wide.
fn value(channels: &[(String, Vec<u32>)], name: &str, [x, y]: [usize; 2]) -> f32 {
    let (_, bits) = channels.iter().find(|(own, _)| own == name).unwrap_or_else(|| panic!("no {name}"));
    f32::from_bits(bits[y * 80 + x])
}

#[test]
fn velocities_are_pixels_a_frame_as_nuke_and_blender_read_them() {
    let path = &Folder::new().with("moving.glb", glb::moving());
    let line = "render moving.glb --size 80x60 --spp 16 --filter box --sky --fps 10 -q";
    expect(path, &format!("{line} --camera b --frame 5 --aov velocity -o b.exr"), 0);
    let found = bits(&path.join("b.exr"));
    // The triangle in the middle goes by (1, 0.5, 0) m a second, 3.5 m before a camera of yfov 0.7.
    let tall = 30.0 / (3.5 * 0.35_f32.tan());
    let (u, v) = (0.1 * tall, 0.05 * tall);
    let at = |name: &str| value(&found, name, [40, 27]);
    for (name, expected) in [
        ("forward.u", u),
        ("forward.v", v),
        ("backward.u", -u),
        ("backward.v", -v),
        ("Vector.X", -u),
        ("Vector.Y", -v),
        ("Vector.Z", -u),
        ("Vector.W", -v),
    ] {
        assert!((at(name) - expected).abs() < 1e-3, "{name}: {} for {expected}", at(name));
    }
    // What stands still before a camera that does, and where nothing is.
    assert_eq!([[16, 55], [1, 1]].map(|pixel| value(&found, "forward.u", pixel)), [0.0; 2]);
    // The form that changes moves as its corners do: its right one goes by (0.5, 0.5, 0) m a second.
    let near = |name: &str| (0..80 * 60).map(|i| value(&found, name, [i % 80, i / 80])).fold(0.0, f32::max);
    assert!(near("forward.v") > v, "the form that changes is as fast as what is placed");
    // Nothing else is another for it, and a camera that moves sees all of it move.
    expect(path, &format!("{line} --camera b --frame 5 --aov none -o none.exr"), 0);
    for channel in ["R", "G", "B", "A"] {
        let of = |all: &[(String, Vec<u32>)]| all.iter().find(|(name, _)| name == channel).unwrap().1.clone();
        assert_eq!(of(&found), of(&bits(&path.join("none.exr"))), "{channel}");
    }
    expect(path, &format!("{line} --camera a --frame 5 --aov velocity -o a.exr"), 0);
    assert!(value(&bits(&path.join("a.exr")), "forward.u", [40, 50]) < -0.1);
    // With an open shutter and without one they are the same, but for edges; and without a moment there are none.
    expect(path, &format!("{line} --camera b --frame 5 --aov velocity --shutter -0.1,0.1 -o open.exr"), 0);
    assert!((value(&bits(&path.join("open.exr")), "forward.u", [40, 27]) - u).abs() < 1e-3);
    says(path, &format!("{line} --aov velocity -o no.exr"), 64, "--aov velocity needs a time");
    expect(path, &format!("{line} --aov all -o still.exr"), 0);
    assert!(!bits(&path.join("still.exr")).iter().any(|(name, _)| name.starts_with("forward")));
    // A frame goes on to what it would have been at once.
    let flags = "--camera b --frame 5 --aov velocity,depth --checkpoint 100";
    let line = line.replace("--spp 16", "");
    expect(path, &format!("{line} --spp 256 {flags} -o whole.exr"), 0);
    expect(path, &format!("{line} --spp 128 {flags} -o more.exr"), 0);
    expect(path, &format!("{line} --spp 256 {flags} -o more.exr --resume"), 0);
    assert_same_bits(&path.join("whole.exr"), &path.join("more.exr"));
}

#[test]
fn a_quarter_turn_is_a_quarter_turn_in_any_number_of_steps() {
    let at = |angle: f64| DAffine3::from_quat(DQuat::from_rotation_y(angle));
    for steps in [1, 2, 3, 26, 100] {
        let moments: Vec<_> = (0..=steps).map(|i| at(FRAC_PI_2 * f64::from(i) / f64::from(steps))).collect();
        let motion = Motion::new(&moments).unwrap();
        for i in 0..=50 {
            let time = i as f32 / 50.0;
            let expected = at(FRAC_PI_2 * f64::from(time)).as_affine3a();
            assert!(motion.at(time).abs_diff_eq(expected, 2e-6), "{steps} steps at {time}");
        }
    }
}
