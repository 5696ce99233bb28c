//! Agreement of two backends. Every difference is judged in double precision: rounding explains it, or it counts as
//! unexplained.

use bismar::rays::{HitBatch, RayBatch, RayOrder, RayQueries};
use bismar::scene::Scene;
use glam::Vec3;

use super::exact::{ExactRay, Hit, Plane, meet};
use super::replay::{self, Sink};
use super::stream::{Kind, Query, Stream};
use crate::statistics::mean_of;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Equal up to rounding.
    Same,
    /// Different triangles, within rounding of an edge.
    Edge,
    /// Different triangles at the same distance, within rounding.
    Coplanar,
    /// The ray lies in the triangle's plane, nearly: rounding is more than a hundredth of the triangle.
    Grazing,
    /// Within rounding of where the ray's interval starts (where it leaves its own surface) or ends.
    SelfHit,
    /// The texel at which alpha was looked up differs.
    Alpha,
    /// One ray passed within rounding of an edge and hit nothing.
    Miss,
    /// Rounding does not explain it.
    Unexplained,
}

/// Number of rays of each [`Class`], in their order.
pub type Tally = [u64; 8];

/// A weight's rounding above this share makes a hit grazing.
const GRAZING: f64 = 0.01;

/// The answers of a backend to a stream, query by query: hits, or what is occluded.
pub struct Answers(Vec<Sink>);

impl Answers {
    pub fn of(backend: &dyn RayQueries, stream: &Stream) -> Self {
        let answer = |query: &Query| {
            let mut sink = Sink::default();
            replay::answer(backend, query, &mut sink);
            sink
        };
        Self(stream.queries.iter().map(answer).collect())
    }

    pub(crate) fn hit_share(&self) -> f64 {
        let hits = self.0.iter().flat_map(|(hits, _)| hits.t.iter().map(|t| t.is_finite()));
        let occluded = self.0.iter().flat_map(|(_, occluded)| occluded.iter().copied());
        mean_of(hits.chain(occluded).map(|hit| f64::from(u8::from(hit))))
    }
}

pub struct Judge<'a> {
    scene: &'a Scene,
    /// [`Scene::has_alpha`] of each mesh.
    has_alpha: Vec<bool>,
}

impl<'a> Judge<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene, has_alpha: (0..scene.meshes.len() as u32).map(|mesh| scene.has_alpha(mesh)).collect() }
    }

    /// Compares the answers of two backends to a stream; hands the first unexplained differences to `tell`.
    pub fn compare(
        &self,
        stream: &Stream,
        (a, of_a): (&dyn RayQueries, &Answers),
        (b, of_b): (&dyn RayQueries, &Answers),
        tell: &mut dyn FnMut(String),
    ) -> Tally {
        let mut counts = Tally::default();
        for (Query { kind, rays, .. }, (own, other)) in stream.queries.iter().zip(of_a.0.iter().zip(&of_b.0)) {
            for i in 0..rays.len() {
                let (class, [hit_a, hit_b]) = match kind {
                    Kind::Closest => {
                        let [a, b] = [&own.0, &other.0].map(|hits| Hit::new(hits, i));
                        (self.class(rays, i, a, b), [a, b])
                    }
                    Kind::Occluded if own.1[i] == other.1[i] => (Class::Same, [None; 2]),
                    Kind::Occluded => {
                        let [a, b] = candidates(a, b, rays, i);
                        (self.class_occluded(rays, i, a, b), [a, b])
                    }
                };
                counts[class as usize] += 1;
                if class == Class::Unexplained && counts[class as usize] <= 3 {
                    let (o, d, range) = (rays.origin(i), rays.direction(i), [rays.tnear[i], rays.tfar[i]]);
                    tell(format!("{}: ray from {o} to {d} in {range:?}: {hit_a:?} against {hit_b:?}", stream.name));
                }
            }
        }
        counts
    }

    /// Class of a difference between closest hits of ray `i`.
    pub fn class(&self, rays: &RayBatch, i: usize, a: Option<Hit>, b: Option<Hit>) -> Class {
        if a == b {
            return Class::Same;
        }
        let ray = ExactRay::new(rays, i);
        let plane = |hit: Hit| meet(self.scene, &ray, hit.id);
        match (a, b) {
            (None, None) => Class::Same,
            (Some(hit), None) | (None, Some(hit)) => match plane(hit) {
                Some(plane) if plane.explains(&hit, &ray) => self.lost(&plane, &ray, rays.key[i], &hit, Class::Miss),
                plane => grazing_or_wrong(plane.as_ref()),
            },
            (Some(a), Some(b)) => {
                let (Some(of_a), Some(of_b)) = (plane(a), plane(b)) else { return Class::Grazing };
                for (plane, hit) in [(&of_a, &a), (&of_b, &b)] {
                    if !plane.explains(hit, &ray) {
                        return grazing_or_wrong(Some(plane));
                    }
                }
                if a.id == b.id {
                    return Class::Same;
                }
                if (of_a.t - of_b.t).abs() <= of_a.t_error + of_b.t_error {
                    return if of_a.at_edge() || of_b.at_edge() { Class::Edge } else { Class::Coplanar };
                }
                let (near, hit) = if of_a.t < of_b.t { (&of_a, &a) } else { (&of_b, &b) };
                self.lost(near, &ray, rays.key[i], hit, Class::Edge)
            }
        }
    }

    /// Class of a difference in occlusion of ray `i`, from both backends' closest hits.
    fn class_occluded(&self, rays: &RayBatch, i: usize, a: Option<Hit>, b: Option<Hit>) -> Class {
        let class = self.class(rays, i, a, b);
        if class != Class::Same {
            return class;
        }
        // Both would hit the same: then the difference is one of the any-hit query, and that very hit must be in doubt.
        let (Some(hit), ray) = (a, ExactRay::new(rays, i)) else { return Class::Unexplained };
        match meet(self.scene, &ray, hit.id) {
            Some(plane) => self.lost(&plane, &ray, rays.key[i], &hit, Class::Miss),
            None => Class::Grazing,
        }
    }

    /// Class of a hit that the other backend missed.
    fn lost(&self, plane: &Plane, ray: &ExactRay, key: u32, hit: &Hit, at_edge: Class) -> Class {
        if plane.weight_error > GRAZING {
            return Class::Grazing;
        }
        if plane.at_end(ray) {
            return Class::SelfHit;
        }
        if plane.at_edge() {
            return at_edge;
        }
        let [instance, mesh, prim] = hit.id;
        let [_, u, v] = plane.weights;
        let near = [-1.0, 0.0, 1.0].map(|step| step * plane.weight_error);
        let is_there =
            |(du, dv): (f64, f64)| self.scene.is_present(key, instance, mesh, prim, (u + du) as f32, (v + dv) as f32);
        let mut around = near.iter().flat_map(|du| near.iter().map(|dv| (*du, *dv)));
        if self.has_alpha[mesh as usize] && !around.all(is_there) { Class::Alpha } else { Class::Unexplained }
    }
}

/// Bounds hold to first order: where they are as large as the triangle, they exclude nothing.
fn grazing_or_wrong(plane: Option<&Plane>) -> Class {
    if plane.is_none_or(|plane| plane.weight_error > 1.0) { Class::Grazing } else { Class::Unexplained }
}

/// Relative extension of a ray's interval, and shift of its origin relative to its coordinates, to find what it
/// passes within rounding.
const NEARBY: f32 = 1e-5;

/// Closest hits of ray `i` by two backends of which only one reports occlusion. If neither has a closest hit, that of a
/// ray nearby: a triangle to be judged against the ray itself.
fn candidates(a: &dyn RayQueries, b: &dyn RayQueries, rays: &RayBatch, i: usize) -> [Option<Hit>; 2] {
    let shift = NEARBY * (1.0 + rays.origin(i).abs().max_element());
    let sides = (0..27).map(|k| Vec3::new((k % 3) as f32, (k / 3 % 3) as f32, (k / 9) as f32) - 1.0);
    let nearby = sides.map(|side| (side * shift, 1.0 + NEARBY));
    let mut tried = [(Vec3::ZERO, 1.0), (Vec3::ZERO, 1.0 + NEARBY)].into_iter().chain(nearby);
    let found = |(shift, longer): (Vec3, f32)| {
        let both = [a, b].map(|backend| alone(backend, rays, i, shift, longer));
        both.iter().any(Option::is_some).then_some((both, shift == Vec3::ZERO))
    };
    match tried.find_map(found) {
        None => [None, None],
        Some((both, true)) => both,
        // For a nearby ray it does not matter which of two triangles is hit.
        Some(([a, b], false)) => [a.or(b), a.or(b)],
    }
}

/// The closest hit of one ray, shifted, its interval's end times `longer`.
fn alone(backend: &dyn RayQueries, rays: &RayBatch, i: usize, shift: Vec3, longer: f32) -> Option<Hit> {
    let mut one = RayBatch::default();
    one.push(rays.origin(i) + shift, rays.direction(i), rays.tnear[i], rays.tfar[i] * longer, rays.key[i]);
    let mut hits = HitBatch::default();
    backend.closest_hits(&one, RayOrder::Incoherent, &mut hits);
    Hit::new(&hits, 0)
}
