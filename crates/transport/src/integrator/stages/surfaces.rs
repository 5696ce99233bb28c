//! From hits to vertices: points on surfaces that scatter.

use glam::Vec3;

use super::eight_of;
use crate::bsdf::Surface;
use crate::integrator::Transport;
use crate::integrator::batch::PixelBatch;
use crate::integrator::dispersion;
use crate::integrator::geometry::Point;
use crate::integrator::path_states::{Mirror, PathStates};
use crate::integrator::queues::{Identity, PathRays, SortedHits};
use crate::integrator::velocity::velocity;
use crate::integrator::vertices::{Group, Scattering, Vertices};
use crate::lanes::{F, LANES, Rows, U, V3, eight, load, load_bits};
use crate::rays::{HitBatch, MISS};
use crate::sampling::samples;

/// Where a ray hit.
#[inline]
pub fn point<'a>(transport: &'a Transport, rays: &PathRays, hits: &HitBatch, ray: usize) -> Point<'a> {
    let (hit, barycentric) = ((hits.instance[ray], hits.mesh[ray], hits.prim[ray]), (hits.u[ray], hits.v[ray]));
    transport.geometry.point(transport.scene, hit, barycentric, rays.rays.time(ray))
}

/// Notes of camera rays that they hit something, and what, for the AOVs.
#[inline(never)]
pub fn observe(
    transport: &Transport,
    rays: &PathRays,
    hits: &HitBatch,
    path_states: &mut PathStates,
    batch: &mut PixelBatch,
) {
    for ray in (0..rays.len).filter(|&ray| hits.mesh[ray] != MISS) {
        let path = &mut path_states.paths[rays.path[ray] as usize];
        path.covered = true;
        let pixel = path.pixel as usize;
        let (aovs, extras) = (batch.aovs.get_mut(pixel), batch.extras.get_mut(pixel));
        if aovs.is_none() && extras.is_none() {
            continue;
        }
        let point = point(transport, rays, hits, ray);
        let (albedo, normal) = (point.base_color(transport.scene), facing(&point, rays, ray));
        let (instance, material) = (hits.instance[ray], point.mesh.material);
        if let Some(aovs) = aovs {
            aovs.add_surface(albedo, normal, hits.t[ray]);
            (aovs.object, aovs.material) = (instance + 1, material + 1);
        }
        if let Some(extras) = extras {
            let names = [transport.names.objects[instance as usize], transport.names.materials[material as usize]];
            extras.add_surface(point.position, point.texcoords[0], names);
            if transport.geometry.has_velocities {
                let hit = (instance, hits.mesh[ray], hits.prim[ray]);
                extras.add_velocity(velocity(transport, hit, (hits.u[ray], hits.v[ray])));
            }
            if is_mirror(transport, &point) {
                path_states.mirrors[rays.path[ray] as usize] = Some(Mirror { tint: albedo, normal, depth: 0 });
            } else {
                extras.add_guide(albedo, normal);
            }
        }
    }
}

/// The shading normal on the side of the ray.
fn facing(point: &Point, rays: &PathRays, ray: usize) -> Vec3 {
    let toward = point.ng.dot(rays.rays.direction(ray));
    point.ns.normalize_or_zero() * if toward > 0.0 { -1.0 } else { 1.0 }
}

/// Does it show others rather than itself: a metal so smooth that reflections have edges?
fn is_mirror(transport: &Transport, point: &Point) -> bool {
    // Textures only take away.
    let metal = point.material.metallic > 0.9 && !point.material.unlit;
    metal && {
        let surface = point.parameters(transport.scene);
        surface.metallic > 0.9 && surface.roughness < 0.15
    }
}

/// Looks for the guides of paths whose camera ray hit a mirror, where rays of their first reflections hit.
#[inline(never)]
pub fn follow_mirrors(
    transport: &Transport,
    depth: u32,
    rays: &PathRays,
    hits: &HitBatch,
    path_states: &mut PathStates,
    batch: &mut PixelBatch,
) {
    for ray in 0..rays.len {
        let path = rays.path[ray] as usize;
        // One reflection speaks for a path: the first that hits.
        let waiting = path_states.mirrors.get(path).copied().flatten();
        let Some(mirror) = waiting.filter(|mirror| mirror.depth + 1 == depth) else { continue };
        let Some(extras) = batch.extras.get_mut(path_states.paths[path].pixel as usize) else { continue };
        if hits.mesh[ray] == MISS {
            continue;
        }
        let point = point(transport, rays, hits, ray);
        let tint = mirror.tint * point.base_color(transport.scene);
        if is_mirror(transport, &point) {
            path_states.mirrors[path] = Some(Mirror { tint, depth, ..mirror });
        } else {
            path_states.mirrors[path] = None;
            extras.add_guide(tint, facing(&point, rays, ray));
        }
    }
}

/// Fills the vertices with the surfaces that scatter, of paths that are guided if a field does or `learns` from them.
pub fn vertices(
    transport: &Transport,
    learns: bool,
    sorted: &SortedHits,
    rays: &PathRays,
    hits: &HitBatch,
    vertices: &mut Vertices,
) {
    let guided = learns || transport.field.is_some();
    let Transport { geometry, materials, .. } = transport;
    vertices.open(rays.len, materials.lobes, materials.absorbs(), guided, geometry.moves);
    for at in (0..sorted.plain.len()).step_by(LANES) {
        plain(transport, &sorted.plain, at, rays, hits, vertices);
    }
    for at in (0..sorted.detailed.len()).step_by(LANES) {
        detailed(transport, &sorted.detailed, at, rays, hits, vertices);
    }
}

/// Vertices on surfaces without texture.
#[inline(always)]
fn plain(transport: &Transport, list: &[u32], at: usize, rays: &PathRays, hits: &HitBatch, vertices: &mut Vertices) {
    let (rows, n) = eight_of(list, at);
    let bits = |column: &[u32]| load_bits(column, &rows).to_array();
    let (instance, mesh, prim) = (bits(&hits.instance), bits(&hits.mesh), bits(&hits.prim));
    let barycentric = (load(&hits.u, &rows), load(&hits.v, &rows));
    let points = transport.geometry.points(transport.scene, instance, mesh, prim, barycentric);
    let direction = rays.rays.directions(&rows);
    let behind = match transport.materials.transmits {
        true => points.ng.dot(direction).simd_gt(F::ZERO).to_bitmask(),
        false => 0,
    };
    let behind = |lane: usize| behind >> lane & 1 == 1;
    let group = Group {
        position: points.position,
        ng: points.ng,
        ns: points.ns,
        direction,
        beta: rays.beta.load(&rows),
        origin_offset: points.origin_offset,
        bsdfs: Scattering::Any(eight(|lane| transport.materials.plain(mesh[lane], behind(lane)))),
        media: media(transport, rays, &rows, mesh, behind),
        identity: identity(rays, &rows),
    };
    vertices.push(n, &group);
}

/// Vertices on surfaces that have to be looked up one by one.
fn detailed(transport: &Transport, list: &[u32], at: usize, rays: &PathRays, hits: &HitBatch, vertices: &mut Vertices) {
    let (rows, n) = eight_of(list, at);
    let each = match rows {
        Rows::From(start) => std::array::from_fn(|lane| (start + lane) as u32),
        Rows::Each(rows) => rows,
    };
    let points = each.map(|ray| point(transport, rays, hits, ray as usize));
    let place = |beta, bsdfs, behind: &dyn Fn(usize) -> bool| Group {
        position: V3::gather(points.map(|p| p.position)),
        ng: V3::gather(points.map(|p| p.ng)),
        ns: V3::gather(points.map(|p| p.ns)),
        direction: rays.rays.directions(&rows),
        beta,
        origin_offset: F::from(points.map(|p| p.origin_offset)),
        bsdfs,
        media: media(transport, rays, &rows, each.map(|ray| hits.mesh[ray as usize]), behind),
        identity: identity(rays, &rows),
    };
    let beta = rays.beta.load(&rows);
    if vertices.core().is_some() {
        let cores = eight(|lane| points[lane].core(transport.scene));
        let group = place(beta, Scattering::Core(cores.each_ref()), &|_| false);
        return vertices.push(n, &group);
    }
    let seen = eight(|lane| points[lane].seen(transport.scene, rays.rays.direction(each[lane] as usize)));
    let (seen, beta) =
        if transport.materials.disperses { of_one_color(&points, seen, beta, rays, &rows) } else { (seen, beta) };
    let bsdfs = eight(|lane| seen[lane].bsdf());
    let group = place(beta, Scattering::Any(bsdfs.each_ref()), &|lane| seen[lane].behind);
    vertices.push(n, &group);
}

/// Surfaces that bend light by its colour, as one channel of their paths meets them.
#[inline(never)]
fn of_one_color(
    points: &[Point; LANES],
    mut seen: [Surface; LANES],
    beta: V3,
    rays: &PathRays,
    rows: &Rows,
) -> ([Surface; LANES], V3) {
    let [number, ..] = samples(load_bits(&rays.seed, rows), load_bits(&rays.index, rows), dispersion::SET);
    let beta = eight(|lane| {
        let (surface, beta) =
            dispersion::draw(seen[lane], points[lane].material, beta.lane(lane), number.as_array()[lane]);
        seen[lane] = surface;
        beta
    });
    (seen, V3::gather(beta))
}

/// The media on both sides of eight hits' surfaces, if any absorb.
#[inline(always)]
fn media(
    transport: &Transport,
    rays: &PathRays,
    rows: &Rows,
    mesh: [u32; LANES],
    behind: impl Fn(usize) -> bool,
) -> [U; 2] {
    if !transport.materials.absorbs() {
        return [U::ZERO; 2];
    }
    let medium = load_bits(&rays.medium, rows).to_array();
    let sides = eight(|lane| transport.materials.sides(mesh[lane], behind(lane), medium[lane]));
    [0, 1].map(|side| U::from(eight(|lane| sides[lane][side])))
}

#[inline(always)]
fn identity(rays: &PathRays, rows: &Rows) -> Identity {
    Identity {
        path: load_bits(&rays.path, rows),
        index: load_bits(&rays.index, rows),
        sub_path: load_bits(&rays.sub_path, rows),
        seed: load_bits(&rays.seed, rows),
        time: rays.rays.times(rows),
    }
}
