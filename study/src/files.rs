//! Output files: tables, pages, and measurements for resuming.

use std::fs;
use std::io::Write;
use std::path::Path;

use bismar::film::atomic;
use bismar::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_aux::prelude::serde_introspect;

/// Makes a folder, and those above it.
pub fn folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", path.display())))
}

/// Writes a file whole or not at all.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    atomic::write(path, |file| Ok(Ok(file.write_all(bytes.as_ref())?)))
}

pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    write(path, serde_json::to_string_pretty(value).map_err(|e| Error::Bug(format!("JSON: {e}")))?)
}

/// Writes rows as CSV with a header line, also where there are no rows; what there is not is empty.
pub fn write_csv<Row: Serialize + DeserializeOwned>(path: &Path, rows: &[Row]) -> Result<()> {
    let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    writer.write_record(serde_introspect::<Row>()).map_err(|e| Error::Bug(format!("CSV: {e}")))?;
    for row in rows {
        writer.serialize(row).map_err(|e| Error::Bug(format!("CSV: {e}")))?;
    }
    write(path, writer.into_inner().map_err(|e| Error::Bug(format!("CSV: {e}")))?)
}

/// First bytes of a record; the digit is raised when a kind of record changes.
const MAGIC: &[u8] = b"bismar study 4\n";

/// Keeps a measurement: a magic line, BLAKE3 of the rest, the value in postcard's encoding.
pub fn keep(path: &Path, value: &impl Serialize) -> Result<()> {
    let payload = postcard::to_stdvec(value).map_err(|e| Error::Bug(format!("a measurement cannot be kept: {e}")))?;
    // Only a file that begins like a record is replaced; it may be cut off or damaged.
    let is_file = fs::symlink_metadata(path).is_ok_and(|data| data.is_file());
    if is_file && fs::read(path).is_ok_and(|old| old.starts_with(MAGIC)) {
        let _ = fs::remove_file(path);
    }
    write(path, [MAGIC, blake3::hash(&payload).as_bytes(), &payload].concat())
}

/// Reads what [`keep`] wrote; `None` for anything else, and for what is cut off or damaged.
pub fn kept<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let bytes = fs::read(path).map_err(|e| Error::reading(path, &e))?;
    let payload = bytes.strip_prefix(MAGIC).and_then(|rest| rest.split_first_chunk());
    Ok(payload
        .filter(|(hash, payload)| blake3::hash(payload) == **hash)
        .and_then(|(_, payload)| postcard::from_bytes(payload).ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_its_header_with_and_without_rows() {
        #[derive(Serialize, serde::Deserialize)]
        struct Row {
            name: String,
            seconds: Option<f64>,
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        write_csv::<Row>(&path, &[]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "name,seconds\n");
        write_csv(&path, &[Row { name: "a,b".into(), seconds: None }]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "name,seconds\n\"a,b\",\n");
    }

    #[test]
    fn what_is_kept_comes_back_to_the_bit_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        assert!(matches!(kept::<Vec<f32>>(&path), Err(Error::Missing(_))));
        let values = vec![1.5f32, -0.0, f32::MIN_POSITIVE, f32::INFINITY];
        keep(&path, &("name".to_owned(), values.clone())).unwrap();
        let (name, again) = kept::<(String, Vec<f32>)>(&path).unwrap().unwrap();
        assert_eq!((name.as_str(), again.iter().map(|x| x.to_bits()).collect::<Vec<_>>()), {
            ("name", values.iter().map(|x| x.to_bits()).collect())
        });
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            fs::write(&path, &whole[..at]).unwrap();
            assert!(kept::<(String, Vec<f32>)>(&path).unwrap().is_none(), "{at} bytes");
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            fs::write(&path, bytes).unwrap();
            assert!(kept::<(String, Vec<f32>)>(&path).unwrap().is_none(), "byte {at}");
        }
    }
}
