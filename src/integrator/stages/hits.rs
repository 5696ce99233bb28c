//! What a batch of rays found: emission is added to its paths, surfaces that scatter become vertices.

use glam::Vec3;

use super::observation;
use crate::balance::{Contribution, Counts, Technique};
use crate::bsdf::{Lobes, MetallicRoughness};
use crate::film::AovSums;
use crate::integrator::geometry::Point;
use crate::integrator::vertices::Group;
use crate::integrator::wave::Wave;
use crate::integrator::{PixelBatch, Transport};
use crate::lanes::{F, LANES, Rows, U, V3, eight, load, load_bits};
use crate::light::area;
use crate::rays::MISS;

impl Wave {
    /// Sorts the rays of the batch at `depth` (0 for camera rays) into escaped and hit; fills the vertices.
    #[inline(never)]
    pub(in crate::integrator) fn hits(&mut self, transport: &Transport, depth: u32, batch: &mut PixelBatch) {
        self.escaped.clear();
        self.plain.clear();
        self.detailed.clear();
        self.vertices.open(self.paths.len, transport.materials.lambert);
        let scatters = depth + 1 < transport.max_depth;
        for ray in 0..self.paths.len {
            let mesh = self.hits.mesh[ray];
            if mesh == MISS {
                self.escaped.push(ray as u32);
                continue;
            }
            let kind = transport.materials.kind(mesh);
            if depth == 0 {
                self.slots[self.paths.slot[ray] as usize].covered = true;
                self.aovs(transport, ray, batch.aovs);
            }
            if kind.shines {
                self.shine(transport, depth, ray, batch);
                if transport.scene.materials[kind.material as usize].unlit {
                    continue;
                }
            }
            if scatters && !kind.black {
                if kind.plain {
                    self.plain.push(ray as u32);
                } else {
                    self.detailed.push(ray as u32);
                }
            }
        }
        for at in (0..self.plain.len()).step_by(LANES) {
            self.plain_vertices(transport, at);
        }
        for at in (0..self.detailed.len()).step_by(LANES) {
            self.detailed_vertices(transport, at);
        }
        self.escapes(transport, depth, batch);
    }

    /// Vertices on surfaces without texture.
    #[inline(always)]
    fn plain_vertices(&mut self, transport: &Transport, at: usize) {
        let (rows, n) = eight_of(&self.plain, at);
        let bits = |column: &[u32]| load_bits(column, &rows).to_array();
        let (instance, mesh, prim) = (bits(&self.hits.instance), bits(&self.hits.mesh), bits(&self.hits.prim));
        let barycentric = (load(&self.hits.u, &rows), load(&self.hits.v, &rows));
        let points = transport.geometry.points(transport.scene, instance, mesh, prim, barycentric);
        let models = eight(|lane| transport.materials.plain(mesh[lane]));
        let lobes = if transport.materials.lambert { Lobes::gather_diffuse(models) } else { Lobes::gather(models) };
        let group = Group {
            position: points.position,
            ng: points.ng,
            ns: points.ns,
            direction: self.rays.directions(&rows),
            beta: self.paths.beta.load(&rows),
            origin_offset: points.origin_offset,
            lobes,
            path: self.path_of(&rows),
        };
        self.vertices.push(n, &group);
    }

    /// Vertices on surfaces that have to be looked up one by one.
    fn detailed_vertices(&mut self, transport: &Transport, at: usize) {
        let (rows, n) = eight_of(&self.detailed, at);
        let rays = match rows {
            Rows::From(start) => std::array::from_fn(|lane| (start + lane) as u32),
            Rows::Each(rays) => rays,
        };
        let points = rays.map(|ray| self.point(transport, ray as usize));
        let models = points.map(|p| MetallicRoughness::new(&p.parameters(transport.scene)));
        let group = Group {
            position: V3::gather(points.map(|p| p.position)),
            ng: V3::gather(points.map(|p| p.ng)),
            ns: V3::gather(points.map(|p| p.ns)),
            direction: self.rays.directions(&rows),
            beta: self.paths.beta.load(&rows),
            origin_offset: F::from(points.map(|p| p.origin_offset)),
            lobes: Lobes::gather(models.each_ref()),
            path: self.path_of(&rows),
        };
        self.vertices.push(n, &group);
    }

    /// Slot, index, child and seed of some rays.
    #[inline(always)]
    fn path_of(&self, rows: &Rows) -> [U; 4] {
        let p = &self.paths;
        [load_bits(&p.slot, rows), load_bits(&p.index, rows), load_bits(&p.child, rows), load_bits(&p.seed, rows)]
    }

    /// Where a ray hit.
    #[inline]
    fn point<'a>(&self, transport: &'a Transport, ray: usize) -> Point<'a> {
        let hits = &self.hits;
        let barycentric = (hits.u[ray], hits.v[ray]);
        transport.geometry.point(transport.scene, hits.instance[ray], hits.mesh[ray], hits.prim[ray], barycentric)
    }

    /// What a camera ray found, for the AOVs.
    fn aovs(&self, transport: &Transport, ray: usize, aovs: &mut [AovSums]) {
        let pixel = self.slots[self.paths.slot[ray] as usize].pixel as usize;
        let Some(aovs) = aovs.get_mut(pixel) else { return };
        let point = self.point(transport, ray);
        let toward = point.ng.dot(self.rays.direction(ray));
        let normal = point.ns.normalize_or_zero() * if toward > 0.0 { -1.0 } else { 1.0 };
        let albedo = point.base_color(transport.scene);
        for c in 0..3 {
            aovs.albedo[c] += albedo[c];
            aovs.normal[c] += normal[c];
        }
        aovs.depth += self.hits.t[ray];
        (aovs.object, aovs.material) = (self.hits.instance[ray] + 1, point.mesh.material + 1);
    }

    /// Light from the surface that a ray hit.
    fn shine(&mut self, transport: &Transport, depth: u32, ray: usize, batch: &mut PixelBatch) {
        let point = self.point(transport, ray);
        let material = point.material;
        if material.unlit {
            self.emitted(transport, batch, depth, ray, point.base_color(transport.scene), [0.0; 2]);
            return;
        }
        let direction = self.rays.direction(ray);
        if material.double_sided || point.ng.dot(direction) < 0.0 {
            let hit = (self.hits.instance[ray], self.hits.mesh[ray], self.hits.prim[ray]);
            let radiance = area::emission(transport.scene, point.mesh, hit.2, self.hits.u[ray], self.hits.v[ray]);
            let from = (self.rays.origin(ray), self.paths.normal.get(ray));
            let pdf = match depth {
                0 => 0.0,
                _ => transport.lights.area_pdf(from, hit, direction, self.hits.t[ray]),
            };
            self.emitted(transport, batch, depth, ray, radiance, [0.0, pdf]);
        }
    }

    /// Light from infinity along the rays that hit nothing.
    fn escapes(&mut self, transport: &Transport, depth: u32, batch: &mut PixelBatch) {
        if transport.lights.environment.is_none() {
            return;
        }
        for at in (0..self.escaped.len()).step_by(LANES) {
            let (rows, n) = eight_of(&self.escaped, at);
            let (radiance, pdf) = transport.lights.environment(self.rays.directions(&rows));
            for lane in 0..n {
                let pdf = if depth == 0 { 0.0 } else { pdf.as_array()[lane] };
                let ray = self.escaped[at + lane] as usize;
                self.emitted(transport, batch, depth, ray, radiance.lane(lane), [pdf, 0.0]);
            }
        }
    }

    /// Light that a ray of the batch found: weighed against having been sampled with the densities `light_pdf` (as the
    /// environment, as an area light).
    #[inline]
    fn emitted(
        &mut self,
        transport: &Transport,
        batch: &mut PixelBatch,
        depth: u32,
        ray: usize,
        radiance: Vec3,
        light_pdf: [f32; 2],
    ) {
        let slot = &mut self.slots[self.paths.slot[ray] as usize];
        let pixel = slot.pixel as usize;
        let weighted_pdf = self.paths.weighted_pdf[ray];
        let environment_probability = transport.lights.environment_probability;
        let [a_env, a_area, a_b] = if depth == 1 { slot.rates } else { Counts::half(1).rates(environment_probability) };
        // One of the two is zero.
        let weighted_light = a_env * light_pdf[0] + a_area * light_pdf[1];
        let weight = if weighted_light > 0.0 { transport.heuristic.weight(weighted_pdf, weighted_light) } else { 1.0 };
        let found = self.paths.beta.get(ray) * radiance * weight;
        if !found.is_finite() || found == Vec3::ZERO {
            return;
        }
        slot.radiance += found;
        if depth <= 1 {
            slot.direct += found;
        } else {
            self.children[self.paths.child[ray] as usize].indirect += found;
        }
        if depth == 1 && batch.observer.is_some() {
            let a_l = a_env + a_area;
            let (w, r) = observation(found, weighted_light / a_l, weighted_pdf / a_b, a_l / (a_l + a_b));
            let (index, area) = (self.paths.index[ray], self.splits[pixel].is_some() && light_pdf[1] > 0.0);
            let technique = Technique::Bsdf;
            batch.tell(pixel, Contribution { pixel: 0, technique, area, index, r, w, radiance: found });
        }
    }
}

/// Eight of some row numbers from `at` on, the first of them in spare lanes, and how many there are.
#[inline(always)]
fn eight_of(list: &[u32], at: usize) -> (Rows, usize) {
    let n = LANES.min(list.len() - at);
    let mut rows = [list[at]; LANES];
    rows[..n].copy_from_slice(&list[at..at + n]);
    let consecutive = n == LANES && rows[LANES - 1] == rows[0] + LANES as u32 - 1;
    (if consecutive { Rows::From(rows[0] as usize) } else { Rows::Each(rows) }, n)
}
