//! Scenes and ray streams that the ray tests share.

use bismar::rays::{HitBatch, RayBatch};
use bismar::scene::{Instance, Material, Mesh, Object, Scene, build};
use glam::{Affine3A, DQuat, DVec3, Vec3, vec3};

use super::random::Random;

/// Every mesh is an object of its own; `placements` name object and transform.
pub fn scene(meshes: Vec<Mesh>, placements: &[(u32, Option<Affine3A>)]) -> Scene {
    let object = |index: u32| Object { name: format!("object {index}"), meshes: index..index + 1 };
    let instance = |&(object, transform): &(u32, Option<Affine3A>)| Instance {
        name: "node".into(),
        object,
        transform,
        ..Default::default()
    };
    Scene {
        objects: (0..meshes.len() as u32).map(object).collect(),
        instances: placements.iter().map(instance).collect(),
        materials: vec![Material::default()],
        meshes: meshes.into_iter().map(Into::into).collect(),
        ..Scene::default()
    }
}

/// A box room without a front, two boxes and an area light: 36 triangles in [-1, 1]³.
pub fn box_room() -> Scene {
    let mut room = build::cuboid(DVec3::NEG_ONE, DVec3::ONE);
    // The front is a cuboid's last face.
    room.positions.truncate(20);
    room.triangles.truncate(10);
    for (centre, half, angle) in [
        (DVec3::new(-0.35, -0.4, -0.3), DVec3::new(0.3, 0.6, 0.3), 0.3),
        (DVec3::new(0.35, -0.7, 0.3), DVec3::splat(0.3), -0.3),
    ] {
        let turned = build::cuboid(-half, half).rotated(DQuat::from_rotation_y(angle));
        room = room.and(&turned.translated(centre));
    }
    let area_light = [(-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)].map(|(x, z)| DVec3::new(x, 0.99, z));
    room = room.and(&build::quad(area_light));
    let positions = room.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    scene(vec![Mesh::new(positions, room.triangles)], &[(0, None)])
}

/// Camera rays from +z in 8x8 blocks, `size`² of them.
pub fn camera_rays(size: u32) -> RayBatch {
    let mut rays = RayBatch::default();
    let mut random = Random(1);
    for block in 0..(size / 8).pow(2) {
        for pixel in 0..64 {
            let x = (block % (size / 8) * 8 + pixel % 8) as f32 + random.f32();
            let y = (block / (size / 8) * 8 + pixel / 8) as f32 + random.f32();
            let direction = vec3(x / size as f32 - 0.5, y / size as f32 - 0.5, -1.2).normalize();
            rays.push(vec3(0.0, 0.2, 3.2), direction, 0.0, f32::INFINITY, random.bits());
        }
    }
    rays
}

/// One diffuse bounce of the hits of `rays`.
pub fn bounce(scene: &Scene, rays: &RayBatch, hits: &HitBatch) -> RayBatch {
    let mut random = Random(2);
    let mut bounced = RayBatch::default();
    for at in 0..rays.len() {
        if hits.t[at].is_infinite() {
            continue;
        }
        let mesh = &scene.meshes[hits.mesh[at] as usize];
        let [a, b, c] = mesh.indices[hits.prim[at] as usize].map(|v| Vec3::from(mesh.positions[v as usize]));
        let direction: Vec3 = std::array::from_fn(|axis| rays.direction[axis][at]).into();
        let normal = (b - a).cross(c - a).normalize();
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        let place = a + (b - a) * hits.u[at] + (c - a) * hits.v[at];
        let outward = (normal + random.direction() * 0.999).normalize();
        bounced.push(place + normal * 1e-4, outward, 0.0, f32::INFINITY, random.bits());
    }
    bounced
}

/// The batch in pieces of `len` rays.
pub fn pieces(rays: &RayBatch, len: usize) -> Vec<RayBatch> {
    (0..rays.len())
        .step_by(len)
        .map(|start| {
            let range = start..(start + len).min(rays.len());
            RayBatch {
                origin: std::array::from_fn(|axis| rays.origin[axis][range.clone()].to_vec()),
                direction: std::array::from_fn(|axis| rays.direction[axis][range.clone()].to_vec()),
                tnear: rays.tnear[range.clone()].to_vec(),
                tfar: rays.tfar[range.clone()].to_vec(),
                time: rays.time.get(range.clone()).map(<[f32]>::to_vec).unwrap_or_default(),
                key: rays.key[range].to_vec(),
            }
        })
        .collect()
}
