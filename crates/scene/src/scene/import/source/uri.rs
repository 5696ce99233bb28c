//! URIs that a scene file may contain: files beside or below it, and data URIs.

use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;

/// Exporters disagree about padding; everything else is checked.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

#[derive(Debug)]
pub enum Resource {
    /// A regular file under the scene's folder.
    File(PathBuf),
    /// Data contained in the URI.
    Data {
        /// Media type, may be empty.
        mime: String,
        bytes: Vec<u8>,
    },
}

/// The scene's folder, with links resolved; every referenced file must lie under it.
///
/// # Errors
/// When the system cannot resolve it.
pub fn folder_of(scene: &Path) -> Result<PathBuf> {
    let parent = match scene.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    parent.canonicalize().map_err(|e| Error::reading(parent, &e))
}

/// Resolves the URI at JSON path `at`.
/// Errors: Any file without a `folder`; a scheme other than `data:`, an absolute path, a path or link that leaves `folder`,
/// anything but a regular file, malformed data: [`Error::Data`]. A file that does not exist: [`Error::Missing`].
pub fn resolve(uri: &str, folder: Option<&Path>, at: &str) -> Result<Resource> {
    if let Some(data) = uri.strip_prefix("data:") {
        return decode(data, at);
    }
    let Some(folder) = folder else {
        return Err(Error::Data(format!(
            "{at}: `{}` names a file, but a scene from standard input has no folder: embed it in the GLB",
            short(uri)
        )));
    };
    let refused = |why: &str| {
        Error::Data(format!(
            "{at}: `{}` {why}; only relative paths to files beside or below the scene file are read: move the file \
             there",
            short(uri)
        ))
    };
    // RFC 3986: the first segment of a relative reference has no colon.
    if uri.split('/').next().is_some_and(|segment| segment.contains(':')) {
        return Err(refused("has a scheme"));
    }
    if uri.is_empty() {
        return Err(refused("is empty"));
    }
    let name = percent_encoding::percent_decode_str(uri).decode_utf8().map_err(|_| refused("is not UTF-8"))?;
    if name.contains('\0') {
        return Err(refused("contains a NUL character"));
    }
    // Exporters on Windows write `\` between folders; a file that has one in its name is still found.
    let mut name = name.into_owned();
    if name.contains('\\') && !folder.join(&name).exists() {
        name = name.replace('\\', "/");
    }
    let relative = Path::new(&name);
    let mut depth = 0_i64;
    for component in relative.components() {
        match component {
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::ParentDir => depth -= 1,
            Component::RootDir | Component::Prefix(_) => return Err(refused("is an absolute path")),
        }
        if depth < 0 {
            return Err(refused("leaves the scene's folder"));
        }
    }
    let path = folder.join(relative);
    let in_place = |e: &std::io::Error| match Error::reading(&path, e) {
        Error::Missing(text) => Error::Missing(format!("{at}: {text}; put the file beside the scene")),
        Error::Permission(text) => Error::Permission(format!("{at}: {text}")),
        other => Error::Data(format!("{at}: {other}")),
    };
    let path = path.canonicalize().map_err(|e| in_place(&e))?;
    if !path.starts_with(folder) {
        return Err(refused("is a link that leaves the scene's folder"));
    }
    let meta = path.metadata().map_err(|e| in_place(&e))?;
    if !meta.is_file() {
        return Err(refused("is not a regular file"));
    }
    Ok(Resource::File(path))
}

/// `[mediatype][;parameter=value]*[;base64],data`.
fn decode(data: &str, at: &str) -> Result<Resource> {
    let malformed = |found: &str| bad(at, "a data URI (`data:<type>;base64,<data>`)", found);
    let (head, body) = data.split_once(',').ok_or_else(|| malformed("one without a comma"))?;
    let mut parameters = head.split(';');
    let mime = parameters.next().unwrap_or_default().to_ascii_lowercase();
    let mut base64 = false;
    for parameter in parameters {
        match parameter {
            "base64" if !base64 => base64 = true,
            _ if !base64 && parameter.contains('=') => {}
            _ => return Err(malformed(&format!("the parameter `{}`", short(parameter)))),
        }
    }
    let bytes = if base64 {
        let body = percent_encoding::percent_decode_str(body).collect::<Vec<u8>>();
        BASE64.decode(body).map_err(|e| malformed(&format!("data that is not base64 ({e})")))?
    } else {
        percent_encoding::percent_decode_str(body).collect()
    };
    Ok(Resource::Data { mime, bytes })
}

fn short(text: &str) -> String {
    text.chars().take(80).collect()
}
