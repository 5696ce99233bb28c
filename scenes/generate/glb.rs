//! Writes binary glTF: the few parts of it that these scenes use.

use std::collections::BTreeSet;

use glam::{DMat3, DQuat, DVec2, DVec3};
use serde_json::{Map, Value, json};

use crate::mesh::Mesh;

/// A material of the metallic-roughness model. Colours are linear RGB.
#[derive(Clone)]
pub struct Material {
    pub name: &'static str,
    pub color: [f64; 3],
    pub metallic: f64,
    pub roughness: f64,
    /// Radiance; a surface that emits shines from its front alone.
    pub emission: [f64; 3],
    /// No specular layer at all.
    pub lambert: bool,
    pub double_sided: bool,
    pub color_texture: Option<usize>,
    pub metallic_roughness_texture: Option<usize>,
    pub normal_texture: Option<(usize, f64)>,
    pub emission_texture: Option<usize>,
    /// Is the base colour's alpha a mask?
    pub masked: bool,
    /// Share of light that passes a dielectric, as through a thin wall.
    pub transmission: f64,
}

impl Material {
    fn plain(name: &'static str, color: [f64; 3], metallic: f64, roughness: f64) -> Self {
        Self {
            name,
            color,
            metallic,
            roughness,
            emission: [0.0; 3],
            lambert: false,
            double_sided: false,
            color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            emission_texture: None,
            masked: false,
            transmission: 0.0,
        }
    }

    pub fn metal(name: &'static str, color: [f64; 3], roughness: f64) -> Self {
        Self::plain(name, color, 1.0, roughness)
    }

    pub fn dielectric(name: &'static str, color: [f64; 3], roughness: f64) -> Self {
        Self::plain(name, color, 0.0, roughness)
    }

    pub fn lambert(name: &'static str, color: [f64; 3]) -> Self {
        Self { lambert: true, ..Self::plain(name, color, 0.0, 1.0) }
    }

    pub fn emitter(name: &'static str, emission: [f64; 3]) -> Self {
        Self { emission, lambert: true, ..Self::plain(name, [0.0; 3], 0.0, 1.0) }
    }
}

/// Where a node is.
#[derive(Clone, Copy)]
pub struct Placement {
    pub translation: DVec3,
    pub rotation: DQuat,
    pub scale: f64,
}

impl Placement {
    pub fn at(translation: DVec3) -> Self {
        Self::scaled(translation, 1.0)
    }

    pub fn scaled(translation: DVec3, scale: f64) -> Self {
        Self { translation, rotation: DQuat::IDENTITY, scale }
    }
}

/// Vertex and index data in the file, without a material: meshes can share it.
#[derive(Clone)]
pub struct Geometry {
    attributes: Value,
    indices: usize,
}

/// A glTF file in the making.
#[derive(Default)]
pub struct Glb {
    bin: Vec<u8>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    materials: Vec<Value>,
    images: Vec<Value>,
    meshes: Vec<Value>,
    cameras: Vec<Value>,
    nodes: Vec<Value>,
    extensions: BTreeSet<&'static str>,
}

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

impl Glb {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bin.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn floats<const N: usize>(&mut self, rows: &[[f32; N]], bounds: bool) -> usize {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let mut accessor =
            json!({ "bufferView": view, "componentType": FLOAT, "count": rows.len(), "type": format!("VEC{N}") });
        if bounds {
            let fold = |f: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
                (0..N).map(|k| rows.iter().map(|row| row[k]).fold(start, f)).collect()
            };
            accessor["min"] = json!(fold(f32::min, f32::INFINITY));
            accessor["max"] = json!(fold(f32::max, f32::NEG_INFINITY));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Puts vertices and triangles into the file. Normals and texture coordinates are left out where the mesh has none.
    pub fn geometry(&mut self, mesh: &Mesh) -> Geometry {
        let vec3 = |v: &DVec3| v.as_vec3().to_array();
        let vec2 = |v: &DVec2| v.as_vec2().to_array();
        let mut attributes = Map::new();
        let positions: Vec<_> = mesh.positions.iter().map(vec3).collect();
        attributes.insert("POSITION".into(), json!(self.floats(&positions, true)));
        if !mesh.normals.is_empty() {
            let normals: Vec<_> = mesh.normals.iter().map(vec3).collect();
            attributes.insert("NORMAL".into(), json!(self.floats(&normals, false)));
        }
        if !mesh.uvs.is_empty() {
            let uvs: Vec<_> = mesh.uvs.iter().map(vec2).collect();
            attributes.insert("TEXCOORD_0".into(), json!(self.floats(&uvs, false)));
        }
        if !mesh.tangents.is_empty() {
            let tangents: Vec<_> = mesh.tangents.iter().map(|t| t.as_vec3().extend(1.0).to_array()).collect();
            attributes.insert("TANGENT".into(), json!(self.floats(&tangents, false)));
        }
        let indices = mesh.triangles.iter().flatten();
        // 65535 is the primitive restart value.
        let short = mesh.positions.len() <= 65535;
        let bytes: Vec<u8> = if short {
            indices.flat_map(|&i| (i as u16).to_le_bytes()).collect()
        } else {
            indices.flat_map(|&i| i.to_le_bytes()).collect()
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        let component = if short { UNSIGNED_SHORT } else { UNSIGNED_INT };
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "count": mesh.triangles.len() * 3, "type": "SCALAR"
        }));
        Geometry { attributes: Value::Object(attributes), indices: self.accessors.len() - 1 }
    }

    /// Adds a picture, used as a texture that repeats. `mime` is image/png or image/jpeg.
    pub fn texture(&mut self, name: &str, bytes: &[u8], mime: &str) -> usize {
        let view = self.view(bytes, None);
        self.images.push(json!({ "name": name, "bufferView": view, "mimeType": mime }));
        self.images.len() - 1
    }

    pub fn material(&mut self, m: &Material) -> usize {
        let [r, g, b] = m.color;
        let mut pbr = json!({
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": m.metallic, "roughnessFactor": m.roughness
        });
        if let Some(texture) = m.color_texture {
            pbr["baseColorTexture"] = json!({ "index": texture });
        }
        if let Some(texture) = m.metallic_roughness_texture {
            pbr["metallicRoughnessTexture"] = json!({ "index": texture });
        }
        let mut material = json!({ "name": m.name, "pbrMetallicRoughness": pbr });
        if let Some((texture, scale)) = m.normal_texture {
            material["normalTexture"] = json!({ "index": texture, "scale": scale });
        }
        if let Some(texture) = m.emission_texture {
            material["emissiveTexture"] = json!({ "index": texture });
        }
        if m.masked {
            material["alphaMode"] = json!("MASK");
        }
        if m.double_sided {
            material["doubleSided"] = json!(true);
        }
        let mut extensions = Map::new();
        if m.lambert {
            self.extensions.insert("KHR_materials_specular");
            extensions.insert("KHR_materials_specular".into(), json!({ "specularFactor": 0.0 }));
        }
        let strength = m.emission.into_iter().fold(0.0, f64::max);
        if strength > 0.0 {
            self.extensions.insert("KHR_materials_emissive_strength");
            material["emissiveFactor"] = json!(m.emission.map(|e| round(e / strength, 6)));
            extensions.insert("KHR_materials_emissive_strength".into(), json!({ "emissiveStrength": strength }));
        }
        if m.transmission > 0.0 {
            self.extensions.insert("KHR_materials_transmission");
            extensions.insert("KHR_materials_transmission".into(), json!({ "transmissionFactor": m.transmission }));
        }
        if !extensions.is_empty() {
            material["extensions"] = Value::Object(extensions);
        }
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// A mesh of one or more primitives.
    pub fn mesh(&mut self, name: &str, primitives: &[(&Geometry, usize)]) -> usize {
        let primitives: Vec<_> = primitives
            .iter()
            .map(|(g, material)| json!({ "attributes": g.attributes, "indices": g.indices, "material": material }))
            .collect();
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.meshes.len() - 1
    }

    /// Adds a mesh and one node that shows it where its vertices say.
    pub fn object(&mut self, name: &str, mesh: &Mesh, material: usize) {
        let geometry = self.geometry(mesh);
        let mesh = self.mesh(name, &[(&geometry, material)]);
        self.nodes.push(json!({ "name": name, "mesh": mesh }));
    }

    /// A node for geometry that other nodes show too, each in its own material.
    pub fn shared(&mut self, name: &str, geometry: &Geometry, material: usize, place: &Placement) {
        let mesh = self.mesh(name, &[(geometry, material)]);
        self.instance(mesh, place);
        if let Some(node) = self.nodes.last_mut() {
            node["name"] = json!(name);
        }
    }

    /// Another node for a mesh. Numbers are cut to a tenth of a millimetre, which keeps large fields small.
    pub fn instance(&mut self, mesh: usize, place: &Placement) {
        let mut node = json!({ "mesh": mesh, "translation": place.translation.to_array().map(|x| round(x, 4)) });
        if place.rotation != DQuat::IDENTITY {
            node["rotation"] = json!(place.rotation.to_array().map(|x| round(x, 4)));
        }
        if place.scale != 1.0 {
            node["scale"] = json!([(); 3].map(|_| round(place.scale, 4)));
        }
        self.nodes.push(node);
    }

    /// A camera that looks from `eye` at `target`, with a vertical field of view in degrees.
    pub fn camera(&mut self, name: &str, eye: DVec3, target: DVec3, yfov_degrees: f64, aspect: f64) {
        let back = (eye - target).normalize();
        let right = DVec3::Y.cross(back).normalize();
        let rotation = DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back));
        self.cameras.push(json!({ "name": name, "type": "perspective", "perspective": {
            "yfov": round(yfov_degrees.to_radians(), 6), "aspectRatio": round(aspect, 6), "znear": 0.01
        }}));
        self.nodes.push(json!({
            "name": name, "camera": self.cameras.len() - 1, "translation": eye.to_array().map(|x| round(x, 6)),
            "rotation": rotation.to_array().map(|x| round(x, 9))
        }));
    }

    /// The finished file.
    pub fn finish(mut self) -> Vec<u8> {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "Bismar make_scenes", "copyright": "CC0 1.0" },
            "scene": 0,
            "scenes": [{ "nodes": (0..self.nodes.len()).collect::<Vec<_>>() }],
            "buffers": [{ "byteLength": self.bin.len() }],
        });
        let textures: Vec<_> = (0..self.images.len()).map(|i| json!({ "source": i })).collect();
        let lists = [
            ("accessors", self.accessors),
            ("bufferViews", self.views),
            ("materials", self.materials),
            ("images", self.images),
            ("textures", textures),
            ("meshes", self.meshes),
            ("cameras", self.cameras),
            ("nodes", self.nodes),
        ];
        for (key, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            root[key] = Value::Array(list);
        }
        if !self.extensions.is_empty() {
            root["extensionsUsed"] = json!(self.extensions);
        }
        let mut text = root.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut file = Vec::with_capacity(28 + text.len() + self.bin.len());
        file.extend_from_slice(b"glTF");
        let total = 28 + text.len() + self.bin.len();
        for word in [2, total as u32, text.len() as u32] {
            file.extend_from_slice(&word.to_le_bytes());
        }
        file.extend_from_slice(b"JSON");
        file.extend_from_slice(&text);
        file.extend_from_slice(&(self.bin.len() as u32).to_le_bytes());
        file.extend_from_slice(b"BIN\0");
        file.extend_from_slice(&self.bin);
        file
    }
}

/// To `digits` decimals, and no negative zero.
fn round(x: f64, digits: i32) -> f64 {
    let unit = 10f64.powi(digits);
    (x * unit).round() / unit + 0.0
}
