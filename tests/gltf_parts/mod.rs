//! Small glTF files for tests.

use std::path::PathBuf;

use base64::Engine;
use bismar::Error;
use bismar::scene::import::{ImportOptions, Imported, import};

/// A folder with a scene file in it.
pub fn scene_file(name: &str, bytes: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

pub const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A scene of one triangle; the parts can be replaced.
pub struct Parts {
    pub positions: Vec<u8>,
    pub accessor: String,
    pub primitive: String,
    pub nodes: String,
    pub more: String,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            positions: floats(&TRIANGLE),
            accessor: r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}"#.into(),
            primitive: r#"{"attributes":{"POSITION":0}}"#.into(),
            nodes: r#"[{"mesh":0}]"#.into(),
            more: String::new(),
        }
    }
}

impl Parts {
    pub fn json(&self) -> String {
        let Self { positions, accessor, primitive, nodes, more } = self;
        let n = positions.len();
        let data = base64::engine::general_purpose::STANDARD.encode(positions);
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":{nodes},
            "meshes":[{{"primitives":[{primitive}]}}],"accessors":[{accessor}],
            "bufferViews":[{{"buffer":0,"byteLength":{n}}}],
            "buffers":[{{"byteLength":{n},"uri":"data:application/octet-stream;base64,{data}"}}]{more}}}"#
        )
    }

    pub fn import(&self) -> Result<Imported, Error> {
        let (_folder, path) = scene_file("scene.gltf", self.json());
        import(&path, &ImportOptions::default())
    }
}
