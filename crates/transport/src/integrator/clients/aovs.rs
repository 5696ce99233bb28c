//! Sums of AOVs: surfaces at first hits, direct and indirect light, light by its source.

use glam::Vec3;

use super::mirrors::{MirrorChains, facing_normal};
use super::velocity::velocity;
use crate::film::stats::accumulate;
use crate::film::{AovSums, ExtraSums};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::{LightKind, PathRays, ShadowRays};
use crate::integrator::events::{FoundEmission, PathEvents, UnoccludedLight};
use crate::rays::{HitBatch, MISS};

/// Adds paths to the AOVs of their pixels, one entry per task in each slice.
#[derive(Debug)]
pub struct Aovs<'a> {
    /// AOV sums; empty if not requested.
    pub sums: &'a mut [AovSums],
    /// Sums of further AOVs; empty if not requested.
    pub extras: &'a mut [ExtraSums],
    /// By task and then by layer of lights ([`Transport::layer`](crate::integrator::Transport::layer)), their light; empty if
    /// not requested.
    pub layers: &'a mut [[f32; 3]],
    /// The same of what BSDF samples find by way of further surfaces; empty if not requested.
    pub indirect: &'a mut [[f32; 3]],
    /// Columns, reused between waves.
    pub columns: &'a mut AovColumns,
}

#[derive(Debug, Default)]
pub struct AovColumns {
    /// By path, its radiance with at most one bounce: emission seen directly, and direct illumination. Empty without sums.
    direct: Vec<Vec3>,
    mirrors: MirrorChains,
    layers: usize,
}

impl PathEvents for Aovs<'_> {
    fn begin(&mut self, at: &WaveContext) {
        self.columns.layers = self.layers.len() / at.tasks.len().max(1);
        self.columns.direct.clear();
        self.columns.direct.resize(if self.sums.is_empty() { 0 } else { at.paths.len() }, Vec3::ZERO);
        self.columns.mirrors.begin(if self.extras.is_empty() { 0 } else { at.paths.len() });
    }

    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        if at.depth == 0 {
            // Layers of lights need nothing of surfaces.
            if !(self.sums.is_empty() && self.extras.is_empty()) {
                self.first_hits(at, rays, hits);
            }
        } else if !self.extras.is_empty() {
            self.columns.mirrors.follow(at, rays, hits, self.extras);
        }
    }

    fn hits_behind_walls(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        if !self.extras.is_empty() {
            self.columns.mirrors.follow(at, rays, hits, self.extras);
        }
    }

    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        let path = rays.path[found.ray as usize];
        self.add_light(at, path, (found.layer.into(), at.depth > 1), found.radiance);
        if let Some(extras) = self.extras.get_mut(at.pixel(path)) {
            let passed_wall = rays.passed_wall.get(found.ray as usize).is_some_and(|passed| *passed);
            if at.depth == 0 && found.kind == LightKind::Area && !passed_wall {
                extras.add_emission(found.radiance);
            }
        }
        if at.depth <= 1 {
            self.add_direct(path, found.radiance);
        }
    }

    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        let path = shadows.path[found.row];
        let layer = at.transport.sampled_layer(shadows.light(found.row));
        self.add_light(at, path, (layer.into(), at.depth > 0), found.radiance);
        if at.depth == 0 {
            self.add_direct(path, found.radiance);
        }
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        self.columns.mirrors.end(at, self.extras);
        let direct = at.by_pixel(&self.columns.direct);
        for (sums, ((_, paths), (_, direct))) in self.sums.iter_mut().zip(at.by_pixel(radiance).zip(direct)) {
            paths.iter().zip(direct).for_each(|(radiance, direct)| sums.add_light(*direct, *radiance - *direct));
        }
    }
}

impl Aovs<'_> {
    #[inline]
    fn add_light(&mut self, at: &WaveContext, path: u32, (layer, is_indirect): (usize, bool), radiance: Vec3) {
        let i = at.pixel(path) * self.columns.layers + layer;
        if let Some(sum) = self.layers.get_mut(i) {
            accumulate(sum, radiance.into());
        }
        if let Some(sum) = self.indirect.get_mut(i).filter(|_| is_indirect) {
            accumulate(sum, radiance.into());
        }
    }

    fn add_direct(&mut self, path: u32, radiance: Vec3) {
        if let Some(direct) = self.columns.direct.get_mut(path as usize) {
            *direct += radiance;
        }
    }

    #[inline(never)]
    fn first_hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        let transport = at.transport;
        for ray in (0..rays.len).filter(|&ray| hits.mesh[ray] != MISS) {
            let path = rays.path[ray];
            let pixel = at.pixel(path);
            let point = transport.point(&rays.rays, hits, ray);
            let (albedo, normal) = (point.base_color(transport.scene), facing_normal(&point, rays, ray));
            let (instance, material) = (hits.instance[ray], point.mesh.material);
            if let Some(sums) = self.sums.get_mut(pixel) {
                sums.add_surface(albedo, normal, hits.t[ray]);
                (sums.object, sums.material) = (instance + 1, material + 1);
            }
            if let Some(extras) = self.extras.get_mut(pixel) {
                let names = [transport.names.objects[instance as usize], transport.names.materials[material as usize]];
                extras.add_surface(point.position + transport.scene.origin.as_vec3(), point.texcoords[0], names);
                if transport.geometry.has_velocities {
                    extras.add_velocity(velocity(transport, hits.primitive(ray), (hits.u[ray], hits.v[ray])));
                }
                self.columns.mirrors.first_hit(at, path, &point, (albedo, normal), extras);
            }
        }
    }
}
