//! Boundaries of media that straight lines cross: what surrounds the start of a camera ray, and what lies behind a boundary that
//! others touch.
//!
//! A body must be closed for this to mean anything. What surrounds the camera is found along lines from outside of all bodies to it;
//! of three lines, all from above, two decide. So a surface of water without walls bounds what lies below it.

use std::cell::RefCell;

use glam::Vec3;

use super::transport::Transport;
use crate::light::samples::ROUNDING;
use crate::rays::{AnyHit, MISS, RayBatch};
use crate::scene::Primitive;

/// From the camera to where lines to it begin. No unit vectors; in no plane in which surfaces often lie.
const OUTWARD: [Vec3; 3] = [Vec3::new(0.31, 0.87, 0.23), Vec3::new(-0.53, 0.79, 0.37), Vec3::new(0.17, 0.93, -0.61)];

/// A part of a line.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// World space.
    pub origin: Vec3,
    /// World space, of any length.
    pub direction: Vec3,
    /// Start and end in units of the direction's length.
    pub interval: [f32; 2],
    /// Time in [0, 1] of the shutter interval.
    pub time: f32,
}

/// A boundary that a line crosses.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    t: f32,
    body: Primitive,
    back_facing: bool,
}

thread_local! {
    static BUFFERS: RefCell<(RayBatch, Vec<AnyHit>, Vec<Crossing>)> = RefCell::default();
}

impl Transport<'_> {
    /// The media on the side of `wo` and beyond the surface, where a ray with the stack `media` hits a mesh. The line leads from
    /// before the surface to where rays begin that cross it; boundaries in between are crossed with it.
    #[inline]
    pub fn media_at_surface(
        &self,
        hit: Primitive,
        back_facing: bool,
        media: u32,
        line: impl FnOnce() -> Line,
    ) -> [u32; 2] {
        let sides = self.materials.media_at_surface(hit.mesh, back_facing, media);
        match self.materials.mesh_material(hit.mesh).interior_medium {
            None => sides,
            Some(_) => [sides[0], self.media_beyond(line(), sides[0], Some((hit, back_facing)))],
        }
    }

    /// The media on the side of `wo` and beyond the surface, where a ray with the stack `media` hits a point: its position, geometric
    /// normal and offset of ray origins, as in [`SurfacePoint`](crate::integrator::surface::geometry::SurfacePoint).
    #[inline]
    pub fn media_at_hit(
        &self,
        hit: Primitive,
        media: u32,
        (direction, time): (Vec3, f32),
        (position, ng, offset): (Vec3, Vec3, f32),
    ) -> [u32; 2] {
        let back_facing = ng.dot(direction) > 0.0;
        self.media_at_surface(hit, back_facing, media, || {
            let to_origin = ng.normalize_or(direction) * if back_facing { -offset } else { offset };
            Line { origin: position + to_origin, direction: -to_origin, interval: [0.0, 2.0], time }
        })
    }

    /// The media of a camera ray that sees surfaces from the distance `near` on, and the distance from which they absorb: 0, or `near`
    /// if the near plane cuts a body open. `known` are the media around the last ray's origin.
    pub fn media_at_camera(
        &self,
        (origin, direction): (Vec3, Vec3),
        near: f32,
        time: f32,
        known: &mut Option<(Vec3, u32)>,
    ) -> (u32, f32) {
        let start = origin + direction * near;
        let holds = |[low, high]: &[Vec3; 2]| start.cmpge(*low).all() && start.cmple(*high).all();
        if !self.materials.bodies.iter().any(holds) {
            return (0, 0.0);
        }
        let media = match known {
            Some((at, media)) if *at == origin && !self.geometry.moves => *media,
            _ => known.insert((origin, self.media_around(origin, time))).1,
        };
        // The camera may be on a boundary.
        let before = ROUNDING * origin.abs().max_element();
        let line = || Line { origin: origin - direction * before, direction, interval: [0.0, before + near], time };
        match near <= 0.0 || self.media_beyond(line(), media, None) == media {
            true => (media, 0.0),
            false => (self.media_around(start, time), near),
        }
    }

    /// The media around a point.
    fn media_around(&self, point: Vec3, time: f32) -> u32 {
        let inward = |outward: Vec3| {
            self.media_beyond(
                Line { origin: point, direction: -outward, interval: [-f32::INFINITY, 0.0], time },
                0,
                None,
            )
        };
        let [first, second] = [inward(OUTWARD[0]), inward(OUTWARD[1])];
        if first == second { first } else { Some(inward(OUTWARD[2])).filter(|third| *third == second).unwrap_or(first) }
    }

    /// The media at the end of a line that starts in `media`. It crosses `certain` in any case.
    #[inline(never)]
    fn media_beyond(&self, line: Line, mut media: u32, certain: Option<(Primitive, bool)>) -> u32 {
        BUFFERS.with_borrow_mut(|(rays, hits, crossings)| {
            let Line { origin, direction, interval: [start, end], time } = line;
            rays.clear();
            // Rays start at their origin: a line that ends there is traced against its direction.
            let forward = if end > 0.0 { 1.0 } else { -1.0 };
            let [near, far] = if end > 0.0 { [start, end] } else { [-end, -start] };
            rays.push(origin, direction * forward, near, far, 0);
            rays.time.extend(self.geometry.moves.then_some(time));
            self.rays.all_hits(rays, hits);
            crossings.clear();
            crossings.extend(hits.iter().filter_map(|&AnyHit { t, primitive: hit, .. }| {
                self.materials.mesh_material(hit.mesh).interior_medium?;
                let back_facing = self.geometry.normal(self.scene, hit, time).dot(direction) > 0.0;
                Some(Crossing { t: t * forward, body: Primitive { prim: MISS, ..hit }, back_facing })
            }));
            if let Some((hit, back_facing)) = certain {
                let body = Primitive { prim: MISS, ..hit };
                if !crossings.iter().any(|crossing| crossing.body == body && crossing.back_facing == back_facing) {
                    crossings.push(Crossing { t: end, body, back_facing });
                }
            }
            crossings.sort_by(|a, b| a.t.total_cmp(&b.t));
            let rounding = ROUNDING * origin.abs().max_element() / direction.length();
            for together in crossings.chunk_by_mut(|a, b| b.t - a.t <= rounding + ROUNDING * b.t.abs()) {
                // Bodies are left before others are entered. Of those that share a face, the smaller one is within the other.
                let size = |of: &Crossing| self.materials.body_sizes.get(&[of.body.instance, of.body.mesh]).copied();
                together.sort_by(|a, b| size(b).unwrap_or(0.0).total_cmp(&size(a).unwrap_or(0.0)));
                together.sort_by_key(|crossing| !crossing.back_facing);
                for (at, crossing) in together.iter().enumerate() {
                    let Crossing { body, back_facing, .. } = *crossing;
                    // Where a line meets an edge, both triangles may be hit. What is entered and left here is thinner than rounding.
                    let same = |all: &[Crossing], side| {
                        all.iter().any(|other| other.body == body && other.back_facing == side)
                    };
                    let (again, both) = (same(&together[..at], back_facing), same(together, !back_facing));
                    if !again && !both {
                        [_, media] = self.materials.media_at_surface(body.mesh, back_facing, media);
                    }
                }
            }
            media
        })
    }
}
