//! Writes pixels and statistics to OpenEXR files, one block of rows at a time.

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use exr::block::lines::LineRefMut;
use exr::error::Error as ExrError;
use exr::image::write::samples::{SamplesWriter, WritableSamples};
use exr::math::RoundingMode;
use exr::meta::attribute::{AttributeValue, Chromaticities, IntegerBounds, LevelMode, SampleType};
use exr::meta::header::Header as ExrHeader;
use exr::prelude::*;
use glam::Vec3;

use super::attributes::{HASH, LENGTH, VARIANCE, text};
use super::checksum::{self, CHECKSUM};
use crate::color::ColorSpace;
use crate::film::aov::{self, Aov, Channel, Value};
use crate::film::atomic;
use crate::film::header::{Header, HeaderValue, WORLD_TO_CAMERA, WORLD_TO_NDC};
use crate::film::pixels::Pixels;
use crate::{Error, Result as Outcome};

/// The layers of a file besides R, G, B and A, and their precision.
#[derive(Debug, Clone, Copy, Default)]
pub struct Layers<'a> {
    pub aovs: &'a [Aov],
    /// Whether colours and directions are 16-bit floats. Distances, statistics and identifiers always have 32 bits.
    pub half: bool,
    /// Primaries of R, G and B of all layers but the variance, which `compare` needs as it is.
    pub colorspace: ColorSpace,
    /// Names of denoised layers, and their colours: linear RGB, row by row over the window.
    pub denoised: &'a [(String, Vec<[f32; 3]>)],
}

impl<'a, T: AsRef<[Aov]> + ?Sized> From<&'a T> for Layers<'a> {
    fn from(aovs: &'a T) -> Self {
        Layers { aovs: aovs.as_ref(), ..Default::default() }
    }
}

/// Writes pixels as one part: R, G, B, A (premultiplied; A by [`Background`](crate::film::Background)) and the AOVs as
/// `layer.channel`, with ZIP compression. The data window is the pixels' window, the display window the whole picture. The file
/// is written atomically. Channels are computed block by block, so that hardly any memory is needed besides the pixels.
///
/// `statistics` are bytes that [`read_statistics`](super::read_statistics) returns. They follow the picture at the end of the
/// file, outside its table of offsets. A part of their own would need its own data window, which crashes Blender 5.0 if it is
/// not inside the picture's.
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write<'a>(
    path: &Path,
    pixels: &dyn Pixels,
    layers: impl Into<Layers<'a>>,
    header: &Header,
    statistics: Option<&[u8]>,
) -> Outcome<()> {
    let layers = layers.into();
    let (shared, mut beauty) = image_of(pixels, layers, header);
    if let Some(bytes) = statistics {
        let hash = blake3::hash(bytes).to_hex();
        beauty.attributes.other.insert(text(LENGTH), AttributeValue::F64(bytes.len() as f64));
        beauty.attributes.other.insert(text(HASH), AttributeValue::Text(text(hash.as_str())));
    }
    save(path, &Image::new(shared, beauty), statistics.unwrap_or_default())
}

/// Writes linear RGB floats, row-major over `window` within `display` (x0, y0, x1, y1 in pixels).
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write_rgb(path: &Path, window: [i64; 4], display: [i64; 4], rgb: &[[f32; 3]]) -> Outcome<()> {
    let bounds = |w: [i64; 4]| {
        IntegerBounds::new(Vec2(w[0] as i32, w[1] as i32), Vec2((w[2] - w[0]) as usize, (w[3] - w[1]) as usize))
    };
    let size = bounds(window).size;
    let channel = |(c, name)| AnyChannel::new(text(name), Samples::Float(Box::new(move |x, y| rgb[y * size.0 + x][c])));
    let channels = ["R", "G", "B"].into_iter().enumerate().map(channel);
    let mut own = LayerAttributes { layer_position: bounds(window).position, ..Default::default() };
    own.other.insert(text(CHECKSUM), AttributeValue::Text(text(checksum::PLACEHOLDER)));
    let layer = Layer::new(size, own, ENCODING, AnyChannels::sort(channels.collect()));
    save(path, &Image::new(ImageAttributes::new(bounds(display)), layer), &[])
}

/// Blocks of 16 rows, which are compressed in parallel.
const ENCODING: Encoding =
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

type Part<'a> = Layer<AnyChannels<Samples<'a>>>;

fn save<'a, L>(path: &Path, image: &'a Image<L>, trailer: &[u8]) -> Outcome<()>
where
    L: exr::image::write::layers::WritableLayers<'a>,
{
    atomic::write(path, |file| match image.write().to_buffered(&mut *file) {
        Ok(()) => {
            file.seek(SeekFrom::End(0))?;
            file.write_all(trailer)?;
            file.flush()?;
            // A device cannot be read back.
            if file.get_ref().metadata()?.is_file() {
                checksum::finish(file.get_ref())?;
            }
            Ok(Ok(()))
        }
        Err(ExrError::Io(e)) => Err(e),
        Err(other) => Ok(Err(Error::Bug(format!("{}: the EXR is not valid: {other}", path.display())))),
    })
}

fn image_of<'a>(pixels: &'a dyn Pixels, layers: Layers<'a>, header: &Header) -> (ImageAttributes, Part<'a>) {
    let [x0, y0, x1, y1] = pixels.window();
    let mut aovs = layers.aovs.to_vec();
    aovs.sort();
    aovs.dedup();
    let converted = (layers.colorspace != ColorSpace::Rec709).then(|| layers.colorspace.from_rec709());
    let beauty = aov::beauty(pixels.background());
    let with_extras = pixels.extras(x0, y0).is_some();
    let channels = beauty
        .into_iter()
        .chain(aovs.iter().flat_map(|aov| aov.channels(pixels.has_aovs(), with_extras, pixels.light_groups())));
    let channels = channels.map(|channel| {
        let (name, value, half) = (text(&channel.name), channel.value, channel.half);
        let is_color = half && channel.name.ends_with(['R', 'G', 'B']);
        let row = converted.filter(|_| is_color).map(|matrix| matrix.row(channel.component));
        let float = move |x, y| {
            let (x, y) = (x0 + x as u32, y0 + y as u32);
            match row {
                None => channel.float(pixels, x, y),
                Some(row) => {
                    let of = |component| Channel { name: String::new(), component, ..channel }.float(pixels, x, y);
                    let color = Vec3::from([0, 1, 2].map(of));
                    // An infinite sun would become NaN.
                    if color.is_finite() { row.dot(color) } else { color[channel.component] }
                }
            }
        };
        let samples = match value {
            Value::Uint(f) => Samples::Uint(Box::new(move |x, y| {
                let (stats, sums) = pixels.at(x0 + x as u32, y0 + y as u32);
                f(&stats, &sums)
            })),
            _ if half && layers.half => Samples::Half(Box::new(move |x, y| nearest_half(float(x, y)))),
            _ => Samples::Float(Box::new(float)),
        };
        AnyChannel::new(name, samples)
    });
    let mut own = LayerAttributes {
        layer_position: Vec2(x0 as i32, y0 as i32),
        software_name: Some(text(concat!("bismar ", env!("CARGO_PKG_VERSION")))),
        ..Default::default()
    };
    own.other.insert(text(CHECKSUM), AttributeValue::Text(text(checksum::PLACEHOLDER)));
    if converted.is_some() {
        own.other.insert(text(VARIANCE), AttributeValue::Text(text(ColorSpace::Rec709.name())));
    }
    for (name, value) in header {
        let value = match (name.as_ref(), value) {
            (_, HeaderValue::Text(t)) => AttributeValue::Text(text(t)),
            (_, HeaderValue::Number(x)) => AttributeValue::F64(*x),
            (WORLD_TO_CAMERA, HeaderValue::Matrix(m)) => {
                own.world_to_camera = Some(*m);
                continue;
            }
            (WORLD_TO_NDC, HeaderValue::Matrix(m)) => {
                own.world_to_normalized_device = Some(*m);
                continue;
            }
            (_, HeaderValue::Matrix(m)) => AttributeValue::Matrix4x4(*m),
        };
        own.other.insert(text(name), value);
    }
    let size = Vec2((x1 - x0) as usize, (y1 - y0) as usize);
    let denoised = layers.denoised.iter().flat_map(|(name, rgb)| {
        ["R", "G", "B"].into_iter().enumerate().map(move |(c, letter)| {
            let value = move |x: usize, y: usize| {
                let color = rgb[y * size.0 + x];
                converted.map_or(color[c], |matrix| matrix.row(c).dot(color.into()))
            };
            let samples = match layers.half {
                true => Samples::Half(Box::new(move |x, y| nearest_half(value(x, y)))),
                false => Samples::Float(Box::new(value)),
            };
            AnyChannel::new(text(&format!("{name}.{letter}")), samples)
        })
    });
    let layer = Layer::new(size, own, ENCODING, AnyChannels::sort(channels.chain(denoised).collect()));
    let [width, height] = pixels.size();
    let mut shared = ImageAttributes::new(IntegerBounds::from_dimensions(Vec2(width as usize, height as usize)));
    // Rec. 709 is the default; readers differ if it is not stated.
    let [rx, ry, gx, gy, bx, by, wx, wy] = layers.colorspace.chromaticities();
    let [red, green, blue, white] = [Vec2(rx, ry), Vec2(gx, gy), Vec2(bx, by), Vec2(wx, wy)];
    shared.chromaticities = Some(Chromaticities { red, green, blue, white });
    (shared, layer)
}

/// The nearest 16-bit float; larger finite values become the largest finite one.
fn nearest_half(x: f32) -> f16 {
    if x.is_finite() { f16::from_f32(x.clamp(f16::MIN.to_f32(), f16::MAX.to_f32())) } else { f16::from_f32(x) }
}

/// The values of a channel by column and row of its part, computed when their block is written.
enum Samples<'a> {
    Half(Box<dyn Fn(usize, usize) -> f16 + Sync + 'a>),
    Float(Box<dyn Fn(usize, usize) -> f32 + Sync + 'a>),
    Uint(Box<dyn Fn(usize, usize) -> u32 + Sync + 'a>),
}

impl<'a, 's> WritableSamples<'s> for Samples<'a>
where
    'a: 's,
{
    type Writer = &'s Samples<'a>;

    fn sample_type(&self) -> SampleType {
        match self {
            Samples::Half(_) => SampleType::F16,
            Samples::Float(_) => SampleType::F32,
            Samples::Uint(_) => SampleType::U32,
        }
    }

    fn infer_level_modes(&self) -> (LevelMode, RoundingMode) {
        (LevelMode::Singular, RoundingMode::Down)
    }

    fn create_samples_writer(&'s self, _: &ExrHeader) -> Self::Writer {
        self
    }
}

impl SamplesWriter for &Samples<'_> {
    fn extract_line(&self, line: LineRefMut<'_>) {
        let Vec2(x, y) = line.location.position;
        match self {
            Samples::Half(value) => line.write_samples(|i| value(x + i, y)),
            Samples::Float(value) => line.write_samples(|i| value(x + i, y)),
            Samples::Uint(value) => line.write_samples(|i| value(x + i, y)),
        }
        .expect("a line has room for its samples");
    }
}
