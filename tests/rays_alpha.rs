//! Surfaces with alpha: both backends let the same rays through.

use std::sync::Arc;

use bismar::rays::{self, Backend, HitBatch, MISS, RayBatch, RayOrder};
use bismar::scene::{AlphaMode, Instance, Material, Mesh, Object, Scene};
use glam::{Affine3A, Vec4, vec3};

use crate::helpers::random::Random;

const RAYS: usize = 100_000;

/// A square with an alpha at z = 0, once in world space around x = 0 and once as an instance around x = 10, each over
/// an opaque one at z = -1.
fn squares(alpha: f32, alpha_mode: AlphaMode) -> Arc<Scene> {
    let square = |z: f32, material: u32| {
        let corners = [[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]];
        let mut mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
        mesh.material = material;
        mesh
    };
    let aside = Affine3A::from_translation(vec3(10.0, 0.0, 0.0));
    let instance = |transform| Instance { name: "node".into(), object: 0, transform, ..Default::default() };
    Arc::new(Scene {
        meshes: vec![square(-1.0, 0).into(), square(0.0, 1).into()],
        objects: vec![Object { name: "squares".into(), meshes: 0..2 }],
        instances: vec![instance(None), instance(Some(aside))],
        materials: vec![
            Material { base_color: Vec4::new(1.0, 1.0, 1.0, alpha), ..Material::default() },
            Material { base_color: Vec4::new(1.0, 1.0, 1.0, alpha), alpha_mode, ..Material::default() },
        ],
        ..Scene::default()
    })
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
            let mut hits = HitBatch::default();
            backend.closest_hits(&rays, RayOrder::Incoherent, &mut hits);
            assert!(hits.mesh.iter().all(|&mesh| mesh != MISS), "the opaque square stops what the upper one does not");
            let stopped: Vec<bool> = hits.mesh.iter().map(|&mesh| mesh == 1).collect();
            // With the interval ending between the squares.
            rays.tfar.fill(1.5);
            let mut occluded = Vec::new();
            backend.occluded(&rays, RayOrder::Incoherent, &mut occluded);
            assert_eq!(occluded, stopped, "{:?}", backend.info());
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
