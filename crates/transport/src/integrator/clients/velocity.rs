//! Motion vectors: screen-space displacement between adjacent frames.

use glam::{Affine3A, Vec2, Vec3};

use crate::integrator::data::transport::Transport;
use crate::scene::Primitive;

/// Displacement of a surface point in pixels to the right and up: from the previous frame to this one, and from this one to
/// the next. The point has the barycentric weights (`u`, `v`) on triangle `prim`. Zero where it is behind the camera.
pub fn velocity(transport: &Transport, Primitive { instance, mesh, prim }: Primitive, (u, v): (f32, f32)) -> [Vec2; 2] {
    let scene = transport.scene;
    let (mesh, instance) = (&scene.meshes[mesh as usize], &scene.instances[instance as usize]);
    let camera = &transport.camera;
    if mesh.adjacent_frames.is_none() && instance.adjacent_frames.is_none() && camera.adjacent_frames.is_none() {
        return [Vec2::ZERO; 2];
    }
    let vertices = mesh.indices[prim as usize].map(|i| i as usize);
    let world_position = |positions: &[[f32; 3]], to_world: Option<Affine3A>| {
        let [a, b, c] = vertices.map(|i| Vec3::from(positions[i]));
        let p = a + (b - a) * u + (c - a) * v;
        to_world.map_or(p, |t| t.transform_point3(p))
    };
    let Some(now) = camera.project(None, world_position(&mesh.positions, instance.transform)) else {
        return [Vec2::ZERO; 2];
    };
    let displacement = |which: usize| {
        let positions = mesh.adjacent_frames.as_ref().map_or(&mesh.positions[..], |frames| &frames[which]);
        let to_world = instance.adjacent_frames.map(|frames| frames[which]).or(instance.transform);
        let then =
            camera.project(camera.adjacent_frames.map(|frames| frames[which]), world_position(positions, to_world));
        then.map_or(Vec2::ZERO, |then| camera.displacement(now, then))
    };
    [-displacement(0), displacement(1)]
}
