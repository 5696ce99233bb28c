//! What happens to the paths of a wave, for its clients: sums of pixels, AOVs, training samples. A client is a value that
//! implements [`PathEvents`]; tuples of clients are clients, and `()` is none. The wave calls a client between its stages, so
//! that the kernels of stages are compiled once for all clients.

use std::iter::once;

use glam::Vec3;

use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::{LightKind, PathRays, ShadowRays};
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::vertices::Vertices;
use crate::lanes::{F, LANES, Survivors, V3};
use crate::rays::HitBatch;

/// Light that a ray found at its end.
#[derive(Debug, Clone, Copy)]
pub struct FoundEmission {
    pub ray: u32,
    /// What it adds to its path: with throughput and MIS weight, clamped, linear RGB; not zero.
    pub radiance: Vec3,
    /// Densities per solid angle of light samples in its direction: environment, area lights. One of them is zero, both for
    /// camera rays.
    pub pdf: [f32; 2],
    pub kind: LightKind,
    /// Number of its layer ([`Transport::layer`](crate::integrator::Transport::layer)).
    pub layer: u8,
}

/// Up to eight light samples of the environment and of area lights.
#[derive(Debug, Clone, Copy)]
pub struct LightSamplePacket {
    /// Those that have a shadow ray.
    pub survivors: Survivors,
    /// Row of the first survivor's shadow ray; the others follow.
    pub first_row: usize,
    /// Mask: toward the environment.
    pub is_environment: F,
    /// Shading points and normals that lights were sampled from.
    pub from: (V3, V3),
    /// [`LightSamples::emitter`](crate::light::LightSamples::emitter).
    pub emitter: [u32; LANES],
    /// Density per solid angle times samples per path of the technique.
    pub weighted_pdf: F,
    /// Densities per solid angle of BSDF samples.
    pub bsdf_pdf: F,
    /// Contribution if unoccluded, with throughput and MIS weight, linear RGB.
    pub radiance: V3,
}

/// Up to eight directions that were sampled from BSDFs, or from the mixture with the guiding field.
#[derive(Debug, Clone, Copy)]
pub struct ScatteredPacket {
    /// Those that have a next ray.
    pub survivors: Survivors,
    /// Number in the wave of the first survivor's ray; the others follow.
    pub first_ray: u32,
    /// Unit directions.
    pub wi: V3,
    /// Densities per solid angle: of the mixture, of the BSDF, of the field.
    pub pdf: [F; 3],
    /// Roulette probabilities at the surface: of the light sample, and of continuing the path.
    pub roulette: [F; 2],
    /// Mask of those that roulette has ended.
    pub ended: F,
}

/// A thin wall that a ray of a path passed.
#[derive(Debug, Clone, Copy)]
pub struct PassedWall {
    pub row: usize,
    /// What the wall leaves of light, linear RGB.
    pub weight: Vec3,
    /// Distance of the wall from the ray's origin.
    pub t: f32,
}

/// Light that a shadow ray found.
#[derive(Debug, Clone, Copy)]
pub struct UnoccludedLight {
    /// Row of the shadow ray.
    pub row: usize,
    /// What it adds to its path: with throughput and MIS weight, clamped, linear RGB.
    pub radiance: Vec3,
    /// The clamp's factor times what thin walls leave, at most 1.
    pub scale: f32,
}

/// Light that a first surface borrowed for one of its BSDF samples ([`reuse`](crate::integrator::reuse)).
#[derive(Debug, Clone, Copy)]
pub struct BorrowedLight {
    /// Index of the path in the wave.
    pub path: u32,
    /// Index of the BSDF sample in the pixel's sequence.
    pub index: u32,
    /// What it adds to the path, linear RGB.
    pub radiance: Vec3,
}

/// Receives what happens to the paths of a wave. Events come in a fixed order, and in that of the functions here at each depth.
/// A client keeps columns of its own by path, by number of a ray ([`PathRays::first`]), or by row of a shadow ray.
#[expect(unused_variables, reason = "the parameters' names are documentation")]
pub trait PathEvents {
    /// A wave begins. Camera rays are numbered like their paths.
    #[inline]
    fn begin(&mut self, at: &WaveContext) {}

    /// The rays at a depth are about to be traced.
    #[inline]
    fn rays(&mut self, at: &WaveContext, rays: &PathRays) {}

    /// A ray has passed a thin wall, told before what it meets behind.
    #[inline]
    fn passed_wall(&mut self, at: &WaveContext, rays: &PathRays, passed: &PassedWall) {}

    /// The rays at a depth have met surfaces, or nothing. Camera rays have not passed thin walls yet, all others have.
    #[inline]
    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {}

    /// Camera rays have passed thin walls, in scenes that have any: `hits` are those behind.
    #[inline]
    fn hits_behind_walls(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {}

    /// A ray has found light at its end.
    #[inline]
    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {}

    /// The second surface at the end of the ray of this number lends what its path finds from here on, with a throughput of one,
    /// or ends its path, where it does not go on ([`reuse`](crate::integrator::reuse)).
    #[inline]
    fn lends(&mut self, at: &WaveContext, ray: u32, goes_on: bool) {}

    /// A ray has found light that its path lends: `radiance` is what leaves the second surface, and is no path's yet.
    #[inline]
    fn lent(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {}

    /// A packet of vertices has sampled lights; punctual lights are not among them.
    #[inline]
    fn light_samples(
        &mut self,
        at: &WaveContext,
        vertices: &Vertices,
        packet: &RequestPacket,
        samples: &LightSamplePacket,
    ) {
    }

    /// A packet of vertices has sampled directions.
    #[inline]
    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, packet: &RequestPacket, samples: &ScatteredPacket) {}

    /// All shadow rays at a depth have been traced, those of light that is lent among them.
    #[inline]
    fn shadow_rays(&mut self, at: &WaveContext, shadows: &ShadowRays) {}

    /// A shadow ray has found light; punctual lights are among them.
    #[inline]
    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {}

    /// A sample of the path with this index was discarded, as its radiance was not finite.
    #[inline]
    fn not_finite(&mut self, at: &WaveContext, path: u32) {}

    /// A first surface has borrowed light.
    #[inline]
    fn borrowed(&mut self, at: &WaveContext, light: &BorrowedLight) {}

    /// All paths have ended; `radiance` is theirs, linear RGB.
    #[inline]
    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {}
}

/// Passes every event on to the clients that an expression names or iterates over.
macro_rules! pass_on {
    ($self:ident => $($clients:expr),*) => {
        #[inline]
        fn begin(&mut $self, at: &WaveContext) {
            $($clients.for_each(|client| client.begin(at));)*
        }

        #[inline]
        fn rays(&mut $self, at: &WaveContext, rays: &PathRays) {
            $($clients.for_each(|client| client.rays(at, rays));)*
        }

        #[inline]
        fn passed_wall(&mut $self, at: &WaveContext, rays: &PathRays, passed: &PassedWall) {
            $($clients.for_each(|client| client.passed_wall(at, rays, passed));)*
        }

        #[inline]
        fn hits(&mut $self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
            $($clients.for_each(|client| client.hits(at, rays, hits));)*
        }

        #[inline]
        fn hits_behind_walls(&mut $self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
            $($clients.for_each(|client| client.hits_behind_walls(at, rays, hits));)*
        }

        #[inline]
        fn emission(&mut $self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
            $($clients.for_each(|client| client.emission(at, rays, found));)*
        }

        #[inline]
        fn lends(&mut $self, at: &WaveContext, ray: u32, goes_on: bool) {
            $($clients.for_each(|client| client.lends(at, ray, goes_on));)*
        }

        #[inline]
        fn lent(&mut $self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
            $($clients.for_each(|client| client.lent(at, rays, found));)*
        }

        #[inline]
        fn light_samples(
            &mut $self,
            at: &WaveContext,
            vertices: &Vertices,
            packet: &RequestPacket,
            samples: &LightSamplePacket,
        ) {
            $($clients.for_each(|client| client.light_samples(at, vertices, packet, samples));)*
        }

        #[inline]
        fn scattered(
            &mut $self,
            at: &WaveContext,
            vertices: &Vertices,
            packet: &RequestPacket,
            samples: &ScatteredPacket,
        ) {
            $($clients.for_each(|client| client.scattered(at, vertices, packet, samples));)*
        }

        #[inline]
        fn shadow_rays(&mut $self, at: &WaveContext, shadows: &ShadowRays) {
            $($clients.for_each(|client| client.shadow_rays(at, shadows));)*
        }

        #[inline]
        fn unoccluded(&mut $self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
            $($clients.for_each(|client| client.unoccluded(at, shadows, found));)*
        }

        #[inline]
        fn not_finite(&mut $self, at: &WaveContext, path: u32) {
            $($clients.for_each(|client| client.not_finite(at, path));)*
        }

        #[inline]
        fn borrowed(&mut $self, at: &WaveContext, light: &BorrowedLight) {
            $($clients.for_each(|client| client.borrowed(at, light));)*
        }

        #[inline]
        fn end(&mut $self, at: &WaveContext, radiance: &[Vec3]) {
            $($clients.for_each(|client| client.end(at, radiance));)*
        }
    };
}

impl PathEvents for () {}

impl<A: PathEvents, B: PathEvents> PathEvents for (A, B) {
    pass_on!(self => once(&mut self.0), once(&mut self.1));
}

impl<A: PathEvents, B: PathEvents, C: PathEvents> PathEvents for (A, B, C) {
    pass_on!(self => once(&mut self.0), once(&mut self.1), once(&mut self.2));
}

impl<A: PathEvents> PathEvents for &mut A {
    pass_on!(self => once(&mut **self));
}

/// A client that may be absent.
impl<A: PathEvents> PathEvents for Option<A> {
    pass_on!(self => self.iter_mut());
}
