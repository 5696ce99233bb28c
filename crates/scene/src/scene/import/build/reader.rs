//! Reads the elements of accessors, within a memory budget.

use std::collections::HashMap;

use bytes::Bytes;
use rayon::prelude::*;

use super::decode::{draco, meshopt};
use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;
use crate::scene::import::document::Document;
use crate::scene::import::document::accessors::{Accessor, Component, Shape, Sparse};
use crate::scene::import::document::draco::Draco;
use crate::scene::import::document::primitives::Primitive;

/// Memory that a file may still use. Hostile files declare far more data than they contain.
#[derive(Debug, Clone)]
pub struct Budget {
    left: u64,
    whole: u64,
    file_bytes: u64,
}

impl Budget {
    /// A budget of `base` bytes plus `factor` times the file's size.
    pub fn new(base: u64, factor: u64, file_bytes: u64) -> Self {
        let whole = base.saturating_add(file_bytes.saturating_mul(factor));
        Self { left: whole, whole, file_bytes }
    }

    /// The budget for geometry: 256 MiB plus 64 times the file's size, as quantized, indexed and shared data expands.
    pub(crate) fn for_data(file_bytes: u64) -> Self {
        Self::new(256 << 20, 64, file_bytes)
    }

    /// Takes `count` times `size` bytes.
    /// Errors: When fewer are left.
    pub fn take(&mut self, at: &str, count: u64, size: u64) -> Result<()> {
        let left = count.checked_mul(size).and_then(|bytes| self.left.checked_sub(bytes));
        self.left = left.ok_or_else(|| {
            Error::Data(format!(
                "{at}: asks for {count} elements of {size} bytes; with what was read before that is more than the {} \
                 MiB that a file of {} bytes may unfold to; is the file damaged?",
                self.whole >> 20,
                self.file_bytes
            ))
        })?;
        Ok(())
    }
}

/// Largest number of elements of an accessor that has no data, whose elements are zeros unless sparse ones replace them. A
/// count costs a file nothing.
const MAX_WITHOUT_DATA: u64 = 1 << 20;

pub struct Reader<'a> {
    pub document: &'a Document,
    pub budget: Budget,
    /// Decoded meshopt views, by index.
    views: HashMap<usize, Result<Bytes>>,
    /// Draco streams that were decoded, by view, or their errors.
    streams: HashMap<usize, Result<()>>,
    /// Tightly packed elements of accessors from Draco streams, with the view of the stream.
    unpacked: HashMap<usize, (usize, Bytes)>,
}

impl<'a> Reader<'a> {
    pub fn new(document: &'a Document, file_bytes: u64) -> Self {
        let budget = Budget::for_data(file_bytes);
        Self { document, budget, views: HashMap::new(), streams: HashMap::new(), unpacked: HashMap::new() }
    }

    /// Decodes the compressed data of these primitives on all cores. Damaged data is an error where it is read.
    /// Errors: Too much memory.
    pub fn unpack<'p>(&mut self, primitives: impl Iterator<Item = &'p Primitive> + Clone) -> Result<()> {
        let document = self.document;
        let accessors = primitives.clone().flat_map(|p| p.attributes.values().chain(&p.indices).copied());
        let views = accessors.filter_map(|index| document.accessors.get(index).ok()?.view);
        let streams: Vec<_> = primitives.filter_map(|p| Some((p, p.draco.as_ref()?))).collect();
        let mut waiting: Vec<usize> = views.chain(streams.iter().map(|(_, draco)| draco.view)).collect();
        waiting.sort_unstable();
        waiting.dedup();
        waiting.retain(|index| !self.views.contains_key(index));
        self.decode_views(&waiting)?;

        let mut jobs: Vec<(&Primitive, &Draco, Bytes)> = Vec::new();
        for (primitive, draco) in streams {
            if self.streams.contains_key(&draco.view) {
                continue;
            }
            let elements = primitive.attributes.values().chain(&primitive.indices);
            for accessor in elements.filter_map(|&index| document.accessors.get(index).ok()) {
                self.budget.take(&accessor.at, accessor.count, accessor.element_bytes())?;
            }
            match self.view_bytes(draco.view, 0) {
                Ok(stream) => {
                    self.streams.insert(draco.view, Ok(()));
                    jobs.push((primitive, draco, stream));
                }
                Err(error) => drop(self.streams.insert(draco.view, Err(error))),
            }
        }
        let decoded: Vec<_> = jobs.par_iter().map(|(p, d, stream)| draco::decode(document, p, d, stream)).collect();
        for ((_, draco, _), decoded) in jobs.into_iter().zip(decoded) {
            match decoded {
                Ok(accessors) => {
                    let found = accessors.into_iter().map(|(index, bytes)| (index, (draco.view, bytes.into())));
                    self.unpacked.extend(found);
                }
                Err(error) => drop(self.streams.insert(draco.view, Err(error))),
            }
        }
        Ok(())
    }

    fn decode_views(&mut self, indices: &[usize]) -> Result<()> {
        let document = self.document;
        let mut jobs = Vec::new();
        for &index in indices {
            let Ok(view) = document.views.get(index) else { continue };
            let Some(compressed) = &view.compressed else { continue };
            self.budget.take(&view.at, compressed.count, compressed.stride)?;
            let buffer = document.buffers.get(compressed.buffer);
            jobs.push((index, compressed, buffer.and_then(|b| b.bytes(compressed.offset, compressed.length))));
        }
        let decoded = jobs.into_par_iter().map(|(index, compressed, stream)| {
            (index, stream.and_then(|stream| meshopt::decode(compressed, &stream)).map(Bytes::from))
        });
        self.views.extend(decoded.collect::<Vec<_>>());
        Ok(())
    }

    /// Checks the primitive's Draco stream, if there is one. It must have been [unpacked](Self::unpack).
    /// Errors: A damaged stream; an accessor that belongs to another stream.
    pub(crate) fn check_stream(&self, primitive: &Primitive) -> Result<()> {
        let Some(draco) = &primitive.draco else { return Ok(()) };
        self.streams.get(&draco.view).cloned().unwrap_or(Ok(()))?;
        let coded = draco.attributes.keys().map(|semantic| primitive.attributes[semantic]).chain(primitive.indices);
        match coded.into_iter().find(|index| self.unpacked.get(index).is_none_or(|(view, _)| *view != draco.view)) {
            None => Ok(()),
            Some(index) => {
                let found = "elements of another stream";
                Err(bad(&draco.at, format!("accessors[{index}] to stand for this stream alone"), found))
            }
        }
    }

    /// All elements as floats, of which some may be NaN or infinite; normalized integers are divided by their largest value.
    /// Errors: Bytes that are not there, wrong sparse indices, too much memory.
    pub fn floats<const N: usize>(&mut self, index: usize) -> Result<Vec<[f32; N]>> {
        let accessor = self.document.accessors.get(index)?;
        let n = accessor.normalized;
        let signed = move |x: f32, largest: f32| if n { (x / largest).max(-1.0) } else { x };
        let unsigned = move |x: f32, largest: f32| if n { x / largest } else { x };
        match accessor.component {
            Component::F32 => self.elements(index, |b: [u8; 4]| f32::from_le_bytes(b)),
            Component::U8 => self.elements(index, |b: [u8; 1]| unsigned(b[0].into(), 255.0)),
            Component::I8 => self.elements(index, |b: [u8; 1]| signed((b[0] as i8).into(), 127.0)),
            Component::U16 => self.elements(index, |b: [u8; 2]| unsigned(u16::from_le_bytes(b).into(), 65535.0)),
            Component::I16 => self.elements(index, |b: [u8; 2]| signed(i16::from_le_bytes(b).into(), 32767.0)),
            Component::U32 => self.elements(index, |b: [u8; 4]| u32::from_le_bytes(b) as f32),
        }
    }

    /// All components of all elements in one list, converted by [`Self::floats`].
    /// Errors: See [`Self::floats`]; also for matrices.
    pub fn flat(&mut self, index: usize) -> Result<Vec<f64>> {
        fn flat<const N: usize>(elements: Vec<[f32; N]>) -> Vec<f64> {
            elements.into_iter().flatten().map(f64::from).collect()
        }
        let accessor = self.document.accessors.get(index)?;
        Ok(match accessor.shape {
            Shape::Scalar => flat(self.floats::<1>(index)?),
            Shape::Vec2 => flat(self.floats::<2>(index)?),
            Shape::Vec3 => flat(self.floats::<3>(index)?),
            Shape::Vec4 => flat(self.floats::<4>(index)?),
            _ => return Err(bad(&accessor.at, "numbers or vectors", accessor.format())),
        })
    }

    /// All elements as unsigned integers.
    pub(crate) fn integers<const N: usize>(&mut self, index: usize) -> Result<Vec<[u32; N]>> {
        match self.document.accessors.get(index)?.component {
            Component::U8 | Component::I8 => self.elements(index, |b: [u8; 1]| b[0].into()),
            Component::U16 | Component::I16 => self.elements(index, |b: [u8; 2]| u16::from_le_bytes(b).into()),
            Component::U32 | Component::F32 => self.elements(index, |b: [u8; 4]| u32::from_le_bytes(b)),
        }
    }

    fn elements<T: Copy + Default, const S: usize, const N: usize>(
        &mut self,
        index: usize,
        decode: impl Fn([u8; S]) -> T,
    ) -> Result<Vec<[T; N]>> {
        let document = self.document;
        let accessor = document.accessors.get(index)?;
        let size = accessor.element_bytes();
        if size != (S * N) as u64 {
            // Callers check formats first; only tightly packed elements are read.
            return Err(bad(&accessor.at, format!("elements of {} bytes", S * N), accessor.format()));
        }
        let is_bare = accessor.view.is_none() && !self.unpacked.contains_key(&index);
        if is_bare && accessor.count > MAX_WITHOUT_DATA {
            return Err(Error::Data(format!(
                "{}: asks for {} elements without data, that is of zeros; at most {MAX_WITHOUT_DATA} can be used: give it a \
                 bufferView, or is the file damaged?",
                accessor.at, accessor.count
            )));
        }
        self.budget.take(&accessor.at, accessor.count, size_of::<[T; N]>() as u64)?;
        let count = accessor.count as usize;
        let element = |bytes: &[u8]| {
            let mut out = [T::default(); N];
            for (x, chunk) in out.iter_mut().zip(bytes.as_chunks::<S>().0) {
                *x = decode(*chunk);
            }
            out
        };
        let mut out = Vec::with_capacity(count);
        match (accessor.view, self.unpacked.get(&index)) {
            (None, Some((_, bytes))) => out.extend(bytes.chunks(S * N).map(element)),
            (None, None) => out.resize(count, [T::default(); N]),
            (Some(view), _) => {
                let bytes = self.view_bytes(view, accessor.offset)?;
                let stride = accessor.stride(document.views.get(view)?) as usize;
                out.extend(bytes.chunks(stride).take(count).map(|chunk| element(&chunk[..chunk.len().min(S * N)])));
            }
        }
        if let Some(sparse) = &accessor.sparse {
            let values = self.view_bytes(sparse.value_view, sparse.value_offset)?;
            let targets = self.sparse_indices(accessor, sparse)?;
            for (target, value) in targets.into_iter().zip(values.chunks(S * N)) {
                out[target] = element(value);
            }
        }
        Ok(out)
    }

    fn sparse_indices(&mut self, accessor: &Accessor, sparse: &Sparse) -> Result<Vec<usize>> {
        let at = || format!("{}.sparse.indices", accessor.at);
        self.budget.take(&accessor.at, sparse.count, size_of::<usize>() as u64)?;
        let bytes = self.view_bytes(sparse.index_view, sparse.index_offset)?;
        let size = sparse.index_component.size();
        let mut out: Vec<usize> = Vec::with_capacity(sparse.count as usize);
        for (i, chunk) in bytes.chunks_exact(size).take(sparse.count as usize).enumerate() {
            let target = chunk.iter().rev().fold(0_usize, |sum, &byte| sum << 8 | usize::from(byte));
            if target as u64 >= accessor.count || out.last().is_some_and(|&last| target <= last) {
                return Err(bad(
                    &at(),
                    format!("strictly increasing indices below {}", accessor.count),
                    format!("{target} as number {i}"),
                ));
            }
            out.push(target);
        }
        Ok(out)
    }

    /// A view's bytes from `offset` to its end.
    fn view_bytes(&mut self, index: usize, offset: u64) -> Result<Bytes> {
        let view = self.document.views.get(index)?;
        if view.compressed.is_some() {
            if !self.views.contains_key(&index) {
                self.decode_views(&[index])?;
            }
            let bytes = self.views[&index].clone()?;
            return Ok(bytes.slice((offset as usize).min(bytes.len())..));
        }
        let start = view.offset.saturating_add(offset);
        self.document.buffers.get(view.buffer)?.bytes(start, view.length.saturating_sub(offset))
    }
}
