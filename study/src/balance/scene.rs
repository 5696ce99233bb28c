//! A scene to be studied: read once, built once.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::RenderSettings;
use bismar::scene::Scene;
use bismar::scene::import::{EnvironmentFile, ImportOptions, SceneFiles};
use bismar::{Error, Result};

use super::{Design, Mosaic};

/// A scene with its rays, and what identifies its pictures.
pub struct StudyScene {
    /// The file's name without folders and extension.
    pub name: String,
    pub scene: PreparedScene<'static>,
    /// Hash of files and settings.
    pub fingerprint: String,
    /// The first camera's view, without balance, samples and seed.
    pub settings: RenderSettings,
}

impl StudyScene {
    pub fn load(path: &Path, design: &Design) -> Result<Self> {
        let files = Files::open(path)?;
        let settings = RenderSettings {
            width: design.width,
            height: design.height,
            integrator: design.integrator,
            ..RenderSettings::even()
        };
        let mosaic = design.mosaic()?;
        let fingerprint = files.fingerprint(&settings, &mosaic)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self {
            name,
            scene: PreparedScene::build(Arc::new(files.import()?), Backend::Embree)?,
            fingerprint,
            settings,
        })
    }

    pub fn folder(&self, design: &Design) -> PathBuf {
        design.folder.join("cells").join(format!("{}-{}", self.name, self.fingerprint))
    }
}

/// A scene's files, opened once: what is hashed is what is rendered.
pub struct Files {
    scene: SceneFiles,
    environment: Option<EnvironmentFile>,
}

impl Files {
    /// Opens them; a file of the scene's name that ends in `.hdr` or `.exr` lights it from infinity.
    pub fn open(path: &Path) -> Result<Self> {
        let environment = ["hdr", "exr"].map(|e| path.with_extension(e)).into_iter().find(|p| p.is_file());
        Ok(Self {
            scene: SceneFiles::open(path)?,
            environment: environment.map(|p| EnvironmentFile::open(&p)).transpose()?,
        })
    }

    /// The scene, lit: one without any light gets a studio's.
    pub fn import(&self) -> Result<Scene> {
        let mut scene = self.scene.import(&ImportOptions::default())?.scene;
        scene.environment = self.environment.as_ref().map(|environment| environment.decode(0.0, 1.0)).transpose()?;
        scene.light_if_dark();
        Ok(scene)
    }

    /// Hash of everything outside of this program that pictures depend on. (Changes of the program are detected by rendering a
    /// piece of each stored measurement again: see [`measure`](super::measure()).)
    fn fingerprint(&self, settings: &RenderSettings, mosaic: &Mosaic) -> Result<String> {
        let environment = self.environment.as_ref().map_or(String::new(), EnvironmentFile::hash);
        let settings = serde_json::to_string(settings).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
        let pieces = if mosaic.is_whole() { String::new() } else { format!("{:?}", mosaic.picture) };
        let all = [self.scene.survey().hash, environment, settings, pieces].join("\n");
        Ok(blake3::hash(all.as_bytes()).to_hex()[..16].to_owned())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_changed_byte_anywhere_is_another_scene() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, buffer) = (folder.path().join("a.gltf"), folder.path().join("b.bin"));
        fs::write(&scene, r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"b.bin","byteLength":1}]}"#).unwrap();
        fs::write(&buffer, "1").unwrap();
        let with = |settings: &RenderSettings, footprint| {
            let mosaic = Mosaic::new([64, 32], footprint).unwrap();
            Files::open(&scene).unwrap().fingerprint(settings, &mosaic).unwrap()
        };
        let of = |settings: &RenderSettings| with(settings, None);
        let first = of(&RenderSettings::even());
        assert_eq!(first, of(&RenderSettings::even()));
        assert_ne!(first, of(&RenderSettings { width: 1, ..RenderSettings::even() }));
        assert_eq!(first, with(&RenderSettings::even(), Some([64, 32])));
        assert_ne!(first, with(&RenderSettings::even(), Some([640, 320])));
        fs::write(&buffer, "2").unwrap();
        assert_ne!(first, of(&RenderSettings::even()));
    }
}
