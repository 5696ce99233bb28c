//! A scene's files, each opened once: what is hashed and measured is what is rendered, whatever happens to the files
//! meanwhile.

mod container;
mod read;
mod survey;
mod uri;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use serde_json::Value;

use crate::error::Result;
use container::Container;
pub use read::read_regular;
pub use survey::Survey;
use uri::Resource;

/// Data that a `uri` names.
#[derive(Debug, Clone)]
pub struct Data {
    /// The bytes.
    pub bytes: Bytes,
    /// Media type of a data URI, may be empty; `None` for files.
    pub mime: Option<String>,
}

/// A scene file and the files that it names, in memory.
#[derive(Debug)]
pub struct Source {
    /// The scene file's path.
    pub path: PathBuf,
    /// Its document.
    pub json: Value,
    /// Does it start with a byte-order mark?
    pub byte_order_mark: bool,
    /// The GLB's binary chunk.
    pub bin: Option<Bytes>,
    /// Bytes of all files, each counted once.
    pub file_bytes: u64,
    /// All files, the scene file first.
    pub files: Vec<PathBuf>,
    buffers: Vec<Option<Result<Data>>>,
    images: Vec<Option<Result<Data>>>,
}

impl Source {
    /// Reads them. What is wrong with a named file is kept until the document is checked.
    ///
    /// # Errors
    /// The scene file missing, forbidden, not regular or neither GLB nor JSON.
    pub fn open(path: &Path) -> Result<Self> {
        let Container { json, byte_order_mark, bin, file_bytes } = container::read(path)?;
        let folder = uri::folder_of(path)?;
        let mut files = Files { folder, bytes: file_bytes, by_path: HashMap::new() };
        let (buffers, images) = (files.read_all(&json, "buffers"), files.read_all(&json, "images"));
        let Files { bytes: file_bytes, by_path, .. } = files;
        let files = [path.to_owned()].into_iter().chain(by_path.into_keys()).collect();
        Ok(Self { path: path.into(), json, byte_order_mark, bin, file_bytes, files, buffers, images })
    }

    /// What `buffers[index].uri` names; `None` without a URI.
    ///
    /// # Errors
    /// A URI that is refused, a file that is not there or cannot be read; with the place in the document.
    pub fn buffer(&self, index: usize) -> Result<Option<Data>> {
        self.buffers.get(index).cloned().flatten().transpose()
    }

    /// As [`Self::buffer`], of `images[index].uri`.
    ///
    /// # Errors
    /// Likewise.
    pub fn image(&self, index: usize) -> Result<Option<Data>> {
        self.images.get(index).cloned().flatten().transpose()
    }
}

/// Files by path, each read once however often it is named.
struct Files {
    folder: PathBuf,
    bytes: u64,
    by_path: HashMap<PathBuf, Bytes>,
}

impl Files {
    fn read_all(&mut self, json: &Value, list: &str) -> Vec<Option<Result<Data>>> {
        let items = json[list].as_array().into_iter().flatten().enumerate();
        items.map(|(i, item)| Some(self.read(item["uri"].as_str()?, &format!("{list}[{i}].uri")))).collect()
    }

    fn read(&mut self, uri: &str, at: &str) -> Result<Data> {
        let path = match uri::resolve(uri, &self.folder, at)? {
            Resource::Data { mime, bytes } => return Ok(Data { bytes: bytes.into(), mime: Some(mime) }),
            Resource::File(path) => path,
        };
        if let Some(bytes) = self.by_path.get(&path) {
            return Ok(Data { bytes: bytes.clone(), mime: None });
        }
        let bytes = Bytes::from(read_regular(&path, u64::MAX)?);
        self.bytes += bytes.len() as u64;
        self.by_path.insert(path, bytes.clone());
        Ok(Data { bytes, mime: None })
    }
}
