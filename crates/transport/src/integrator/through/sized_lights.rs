//! Lights with a size that rays of paths hit: BSDF samples, weighted against light samples. They are no surfaces. Toward the light
//! that a ray hits goes a shadow ray of the same direction, which passes what those of light samples pass, so that both find the
//! same light.

use wide::bytemuck::cast;

use super::passing::Passing;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::counts::{WaveCounts, timed};
use crate::integrator::data::path_states::{NonFiniteSamples, clamp_contribution};
use crate::integrator::data::queues::{LightKind, PathRays, ShadowRays};
use crate::integrator::events::{FoundEmission, PathEvents};
use crate::integrator::stages::{emission, media};
use crate::lanes::{F, LANES, Rows, Survivors, U, V3, are, eight, load_bits, mask};
use crate::light::{SizedHit, SizedLights};

/// Finds the lights with a size that rays hit; one per thread.
#[derive(Debug, Default)]
pub struct SizedLightHits {
    /// Rows of the rays, and what they hit.
    found: Vec<(u32, SizedHit)>,
    shadows: ShadowRays,
}

impl SizedLightHits {
    /// Adds the light with a size that rays find before they meet surfaces. Camera rays find none.
    pub fn find<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        passing: &mut Passing,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
        counts: &mut WaveCounts,
    ) {
        let Some(sized) = at.transport.lights.sized.as_ref().filter(|_| at.depth > 0) else { return };
        self.list(at, sized, rays);
        if self.found.is_empty() {
            return;
        }
        self.push_shadow_rays(at, rays, non_finite);
        counts.shadow_rays += self.shadows.len as u64;
        timed(counts, || passing.walls.occlude(at.transport, &mut self.shadows));
        let limit = emission::limit(at);
        for (row, (ray, hit)) in self.found.iter().enumerate().filter(|(row, _)| !self.shadows.occluded[*row]) {
            let (radiance, _) = clamp_contribution(self.shadows.radiance.get(row), limit);
            let kind = LightKind::Sized;
            let layer = at.transport.layer(kind, |layers| layers.punctual[hit.light as usize]);
            let found = FoundEmission { ray: *ray, radiance, pdf: [0.0, hit.pdf], kind, layer };
            clients.emission(at, rays, &found);
        }
    }

    #[inline(never)]
    fn list(&mut self, at: &WaveContext, sized: &SizedLights, rays: &PathRays) {
        let transport = at.transport;
        self.found.clear();
        for first in (0..rays.len).step_by(LANES) {
            let n = LANES.min(rays.len - first);
            let rows = match n {
                LANES => Rows::From(first),
                _ => Rows::Each(eight(|lane| (first + lane.min(n - 1)) as u32)),
            };
            sized.candidates(rays.rays.origins(&rows), rays.rays.directions(&rows), |index, may_hit| {
                for row in (0..n).filter(|lane| may_hit >> lane & 1 == 1).map(|lane| first + lane) {
                    // The light belongs to light samples of an earlier vertex.
                    if rays.history(row).is_refracted() {
                        continue;
                    }
                    let (from, direction) = ((rays.rays.origin(row), rays.normal.get(row)), rays.rays.direction(row));
                    let hit = transport.lights.sized_hit(transport.scene, index, from, direction, rays.rays.time(row));
                    self.found.extend(hit.map(|hit| (row as u32, hit)));
                }
            });
        }
    }

    /// Makes a shadow ray of each ray that hits a light; those that carry nothing are taken from the list.
    fn push_shadow_rays(&mut self, at: &WaveContext, rays: &PathRays, non_finite: &mut NonFiniteSamples) {
        let Self { found, shadows } = self;
        found.retain(|(row, hit)| {
            let radiance = rays.beta.get(*row as usize) * hit.radiance;
            if !radiance.is_finite() {
                non_finite.add(rays.path[*row as usize]);
            }
            radiance.is_finite() && radiance.max_element() > 0.0
        });
        let transport = at.transport;
        shadows.open(transport, found.len());
        for packet in found.chunks(LANES) {
            let hits = eight(|lane| packet[lane.min(packet.len() - 1)]);
            let rows = Rows::Each(hits.map(|(row, _)| row));
            let weights = hits.map(|(row, hit)| emission::mis_weight(at, rays, row as usize, [0.0, hit.pdf]));
            let emitted = V3::gather(eight(|lane| hits[lane].1.radiance * weights[lane]));
            let (beta, survivors) = (rays.beta.load(&rows), Survivors::of(mask(packet.len())));
            let mut radiance = beta * emitted;
            let medium = transport.materials.tracks_media.then(|| load_bits(&rays.medium, &rows));
            if transport.passes_bodies() {
                let rough = U::from(hits.map(|(row, _)| u32::from(rays.history(row as usize).is_rough())));
                shadows.set_bodies(&survivors, cast::<F, U>(are(rough, 1)), medium.unwrap_or(U::ZERO));
            } else {
                radiance = media::attenuated(transport, radiance, medium, F::from(hits.map(|(_, hit)| hit.distance)));
            }
            let backs = hits.map(|(row, _)| u32::from(rays.passes_backs(transport, row as usize)));
            shadows.set_backs(&survivors, U::from(backs));
            let ray = (rays.rays.origins(&rows), rays.rays.directions(&rows));
            let (key, ends) = (load_bits(&rays.rays.key, &rows), F::from(hits.map(|(_, hit)| hit.end)));
            let ids = [load_bits(&rays.path, &rows), U::ZERO, U::ZERO, U::splat(LightKind::Sized as u32)];
            shadows.push(&survivors, ray, ends, (key, rays.rays.times(&rows)), radiance, ids);
        }
        shadows.close();
    }
}
