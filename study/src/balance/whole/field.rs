//! Pictures of a guiding field: per pixel, the share of samples that it guides at the visible surface, and their mean direction.

use std::sync::atomic::AtomicBool;

use bismar::guiding::Field;
use bismar::lanes::{F, LANES, V3, mask};
use bismar::rays::{HitBatch, MISS, RayBatch, RayOrder};
use bismar::render::prepass::guiding::learned;
use bismar::render::{Choice, RenderSettings, Technique, camera, transport};
use glam::Vec3;

use crate::balance::StudyScene;

/// A field, pixel by pixel.
pub struct FieldPicture {
    /// Probability of guiding; NaN where a pixel sees no surface.
    pub shares: Vec<f64>,
    /// (1 + mean direction) / 2, where the mean of unit directions is shorter the more they differ; black without guiding.
    pub directions: Vec<[f32; 3]>,
    pub cells: usize,
}

/// Side of the square of stratified samples for the mean direction.
const SIDE: usize = 16;

/// The field that a pre-pass for `spp` paths a pixel learns, if it decides for guiding.
pub fn seen(scene: &StudyScene, spp: u32) -> Option<FieldPicture> {
    let settings = scene.settings.clone().with(Technique::Guiding, Choice::Auto);
    let settings = RenderSettings { spp: Some(spp), ..settings };
    let transport = transport(&scene.scene, &settings);
    let field = learned(&scene.scene, &settings, &transport, &AtomicBool::new(false))?.field?;
    let camera = camera(&scene.scene.scene, &settings);
    let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
    for (y, x) in (0..settings.height).flat_map(|y| (0..settings.width).map(move |x| (y, x))) {
        let at = |x: u32| F::splat(x as f32 + 0.5);
        let (origin, direction) = camera.rays(at(x), at(y), F::ZERO);
        rays.push(origin.lane(0), direction.lane(0), 0.0, f32::INFINITY, 0);
        rays.time.extend(scene.scene.geometry.moves.then_some(0.0));
    }
    scene.scene.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
    let of_pixel = |i: usize| {
        if hits.mesh[i] == MISS {
            return (f64::NAN, [0.0; 3]);
        }
        let hit = hits.primitive(i);
        let point = scene.scene.geometry.point(&scene.scene.scene, hit, (hits.u[i], hits.v[i]), 0.0);
        let normal = point.ng.normalize_or_zero();
        let normal = if normal.dot(rays.direction(i)) > 0.0 { -normal } else { normal };
        let origin = point.position + normal * point.origin_offset;
        let cells = field.cells_at(V3::splat(origin), V3::splat(normal));
        let share = field.guiding_probabilities(field.guiding_cells(cells)).as_array()[0];
        let color = if share > 0.0 { (0.5 * (Vec3::ONE + mean(&field, cells))).to_array() } else { [0.0; 3] };
        (f64::from(share), color)
    };
    let (shares, directions) = (0..hits.mesh.len()).map(of_pixel).unzip();
    Some(FieldPicture { shares, directions, cells: field.cells() })
}

/// The mean of the unit directions that a cell draws.
fn mean(field: &Field, cells: [u32; LANES]) -> Vec3 {
    let number = |i: usize| (i as f32 + 0.5) / SIDE as f32;
    let mut sum = Vec3::ZERO;
    for at in (0..SIDE * SIDE).step_by(LANES) {
        let numbers =
            |of: &dyn Fn(usize) -> usize| F::from(std::array::from_fn::<_, LANES, _>(|lane| number(of(at + lane))));
        let (drawn, _) = field.draw(cells, mask(LANES), numbers(&|i| i % SIDE), numbers(&|i| i / SIDE));
        sum += (0..LANES).map(|lane| drawn.lane(lane)).sum::<Vec3>();
    }
    sum / (SIDE * SIDE) as f32
}
