//! A scene's files. Each is opened once, so that the data that is hashed is the data that is rendered.

mod blob;
mod census;
mod container;
mod input;
mod reach;
mod read;
mod survey;
mod uri;

use std::collections::HashMap;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::error::Result;
pub use blob::Blob;
pub use census::Census;
use container::{Container, Repairs};
use input::Input;
pub use input::STANDARD_INPUT;
use reach::Reach;
use read::{open_regular, refuse_pointer};
pub use read::{read_own, read_regular, read_text};
pub use survey::Survey;
use uri::Resource;

/// Data that a `uri` names.
#[derive(Debug, Clone)]
pub struct Data {
    pub bytes: Blob,
    /// Media type of a data URI, may be empty; `None` for files.
    pub mime: Option<String>,
}

/// A scene file and the files that it refers to, in memory, except for data that none of its scenes can show.
#[derive(Debug)]
pub struct Source {
    pub path: PathBuf,
    pub json: Value,
    /// Small faults of it that were mended.
    pub repairs: Repairs,
    pub bin: Option<Blob>,
    /// Size of all files in bytes, each counted once.
    pub file_bytes: u64,
    /// Number of these bytes that were read.
    read_bytes: u64,
    /// All files, the scene file first; none for what comes from standard input.
    pub files: Vec<PathBuf>,
    buffers: Vec<Option<Result<Data>>>,
    images: Vec<Option<Result<Data>>>,
    reach: Reach,
}

impl Source {
    /// Reads the files. Errors of files that the document refers to are kept until the document is checked.
    /// Errors: The scene file missing, forbidden, not regular or neither GLB nor JSON.
    pub fn open(path: &Path) -> Result<Self> {
        Self::of(path, container::open(path)?, Some(uri::folder_of(path)?))
    }

    /// Reads a GLB of at most `limit` bytes, which has no folder: it can name no other file.
    pub fn read_glb(reader: &mut dyn Read, limit: u64) -> Result<Self> {
        let (path, bytes) = (Path::new(STANDARD_INPUT), container::read_glb(reader, limit)?);
        let file_bytes = bytes.len() as u64;
        Self::of(path, container::read(path, Input::Memory(bytes), file_bytes)?, None)
    }

    fn of(path: &Path, container: Container, folder: Option<PathBuf>) -> Result<Self> {
        let Container { json, repairs, input, file_bytes, bin } = container;
        let reach = Reach::of(&json);
        let bin = match bin {
            Some(within) => Some(Blob::read(path, &input, within, Some(reach.ranges(&json, 0)))?),
            None => None,
        };
        let resolve = |list: &str| -> Vec<Option<Result<Resource>>> {
            let items = reach::items(&json[list]).enumerate();
            items
                .map(|(i, item)| {
                    Some(uri::resolve(item["uri"].as_str()?, folder.as_deref(), &format!("{list}[{i}].uri")))
                })
                .collect()
        };
        let (buffers, images) = (resolve("buffers"), resolve("images"));
        let mut files = Wanted::new();
        for (i, buffer) in buffers.iter().enumerate() {
            want(&mut files, buffer.as_ref(), Some(reach.ranges(&json, i)));
        }
        // A picture is read completely or not at all.
        for (image, reached) in images.iter().zip(&reach.images) {
            want(&mut files, image.as_ref(), (!reached).then(Vec::new));
        }
        let read = |(path, wanted): (PathBuf, _)| {
            let blob = read(&path, wanted);
            (path, blob)
        };
        let blobs: HashMap<_, _> = files.into_iter().map(read).collect();
        let data = |named: Vec<Option<Result<Resource>>>| -> Vec<Option<Result<Data>>> {
            let data = |resource| match resource {
                Resource::Data { mime, bytes } => Ok(Data { bytes: Blob::whole(bytes.into()), mime: Some(mime) }),
                Resource::File(path) => Ok(Data { bytes: blobs[&path].clone()?, mime: None }),
            };
            named.into_iter().map(|resource| Some(resource?.and_then(data))).collect()
        };
        let (buffers, images) = (data(buffers), data(images));
        let sound = || blobs.iter().filter_map(|(path, blob)| Some((path, blob.as_ref().ok()?)));
        // What is in memory was read whole.
        let in_memory = matches!(input, Input::Memory(_));
        let left_out = |blob: &Blob| if in_memory { 0 } else { blob.length - blob.read_bytes() };
        let file_bytes = file_bytes + sound().map(|(_, blob)| blob.length).sum::<u64>();
        let read_bytes =
            file_bytes - sound().map(|(_, blob)| left_out(blob)).chain(bin.iter().map(left_out)).sum::<u64>();
        let files =
            folder.map(|_| path).into_iter().chain(sound().map(|(path, _)| &**path)).map(Path::to_owned).collect();
        Ok(Self { path: path.into(), json, repairs, bin, file_bytes, read_bytes, files, buffers, images, reach })
    }

    /// Data of `buffers[index].uri`; `None` without a URI.
    /// Errors: A URI that is refused, a file that is missing or cannot be read; with the JSON path.
    pub fn buffer(&self, index: usize) -> Result<Option<Data>> {
        self.buffers.get(index).cloned().flatten().transpose()
    }

    /// Data of `images[index].uri`; `None` without a URI or if no scene can show it.
    /// Errors: A URI that is refused, a file that is missing or cannot be read; with the JSON path.
    pub fn image(&self, index: usize) -> Result<Option<Data>> {
        self.images.get(index).cloned().flatten().transpose()
    }
}

/// Byte ranges to read of each file; `None` for the whole file.
type Wanted = HashMap<PathBuf, Option<Vec<Range<u64>>>>;

fn want(files: &mut Wanted, resource: Option<&Result<Resource>>, ranges: Option<Vec<Range<u64>>>) {
    let Some(Ok(Resource::File(path))) = resource else { return };
    let wanted = files.entry(path.clone()).or_insert_with(|| Some(Vec::new()));
    match (wanted.as_mut(), ranges) {
        (Some(wanted), Some(ranges)) => wanted.extend(ranges),
        _ => *wanted = None,
    }
}

fn read(path: &Path, wanted: Option<Vec<Range<u64>>>) -> Result<Blob> {
    let (file, size) = open_regular(path, u64::MAX)?;
    let blob = Blob::read(path, &Input::File(file), 0..size, wanted)?;
    refuse_pointer(path, &blob.all())?;
    Ok(blob)
}
