//! How far what is seen has come in the picture since the frame before, and how far it is from there to the next one.

use glam::{Affine3A, Vec2, Vec3};

use super::Transport;

/// Pixels to the right and up, from the frame before to the picture's own moment and from there to the next one, of the
/// point with barycentric weights (`u`, `v`) of triangle `prim`. Zero where it or the camera is behind the other.
pub fn velocity(transport: &Transport, (instance, mesh, prim): (u32, u32, u32), (u, v): (f32, f32)) -> [Vec2; 2] {
    let scene = transport.scene;
    let (mesh, instance) = (&scene.meshes[mesh as usize], &scene.instances[instance as usize]);
    let camera = &transport.camera;
    if mesh.adjacent_frames.is_none() && instance.adjacent_frames.is_none() && camera.adjacent_frames.is_none() {
        return [Vec2::ZERO; 2];
    }
    let vertices = mesh.indices[prim as usize].map(|i| i as usize);
    let place = |positions: &[[f32; 3]], to_world: Option<Affine3A>| {
        let [a, b, c] = vertices.map(|i| Vec3::from(positions[i]));
        let p = a + (b - a) * u + (c - a) * v;
        to_world.map_or(p, |t| t.transform_point3(p))
    };
    let Some(now) = camera.place(None, place(&mesh.positions, instance.transform)) else { return [Vec2::ZERO; 2] };
    let of = |which: usize| {
        let positions =
            mesh.adjacent_frames.as_ref().map_or(&mesh.positions[..], |adjacent_frames| &adjacent_frames[which]);
        let to_world = instance.adjacent_frames.map(|adjacent_frames| adjacent_frames[which]).or(instance.transform);
        let then = camera
            .place(camera.adjacent_frames.map(|adjacent_frames| adjacent_frames[which]), place(positions, to_world));
        then.map_or(Vec2::ZERO, |then| then - now)
    };
    [-of(0), of(1)]
}
