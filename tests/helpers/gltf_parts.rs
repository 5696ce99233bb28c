//! Small glTF files for tests, and what must hold for all of them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use base64::Engine;
use bismar::Error;
use bismar::scene::TextureSlot;
use bismar::scene::import::{ImportOptions, Imported, import};
use cpu_time::ThreadTime;

pub use super::glb::floats;

/// A folder with a scene file in it.
pub fn scene_file(name: &str, bytes: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

pub fn data_uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
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
    /// With these materials, of which the triangle has the first.
    pub fn of_materials(materials: &str) -> Self {
        let primitive = r#"{"attributes":{"POSITION":0},"material":0}"#.into();
        Self { primitive, more: format!(r#","materials":[{materials}]"#), ..Self::default() }
    }

    /// With this punctual light in the triangle's node.
    pub fn of_light(light: &str) -> Self {
        let nodes = r#"[{"mesh":0,"extensions":{"KHR_lights_punctual":{"light":0}}}]"#.into();
        let more = format!(r#","extensions":{{"KHR_lights_punctual":{{"lights":[{light}]}}}}"#);
        Self { nodes, more, ..Self::default() }
    }

    pub fn json(&self) -> String {
        self.json_with(&data_uri("application/octet-stream", &self.positions))
    }

    /// With the data elsewhere.
    pub fn json_with(&self, uri: &str) -> String {
        let Self { positions, accessor, primitive, nodes, more } = self;
        let n = positions.len();
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":{nodes},
            "meshes":[{{"primitives":[{primitive}]}}],"accessors":[{accessor}],
            "bufferViews":[{{"buffer":0,"byteLength":{n}}}],
            "buffers":[{{"byteLength":{n},"uri":"{uri}"}}]{more}}}"#
        )
    }

    pub fn import(&self) -> Result<Imported, Error> {
        let (_folder, path) = scene_file("scene.gltf", self.json());
        import(&path, &ImportOptions::default())
    }
}

/// Processor time, so that a busy machine has no part in it: longer than any file of the set needs by far.
pub const LONGEST: Duration = Duration::from_secs(30);

/// What came of one file, the import's result or what a panic said, and its processor time.
pub fn attempt(path: &Path) -> (Result<Result<Imported, Error>, String>, Duration) {
    // All of it on one thread, whose time it is.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (outcome, time) = alone.install(|| {
        let start = ThreadTime::now();
        (catch_unwind(AssertUnwindSafe(|| import(path, &ImportOptions::default()))), start.elapsed())
    });
    let outcome = outcome.map_err(|payload| {
        let text = payload.downcast_ref::<String>().cloned();
        text.or_else(|| payload.downcast_ref::<&str>().map(|s| s.to_string())).unwrap_or_default()
    });
    (outcome, time)
}

/// What every accepted scene promises to those who render it.
pub fn check_scene(imported: &Imported) -> Result<(), String> {
    let scene = &imported.scene;
    let promise = |holds: bool, what: &str| if holds { Ok(()) } else { Err(what.to_string()) };
    promise(!scene.cameras.is_empty(), "a camera")?;
    for camera in &scene.cameras {
        let m = camera.to_world.matrix3;
        promise(camera.to_world.is_finite() && (m.determinant() - 1.0).abs() < 1e-5, "cameras without scale")?;
    }
    for mesh in &scene.meshes {
        let n = mesh.positions.len();
        promise(mesh.indices.iter().flatten().all(|&i| (i as usize) < n), "indices below the vertex count")?;
        promise(mesh.positions.iter().flatten().all(|x| x.is_finite()), "finite positions")?;
        let mut lengths = vec![n];
        lengths.extend(mesh.normals.as_ref().map(Vec::len));
        let tangents = || [&mesh.tangents, &mesh.coat_tangents].into_iter().flatten();
        lengths.extend(tangents().map(Vec::len));
        lengths.extend(mesh.texcoords.iter().flatten().map(Vec::len));
        lengths.extend(mesh.colors.as_ref().map(Vec::len));
        promise(lengths.iter().all(|&l| l == n), "attributes as long as positions")?;
        let unit = |v: &[f32]| (v.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5;
        promise(mesh.normals.iter().flatten().all(|n| unit(n)), "unit normals")?;
        promise(tangents().flatten().all(|t| unit(&t[..3]) && t[3].abs() == 1.0), "unit tangents")?;
        let material = scene.materials.get(mesh.material as usize).ok_or("materials that exist")?;
        // What is anisotropic without a normal map may do without.
        let slots = [TextureSlot::Normal, TextureSlot::ClearcoatNormal];
        let mapped = slots.iter().any(|&slot| material.textures[slot].is_some());
        let promised =
            if mapped { mesh.tangents.is_some() } else { mesh.tangents.is_none() || material.anisotropy > 0.0 };
        promise(promised, "tangents where a normal map is")?;
        promise(mesh.tangents.is_none() || mesh.normals.is_some(), "normals where tangents are")?;
        for texture in material.textures.iter() {
            promise(mesh.texcoords[usize::from(texture.set)].is_some(), "coordinates for every texture")?;
            scene.sample_texture(texture, glam::Vec2::new(0.3, 0.7));
        }
    }
    for texture in &scene.textures {
        promise((texture.image as usize) < scene.images.len(), "images that exist")?;
    }
    for object in &scene.objects {
        promise(object.meshes.end as usize <= scene.meshes.len() && !object.meshes.is_empty(), "meshes of objects")?;
    }
    for instance in &scene.instances {
        promise((instance.object as usize) < scene.objects.len(), "objects that exist")?;
        let invertible = instance.transform.is_none_or(|t| t.is_finite() && t.inverse().is_finite());
        promise(invertible, "invertible instances")?;
    }
    serde_json::to_string(&bismar::scene::import::summary(imported)).map_err(|e| e.to_string())?;
    Ok(())
}
