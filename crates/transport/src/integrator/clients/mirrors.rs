//! Guides of the denoiser (albedo, normal): those of the first surface of a path that is no mirror and no window pane.

use glam::Vec3;

use crate::film::ExtraSums;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::PathRays;
use crate::integrator::data::transport::Transport;
use crate::integrator::surface::geometry::SurfacePoint;
use crate::rays::{HitBatch, MISS};

/// The chains of mirrors at the start of paths, a part of [`Aovs`](crate::integrator::clients::Aovs).
#[derive(Debug, Default)]
pub struct MirrorChains {
    /// By path, the chain whose end is still to be found.
    open: Vec<Option<MirrorVertex>>,
}

/// The last vertex of a chain of mirrors.
#[derive(Debug, Clone, Copy)]
struct MirrorVertex {
    /// Product of the base colours of the chain.
    tint: Vec3,
    /// Shading normal of the first mirror, on the camera's side.
    normal: Vec3,
    /// Depth at which the chain goes on: that of the next rays, or of the camera rays that have passed walls.
    next: u32,
}

impl MirrorChains {
    /// A wave of `paths` begins.
    pub fn begin(&mut self, paths: usize) {
        self.open.clear();
        self.open.resize(paths, None);
    }

    /// A path's first hit, with its guides: begins a chain at a mirror.
    #[inline]
    pub(crate) fn first_hit(
        &mut self,
        at: &WaveContext,
        path: u32,
        point: &SurfacePoint,
        (albedo, normal): (Vec3, Vec3),
        extras: &mut ExtraSums,
    ) {
        let mirrors = is_mirror(at.transport, point);
        if mirrors || is_pane(at.transport, point) {
            self.open[path as usize] = Some(MirrorVertex { tint: albedo, normal, next: mirrors.into() });
        } else {
            extras.add_guide(albedo, normal);
        }
    }

    /// Later hits: records the guides of the first other surface.
    #[inline(never)]
    pub fn follow(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch, extras: &mut [ExtraSums]) {
        for ray in 0..rays.len {
            let path = rays.path[ray];
            let open = &mut self.open[path as usize];
            // Of several reflected rays, only the first that hits counts.
            let Some(mirror) = open.filter(|mirror| mirror.next == at.depth) else { continue };
            if at.depth == 0 && !rays.passed_wall[ray] {
                *open = Some(MirrorVertex { next: 1, ..mirror });
                continue;
            }
            if hits.mesh[ray] == MISS {
                continue;
            }
            let point = at.transport.point(&rays.rays, hits, ray);
            let tint = mirror.tint * point.base_color(at.transport.scene);
            if is_mirror(at.transport, &point) || is_pane(at.transport, &point) {
                *open = Some(MirrorVertex { tint, next: at.depth + 1, ..mirror });
            } else {
                *open = None;
                extras[at.pixel(path)].add_guide(tint, facing_normal(&point, rays, ray));
            }
        }
    }

    /// All paths have ended. The guide of a chain that reached no other surface is its first mirror.
    pub fn end(&self, at: &WaveContext, extras: &mut [ExtraSums]) {
        for (path, mirror) in at.paths.iter().zip(&self.open) {
            if let Some(mirror) = mirror {
                extras[path.pixel as usize].add_guide(mirror.tint, mirror.normal);
            }
        }
    }
}

/// Unit shading normal on the side of the ray origin.
pub(crate) fn facing_normal(point: &SurfacePoint, rays: &PathRays, ray: usize) -> Vec3 {
    let cos = point.ng.dot(rays.rays.direction(ray));
    point.ns.normalize_or_zero() * if cos > 0.0 { -1.0 } else { 1.0 }
}

/// Is the surface a clear window pane?
fn is_pane(transport: &Transport, point: &SurfacePoint) -> bool {
    transport.materials.has_thin_walls && point.material.transmission > 0.9 && !point.material.unlit && {
        let surface = point.parameters(transport.scene);
        surface.transmission > 0.9 && surface.metallic < 0.1 && surface.is_smooth_wall()
    }
}

/// Is the surface a mirror: metal with a roughness so low that reflections have sharp edges?
fn is_mirror(transport: &Transport, point: &SurfacePoint) -> bool {
    // Textures only lower the metalness.
    let metal = point.material.metallic > 0.9 && !point.material.unlit;
    metal && {
        let surface = point.parameters(transport.scene);
        surface.metallic > 0.9 && surface.roughness < 0.15
    }
}
