//! Buffer views under EXT_meshopt_compression and KHR_meshopt_compression: the parameters of the decoder.

use meshoptimizer_rs::codec::{self, Mode};
use meshoptimizer_rs::{Error, Workspace};

use super::json::Json;
use crate::error::Result;

/// Inverts a filter after a meshopt stream of attributes is decoded: bytes, number of elements, bytes of each.
pub type InvertFilter = fn(&mut [u8], usize, usize, &mut Workspace) -> std::result::Result<(), Error>;

/// Parameters of a compressed buffer view.
#[derive(Debug)]
pub struct Meshopt {
    pub buffer: usize,
    pub offset: u64,
    pub length: u64,
    pub stride: u64,
    pub count: u64,
    pub mode: Mode,
    pub filter: Option<InvertFilter>,
    pub at: String,
}

impl Meshopt {
    /// Parses the extension of a buffer view; `None` if the view is not compressed.
    pub fn parse(view: &Json) -> Result<Option<Self>> {
        let khr = view.extension("KHR_meshopt_compression")?;
        let color = khr.is_some();
        let Some(json) = khr.map_or_else(|| view.extension("EXT_meshopt_compression"), |json| Ok(Some(json)))? else {
            return Ok(None);
        };
        let need = |key: &str| json.need(key, json.integer(key)?);
        let buffer = json.need("buffer", json.index("buffer", "buffers")?)?;
        let (offset, length) = (json.integer("byteOffset")?.unwrap_or(0), need("byteLength")?);
        let (stride, count) = (need("byteStride")?, need("count")?);
        let text = json.need("mode", json.string("mode")?)?;
        let mode = match Mode::parse(text) {
            Ok(mode) => mode,
            Err(_) => return Err(json.bad("mode", "ATTRIBUTES, TRIANGLES or INDICES", text)),
        };
        let filter: Option<InvertFilter> = match json.string("filter")?.unwrap_or("NONE") {
            "NONE" => None,
            "OCTAHEDRAL" => Some(codec::decode_filter_oct),
            "QUATERNION" => Some(codec::decode_filter_quat),
            "EXPONENTIAL" => Some(codec::decode_filter_exp),
            "COLOR" if color => Some(codec::decode_filter_color),
            other => return Err(json.bad("filter", "NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL", other)),
        };
        let whole = view.need("byteLength", view.integer("byteLength")?)?;
        if count == 0 || count.checked_mul(stride) != Some(whole) {
            let wanted = format!("elements that fill the view's {whole} bytes");
            return Err(json.bad("count", wanted, format!("{count} of {stride} bytes")));
        }
        Ok(Some(Self { buffer, offset, length, stride, count, mode, filter, at: json.at }))
    }
}
