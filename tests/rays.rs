//! Properties of both ray query backends.

use std::f32::consts::FRAC_PI_3;
use std::hint::black_box;
use std::sync::{Arc, Mutex};

use bismar::Error;
use bismar::rays::cwbvh::{ObvhsOptions, ObvhsRays, Preset, TreeKind, TriangleTest};
use bismar::rays::embree::{EmbreeOptions, EmbreeRays, Packets, Quality};
use bismar::rays::{self, AnyHit, Backend, HitBatch, MISS, RayBatch, RayOrder, RayQueries};
use bismar::scene::{AlphaMode, Instance, Material, Mesh, Object, Primitive, Scene};
use glam::{Affine3A, Quat, Vec3, Vec4, vec3};

mod reference;
use reference::Reference;

use crate::helpers::random::Random;
use crate::helpers::ray_scenes::{bounce, box_room, camera_rays, pieces, scene};

/// obvhs, and Embree with the native, the AVX2 and the SSE2 instruction set (emulated packets).
fn backends(scene: &Arc<Scene>) -> Vec<Box<dyn RayQueries>> {
    let mut all = vec![obvhs(scene, &ObvhsOptions::default())];
    for isa in [None, Some("avx2"), Some("sse2")] {
        all.push(embree(scene, &EmbreeOptions { isa, ..EmbreeOptions::default() }));
    }
    all
}

fn embree(scene: &Arc<Scene>, options: &EmbreeOptions) -> Box<dyn RayQueries> {
    Box::new(EmbreeRays::build(scene.clone(), options, &|_| true).unwrap())
}

fn obvhs(scene: &Arc<Scene>, options: &ObvhsOptions) -> Box<dyn RayQueries> {
    Box::new(ObvhsRays::build(scene.clone(), options, &|_| true).unwrap())
}

/// Options that only the ray study uses.
fn other_choices(scene: &Arc<Scene>) -> Vec<Box<dyn RayQueries>> {
    let mut all = Vec::new();
    for quality in [Quality::Low, Quality::TwoLevel, Quality::Medium, Quality::High] {
        for packets in [Packets::Single, Packets::Four, Packets::Eight, Packets::Sixteen] {
            let compact = matches!(packets, Packets::Four | Packets::Eight);
            let robust = matches!(packets, Packets::Single | Packets::Four);
            all.push(embree(scene, &EmbreeOptions { quality, packets, compact, robust, ..Default::default() }));
        }
    }
    for preset in Preset::ALL {
        for (tree, test) in [(TreeKind::Binary, TriangleTest::Embree), (TreeKind::EightWide, TriangleTest::Obvhs)] {
            let split = Some(preset == Preset::Fast);
            all.push(obvhs(scene, &ObvhsOptions { tree, preset, split, test }));
            all.push(obvhs(scene, &ObvhsOptions { tree, preset, ..Default::default() }));
        }
    }
    all
}

fn closest(rays: &dyn RayQueries, batch: &RayBatch, order: RayOrder) -> HitBatch {
    // Start with entries, which must be overwritten.
    let mut hits = HitBatch::default();
    rays.closest_hits(&ray(vec3(0.1, 0.2, 5.0), -Vec3::Z), order, &mut hits);
    rays.closest_hits(batch, order, &mut hits);
    hits
}

fn occluded(rays: &dyn RayQueries, batch: &RayBatch, order: RayOrder) -> Vec<bool> {
    let mut occluded = vec![true; 3];
    rays.occluded(batch, order, &mut occluded);
    occluded
}

fn ray(origin: Vec3, direction: Vec3) -> RayBatch {
    let mut batch = RayBatch::default();
    batch.push(origin, direction, 0.0, f32::INFINITY, 0);
    batch
}

/// Triangles of all sizes in [-1, 1]³.
fn soup(count: u32, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut vertices = Vec::new();
    for _ in 0..count {
        let (centre, size) = (random.point(), random.f32() * 0.5);
        vertices.extend([(); 3].map(|()| (centre + random.point() * size).to_array()));
    }
    Mesh::new(vertices, (0..count).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect())
}

/// Triangle soups in world space, and others rotated, scaled, mirrored, and instanced several times.
fn soups() -> Arc<Scene> {
    let turn = Quat::from_axis_angle(vec3(1.0, 2.0, 3.0).normalize(), FRAC_PI_3);
    let stretched = Affine3A::from_scale_rotation_translation(vec3(0.5, 2.0, 1.0), turn, vec3(0.3, -0.2, 0.1));
    let mirrored = Affine3A::from_scale_rotation_translation(vec3(-1.5, 0.7, 1.0), turn, vec3(-2.0, 0.5, -1.0));
    let meshes = vec![soup(60, 1), soup(40, 2), Mesh::new(vec![], vec![]), soup(30, 3), soup(20, 4)];
    let mut scene = scene(meshes, &[(0, None), (1, Some(stretched)), (2, None), (1, Some(mirrored))]);
    // An object of three meshes, the first without triangles; one object placed both with and without a transform.
    scene.objects.push(Object { name: "three".into(), meshes: 2..5 });
    for (object, transform) in [(5, Some(mirrored)), (3, None), (3, Some(stretched)), (2, Some(stretched))] {
        scene.instances.push(Instance { name: "node".into(), object, transform, ..Default::default() });
    }
    Arc::new(scene)
}

/// Rays toward the centre, some with short intervals, some along axes with zeros of both signs.
fn rays_at_soup(len: usize, seed: u64) -> RayBatch {
    let mut random = Random(seed);
    let mut batch = RayBatch::default();
    for at in 0..len {
        let origin = random.point() * 3.0;
        let mut direction = (random.point() - origin).normalize();
        if at % 7 == 0 {
            direction = [vec3(-0.0, 0.0, 1.0), vec3(0.0, -1.0, -0.0), vec3(1.0, -0.0, -0.0)][at / 7 % 3];
        }
        let (tnear, tfar) = match at % 3 {
            0 => (0.0, f32::INFINITY),
            1 => (random.f32() * 3.0, f32::INFINITY),
            _ => (random.f32(), 1.0 + random.f32() * 3.0),
        };
        batch.push(origin, direction, tnear, tfar, random.bits());
    }
    batch
}

/// Relative error of Embree's reciprocal (an approximation and one Newton step): two units in the last place.
const RECIPROCAL: f32 = 2.0 * f32::EPSILON;

const LENGTHS: [usize; 9] = [0, 1, 7, 8, 9, 15, 16, 17, 1000];

#[test]
fn all_hits_are_the_closest_ones_one_after_the_other_and_all_that_coincide() {
    let mut scene = Arc::unwrap_or_clone(soups());
    // Backends list all hits in scenes with bodies.
    let body = Material { metallic: 0.0, transmission: 1.0, bounds_medium: true, ..Material::default() };
    scene.materials.push(body);
    // One object twice in one place.
    let twice = scene.instances.last().unwrap().clone();
    scene.instances.push(twice);
    let twice = scene.instances.len() as u32 - 2;
    let scene = Arc::new(scene);
    for backend in backends(&scene).into_iter().chain(other_choices(&scene)) {
        let rays = rays_at_soup(1000, 7);
        let mut found = vec![AnyHit { ray: 9, t: 0.0, primitive: Primitive { instance: 0, mesh: 0, prim: 0 } }];
        backend.all_hits(&rays, &mut found);
        let (mut several, mut differing) = (0, 0);
        for ray in 0..rays.len() {
            let key = |of: Primitive| (of.instance.min(twice), of.mesh, of.prim);
            let all: Vec<_> = found.iter().filter(|hit| hit.ray == ray as u32).collect();
            let mut known: Vec<_> = all.iter().map(|hit| key(hit.primitive)).collect();
            let mut one = RayBatch::default();
            one.push(rays.origin(ray), rays.direction(ray), rays.tnear[ray], rays.tfar[ray], 0);
            let mut followed = Vec::new();
            loop {
                let hits = closest(&*backend, &one, RayOrder::Incoherent);
                if hits.mesh[0] == MISS {
                    break;
                }
                followed.push(key(hits.primitive(0)));
                one.tnear[0] = hits.t[0] * (1.0 + 1e-6);
            }
            let both = |at: u32| all.iter().any(|hit| hit.primitive.instance == twice + at);
            assert_eq!(both(0), both(1));
            known.sort_unstable();
            known.dedup();
            followed.sort_unstable();
            followed.dedup();
            several += usize::from(known.len() > 2);
            differing += usize::from(known != followed);
        }
        // Some are within rounding of an edge or of each other.
        assert!(several > 20 && differing <= 3, "{several} {differing}");
    }
}

#[test]
fn closest_hits_are_those_of_brute_force_in_double_precision() {
    let scene = soups();
    let reference = Reference::new(&scene, true);
    for backend in backends(&scene).into_iter().chain(other_choices(&scene)) {
        for len in LENGTHS {
            let rays = rays_at_soup(len, len as u64);
            let hits = closest(&*backend, &rays, RayOrder::Incoherent);
            let unique = reference.check(&rays, &hits);
            let hit = hits.prim.iter().filter(|&&prim| prim != MISS).count();
            if len == 1000 {
                // The test is not vacuous: many rays hit, and few are within rounding of an edge.
                assert!(hit > 300 && hit < 700, "{hit}");
                assert!(unique > 990, "{unique}");
            }
        }
    }
}

#[test]
fn closest_front_hits_are_those_of_brute_force_without_backs() {
    let mut scene = Arc::unwrap_or_clone(soups());
    scene.materials.push(Material { double_sided: true, ..Material::default() });
    Arc::make_mut(&mut scene.meshes[0]).material = 1;
    let scene = Arc::new(scene);
    let reference = Reference::new(&scene, false);
    for backend in backends(&scene).into_iter().chain(other_choices(&scene)) {
        for len in LENGTHS {
            let rays = rays_at_soup(len, len as u64);
            let mut hits = closest(&*backend, &rays, RayOrder::Incoherent);
            let all = hits.prim.clone();
            backend.closest_front_hits(&rays, &mut hits);
            let unique = reference.check(&rays, &hits);
            if len == 1000 {
                let passed = all.iter().zip(&hits.prim).filter(|(all, fronts)| all != fronts).count();
                assert!(passed > 100 && passed < 300 && unique > 990, "{passed} {unique}");
            }
        }
    }
}

#[test]
fn occluded_says_whether_there_is_a_hit() {
    let scene = soups();
    for backend in backends(&scene) {
        for len in LENGTHS {
            for order in [RayOrder::Coherent, RayOrder::Incoherent] {
                let rays = rays_at_soup(len, 100 + len as u64);
                let hits = closest(&*backend, &rays, order);
                let hit: Vec<bool> = hits.prim.iter().map(|&prim| prim != MISS).collect();
                assert_eq!(occluded(&*backend, &rays, order), hit, "{:?}", backend.info());
            }
        }
    }
}

#[test]
fn hits_are_the_same_in_every_grouping_and_order_but_for_which_of_coincident_surfaces_is_hit() {
    let bits = |distances: &[f32]| distances.iter().map(|t| t.to_bits()).collect::<Vec<_>>();
    // Two equal instances in one place: every hit is a tie.
    let room = box_room().meshes.remove(0);
    let here = Some(Affine3A::IDENTITY);
    let twice = scene(vec![(*room).clone(), (*room).clone()], &[(0, here), (0, here), (1, None), (0, None)]);
    for scene in [Arc::new(twice), soups()] {
        for backend in backends(&scene) {
            let camera = camera_rays(64);
            let first = closest(&*backend, &camera, RayOrder::Incoherent);
            let bounced = bounce(&scene, &camera, &first);
            for rays in [&camera, &bounced] {
                let whole = closest(&*backend, rays, RayOrder::Incoherent);
                let shadows = occluded(&*backend, rays, RayOrder::Incoherent);
                for (len, order) in [(1, RayOrder::Coherent), (7, RayOrder::Incoherent), (1000, RayOrder::Coherent)] {
                    let (mut distances, mut concatenated_shadows) = (Vec::new(), Vec::new());
                    for piece in pieces(rays, len) {
                        distances.extend(closest(&*backend, &piece, order).t);
                        concatenated_shadows.extend(occluded(&*backend, &piece, order));
                    }
                    let what = format!("pieces of {len}, {order:?}, {:?}", backend.info());
                    assert_eq!(bits(&whole.t), bits(&distances), "{what}");
                    assert_eq!(shadows, concatenated_shadows, "{what}");
                }
            }
        }
    }
}

#[test]
fn scenes_without_triangles_are_missed() {
    let empty = Mesh::new(vec![], vec![]);
    let placed = [(0, None), (0, Some(Affine3A::IDENTITY))];
    let unplaced = scene(vec![soup(10, 1)], &[]);
    for scene in [Scene::default(), scene(vec![empty], &placed), unplaced] {
        for backend in backends(&Arc::new(scene)) {
            let rays = rays_at_soup(20, 1);
            assert_eq!(closest(&*backend, &rays, RayOrder::Coherent).prim, [MISS; 20]);
            assert_eq!(occluded(&*backend, &rays, RayOrder::Coherent), [false; 20]);
        }
    }
}

#[test]
fn hits_very_close_to_the_origin_count() {
    let triangle = Mesh::new(vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    for backend in backends(&Arc::new(scene(vec![triangle], &[(0, None)]))) {
        for height in [1e-3, 1e-5, 1e-7] {
            let hits = closest(&*backend, &ray(vec3(0.0, 0.0, height), -Vec3::Z), RayOrder::Coherent);
            let error = (hits.t[0] / height - 1.0).abs();
            assert!(error <= RECIPROCAL, "{:?}: {}", backend.info(), hits.t[0]);
        }
    }
}

#[test]
fn weights_are_of_the_second_and_third_vertex() {
    let triangle = Mesh::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    for backend in backends(&Arc::new(scene(vec![triangle], &[(0, None)]))) {
        let hits = closest(&*backend, &ray(vec3(0.5, 0.25, 1.0), -Vec3::Z), RayOrder::Coherent);
        for (value, exact) in [(hits.u[0], 0.5), (hits.v[0], 0.25), (hits.t[0], 1.0)] {
            assert!((value / exact - 1.0).abs() <= RECIPROCAL, "{:?}: {value} is not {exact}", backend.info());
        }
    }
}

#[test]
fn malformed_scenes_are_rejected_with_the_element() {
    let good = || scene(vec![soup(3, 1)], &[(0, Some(Affine3A::IDENTITY))]);
    let rejected = |change: fn(&mut Scene), part: &str| {
        let mut scene = good();
        change(&mut scene);
        let scene = Arc::new(scene);
        for backend in [Backend::Embree, Backend::Obvhs] {
            let refused = rays::build(backend, scene.clone()).err();
            assert!(matches!(&refused, Some(Error::Data(text)) if text.contains(part)), "{part}: {refused:?}");
        }
    };
    rejected(|scene| Arc::make_mut(&mut scene.meshes[0]).indices[2][1] = 9, "triangle 2");
    rejected(|scene| Arc::make_mut(&mut scene.meshes[0]).indices[0][0] = u32::MAX, "triangle 0");
    rejected(|scene| Arc::make_mut(&mut scene.meshes[0]).positions.as_mut_slice()[4][1] = f32::NAN, "vertex 4");
    rejected(
        |scene| Arc::make_mut(&mut scene.meshes[0]).positions.as_mut_slice()[5][0] = f32::NEG_INFINITY,
        "vertex 5",
    );
    rejected(|scene| Arc::make_mut(&mut scene.meshes[0]).positions.as_mut_slice()[6][2] = 3e18, "vertex 6");
    rejected(|scene| scene.objects[0].meshes = 0..2, "object 0");
    rejected(|scene| scene.instances[0].object = 1, "instance 0");
    rejected(|scene| scene.instances[0].transform = Some(Affine3A::from_scale(vec3(1.0, 0.0, 1.0))), "inverted");
    rays::build(Backend::Embree, Arc::new(good())).unwrap();
}

#[test]
fn a_build_is_followed_and_can_be_stopped() {
    let placed = |x: f32| Some(Affine3A::from_translation(Vec3::X * x));
    let meshes = || vec![soup(50_000, 1), soup(30_000, 2), soup(20_000, 3)];
    let scene = Arc::new(scene(meshes(), &[(0, None), (1, placed(3.0)), (1, placed(6.0)), (2, placed(9.0))]));
    for backend in [Backend::Embree, Backend::Obvhs] {
        let seen = Mutex::new(Vec::new());
        let build = |stop_at: f64| {
            let watch = |done: f64| {
                seen.lock().unwrap().push(done);
                done < stop_at
            };
            rays::build_watched(backend, scene.clone(), &watch)
        };
        build(f64::INFINITY).unwrap();
        let all = std::mem::take(&mut *seen.lock().unwrap());
        assert!(all.iter().all(|done| (0.0..=1.0).contains(done)), "{all:?}");
        // Both backends report progress in each of these ranges.
        for (low, high) in [(0.0, 0.31), (0.3, 0.81), (0.5, 1.0)] {
            let reported = all.iter().any(|done| (low..=high).contains(done));
            assert!(reported, "{backend:?}: nothing in {low}..{high}: {all:?}");
        }
        for stop_at in [0.0, 0.4] {
            let stopped = build(stop_at).err();
            assert!(matches!(&stopped, Some(Error::Interrupted(text)) if text.contains("building")), "{stopped:?}");
        }
    }
}

#[test]
fn queries_leave_the_threads_floating_point_mode_alone() {
    let denormal_survives = || black_box(f32::from_bits(1)) * black_box(1.0) != 0.0;
    let scene = soups();
    let backend = EmbreeRays::build(scene, &EmbreeOptions::default(), &|_| true).unwrap();
    std::thread::spawn(move || {
        assert!(denormal_survives());
        closest(&backend, &rays_at_soup(20, 1), RayOrder::Coherent);
        assert!(denormal_survives());
    })
    .join()
    .unwrap();
}

#[test]
fn backends_describe_themselves() {
    for backend in backends(&Arc::new(box_room())) {
        let info = backend.info();
        assert!(info.memory_bytes > 36 * 16, "{info:?}");
        assert!(info.build_seconds > 0.0 && !info.isa.is_empty(), "{info:?}");
        assert!(info.version.split('.').all(|part| part.parse::<u32>().is_ok()), "{info:?}");
    }
}

const RAYS: usize = 100_000;

/// A square with an alpha at z = 0, once in world space around x = 0 and once as an instance around x = 10, each over
/// an opaque one at z = -1.
fn squares(alpha: f32, alpha_mode: AlphaMode) -> Arc<Scene> {
    let square = |z: f32, material: u32| {
        let corners = vec![[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]];
        Mesh { material, ..Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]) }
    };
    let aside = Affine3A::from_translation(vec3(10.0, 0.0, 0.0));
    let mut squares = scene(vec![square(-1.0, 0), square(0.0, 1)], &[(0, None), (0, Some(aside))]);
    squares.objects[0].meshes = 0..2;
    let opaque = Material { base_color: Vec4::new(1.0, 1.0, 1.0, alpha), ..Material::default() };
    squares.materials = vec![opaque.clone(), Material { alpha_mode, ..opaque }];
    Arc::new(squares)
}

/// Rays down on the squares around `x`.
fn rays_down(x: f32) -> RayBatch {
    let mut random = Random(x as u64);
    let mut batch = RayBatch::default();
    for _ in 0..RAYS {
        let origin = random.point() * vec3(0.9, 0.9, 0.0) + vec3(x, 0.0, 1.0);
        batch.push(origin, vec3(0.0, 0.0, -1.0), 0.0, f32::INFINITY, random.bits());
    }
    batch
}

/// Of each backend, and of both places: which rays the upper square stops.
fn stopped(scene: &Arc<Scene>) -> Vec<Vec<bool>> {
    let mut all = Vec::new();
    for backend in [Backend::Embree, Backend::Obvhs] {
        let backend = rays::build(backend, scene.clone()).unwrap();
        for x in [0.0, 10.0] {
            let mut rays = rays_down(x);
            let hits = closest(&*backend, &rays, RayOrder::Incoherent);
            assert!(hits.mesh.iter().all(|&mesh| mesh != MISS), "the opaque square stops what the upper one does not");
            let stopped: Vec<bool> = hits.mesh.iter().map(|&mesh| mesh == 1).collect();
            // With the interval ending between the squares.
            rays.tfar.fill(1.5);
            assert_eq!(occluded(&*backend, &rays, RayOrder::Incoherent), stopped, "{:?}", backend.info());
            all.push(stopped);
        }
    }
    assert_eq!(all[0], all[2], "both backends let the same rays through in world space");
    assert_eq!(all[1], all[3], "both backends let the same rays through an instance");
    all
}

/// Five standard deviations: fewer than one false alarm in 1.7 million such tests.
#[test]
fn surfaces_are_there_as_often_as_their_alpha_and_its_mode_say() {
    for (alpha, mode, share) in [
        (0.0, AlphaMode::Opaque, 1.0_f32),
        (0.49, AlphaMode::Mask(0.5), 0.0),
        (0.5, AlphaMode::Mask(0.5), 1.0),
        (0.0, AlphaMode::Blend, 0.0),
        (0.3, AlphaMode::Blend, 0.3),
        (1.0, AlphaMode::Blend, 1.0),
    ] {
        for stopped in stopped(&squares(alpha, mode)) {
            let (n, p) = (RAYS as f64, f64::from(share));
            let deviation = (n * p * (1.0 - p)).sqrt();
            let surplus = stopped.iter().filter(|&&stopped| stopped).count() as f64 - n * p;
            // Half a ray for the rounding of n p; where all or none are stopped, that is the exact number.
            assert!(surplus.abs() <= 5.0 * deviation + 0.5, "{surplus} of {n} rays at alpha {alpha}, {mode:?}");
        }
    }
}
