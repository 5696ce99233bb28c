//! Primitives under KHR_draco_mesh_compression.

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};

use super::{damaged, guarded};
use crate::error::Result;
use crate::scene::import::complaint::bad;
use crate::scene::import::document::Document;
use crate::scene::import::document::accessors::{Accessor, Component};
use crate::scene::import::document::draco::Draco;
use crate::scene::import::document::primitives::Primitive;

/// Largest decoded size of a vertex: sixteen attributes of four doubles.
const MAX_BYTES_PER_VERTEX: u64 = 512;

/// Tightly packed elements of the primitive's accessors, by accessor index.
/// Errors: A damaged stream, or one that does not match the accessors.
pub fn decode(
    document: &Document,
    primitive: &Primitive,
    draco: &Draco,
    stream: &[u8],
) -> Result<Vec<(usize, Vec<u8>)>> {
    let accessor = |index: usize| document.accessors.get(index);
    let corners = primitive.indices.map(|index| Ok(accessor(index)?.count)).transpose()?;
    let vertices = primitive.attributes.values().next().map(|&index| Ok(accessor(index)?.count)).transpose()?;
    let vertices = vertices.unwrap_or(0);
    let mesh = guarded(|| {
        let limits = DecodeLimits::default()
            .with_max_points(vertices)
            .with_max_faces(corners.unwrap_or(vertices) / 3)
            .with_max_decoded_bytes(vertices * MAX_BYTES_PER_VERTEX);
        let mut mesh = Mesh::new();
        MeshDecoder::new().decode(&mut DecoderBuffer::new(stream).with_limits(limits), &mut mesh)?;
        Ok::<_, draco_core::DracoError>(mesh)
    })
    .map_err(|why| damaged(&draco.at, "Draco stream", &why))?;
    if mesh.num_points() as u64 != vertices || corners.is_some_and(|n| n != 3 * mesh.num_faces() as u64) {
        let wanted = format!("{vertices} vertices and {} triangles, as the accessors say", corners.unwrap_or(0) / 3);
        return Err(bad(&draco.at, wanted, format!("{} and {}", mesh.num_points(), mesh.num_faces())));
    }
    let mut out = Vec::new();
    if let Some(index) = primitive.indices {
        let component = accessor(index)?.component;
        let corners = mesh.faces().iter().flatten().map(|point| point.0);
        let bytes = corners.flat_map(|i| i.to_le_bytes().into_iter().take(component.size()));
        out.push((index, bytes.collect()));
    }
    for (semantic, &id) in &draco.attributes {
        let Some(&index) = primitive.attributes.get(semantic) else { continue };
        let to = accessor(index)?;
        let Some(from) = mesh.attribute_by_unique_id(id) else {
            return Err(bad(&draco.at, format!("an attribute {id} in the stream"), "none"));
        };
        out.push((index, packed(from, to, mesh.num_points(), &draco.at)?));
    }
    Ok(out)
}

/// An attribute's values per vertex, in the accessor's format.
fn packed(from: &PointAttribute, to: &Accessor, points: usize, at: &str) -> Result<Vec<u8>> {
    let component = match from.data_type() {
        DataType::Int8 => Some(Component::I8),
        DataType::Uint8 => Some(Component::U8),
        DataType::Int16 => Some(Component::I16),
        DataType::Uint16 => Some(Component::U16),
        DataType::Uint32 => Some(Component::U32),
        DataType::Float32 => Some(Component::F32),
        _ => None,
    };
    let size = to.element_bytes() as usize;
    let width = u64::from(from.num_components()) * to.component.size() as u64;
    if component != Some(to.component) || width != size as u64 {
        let found = format!("{} of {:?} in the Draco stream", from.num_components(), from.data_type());
        return Err(bad(&to.at, to.format(), found));
    }
    let (data, stride) = (from.buffer().data(), from.byte_stride() as usize);
    let mut out = Vec::with_capacity(points * size);
    for point in 0..points as u32 {
        let start = (from.mapped_index(PointIndex(point)).0 as usize).saturating_mul(stride);
        let value = data.get(start..start.saturating_add(size));
        out.extend(value.ok_or_else(|| bad(at, "a value for every vertex", format!("none for vertex {point}")))?);
    }
    Ok(out)
}
