//! Buffer views and accessors, with checks that all elements lie inside their buffers.

pub use gltf::json::accessor::{ComponentType as Component, Type as Shape};

use super::buffers::Buffer;
use super::json::Json;
use super::meshopt::Meshopt;
use super::table::Table;
use crate::error::Result;
use crate::scene::import::complaint::bad;

/// What to say of `normalized` where it means nothing.
pub(crate) const NOT_NORMALIZED: &str = "normalized, which means nothing here";

/// A range of a buffer.
#[derive(Debug)]
pub struct View {
    pub buffer: usize,
    pub offset: u64,
    pub length: u64,
    pub stride: Option<u64>,
    /// Compressed source of the bytes, if the buffer has no data.
    pub compressed: Option<Meshopt>,
    pub at: String,
}

impl View {
    pub fn parse(json: &Json, buffers: &Table<Buffer>) -> Result<Self> {
        let buffer = json.need("buffer", json.index("buffer", "buffers")?)?;
        let offset = json.integer("byteOffset")?.unwrap_or(0);
        let length = json.need("byteLength", json.integer("byteLength")?)?;
        if length == 0 {
            return Err(json.bad("byteLength", "at least 1", 0));
        }
        let stride = json.integer("byteStride")?;
        if let Some(stride) = stride.filter(|s| !(4..=252).contains(s) || s % 4 != 0) {
            // None, or the size of elements of one or two bytes a number.
            if ![0, 1, 2, 3, 6].contains(&stride) {
                return Err(json.bad("byteStride", "a multiple of 4 from 4 to 252", stride));
            }
            json.repaired("byteStride", "no multiple of 4 from 4 to 252: used as it is, and 0 as none");
        }
        let stride = stride.filter(|stride| *stride > 0);
        let compressed = match buffers.get(buffer) {
            Ok(buffer) if buffer.has_data() => None,
            _ => Meshopt::parse(json)?,
        };
        if compressed.is_none() {
            let whole = buffers.get(buffer)?.length;
            if offset.checked_add(length).is_none_or(|end| end > whole) {
                let wanted = format!("a range within the {whole} bytes of buffers[{buffer}]");
                return Err(bad(&json.at, wanted, format!("{length} bytes from byte {offset}")));
            }
        }
        Ok(Self { buffer, offset, length, stride, compressed, at: json.at.clone() })
    }
}

fn parse_component(json: &Json) -> Result<Component> {
    Ok(match json.need("componentType", json.integer("componentType")?)? {
        5120 => Component::I8,
        5121 => Component::U8,
        5122 => Component::I16,
        5123 => Component::U16,
        5125 => Component::U32,
        5126 => Component::F32,
        other => return Err(json.bad("componentType", "5120, 5121, 5122, 5123, 5125 or 5126", other)),
    })
}

fn component_name(component: Component) -> &'static str {
    match component {
        Component::I8 => "BYTE",
        Component::U8 => "UNSIGNED_BYTE",
        Component::I16 => "SHORT",
        Component::U16 => "UNSIGNED_SHORT",
        Component::U32 => "UNSIGNED_INT",
        Component::F32 => "FLOAT",
    }
}

fn parse_shape(json: &Json) -> Result<Shape> {
    Ok(match json.need("type", json.string("type")?)? {
        "SCALAR" => Shape::Scalar,
        "VEC2" => Shape::Vec2,
        "VEC3" => Shape::Vec3,
        "VEC4" => Shape::Vec4,
        "MAT2" => Shape::Mat2,
        "MAT3" => Shape::Mat3,
        "MAT4" => Shape::Mat4,
        other => return Err(json.bad("type", "SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4", other)),
    })
}

/// Sparse storage: elements that replace those of the view.
#[derive(Debug)]
pub struct Sparse {
    pub count: u64,
    pub index_view: usize,
    pub index_offset: u64,
    pub index_component: Component,
    pub value_view: usize,
    pub value_offset: u64,
}

/// A checked accessor: its elements lie inside their views.
#[derive(Debug)]
pub struct Accessor {
    pub view: Option<usize>,
    pub offset: u64,
    pub component: Component,
    pub shape: Shape,
    pub normalized: bool,
    pub count: u64,
    pub sparse: Option<Sparse>,
    pub at: String,
}

impl Accessor {
    pub fn parse(json: &Json, views: &Table<View>) -> Result<Self> {
        let component = parse_component(json)?;
        let shape = parse_shape(json)?;
        let count = json.need("count", json.integer("count")?)?;
        if count == 0 {
            return Err(json.bad("count", "at least 1", 0));
        }
        let mut normalized = json.boolean("normalized", false)?;
        if normalized && matches!(component, Component::U32 | Component::F32) {
            json.repaired("normalized", NOT_NORMALIZED);
            normalized = false;
        }
        let view = json.index("bufferView", "bufferViews")?;
        let offset = json.integer("byteOffset")?.unwrap_or(0);
        let accessor = Self { view, offset, component, shape, normalized, count, sparse: None, at: json.at.clone() };
        if let Some(view) = view {
            let view = views.get(view)?;
            let alignment = if accessor.columns() > 1 { 4 } else { component.size() as u64 };
            check_range(json, view, offset, count, accessor.stride(view), accessor.element_bytes(), alignment)?;
        }
        let sparse = json.get("sparse")?.map(|sparse| parse_sparse(&sparse, &accessor, views)).transpose()?;
        Ok(Self { sparse: sparse.flatten(), ..accessor })
    }

    /// Number of columns of an element; above 1 for matrices.
    fn columns(&self) -> usize {
        match self.shape {
            Shape::Mat2 => 2,
            Shape::Mat3 => 3,
            Shape::Mat4 => 4,
            _ => 1,
        }
    }

    /// Columns of matrices start at multiples of 4 bytes.
    pub(crate) fn element_bytes(&self) -> u64 {
        let column = self.shape.multiplicity() / self.columns() * self.component.size();
        ((self.columns() - 1) * column.next_multiple_of(4) + column) as u64
    }

    pub fn stride(&self, view: &View) -> u64 {
        view.stride.unwrap_or_else(|| self.element_bytes())
    }

    /// `VEC3 of FLOAT`, for messages.
    pub fn format(&self) -> String {
        let normalized = if self.normalized { "normalized " } else { "" };
        format!("{} of {normalized}{}", format!("{:?}", self.shape).to_uppercase(), component_name(self.component))
    }
}

/// Checks that a member's view has no stride, or the size in bytes of what lies in it.
pub(crate) fn check_tight(json: &Json, key: &str, view: &View, size: u64) -> Result<()> {
    match view.stride {
        None => {}
        Some(stride) if stride == size => {
            json.repaired(key, "a byteStride, which such data does not have, of the elements' own size");
        }
        Some(_) => return Err(json.bad(key, "a view without byteStride", &view.at)),
    }
    Ok(())
}

/// Checks that `count` elements of `size` bytes, `stride` bytes apart from `offset`, lie inside the view; notes those that are not
/// aligned.
fn check_range(
    json: &Json,
    view: &View,
    offset: u64,
    count: u64,
    stride: u64,
    size: u64,
    alignment: u64,
) -> Result<()> {
    let bad = |wanted: String, found: String| Err(json.bad("byteOffset", wanted, found));
    if stride < size {
        return bad(format!("a stride of at least {size} bytes in {}", view.at), stride.to_string());
    }
    if !offset.is_multiple_of(alignment) || !view.offset.is_multiple_of(alignment) {
        json.repaired("byteOffset", "data that is not aligned to the size of its numbers");
    }
    let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size)).and_then(|n| n.checked_add(offset));
    if end.is_none_or(|end| end > view.length) {
        let found = format!("elements up to byte {}", end.map_or("2^64".into(), |end| end.to_string()));
        return bad(format!("{count} elements of {size} bytes within the {} bytes of {}", view.length, view.at), found);
    }
    Ok(())
}

/// `None` if it replaces no element.
fn parse_sparse(json: &Json, accessor: &Accessor, views: &Table<View>) -> Result<Option<Sparse>> {
    let count = json.need("count", json.integer("count")?)?;
    if count == 0 {
        json.repaired("count", "sparse storage of 0 elements changes nothing");
        return Ok(None);
    }
    if count > accessor.count {
        return Err(json.bad("count", format!("1 to {}", accessor.count), count));
    }
    let part = |key: &str| -> Result<(Json, usize, u64)> {
        let part = json.need(key, json.get(key)?)?;
        let view = part.need("bufferView", part.index("bufferView", "bufferViews")?)?;
        let offset = part.integer("byteOffset")?.unwrap_or(0);
        Ok((part, view, offset))
    };
    let (indices, index_view, index_offset) = part("indices")?;
    let index_component = parse_component(&indices)?;
    if !matches!(index_component, Component::U8 | Component::U16 | Component::U32) {
        return Err(indices.bad("componentType", "5121, 5123 or 5125", component_name(index_component)));
    }
    let size = index_component.size() as u64;
    check_tight(&indices, "bufferView", views.get(index_view)?, size)?;
    check_range(&indices, views.get(index_view)?, index_offset, count, size, size, size)?;
    let (values, value_view, value_offset) = part("values")?;
    let size = accessor.element_bytes();
    check_tight(&values, "bufferView", views.get(value_view)?, size)?;
    check_range(&values, views.get(value_view)?, value_offset, count, size, size, accessor.component.size() as u64)?;
    Ok(Some(Sparse { count, index_view, index_offset, index_component, value_view, value_offset }))
}
