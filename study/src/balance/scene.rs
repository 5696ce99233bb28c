//! A scene to be studied: read once, built once.

use std::collections::hash_map::DefaultHasher;
use std::fs;
use std::hash::Hasher;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::RenderSettings;
use bismar::scene::Scene;
use bismar::scene::import::{self, ImportOptions};
use bismar::{Error, Result};
use serde_json::Value;

use super::Plan;

/// A scene with its rays, and what identifies its pictures.
pub struct StudyScene {
    /// The file's name without folders and extension.
    pub name: String,
    /// What is there.
    pub scene: PreparedScene<'static>,
    /// Of the files' bytes and the settings.
    pub fingerprint: u64,
    /// The first camera's view, without balance, samples and seed.
    pub settings: RenderSettings,
}

impl StudyScene {
    /// [Reads](read) and builds a scene.
    ///
    /// # Errors
    /// As [`read`] and [`PreparedScene::build`].
    pub fn load(path: &Path, plan: &Plan) -> Result<Self> {
        let (scene, sky) = read(path)?;
        let settings = RenderSettings {
            width: plan.width,
            height: plan.height,
            integrator: plan.integrator,
            ..RenderSettings::default()
        };
        let fingerprint = fingerprint(path, sky.as_deref(), &settings)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self { name, scene: PreparedScene::build(Arc::new(scene), Backend::Embree)?, fingerprint, settings })
    }

    /// Where its measurements are kept.
    pub fn folder(&self, plan: &Plan) -> PathBuf {
        plan.folder.join("cells").join(format!("{}-{:016x}", self.name, self.fingerprint))
    }
}

/// Reads a scene, and says which file lights it from infinity: one of the same name that ends in `.hdr` or `.exr`. A
/// scene without any light gets a plain white sky.
///
/// # Errors
/// As [`import::import`] and [`import::environment`].
pub fn read(path: &Path) -> Result<(Scene, Option<PathBuf>)> {
    let mut scene = import::import(path, &ImportOptions::default())?.scene;
    let sky = ["hdr", "exr"].map(|e| path.with_extension(e)).into_iter().find(|p| p.is_file());
    if let Some(sky) = &sky {
        scene.environment = Some(import::environment(sky, 0.0, 1.0)?);
    }
    scene.light_if_dark();
    Ok((scene, sky))
}

/// Of what the pictures depend on outside of this program. (What they depend on inside is found out by rendering a piece
/// of each stored measurement again: see [`measure`](super::measure()).) The hash may change with the standard library:
/// then everything is measured anew.
fn fingerprint(path: &Path, sky: Option<&Path>, settings: &RenderSettings) -> Result<u64> {
    let mut hasher = DefaultHasher::new();
    let bytes = fs::read(path).map_err(|e| Error::reading(path, &e))?;
    hasher.write(&bytes);
    let folder = path.parent().unwrap_or(Path::new(""));
    for file in referenced(&bytes).into_iter().map(|f| folder.join(f)).chain(sky.map(Path::to_owned)) {
        // What the importer could do without is not there for us either.
        if let Ok(bytes) = fs::read(&file) {
            hasher.write(&bytes);
        }
        hasher.write_u8(0);
    }
    let settings = serde_json::to_string(settings).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
    hasher.write(settings.as_bytes());
    Ok(hasher.finish())
}

/// Files that a glTF file names.
fn referenced(bytes: &[u8]) -> Vec<PathBuf> {
    let json = match bytes {
        [b'g', b'l', b'T', b'F', _, _, _, _, _, _, _, _, a, b, c, d, _, _, _, _, rest @ ..] => {
            &rest[..rest.len().min(u32::from_le_bytes([*a, *b, *c, *d]) as usize)]
        }
        text => text,
    };
    let document: Value = serde_json::from_slice(json).unwrap_or_default();
    let lists = ["buffers", "images"].into_iter().filter_map(|list| document[list].as_array());
    let uris = lists.flatten().filter_map(|entry| entry["uri"].as_str()).filter(|uri| !uri.starts_with("data:"));
    uris.map(|uri| percent_encoding::percent_decode_str(uri).decode_utf8_lossy().into_owned().into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn named_files_are_found_in_both_containers() {
        let json = br#"{"buffers":[{"uri":"a%20b.bin"},{"uri":"data:,x"},{}],"images":[{"uri":"t/c.png"}]}"#;
        let files = [PathBuf::from("a b.bin"), PathBuf::from("t/c.png")];
        assert_eq!(referenced(json), files);
        let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        glb.extend((json.len() as u32).to_le_bytes());
        glb.extend(b"JSON");
        glb.extend(json);
        glb.extend([0; 9]);
        assert_eq!(referenced(&glb), files);
        assert!(referenced(b"").is_empty());
    }

    #[test]
    fn a_changed_byte_anywhere_is_another_scene() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, buffer) = (folder.path().join("a.gltf"), folder.path().join("b.bin"));
        fs::write(&scene, r#"{"buffers":[{"uri":"b.bin"}]}"#).unwrap();
        fs::write(&buffer, "1").unwrap();
        let of = |settings: &RenderSettings| fingerprint(&scene, None, settings).unwrap();
        let first = of(&RenderSettings::default());
        assert_eq!(first, of(&RenderSettings::default()));
        assert_ne!(first, of(&RenderSettings { width: 1, ..Default::default() }));
        fs::write(&buffer, "2").unwrap();
        assert_ne!(first, of(&RenderSettings::default()));
    }
}
