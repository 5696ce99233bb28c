//! What `bismar inspect` shows.

use serde::Serialize;

use super::build::{image_bytes, mesh_bytes};
use super::report::{Note, NoteKind, SceneCounts};
use super::{ImportReport, Imported};
use crate::scene::{AlphaMode, Material, Projection, PunctualKind, TextureSlot};

/// A camera, for people.
#[derive(Debug, Clone, Serialize)]
pub struct CameraSummary {
    /// Index for `--camera`.
    pub index: usize,
    /// Name for `--camera`.
    pub name: String,
    /// `perspective` or `orthographic`.
    pub projection: &'static str,
    /// Vertical field of view in degrees, or half the height in metres.
    pub vertical: f32,
    /// Width over height, when the file says one.
    pub aspect: Option<f32>,
    /// Metres.
    pub position: [f32; 3],
}

/// A punctual light, for people.
#[derive(Debug, Clone, Serialize)]
pub struct LightSummary {
    /// Name.
    pub name: String,
    /// `directional`, `point` or `spot`.
    pub kind: &'static str,
    /// Linear RGB; lux for directional lights, candela for others.
    pub intensity: [f32; 3],
    /// Metres to where it ends, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<f32>,
}

/// A material, for people.
#[derive(Debug, Clone, Serialize)]
pub struct MaterialSummary {
    /// Name.
    pub name: String,
    /// What of the model it switches on.
    pub features: Vec<&'static str>,
    /// Triangles that have it, each instance counted once.
    pub triangles: u64,
}

/// A mesh, for people.
#[derive(Debug, Clone, Serialize)]
pub struct MeshSummary {
    /// Name.
    pub name: String,
    /// Triangles.
    pub triangles: u64,
    /// Placements.
    pub instances: u64,
    /// Its material's name.
    pub material: String,
    /// Bytes of vertices and indices.
    pub bytes: u64,
}

/// A decoded picture, for people.
#[derive(Debug, Clone, Serialize)]
pub struct ImageSummary {
    /// Name or URI.
    pub name: String,
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes in memory.
    pub bytes: u64,
}

/// What was modelled, approximated and left out.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// The file, as it was named.
    pub file: String,
    /// What wrote it, if it says so.
    pub generator: Option<String>,
    /// Bytes of the file and of the files that it names.
    pub file_bytes: u64,
    /// Wall time of the import.
    pub read_seconds: f64,
    /// Sizes.
    pub counts: SceneCounts,
    /// Cameras; at least one.
    pub cameras: Vec<CameraSummary>,
    /// Punctual lights.
    pub lights: Vec<LightSummary>,
    /// Does any surface emit light?
    pub has_emissive_meshes: bool,
    /// Materials.
    pub materials: Vec<MaterialSummary>,
    /// Meshes.
    pub meshes: Vec<MeshSummary>,
    /// Decoded pictures.
    pub images: Vec<ImageSummary>,
    /// Names of the document's scenes; empty for those without.
    pub scenes: Vec<String>,
    /// Names of its material variants.
    pub variants: Vec<String>,
    /// Extensions shown as they ask.
    pub extensions_used: Vec<String>,
    /// Extensions shown, but not exactly: none at present.
    pub extensions_approximated: Vec<String>,
    /// Extensions left out.
    pub extensions_ignored: Vec<String>,
    /// Shown, but not exactly.
    pub approximated: Vec<Note>,
    /// Left out though it has an effect on the picture.
    pub ignored: Vec<Note>,
    /// Left out because the picture does not need it.
    pub not_loaded: Vec<Note>,
    /// Repairs and conventions.
    pub remarks: Vec<Note>,
}

/// Sums up an imported scene.
pub fn summary(imported: &Imported) -> Summary {
    let Imported { scene, report } = imported;
    let mut placements = vec![0_u64; scene.objects.len()];
    scene.instances.iter().for_each(|i| placements[i.object as usize] += 1);
    let mut meshes = Vec::with_capacity(scene.meshes.len());
    for (object, &instances) in scene.objects.iter().zip(&placements) {
        for mesh in &scene.meshes[object.meshes.start as usize..object.meshes.end as usize] {
            meshes.push(MeshSummary {
                name: mesh.name.clone(),
                triangles: mesh.indices.len() as u64,
                instances,
                material: scene.materials[mesh.material as usize].name.clone(),
                bytes: mesh_bytes(mesh),
            });
        }
    }
    let mut triangles = vec![0_u64; scene.materials.len()];
    scene.meshes.iter().for_each(|m| triangles[m.material as usize] += m.indices.len() as u64);
    let notes = |report: &ImportReport, kinds: &[NoteKind]| {
        report.notes.iter().filter(|n| kinds.contains(&n.kind)).cloned().collect::<Vec<_>>()
    };
    Summary {
        file: report.file.clone(),
        generator: report.generator.clone(),
        file_bytes: report.file_bytes,
        read_seconds: report.read_seconds,
        counts: report.counts.clone(),
        cameras: scene.cameras.iter().enumerate().map(|(index, c)| camera(index, c)).collect(),
        lights: scene.lights.iter().map(light).collect(),
        has_emissive_meshes: scene.meshes.iter().any(|m| scene.materials[m.material as usize].is_emissive()),
        materials: scene
            .materials
            .iter()
            .zip(triangles)
            .map(|(m, triangles)| MaterialSummary { name: m.name.clone(), features: features(m), triangles })
            .collect(),
        meshes,
        images: scene
            .images
            .iter()
            .map(|i| ImageSummary { name: i.name.clone(), width: i.width, height: i.height, bytes: image_bytes(i) })
            .collect(),
        scenes: report.scenes.clone(),
        variants: report.variants.clone(),
        extensions_used: report.extensions_used.clone(),
        extensions_approximated: Vec::new(),
        extensions_ignored: report.extensions_ignored.clone(),
        approximated: notes(report, &[NoteKind::Approximated]),
        ignored: notes(report, &[NoteKind::Ignored]),
        not_loaded: notes(report, &[NoteKind::NotLoaded]),
        remarks: notes(report, &[NoteKind::Repaired, NoteKind::Convention]),
    }
}

fn camera(index: usize, camera: &crate::scene::Camera) -> CameraSummary {
    let (projection, vertical) = match camera.projection {
        Projection::Perspective { yfov } => ("perspective", yfov.to_degrees()),
        Projection::Orthographic { ymag, .. } => ("orthographic", ymag),
    };
    let position = camera.to_world.translation.to_array();
    CameraSummary { index, name: camera.name.clone(), projection, vertical, aspect: camera.aspect, position }
}

fn light(light: &crate::scene::PunctualLight) -> LightSummary {
    let kind = match light.kind {
        PunctualKind::Directional => "directional",
        PunctualKind::Point => "point",
        PunctualKind::Spot { .. } => "spot",
    };
    let range = Some(light.range).filter(|range| range.is_finite() && kind != "directional");
    LightSummary { name: light.name.clone(), kind, intensity: light.intensity.to_array(), range }
}

fn features(m: &Material) -> Vec<&'static str> {
    let textured = |slot| m.textures[slot].is_some();
    let all = [
        (m.unlit, "unlit"),
        (textured(TextureSlot::BaseColor), "base colour texture"),
        (textured(TextureSlot::MetallicRoughness), "metallic-roughness texture"),
        (textured(TextureSlot::Normal), "normal map"),
        (m.is_emissive(), "emissive"),
        (textured(TextureSlot::Emissive), "emissive texture"),
        (textured(TextureSlot::Specular) || textured(TextureSlot::SpecularColor), "specular texture"),
        (m.clearcoat > 0.0, "clear coat"),
        (m.sheen_color.max_element() > 0.0, "sheen"),
        (m.specular_glossiness.is_some(), "specular-glossiness"),
        (m.transmits() && !m.bounds_medium, "transmission"),
        (m.transmits() && m.bounds_medium, "transmission into a body"),
        (matches!(m.alpha_mode, AlphaMode::Mask(_)), "alpha mask"),
        (m.alpha_mode == AlphaMode::Blend, "alpha blend"),
        (m.double_sided, "double-sided"),
    ];
    all.into_iter().filter(|(on, _)| *on).map(|(_, name)| name).collect()
}
