//! Vertices on scattering surfaces from hits.

use glam::Vec3;

use super::eight_of;
use crate::bsdf::Surface;
use crate::integrator::data::dimensions;
use crate::integrator::data::queues::{PathRays, SortedHits};
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::{BsdfPacket, VertexPacket, Vertices};
use crate::integrator::surface::dispersion;
use crate::integrator::surface::geometry::SurfacePoint;
use crate::lanes::{F, LANES, NUMBERS, Rows, U, V3, eight, load, load_bits};
use crate::rays::HitBatch;
use crate::sampling::samples;
use crate::scene::Primitive;

/// Fills the vertices with hits on scattering surfaces. There are guiding columns if there is a field.
pub fn vertices(transport: &Transport, sorted: &SortedHits, rays: &PathRays, hits: &HitBatch, vertices: &mut Vertices) {
    let guiding = transport.proposal.field.is_some();
    let Transport { geometry, materials, .. } = transport;
    vertices.open(rays.len, materials.lobes, materials.tracks_media, guiding, geometry.moves);
    for at in (0..sorted.constant.len()).step_by(LANES) {
        constant(transport, &sorted.constant, at, rays, hits, vertices);
    }
    for at in (0..sorted.varying.len()).step_by(LANES) {
        varying(transport, &sorted.varying, at, rays, hits, vertices);
    }
}

/// Appends vertices on surfaces with a constant BSDF.
#[inline(always)]
fn constant(transport: &Transport, list: &[u32], at: usize, rays: &PathRays, hits: &HitBatch, vertices: &mut Vertices) {
    let (rows, n) = eight_of(list, at);
    let bits = |column: &[u32]| load_bits(column, &rows).to_array();
    let (instance, mesh, prim) = (bits(&hits.instance), bits(&hits.mesh), bits(&hits.prim));
    let barycentric = (load(&hits.u, &rows), load(&hits.v, &rows));
    let points = transport.geometry.points(transport.scene, instance, mesh, prim, barycentric);
    let direction = rays.rays.directions(&rows);
    let back_facing = match transport.materials.transmits {
        true => points.ng.dot(direction).simd_gt(F::ZERO).to_bitmask(),
        false => 0,
    };
    let back_facing = |lane: usize| back_facing >> lane & 1 == 1;
    let packet = VertexPacket {
        position: points.position,
        ng: points.ng,
        ns: points.ns,
        direction,
        beta: rays.beta.load(&rows),
        origin_offset: points.origin_offset,
        bsdfs: BsdfPacket::Any(eight(|lane| transport.materials.constant_bsdf(mesh[lane], back_facing(lane)))),
        media: media(transport, rays, &rows, n, |lane| {
            let hit = Primitive { instance: instance[lane], mesh: mesh[lane], prim: prim[lane] };
            (hit, points.position.lane(lane), points.ng.lane(lane), points.origin_offset.as_array()[lane])
        }),
        path_ids: rays.path_ids(&rows),
        ray: numbers(rays, &rows),
    };
    vertices.push(n, &packet);
}

/// Appends vertices on surfaces whose BSDF is evaluated point by point.
fn varying(transport: &Transport, list: &[u32], at: usize, rays: &PathRays, hits: &HitBatch, vertices: &mut Vertices) {
    let (rows, n) = eight_of(list, at);
    let each = match rows {
        Rows::From(start) => std::array::from_fn(|lane| (start + lane) as u32),
        Rows::Each(rows) => rows,
    };
    let points = each.map(|ray| transport.point(&rays.rays, hits, ray as usize));
    let media = media(transport, rays, &rows, n, |lane| {
        let point = &points[lane];
        (hits.primitive(each[lane] as usize), point.position, point.ng, point.origin_offset)
    });
    let packet_of = |beta, bsdfs| VertexPacket {
        position: V3::gather(points.map(|p| p.position)),
        ng: V3::gather(points.map(|p| p.ng)),
        ns: V3::gather(points.map(|p| p.ns)),
        direction: rays.rays.directions(&rows),
        beta,
        origin_offset: F::from(points.map(|p| p.origin_offset)),
        bsdfs,
        media,
        path_ids: rays.path_ids(&rows),
        ray: numbers(rays, &rows),
    };
    let beta = rays.beta.load(&rows);
    if vertices.core().is_some() {
        let cores = eight(|lane| points[lane].core(transport.scene));
        let packet = packet_of(beta, BsdfPacket::Core(cores.each_ref()));
        return vertices.push(n, &packet);
    }
    let seen = eight(|lane| points[lane].surface_from(transport.scene, rays.rays.direction(each[lane] as usize)));
    let (seen, beta) =
        if transport.materials.disperses { disperse(&points, seen, beta, rays, &rows) } else { (seen, beta) };
    let bsdfs = eight(|lane| {
        let stacks = media.map(|side| side.to_array()[lane]);
        transport.materials.relative(seen[lane], hits.mesh[each[lane] as usize], stacks).bsdf()
    });
    let packet = packet_of(beta, BsdfPacket::Any(bsdfs.each_ref()));
    vertices.push(n, &packet);
}

/// Applies dispersion: surfaces and throughputs of the colour channel that each path chooses.
#[inline(never)]
fn disperse(
    points: &[SurfacePoint; LANES],
    mut seen: [Surface; LANES],
    beta: V3,
    rays: &PathRays,
    rows: &Rows,
) -> ([Surface; LANES], V3) {
    let [number, ..] = samples(load_bits(&rays.seed, rows), load_bits(&rays.index, rows), dimensions::CHANNEL);
    let beta = eight(|lane| {
        let (surface, beta) =
            dispersion::sample_channel(seen[lane], points[lane].material, beta.lane(lane), number.as_array()[lane]);
        seen[lane] = surface;
        beta
    });
    (seen, V3::gather(beta))
}

/// The media on the side of `wo` and beyond the surface at `n` of eight hits; zero if rays track none. `point` is a triangle, a point on it,
/// its geometric normal, and the offset of ray origins.
#[inline(always)]
fn media(
    transport: &Transport,
    rays: &PathRays,
    rows: &Rows,
    n: usize,
    point: impl Fn(usize) -> (Primitive, Vec3, Vec3, f32),
) -> [U; 2] {
    if !transport.materials.tracks_media {
        return [U::ZERO; 2];
    }
    let (media, direction, time) = (load_bits(&rays.medium, rows), rays.rays.directions(rows), rays.rays.times(rows));
    let (media, time) = (media.to_array(), time.to_array());
    let sides = eight(|lane| {
        if lane >= n {
            return [0; 2];
        }
        let (hit, position, ng, offset) = point(lane);
        transport.media_at_hit(hit, media[lane], (direction.lane(lane), time[lane]), (position, ng, offset))
    });
    [0, 1].map(|side| U::from(eight(|lane| sides[lane][side])))
}

/// Numbers in the wave of eight rays.
#[inline(always)]
fn numbers(rays: &PathRays, rows: &Rows) -> U {
    let rows = match rows {
        Rows::From(first) => U::splat(*first as u32) + U::from(NUMBERS),
        Rows::Each(rows) => U::from(*rows),
    };
    U::splat(rays.first) + rows
}
