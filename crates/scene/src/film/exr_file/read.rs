//! Reads OpenEXR files: pictures, environments, and the attributes and statistics of our own files.

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{BufReader, Cursor, ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::lines::LineRef;
use exr::block::reader::{ChunksReader, Reader};
use exr::error::Error as ExrError;
use exr::meta::attribute::{AttributeValue, SampleType};
use exr::meta::header::Header as ExrHeader;
use exr::prelude::*;
use glam::Mat3;

use super::attributes::{HASH, LENGTH, VARIANCE, string, text};
use super::checksum::CHECKSUM;
use super::{bounds, head};
use crate::film::cryptomatte::PREFIX;
use crate::film::header::{Header, HeaderValue, MEAN_VARIANCE, WORLD_TO_CAMERA, WORLD_TO_NDC};
use crate::film::picture::Picture;
use crate::{Error, Result as Outcome, color, guard};

/// Reads the beauty of any flat OpenEXR file: the channels R, G, B (or those of a layer that ends in `Combined`, as Blender
/// writes), or the only one of a grey picture, Y, in half, float or integer, and `variance.R`, `.G`, `.B` if they exist. The content of the file is not trusted.
///
/// # Errors
/// [`Error::reading`] for a file that cannot be read; [`Error::Data`] for one that is no such picture.
pub fn read(path: &Path) -> Outcome<Picture> {
    picture(&bytes_of(path)?, &|_, _| Ok(())).map_err(|why| cannot_use(path, &why))
}

/// Reads the beauty from the bytes of a file. `fits` can refuse a width and height before memory is allocated.
///
/// # Errors
/// The defect, as a part of a sentence.
pub fn picture(bytes: &[u8], fits: &Fits) -> std::result::Result<Picture, String> {
    guarded(|| decode(bytes, &[None], fits)).map(|mut all| all.remove(0))
}

/// Width and height of the largest window in pixels, by the head of a file's bytes; `None` for a head that cannot be read.
pub fn size(bytes: &[u8]) -> Option<(u64, u64)> {
    let mut largest = None;
    let visit = &mut |attribute: head::Attribute| {
        let side = |at: usize| Some(i64::from(i32::from_le_bytes(attribute.value.get(at..at + 4)?.try_into().ok()?)));
        let sides = || Some((side(8)? - side(0)? + 1, side(12)? - side(4)? + 1));
        if [&b"dataWindow"[..], b"displayWindow"].contains(&attribute.name)
            && let Some((width, height)) = sides().filter(|(width, height)| *width > 0 && *height > 0)
        {
            largest = largest.max(Some((width as u64, height as u64)));
        }
    };
    head::walk(bytes, visit).ok()?;
    largest
}

/// Reads layers from the bytes of a file: of each its R, G and B, its X, Y and Z, or its only channel three times; or a channel
/// by its full name. `None` is the beauty.
///
/// # Errors
/// The defect, as a part of a sentence.
pub fn layers(bytes: &[u8], layers: &[Option<&str>]) -> std::result::Result<Vec<Picture>, String> {
    guarded(|| decode(bytes, layers, &|_, _| Ok(())))
}

/// Returns an error if a picture of this width and height is too large.
type Fits<'a> = dyn Fn(u64, u64) -> std::result::Result<(), String> + 'a;

/// Reads the header attributes that this program has written, without the pixels. Empty for pictures of other programs.
///
/// # Errors
/// The errors of [`read()`].
pub fn read_header(path: &Path) -> Outcome<Header> {
    let meta = read_meta(path, &open(path)?)?;
    let Some(first) = meta.headers.first() else { return Ok(Header::new()) };
    let ours = first.own_attributes.other.iter().filter_map(|(name, value)| {
        let name = string(name);
        let value = match value {
            AttributeValue::Text(t) => HeaderValue::Text(string(t)),
            AttributeValue::F64(x) => HeaderValue::Number(*x),
            _ => return None,
        };
        // Length and hash of the statistics and the checksum are internal.
        let ours = name.starts_with("bismar.") || name.starts_with(PREFIX);
        let public = ours && ![LENGTH, HASH, CHECKSUM].contains(&name.as_str());
        public.then(|| (name.into(), value))
    });
    let mut header: Header = ours.collect();
    // The decoder has them in no order.
    header.sort_by(|a, b| a.0.cmp(&b.0));
    let own = &first.own_attributes;
    for (name, matrix) in [(WORLD_TO_CAMERA, own.world_to_camera), (WORLD_TO_NDC, own.world_to_normalized_device)] {
        header.extend(matrix.map(|m| (name.into(), HeaderValue::Matrix(m))));
    }
    Ok(header)
}

/// Names of all channels of a file.
///
/// # Errors
/// The errors of [`read()`].
pub fn channels(path: &Path) -> Outcome<Vec<String>> {
    Ok(read_meta(path, &open(path)?)?.headers.iter().flat_map(names).collect())
}

fn open(path: &Path) -> Outcome<File> {
    File::open(path).map_err(|e| Error::reading(path, &e))
}

fn read_meta(path: &Path, mut file: &File) -> Outcome<MetaData> {
    check_head(path, file)?;
    file.rewind().map_err(|e| Error::reading(path, &e))?;
    let mut failed = None;
    let read = || match MetaData::read_from_buffered(BufReader::new(file), false) {
        Err(ExrError::Io(e)) if e.kind() != ErrorKind::UnexpectedEof => {
            failed = Some(e);
            Err(invalid("it cannot be read"))
        }
        other => other,
    };
    let meta = guarded(read);
    if let Some(e) = failed {
        return Err(Error::reading(path, &e));
    }
    meta.map_err(|why| cannot_use(path, &why))
}

/// Reads the statistics that were given to [`write()`](super::write()); `None` for a picture without statistics.
///
/// # Errors
/// The errors of [`read()`]; [`Error::Data`] also if the statistics do not have their hash.
pub fn read_statistics(path: &Path) -> Outcome<Option<Vec<u8>>> {
    let mut file = open(path)?;
    let failed = |e| Error::reading(path, &e);
    let meta = read_meta(path, &file)?;
    let refused = |why: &str| cannot_use(path, why);
    let Some(header) = meta.headers.first() else { return Ok(None) };
    let (length, hash) = match (attribute(header, LENGTH), attribute(header, HASH)) {
        (None, None) => return Ok(None),
        (Some(AttributeValue::F64(length)), Some(AttributeValue::Text(hash))) => (*length as u64, hash.to_string()),
        _ => return Err(refused("invalid: its statistics have no length or hash")),
    };
    let all = file.metadata().map_err(failed)?.len();
    let start = all.checked_sub(length).ok_or_else(|| refused("its statistics are cut off"))?;
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(start)).and_then(|_| file.read_to_end(&mut bytes)).map_err(failed)?;
    if *blake3::hash(&bytes).to_hex() != *hash {
        return Err(refused("its statistics are not those that were written: the file is damaged"));
    }
    Ok(Some(bytes))
}

/// Length of a picture's file in bytes.
///
/// # Errors
/// [`Error::reading`].
pub fn length(path: &Path) -> Outcome<u64> {
    fs::metadata(path).map(|file| file.len()).map_err(|e| Error::reading(path, &e))
}

/// Reads all bytes of a picture of any format, so that later errors of decoders concern the content and not the disk.
///
/// # Errors
/// [`Error::reading`]; [`Error::Data`] for devices and for OpenEXR files with too large attributes.
pub fn bytes_of(path: &Path) -> Outcome<Vec<u8>> {
    let failed = |e| Error::reading(path, &e);
    let kind = fs::metadata(path).map_err(failed)?.file_type();
    if kind.is_char_device() || kind.is_block_device() {
        return Err(Error::Data(format!("{}: a device, not a picture", path.display())));
    }
    if kind.is_file() {
        let mut file = open(path)?;
        let mut magic = [0; 4];
        if file.read(&mut magic).map_err(failed)? == 4 && magic == head::MAGIC {
            file.rewind().map_err(failed)?;
            check_head(path, &file)?;
        }
    }
    fs::read(path).map_err(failed)
}

/// Checks the head of a file before the whole file is read.
fn check_head(path: &Path, file: &File) -> Outcome<()> {
    head::walk(BufReader::new(file), &mut |_| ()).map_err(|e| match e.kind() {
        ErrorKind::InvalidData | ErrorKind::UnexpectedEof => cannot_use(path, &e.to_string()),
        _ => Error::reading(path, &e),
    })
}

pub(crate) fn cannot_use(path: &Path, why: &str) -> Error {
    Error::Data(format!("{}: cannot use this OpenEXR file: {why}", path.display()))
}

/// Runs the decoder and turns its panics into errors.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T>) -> std::result::Result<T, String> {
    guard::guarded("it is corrupt", decode)
}

fn decode(bytes: &[u8], layers: &[Option<&str>], fits: &Fits) -> Result<Vec<Picture>> {
    let chunks = checked(bytes)?;
    let headers = chunks.headers().to_vec();
    let mut chunks = Some(chunks);
    let mut all = layers.iter().map(|layer| Decoded::new(&headers, *layer, fits)).collect::<Result<Vec<_>>>()?;
    for part in 0..headers.len() {
        let mut wanted = all.iter_mut().filter(|own| own.part == part).collect::<Vec<_>>();
        if !wanted.is_empty() {
            // The reader of a part is used up: most files have one.
            let chunks = chunks.take().map_or_else(|| checked(bytes), Ok)?;
            each_block(chunks, part, |block| wanted.iter_mut().try_for_each(|own| own.put(&block)))?;
        }
    }
    Ok(all.into_iter().zip(layers).map(|(own, layer)| own.converted(*layer)).collect())
}

/// A layer while it is read.
struct Decoded {
    /// Index and header of its part.
    part: usize,
    header: ExrHeader,
    /// Names and indices of its channels.
    names: Vec<String>,
    color: [usize; 3],
    alpha: Option<usize>,
    variance: Option<[usize; 3]>,
    picture: Picture,
}

impl Decoded {
    fn new(headers: &[ExrHeader], layer: Option<&str>, fits: &Fits) -> Result<Self> {
        let wanted = |header: &ExrHeader| match layer {
            _ if header.deep => None,
            None => beauty_channels(&names(header)),
            Some(layer) => layer_channels(&names(header), layer),
        };
        let found = headers.iter().enumerate().find_map(|(i, h)| Some((i, wanted(h)?)));
        let Some((part, colors)) = found.filter(|(_, colors): &(_, Vec<String>)| colors.len() == 3) else {
            let names = headers.iter().flat_map(names).collect::<Vec<_>>();
            let wanted = layer.map_or("channels R, G and B".into(), |layer| format!("layer '{layer}'"));
            return Err(invalid(format!("it has no {wanted} but {}", names.join(", "))));
        };
        let header = headers[part].clone();
        let (width, height) = (header.layer_size.0, header.layer_size.1);
        fits(width as u64, height as u64).map_err(invalid)?;
        let full = |names: &[String]| names.iter().map(|name| full_channel(&header, name)).collect::<Option<Vec<_>>>();
        let three = |names: &[String]| full(names).and_then(|all| <[usize; 3]>::try_from(all).ok());
        let color = three(&colors).ok_or_else(|| invalid("its colour channels are subsampled"))?;
        let beauty = |name: &str| layer.is_none().then(|| name.to_owned());
        let variance = beauty("variance.").and_then(|v| three(&["R", "G", "B"].map(|c| format!("{v}{c}"))));
        let alpha =
            beauty(colors[0].trim_end_matches(['R', 'Y'])).and_then(|prefix| full_channel(&header, &(prefix + "A")));
        let black = || vec![[0.0; 3]; width * height];
        let picture = Picture {
            window: window_of(header.own_attributes.layer_position, header.layer_size),
            display: window_of(
                header.shared_attributes.display_window.position,
                header.shared_attributes.display_window.size,
            ),
            rgb: black(),
            variance: variance.map(|_| black()),
            alpha: alpha.map(|_| vec![0.0; width * height]),
            displayed: false,
            mean_variance: match attribute(&header, MEAN_VARIANCE) {
                Some(AttributeValue::Text(text)) => serde_json::from_str(&string(text))
                    .ok()
                    .filter(|of: &[f64; 3]| of.iter().all(|x| *x >= 0.0 && x.is_finite()))
                    .unwrap_or([1.0; 3]),
                _ => [1.0; 3],
            },
        };
        Ok(Self { part, header, names: colors, color, alpha, variance, picture })
    }

    /// Takes what a block has of its channels.
    fn put(&mut self, block: &UncompressedBlock) -> Result<()> {
        let Self { header, color, alpha, variance, picture, .. } = self;
        let width = header.layer_size.0;
        for line in block.lines(&header.channels) {
            let channel = line.location.channel;
            let (Vec2(x, y), kind) = (line.location.position, header.channels.list[channel].sample_type);
            let range = y * width + x..y * width + x + line.location.sample_count;
            let beyond = || invalid("a block out of bounds");
            let put = |channels: [usize; 3], pixels: &mut [[f32; 3]]| -> Result<()> {
                let row = pixels.get_mut(range.clone()).ok_or_else(beyond)?;
                for (c, _) in channels.iter().enumerate().filter(|(_, own)| **own == channel) {
                    read_line(&line, kind, |i, value| row[i][c] = value)?;
                }
                Ok(())
            };
            put(*color, &mut picture.rgb)?;
            if let (Some(_), Some(pixels)) = (alpha.filter(|own| *own == channel), &mut picture.alpha) {
                let row = pixels.get_mut(range.clone()).ok_or_else(beyond)?;
                read_line(&line, kind, |i, value| row[i] = value)?;
            }
            if let (Some(channels), Some(pixels)) = (*variance, &mut picture.variance) {
                put(channels, pixels)?;
            }
        }
        Ok(())
    }

    /// The picture in Rec. 709.
    fn converted(self, layer: Option<&str>) -> Picture {
        let Self { header, names, mut picture, .. } = self;
        let is_rgb = names.iter().zip(["R", "G", "B"]).all(|(name, letter)| name.ends_with(letter));
        let plain_variance = attribute(&header, VARIANCE).is_some();
        let is_rgb = is_rgb && !(plain_variance && layer == Some("variance"));
        if let Some(c) = header.shared_attributes.chromaticities.filter(|_| is_rgb) {
            let points = [c.red, c.green, c.blue, c.white].map(|Vec2(x, y)| [x, y]);
            match color::rec709_from_rgb(points.as_flattened().try_into().expect("four points")) {
                Some(matrix) if matrix == Mat3::IDENTITY => {}
                Some(matrix) => {
                    let kept = picture.variance.take_if(|_| plain_variance);
                    picture.transform(matrix);
                    picture.variance = kept.or(picture.variance);
                }
                None => tracing::warn!("chromaticities {points:?} are no colour space's: read as those of Rec. 709"),
            }
        }
        picture
    }
}

/// Opens a file and checks its attributes, sizes and counts.
pub(super) fn checked(bytes: &[u8]) -> Result<Reader<Cursor<&[u8]>>> {
    head::walk(bytes, &mut |_| ()).map_err(|e| invalid(e.to_string()))?;
    let chunks = exr::block::read(Cursor::new(bytes), false)?;
    chunks.headers().iter().try_for_each(|header| bounds::check(header, bytes.len() as u64)).map_err(invalid)?;
    Ok(chunks)
}

/// Decodes the blocks of a part's highest resolution level in order, on this thread, where panics are caught.
pub(super) fn each_block(
    chunks: Reader<Cursor<&[u8]>>,
    part: usize,
    mut work: impl FnMut(UncompressedBlock) -> Result<()>,
) -> Result<()> {
    let wanted = chunks.filter_chunks(false, |_, _, block| block.layer == part && block.level == Vec2(0, 0))?;
    let meta = wanted.meta_data().clone();
    for chunk in wanted {
        let chunk = chunk?;
        let header = meta.headers.get(chunk.layer_index).ok_or_else(|| invalid("a block of no part"))?;
        bounds::check_block(&chunk, header).map_err(invalid)?;
        let block = UncompressedBlock::decompress_chunk(chunk, &meta, false)?;
        // The table of blocks and the blocks may differ.
        if block.index.layer != part || block.index.level != Vec2(0, 0) {
            return Err(invalid("a block in the place of another"));
        }
        work(block)?;
    }
    Ok(())
}

fn read_line(line: &LineRef, kind: SampleType, put: impl FnMut(usize, f32)) -> Result<()> {
    match kind {
        SampleType::F16 => each_sample(line, f16::to_f32, put),
        SampleType::F32 => each_sample(line, |x: f32| x, put),
        SampleType::U32 => each_sample(line, |x: u32| x as f32, put),
    }
}

/// Converts the samples of a line, which have the type `T`, and passes them on with their index.
pub(super) fn each_sample<T: exr::io::Data, V>(
    line: &LineRef,
    convert: impl Fn(T) -> V,
    mut put: impl FnMut(usize, V),
) -> Result<()> {
    for (i, sample) in line.read_samples::<T>().enumerate() {
        put(i, convert(sample?));
    }
    Ok(())
}

fn attribute<'a>(header: &'a ExrHeader, name: &str) -> Option<&'a AttributeValue> {
    header.own_attributes.other.get(&text(name))
}

pub(super) fn invalid(why: impl Into<Cow<'static, str>>) -> ExrError {
    ExrError::Invalid(why.into())
}

fn names(header: &ExrHeader) -> Vec<String> {
    header.channels.list.iter().map(|c| string(&c.name)).collect()
}

/// The names of the beauty's channels: R, G and B, or three times Y, but not the Y of chroma (RY, BY).
fn beauty_channels(names: &[String]) -> Option<Vec<String>> {
    let has = |name: &str| names.iter().any(|own| own == name);
    let of = |letters: [&str; 3], prefix: &str| letters.map(|letter| format!("{prefix}{letter}"));
    let reds = names.iter().filter_map(|name| name.strip_suffix('R'));
    let mut colors =
        reds.filter(|p| p.is_empty() || p.ends_with("Combined.")).map(|prefix| of(["R", "G", "B"], prefix));
    let grey = || (has("Y") && !has("RY") && !has("BY")).then(|| of(["Y"; 3], ""));
    colors.find(|all| all.iter().all(|name| has(name))).or_else(grey).map(Into::into)
}

/// The names of a layer's three channels, or three times the name of its only one.
fn layer_channels(names: &[String], layer: &str) -> Option<Vec<String>> {
    let all = |letters: &str| letters.chars().map(|c| format!("{layer}.{c}")).collect::<Vec<_>>();
    let exist = |wanted: &Vec<String>| wanted.iter().all(|name| names.contains(name));
    let alone = names.iter().filter(|name| name.strip_prefix(layer).is_some_and(|rest| rest.starts_with('.')));
    let alone = match alone.collect::<Vec<_>>()[..] {
        [one] => Some(one.clone()),
        _ => names.iter().find(|name| *name == layer).cloned(),
    };
    ["RGB", "XYZ"].into_iter().map(all).find(exist).or_else(|| alone.map(|one| vec![one; 3]))
}

/// Index of the channel with this name, if it has full resolution.
fn full_channel(header: &ExrHeader, name: &str) -> Option<usize> {
    header.channels.list.iter().position(|x| string(&x.name) == name && x.sampling == Vec2(1, 1))
}

fn window_of(position: Vec2<i32>, size: Vec2<usize>) -> [i64; 4] {
    let (x, y) = (i64::from(position.0), i64::from(position.1));
    [x, y, x + size.0 as i64, y + size.1 as i64]
}
