//! Writes binary glTF: the few parts of it that these scenes use.

use std::array;
use std::collections::BTreeSet;

use glam::{DMat3, DQuat, DVec3};
use serde_json::{Map, Value, json};

use crate::mesh::Mesh;

/// A material of the metallic-roughness model. Colours are linear RGB.
#[derive(Clone, Default)]
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
    pub fn metal(name: &'static str, color: [f64; 3], roughness: f64) -> Self {
        Self { metallic: 1.0, ..Self::dielectric(name, color, roughness) }
    }

    pub fn dielectric(name: &'static str, color: [f64; 3], roughness: f64) -> Self {
        Self { name, color, roughness, ..Self::default() }
    }

    pub fn lambert(name: &'static str, color: [f64; 3]) -> Self {
        Self { lambert: true, ..Self::dielectric(name, color, 1.0) }
    }

    pub fn emitter(name: &'static str, emission: [f64; 3]) -> Self {
        Self { emission, ..Self::lambert(name, [0.0; 3]) }
    }
}

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
    extensions: BTreeSet<String>,
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

    /// Puts an attribute of vertices into the file, unless it is empty.
    fn attribute<const N: usize>(&mut self, all: &mut Map<String, Value>, name: &str, rows: Vec<[f32; N]>) {
        if rows.is_empty() {
            return;
        }
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let mut accessor =
            json!({ "bufferView": view, "componentType": FLOAT, "count": rows.len(), "type": format!("VEC{N}") });
        // glTF wants the bounds of positions alone.
        if name == "POSITION" {
            let fold = |f: fn(f32, f32) -> f32| rows.iter().copied().reduce(|a, b| array::from_fn(|k| f(a[k], b[k])));
            accessor["min"] = json!(fold(f32::min).map(Vec::from));
            accessor["max"] = json!(fold(f32::max).map(Vec::from));
        }
        self.accessors.push(accessor);
        all.insert(name.into(), json!(self.accessors.len() - 1));
    }

    /// Puts vertices and triangles into the file. Normals and texture coordinates are left out where the mesh has none.
    pub fn geometry(&mut self, mesh: &Mesh) -> Geometry {
        let vec3 = |v: &DVec3| v.as_vec3().to_array();
        let mut attributes = Map::new();
        self.attribute(&mut attributes, "POSITION", mesh.positions.iter().map(vec3).collect());
        self.attribute(&mut attributes, "NORMAL", mesh.normals.iter().map(vec3).collect());
        self.attribute(&mut attributes, "TEXCOORD_0", mesh.uvs.iter().map(|v| v.as_vec2().to_array()).collect());
        let tangents = mesh.tangents.iter().map(|t| t.as_vec3().extend(1.0).to_array());
        self.attribute(&mut attributes, "TANGENT", tangents.collect());
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
        let texture = |index: Option<usize>| index.map(|index| json!({ "index": index }));
        let pbr = present([
            ("baseColorFactor", Some(json!([r, g, b, 1.0]))),
            ("metallicFactor", Some(json!(m.metallic))),
            ("roughnessFactor", Some(json!(m.roughness))),
            ("baseColorTexture", texture(m.color_texture)),
            ("metallicRoughnessTexture", texture(m.metallic_roughness_texture)),
        ]);
        let strength = m.emission.into_iter().fold(0.0, f64::max);
        let shines = strength > 0.0;
        let passes = m.transmission > 0.0;
        let extensions = present([
            ("KHR_materials_specular", m.lambert.then(|| json!({ "specularFactor": 0.0 }))),
            ("KHR_materials_emissive_strength", shines.then(|| json!({ "emissiveStrength": strength }))),
            ("KHR_materials_transmission", passes.then(|| json!({ "transmissionFactor": m.transmission }))),
        ]);
        self.extensions.extend(extensions.keys().cloned());
        let normal = m.normal_texture.map(|(index, scale)| json!({ "index": index, "scale": scale }));
        self.materials.push(Value::Object(present([
            ("name", Some(json!(m.name))),
            ("pbrMetallicRoughness", Some(Value::Object(pbr))),
            ("normalTexture", normal),
            ("emissiveTexture", texture(m.emission_texture)),
            ("alphaMode", m.masked.then(|| json!("MASK"))),
            ("doubleSided", m.double_sided.then_some(json!(true))),
            ("emissiveFactor", shines.then(|| json!(m.emission.map(|e| round(e / strength, 6))))),
            ("extensions", (!extensions.is_empty()).then_some(Value::Object(extensions))),
        ])));
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
        let size = |bytes: usize| (bytes as u32).to_le_bytes();
        let (total, binary) = (size(28 + text.len() + self.bin.len()), size(self.bin.len()));
        let json = [&2_u32.to_le_bytes()[..], &total, &size(text.len()), b"JSON", &text].concat();
        [b"glTF", &json[..], &binary, b"BIN\0", &self.bin].concat()
    }
}

/// An object of those of the entries that there are.
fn present<const N: usize>(entries: [(&str, Option<Value>); N]) -> Map<String, Value> {
    entries.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))).collect()
}

/// To `digits` decimals, and no negative zero.
fn round(x: f64, digits: i32) -> f64 {
    let unit = 10f64.powi(digits);
    (x * unit).round() / unit + 0.0
}
