//! Straight shadows of smooth glass (`--glass-shadows straight`), an approximation: light samples see through bodies of smooth
//! glass as if these did not bend light, attenuated by Fresnel terms, tints and absorption.
//!
//! The paths that find the same light by refraction are left out, so that no light counts twice:
//!
//! - A direction that a vertex samples is *rough* if its density is below
//!   [`MIRROR_PDF`](crate::integrator::data::history::MIRROR_PDF). Light samples in rough directions pass bodies. BSDF samples in
//!   rough directions find the light that lies straight behind bodies, with MIS weights as usual, besides that they are scattered
//!   by the body.
//! - The emission that such a scattered path finds, once it has been refracted, is left out until it has another rough vertex,
//!   and so are light samples in refracted directions. Paths from the camera that are refracted or mirrored only see all light.

use glam::Vec3;

use super::thin_walls::{ThinWalls, is_wall};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::dimensions::MAX_WALLS;
use crate::integrator::data::history::RayHistory;
use crate::integrator::data::path_states::NonFiniteSamples;
use crate::integrator::data::queues::{PathRays, SortedHits};
use crate::integrator::data::transport::Transport;
use crate::integrator::events::{FoundEmission, PathEvents};
use crate::integrator::stages::emission;
use crate::lanes::V3Column;
use crate::rays::{HitBatch, MISS};

/// Finds what lies straight behind bodies; one per thread.
#[derive(Debug, Default)]
pub struct GlassShadows {
    walls: ThinWalls,
    hits: HitBatch,
    /// Throughputs of the rays before they pass bodies.
    beta: V3Column,
    /// Rows and throughputs before absorption.
    before: Vec<(usize, Vec3)>,
    sorted: SortedHits,
    found: Vec<FoundEmission>,
}

impl GlassShadows {
    /// Adds the light straight behind bodies that rays in rough directions hit. Their own light is left out by
    /// [`RayHistory::is_refracted`](crate::integrator::data::history::RayHistory::is_refracted).
    pub fn find<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        hits: &HitBatch,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
    ) {
        let transport = at.transport;
        if at.depth == 0 || !transport.passes_bodies() {
            return;
        }
        let is_rough = |row: usize| RayHistory(rays.history[row]).is_rough();
        let culls = transport.culls();
        let passes_backs = |row: usize| culls && RayHistory(rays.history[row]).is_mirror_image();
        self.hits.copy_from(hits);
        self.beta.copy_from(&rays.beta);
        let medium = transport.materials.tracks_media.then(|| &rays.medium[..rays.len]);
        self.walls.begin(transport, rays.len, hits, &is_rough, medium);
        // Rays have passed the thin walls that they pass.
        self.walls.retain(|row| is_rough(row) && !is_wall(transport, hits.mesh[row]));
        for _ in 0..MAX_WALLS {
            if self.walls.is_empty() {
                break;
            }
            self.walls.step(
                transport,
                &rays.rays,
                &mut rays.beta,
                &mut self.hits,
                [&is_rough, &passes_backs],
                |_, _| (),
            );
            self.sorted.clear();
            self.before.clear();
            for row in self.walls.passed().map(|row| row as usize) {
                if self.hits.mesh[row] == MISS {
                    self.sorted.escaped.push(row as u32);
                } else if emits(transport, self.hits.mesh[row]) {
                    self.before.push((row, rays.beta.get(row)));
                    self.walls.absorb(transport, &mut rays.beta, row, self.hits.t[row]);
                    self.sorted.emissive.push(row as u32);
                }
            }
            emission::find(at, &self.sorted, rays, &self.hits, &mut self.found, non_finite, clients);
            self.before.drain(..).for_each(|(row, beta)| rays.beta.set(row, beta));
        }
        std::mem::swap(&mut rays.beta, &mut self.beta);
    }
}

/// Does a mesh emit light that light samples may find?
pub fn emits(transport: &Transport, mesh: u32) -> bool {
    let kind = transport.materials.mesh_material(mesh);
    kind.emits && !kind.unlit
}
