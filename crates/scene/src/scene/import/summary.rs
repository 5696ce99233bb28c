//! Summary of an imported scene, printed by `bismar inspect`.

use serde::Serialize;

use super::build::{image_bytes, mesh_bytes};
use super::report::{Note, NoteKind, SceneCounts};
use super::{ImportReport, Imported};
use crate::scene::{AlphaMode, Material, Projection, PunctualKind, Scene, TextureSlot};

#[derive(Debug, Clone, Serialize)]
pub struct CameraSummary {
    /// Index for `--camera`.
    pub index: usize,
    /// Name for `--camera`.
    pub name: String,
    /// `perspective` or `orthographic`.
    pub projection: &'static str,
    /// Vertical field of view in degrees (perspective), or half height in metres (orthographic).
    pub vertical: f32,
    /// Width over height, if the file states it.
    pub aspect: Option<f32>,
    /// Position in world space, metres.
    pub position: [f32; 3],
    /// Near clipping plane, a depth along the view axis in metres, if the camera has planes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub znear: Option<f32>,
    /// Far clipping plane, likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zfar: Option<f32>,
    /// Why it cannot be used, if it is faulty; its projection is then a stand-in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
}

#[derive(Debug, Clone, Serialize)]
pub struct LightSummary {
    pub name: String,
    /// `directional`, `point` or `spot`.
    pub kind: &'static str,
    /// Linear RGB; lux for directional lights, candela for others.
    pub intensity: [f32; 3],
    /// Range in metres, if limited.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<f32>,
    /// Angle in degrees that a directional light subtends, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<f32>,
}

#[derive(Debug, Clone, Serialize)]
pub struct MaterialSummary {
    pub name: String,
    /// Features of the material model that it uses.
    pub features: Vec<&'static str>,
    /// Triangles with this material, not counting instances.
    pub triangles: u64,
}

#[derive(Debug, Clone, Serialize)]
pub struct MeshSummary {
    pub name: String,
    pub triangles: u64,
    pub instances: u64,
    pub material: String,
    pub bytes: u64,
}

#[derive(Debug, Clone, Serialize)]
pub struct ImageSummary {
    /// Name or URI.
    pub name: String,
    pub width: u32,
    pub height: u32,
    pub bytes: u64,
}

/// Contents of a scene, and what was approximated and omitted.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Path of the file as given.
    pub file: String,
    /// Software that wrote the file, if stated.
    pub generator: Option<String>,
    /// Size in bytes of the file and of the files that it refers to.
    pub file_bytes: u64,
    pub read_seconds: f64,
    pub counts: SceneCounts,
    /// Cameras; at least one.
    pub cameras: Vec<CameraSummary>,
    pub lights: Vec<LightSummary>,
    pub has_emissive_meshes: bool,
    pub materials: Vec<MaterialSummary>,
    pub meshes: Vec<MeshSummary>,
    pub images: Vec<ImageSummary>,
    /// Names of the document's scenes; empty for those without.
    pub scenes: Vec<String>,
    pub variants: Vec<String>,
    /// Names of its animations; `animations[3]` for one without.
    pub animations: Vec<String>,
    pub extensions_used: Vec<String>,
    /// Extensions rendered approximately; none at present.
    pub extensions_approximated: Vec<String>,
    pub extensions_ignored: Vec<String>,
    pub approximated: Vec<Note>,
    /// Notes of what is omitted although it affects the picture.
    pub ignored: Vec<Note>,
    /// Notes of what is omitted because the picture does not need it.
    pub not_loaded: Vec<Note>,
    /// Notes of repairs and conventions.
    pub remarks: Vec<Note>,
}

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
        cameras: scene.cameras.iter().enumerate().map(|(index, c)| camera(scene, index, c)).collect(),
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
        animations: report.animations.clone(),
        extensions_used: report.extensions_used.clone(),
        extensions_approximated: Vec::new(),
        extensions_ignored: report.extensions_ignored.clone(),
        approximated: notes(report, &[NoteKind::Approximated]),
        ignored: notes(report, &[NoteKind::Ignored]),
        not_loaded: notes(report, &[NoteKind::NotLoaded]),
        remarks: notes(report, &[NoteKind::Repaired, NoteKind::Convention]),
    }
}

fn camera(scene: &Scene, index: usize, camera: &crate::scene::Camera) -> CameraSummary {
    let (projection, vertical) = match camera.projection {
        Projection::Perspective { yfov } => ("perspective", yfov.to_degrees()),
        Projection::Orthographic { ymag, .. } => ("orthographic", ymag),
        Projection::Panorama => ("panorama", 180.0),
        Projection::Calibrated(of) => (of.described().0, of.described().1 as f32),
    };
    let position = (camera.to_world.translation.as_dvec3() + scene.origin).as_vec3().to_array();
    let znear = camera.clip.map(|[near, _]| near);
    let zfar = camera.clip.map(|[_, far]| far).filter(|far| far.is_finite());
    CameraSummary {
        index,
        name: camera.name.clone(),
        projection,
        vertical,
        aspect: camera.aspect,
        position,
        znear,
        zfar,
        fault: camera.fault.as_deref().map(Into::into),
    }
}

fn light(light: &crate::scene::PunctualLight) -> LightSummary {
    let kind = match light.kind {
        PunctualKind::Directional => "directional",
        PunctualKind::Point => "point",
        PunctualKind::Spot { .. } => "spot",
    };
    let range = Some(light.range).filter(|range| range.is_finite() && kind != "directional");
    let size = Some(light.size).filter(|size| *size > 0.0);
    let directional = kind == "directional";
    let (radius, angle) = (size.filter(|_| !directional), size.filter(|_| directional));
    let angle = angle.map(|half| 2.0 * half.to_degrees());
    LightSummary { name: light.name.clone(), kind, intensity: light.intensity.to_array(), range, radius, angle }
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
