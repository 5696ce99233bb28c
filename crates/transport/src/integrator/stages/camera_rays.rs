//! The first stage: camera rays.

use glam::Vec3;

use crate::integrator::data::dimensions;
use crate::integrator::data::history::RayHistory;
use crate::integrator::data::queues::{PathIds, PathRays};
use crate::integrator::data::task::PixelTask;
use crate::integrator::data::transport::Transport;
use crate::lanes::{F, LANES, NUMBERS, Rows, U, V3, store};
use crate::sampling::{keys, pixel_seed, samples};

/// Fills `rays` with the camera rays of all pixels, in the order of the path states.
#[inline(never)]
pub fn begin(transport: &Transport, tasks: &[PixelTask], rays: &mut PathRays) {
    let moves = transport.geometry.moves;
    rays.open(tasks.iter().map(|task| task.counts.paths as usize).sum(), moves, 0);
    for task in tasks {
        let paths = task.counts.paths;
        let seed = U::splat(pixel_seed(task.x, task.y, transport.seed));
        for i in (0..paths).step_by(LANES) {
            let n = LANES.min((paths - i) as usize);
            let index = U::splat(task.first_path + i) + U::from(NUMBERS);
            let path = U::splat(rays.len as u32) + U::from(NUMBERS);
            let (ray, time) = camera_ray(transport, [task.x, task.y], seed, index);
            let path_ids = PathIds { path, index, seed, time, root: U::ZERO, history: U::splat(RayHistory::CAMERA.0) };
            rays.push(n, ray, keys(seed, index, dimensions::CAMERA), V3::splat(Vec3::ONE), V3::ZERO, F::ZERO, path_ids);
            clip(transport, rays, n);
        }
    }
    rays.close();
}

/// Ends the last `n` of the rays, which are camera rays, at the clipping planes.
#[inline(always)]
pub fn clip(transport: &Transport, rays: &mut PathRays, n: usize) {
    let at = Rows::From(rays.len - n);
    let (near, far) = transport.camera.intervals(rays.rays.directions(&at), rays.rays.times(&at));
    store(&mut rays.rays.tnear, rays.len - n, near);
    store(&mut rays.rays.tfar, rays.len - n, far);
}

/// Eight camera rays of the pixel at column `x` and row `y`, by these points of its sequence: origins and unit directions, and
/// times in [0, 1] of the shutter interval.
#[inline(always)]
pub fn camera_ray(transport: &Transport, [x, y]: [u32; 2], seed: U, index: U) -> ((V3, V3), F) {
    let [px, py, u, v] = samples(seed, index, dimensions::CAMERA);
    let x = transport.filter.offsets(px) + F::splat(x as f32 + 0.5);
    let y = transport.filter.offsets(py) + F::splat(y as f32 + 0.5);
    let time = if transport.geometry.moves { samples(seed, index, dimensions::TIME)[0] } else { F::ZERO };
    (transport.camera.rays_through((x, y), (u, v), time), time)
}
