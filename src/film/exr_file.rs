//! OpenEXR files: films out, any RGB picture in.

use std::borrow::Cow;
use std::cell::Cell;
use std::fs;
use std::io::{BufReader, Cursor, ErrorKind};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use exr::block::reader::ChunksReader;
use exr::error::Error as ExrError;
use exr::meta::attribute::{AttributeValue, Chromaticities, IntegerBounds, Text};
use exr::prelude::*;

use super::aov::Channel;
use super::{Aov, Film, atomic};
use crate::{Error, Result as Outcome};

/// What a header attribute holds.
#[derive(Debug, Clone, PartialEq)]
pub enum HeaderValue {
    /// UTF-8.
    Text(String),
    /// An OpenEXR `double`.
    Number(f64),
}

/// Named header attributes; names are ASCII, under 32 characters.
pub type Header = Vec<(Cow<'static, str>, HeaderValue)>;

/// A picture that was read.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The data window: x0, y0, x1, y1, the last two exclusive.
    pub window: [i64; 4],
    /// The display window, as `window`: the whole picture of which `window` has pixels.
    pub display: [i64; 4],
    /// Linear RGB, row-major over `window`.
    pub rgb: Vec<[f32; 3]>,
    /// Variance of each value of `rgb` from the layer `variance`, if the file has one.
    pub variance: Option<Vec<[f32; 3]>>,
}

/// Name of the part that holds what a render goes on from.
const STATISTICS: &str = "statistics";
/// 32-bit words a row of that part.
const WORDS: usize = 4096;
/// How many bytes of the part count.
const LENGTH: &str = "bismar.bytes";
/// What they hash to (BLAKE3, hexadecimal).
const HASH: &str = "bismar.hash";

/// Writes a film as one part: R, G, B, A in 32-bit floats (A is the share of paths that hit something; colours are
/// not multiplied by it) and the AOVs as `layer.channel`. ZIP compression; the data window is the film's window, the
/// display window the whole picture. The file appears whole or not at all.
///
/// `statistics` are bytes that [`read_statistics`] gives back. They go into a second part of that name, as one channel
/// of integers: programs that do not know it show the first part as ever.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(path: &Path, film: &Film, aovs: &[Aov], header: &Header, statistics: Option<&[u8]>) -> Outcome<()> {
    let (shared, mut beauty) = image_of(film, aovs, header);
    let Some(bytes) = statistics else { return save(path, &Image::new(shared, beauty)) };
    // The name that Nuke and its successors show without a prefix.
    beauty.attributes.layer_name = Some(text("rgba"));
    save(path, &Image::from_layers(shared, vec![beauty, statistics_of(bytes)]))
}

fn statistics_of(bytes: &[u8]) -> Layer<AnyChannels<FlatSamples>> {
    let rows = bytes.len().div_ceil(4 * WORDS).max(1);
    let mut words = vec![0; rows * WORDS];
    for (word, chunk) in words.iter_mut().zip(bytes.chunks(4)) {
        let mut four = [0; 4];
        four[..chunk.len()].copy_from_slice(chunk);
        *word = u32::from_le_bytes(four);
    }
    let mut own = LayerAttributes::named(STATISTICS);
    own.other.insert(text(LENGTH), AttributeValue::F64(bytes.len() as f64));
    own.other.insert(text(HASH), AttributeValue::Text(text(blake3::hash(bytes).to_hex().as_str())));
    let channel = AnyChannel::new(text("bytes"), FlatSamples::U32(words));
    // They are packed already, if they can be.
    let encoding = Encoding { compression: Compression::Uncompressed, ..ENCODING };
    Layer::new(Vec2(WORDS, rows), own, encoding, AnyChannels::sort([channel].into_iter().collect()))
}

/// Blocks of 16 rows: the unit of packing in parallel.
const ENCODING: Encoding =
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

fn save<'a, L>(path: &Path, image: &'a Image<L>) -> Outcome<()>
where
    L: exr::image::write::layers::WritableLayers<'a>,
{
    atomic::write(path, |file| match image.write().to_buffered(file) {
        Ok(()) => Ok(Ok(())),
        Err(ExrError::Io(e)) => Err(e),
        Err(other) => Ok(Err(Error::Bug(format!("{}: the EXR is not valid: {other}", path.display())))),
    })
}

fn image_of(film: &Film, aovs: &[Aov], header: &Header) -> (ImageAttributes, Layer<AnyChannels<FlatSamples>>) {
    let [x0, y0, x1, y1] = film.window.map(|x| x as usize);
    let mut channels = Vec::new();
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        channels.push((name.to_owned(), Channel::Float(film.pixels.iter().map(|p| p.mean()[c]).collect())));
    }
    let alpha = film.pixels.iter().map(|p| p.covered as f32 / p.samples.max(1) as f32);
    channels.push(("A".into(), Channel::Float(alpha.collect())));
    let mut aovs = aovs.to_vec();
    aovs.sort();
    aovs.dedup();
    channels.extend(aovs.iter().flat_map(|aov| aov.channels(film)));

    let channels = channels.into_iter().map(|(name, channel)| {
        let samples = match channel {
            Channel::Float(values) => FlatSamples::F32(values),
            Channel::Uint(values) => FlatSamples::U32(values),
        };
        AnyChannel::new(text(&name), samples)
    });

    let mut own = LayerAttributes {
        layer_position: Vec2(x0 as i32, y0 as i32),
        software_name: Some(text(concat!("bismar ", env!("CARGO_PKG_VERSION")))),
        ..Default::default()
    };
    for (name, value) in header {
        let value = match value {
            HeaderValue::Text(t) => AttributeValue::Text(text(t)),
            HeaderValue::Number(x) => AttributeValue::F64(*x),
        };
        own.other.insert(text(name), value);
    }
    let layer = Layer::new(Vec2(x1 - x0, y1 - y0), own, ENCODING, AnyChannels::sort(channels.collect()));
    let display = IntegerBounds::from_dimensions(Vec2(film.width as usize, film.height as usize));
    let mut shared = ImageAttributes::new(display);
    // Rec. 709, said aloud.
    shared.chromaticities = Some(Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.3, 0.6),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.329),
    });
    (shared, layer)
}

/// OpenEXR strings are bytes, UTF-8 by custom.
fn text(s: &str) -> Text {
    Text::from_slice_unchecked(s.as_bytes())
}

/// Reads the colour of any flat OpenEXR file: channels R, G, B (or a layer's that ends in `Combined`, as Blender
/// writes) in half, float or integer, and `variance.R`, `.G`, `.B` when they are there. Nothing in the file is trusted.
///
/// # Errors
/// Missing, forbidden or failing files as [`Error::reading`]; [`Error::Data`] for anything that is not such a
/// picture, however broken.
pub fn read(path: &Path) -> Outcome<Picture> {
    decoded(path, decode)
}

/// Reads the header attributes that bismar has written, without the picture. Empty for pictures of others.
///
/// # Errors
/// As [`read()`].
pub fn read_header(path: &Path) -> Outcome<Header> {
    let bad = |why: &str| Error::Data(format!("{}: cannot use this OpenEXR file: {why}", path.display()));
    let file = fs::File::open(path).map_err(|e| Error::reading(path, &e))?;
    let read = || MetaData::read_from_buffered(BufReader::new(file), false);
    let meta = match while_decoding(|| catch_unwind(AssertUnwindSafe(read))) {
        Ok(Ok(meta)) => meta,
        Ok(Err(ExrError::Io(e))) if e.kind() != ErrorKind::UnexpectedEof => return Err(Error::reading(path, &e)),
        Ok(Err(e)) => return Err(bad(&e.to_string())),
        Err(_) => return Err(bad("it is corrupt")),
    };
    let Some(first) = meta.headers.first() else { return Ok(Header::new()) };
    let ours = first.own_attributes.other.iter().filter_map(|(name, value)| {
        let name = name.to_string();
        let value = match value {
            AttributeValue::Text(t) => HeaderValue::Text(t.to_string()),
            AttributeValue::F64(x) => HeaderValue::Number(*x),
            _ => return None,
        };
        name.starts_with("bismar.").then(|| (name.into(), value))
    });
    Ok(ours.collect())
}

/// The statistics that [`write()`] was given, or `None` for a picture without.
///
/// # Errors
/// As [`read()`]; [`Error::Data`] also if the bytes are not those that were written.
pub fn read_statistics(path: &Path) -> Outcome<Option<Vec<u8>>> {
    decoded(path, decode_statistics)
}

fn decoded<T>(path: &Path, decode: impl FnOnce(&[u8]) -> Result<T>) -> Outcome<T> {
    let bad = |why: &str| Error::Data(format!("{}: cannot use this OpenEXR file: {why}", path.display()));
    // All of it at once: what the decoder says afterwards is about the content, never about the disk.
    let bytes = fs::read(path).map_err(|e| Error::reading(path, &e))?;
    // The decoder has assertions that broken files can reach; a panic of its is the file's fault, not a bug of ours.
    match while_decoding(|| catch_unwind(AssertUnwindSafe(|| decode(&bytes)))) {
        Ok(Ok(picture)) => Ok(picture),
        Ok(Err(e)) => Err(bad(&e.to_string())),
        Err(_) => Err(bad("it is corrupt")),
    }
}

fn is_statistics(header: &exr::meta::header::Header) -> bool {
    header.own_attributes.layer_name.as_ref().is_some_and(|name| name.eq(STATISTICS))
}

fn attribute<'a>(header: &'a exr::meta::header::Header, name: &str) -> Option<&'a AttributeValue> {
    header.own_attributes.other.get(&text(name))
}

fn decode_statistics(bytes: &[u8]) -> Result<Option<Vec<u8>>> {
    let chunks = exr::block::read(Cursor::new(bytes), false)?;
    let Some(index) = chunks.headers().iter().position(is_statistics) else { return Ok(None) };
    let header = &chunks.headers()[index];
    plausible(header, bytes.len() as u64)?;
    let rows = header.layer_size.1;
    let (length, hash) = match (attribute(header, LENGTH), attribute(header, HASH)) {
        (Some(AttributeValue::F64(length)), Some(AttributeValue::Text(hash))) => (*length as usize, hash.to_string()),
        _ => return Err(invalid("its statistics have no length or hash")),
    };
    let row = 4 * WORDS;
    if header.layer_size.0 != WORDS || header.channels.bytes_per_pixel != 4 || length > rows * row {
        return Err(invalid("its statistics have another shape"));
    }
    let mut all = vec![0; rows * row];
    let chunks = chunks.filter_chunks(false, |_, _, block| block.layer == index)?;
    chunks.decompress_sequential(false, |_, block| {
        let at = block.index.pixel_position.1 * row;
        let place = all.get_mut(at..at + block.data.len()).ok_or_else(|| invalid("a block out of bounds"))?;
        for (to, from) in place.chunks_exact_mut(4).zip(block.data.chunks_exact(4)) {
            to.copy_from_slice(&u32::from_ne_bytes([from[0], from[1], from[2], from[3]]).to_le_bytes());
        }
        Ok(())
    })?;
    all.truncate(length);
    if *blake3::hash(&all).to_hex() != *hash {
        return Err(invalid("its statistics are not those that were written: the file is damaged"));
    }
    Ok(Some(all))
}

thread_local! {
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

fn while_decoding<T>(work: impl FnOnce() -> T) -> T {
    DECODING.set(true);
    let result = work();
    DECODING.set(false);
    result
}

/// Is this thread inside the decoder? A panic is then reported as a corrupt file, and a panic hook has nothing to say.
pub fn is_decoding() -> bool {
    DECODING.get()
}

fn decode(bytes: &[u8]) -> Result<Picture> {
    let chunks = exr::block::read(Cursor::new(bytes), false)?;
    for header in chunks.headers() {
        plausible(header, bytes.len() as u64)?;
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        // On this thread alone, where panics are expected.
        .non_parallel()
        .from_chunks(chunks)?;

    let display = window_of(image.attributes.display_window);
    for layer in &image.layer_data {
        let channels = &layer.channel_data.list;
        let Some(prefix) = color_prefix(channels.iter().map(|c| c.name.to_string())) else { continue };
        let rgb = triple(channels, &prefix).ok_or_else(|| invalid("its colour channels are subsampled"))?;
        return Ok(Picture {
            window: window_of(layer.absolute_bounds()),
            display,
            rgb,
            variance: triple(channels, "variance."),
        });
    }
    let names = image.layer_data.iter().flat_map(|l| &l.channel_data.list).map(|c| c.name.to_string());
    Err(invalid(format!("it has no channels R, G and B but {}", names.collect::<Vec<_>>().join(", "))))
}

fn invalid(why: impl Into<Cow<'static, str>>) -> ExrError {
    ExrError::Invalid(why.into())
}

/// Refuses sizes that a file of so many bytes cannot hold, before memory is taken for them. No codec of OpenEXR packs
/// more than a few thousand times (zip at most 1032).
fn plausible(header: &exr::meta::header::Header, file_bytes: u64) -> Result<()> {
    const MOST_PACKED: u64 = 10_000;
    let pixels = (header.layer_size.0 as u64).checked_mul(header.layer_size.1 as u64);
    let bytes = pixels.and_then(|p| p.checked_mul(header.channels.bytes_per_pixel as u64));
    match bytes {
        Some(bytes) if bytes <= file_bytes.saturating_mul(MOST_PACKED) => Ok(()),
        _ => Err(invalid(format!(
            "it says {} x {} pixels but has only {file_bytes} bytes",
            header.layer_size.0, header.layer_size.1
        ))),
    }
}

/// What stands before R, G and B in the names of the beauty's channels.
fn color_prefix(names: impl Iterator<Item = String>) -> Option<String> {
    let names = names.collect::<Vec<_>>();
    let complete = |prefix: &&str| ["R", "G", "B"].iter().all(|c| names.contains(&format!("{prefix}{c}")));
    let reds = names.iter().filter_map(|n| n.strip_suffix('R'));
    let mut candidates = reds.filter(|p| p.is_empty() || p.ends_with("Combined."));
    candidates.find(complete).map(str::to_owned)
}

fn triple(channels: &[AnyChannel<FlatSamples>], prefix: &str) -> Option<Vec<[f32; 3]>> {
    let find = |c: &str| channels.iter().find(|x| x.name.eq(&format!("{prefix}{c}")) && x.sampling == Vec2(1, 1));
    let (r, g, b) = (find("R")?, find("G")?, find("B")?);
    let columns = [r, g, b].map(|c| c.sample_data.values_as_f32());
    let [r, g, b] = columns;
    Some(r.zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect())
}

fn window_of(bounds: IntegerBounds) -> [i64; 4] {
    let (x, y) = (i64::from(bounds.position.0), i64::from(bounds.position.1));
    [x, y, x + bounds.size.0 as i64, y + bounds.size.1 as i64]
}

/// Writes linear RGB floats, row-major over `window` within `display` (x0, y0, x1, y1).
///
/// # Errors
/// As [`atomic::write`].
pub fn write_rgb(path: &Path, window: [i64; 4], display: [i64; 4], rgb: &[[f32; 3]]) -> Outcome<()> {
    let bounds = |w: [i64; 4]| {
        IntegerBounds::new(Vec2(w[0] as i32, w[1] as i32), Vec2((w[2] - w[0]) as usize, (w[3] - w[1]) as usize))
    };
    let channel = |c: usize, name| AnyChannel::new(text(name), FlatSamples::F32(rgb.iter().map(|p| p[c]).collect()));
    let channels = [channel(0, "R"), channel(1, "G"), channel(2, "B")];
    let own = LayerAttributes { layer_position: bounds(window).position, ..Default::default() };
    let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::default() };
    let layer = Layer::new(bounds(window).size, own, encoding, AnyChannels::sort(channels.into_iter().collect()));
    save(path, &Image::new(ImageAttributes::new(bounds(display)), layer))
}

#[cfg(test)]
mod tests;
