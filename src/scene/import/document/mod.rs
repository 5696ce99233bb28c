//! The glTF document, checked: after [`Document::parse`] every index is in range, every accessor lies in its view,
//! and the nodes are a forest.

pub mod accessors;
mod buffers;
pub mod cameras;
pub mod extensions;
pub mod images;
mod json;
pub mod lights;
pub mod materials;
pub mod nodes;
pub mod primitives;
pub mod skins;

use std::collections::BTreeMap;

use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;
use crate::scene::import::report::Notes;
use crate::scene::import::source::Source;
use accessors::{Accessor, View};
use buffers::Buffer;
use cameras::Camera;
use images::{Image, Sampler, Texture};
use json::{Json, each_extension, join};
use lights::Light;
use materials::Material;
use nodes::{Node, check_forest};
use primitives::Mesh;
use skins::Skin;

/// Lengths of the document's arrays, to check indices against.
#[derive(Default)]
pub struct Lengths {
    pub accessors: usize,
    pub buffers: usize,
    pub cameras: usize,
    pub images: usize,
    pub lights: usize,
    pub materials: usize,
    pub meshes: usize,
    pub nodes: usize,
    pub samplers: usize,
    pub scenes: usize,
    pub skins: usize,
    pub textures: usize,
    pub variants: usize,
}

/// A checked glTF document. Arrays and indices are those of the file.
pub struct Document {
    pub generator: Option<String>,
    pub buffers: Vec<Buffer>,
    pub views: Vec<View>,
    pub accessors: Vec<Accessor>,
    pub images: Vec<Image>,
    pub samplers: Vec<Sampler>,
    pub textures: Vec<Texture>,
    pub materials: Vec<Material>,
    pub meshes: Vec<Mesh>,
    pub skins: Vec<Skin>,
    pub cameras: Vec<Camera>,
    pub lights: Vec<Light>,
    pub nodes: Vec<Node>,
    /// Root nodes of the scene that is shown.
    pub roots: Vec<usize>,
    /// JSON path of that scene.
    pub scene_at: String,
    pub animations: usize,
    pub scenes: usize,
    /// Extensions that stand in the document or are declared, and where first.
    pub extensions: BTreeMap<String, String>,
}

impl Document {
    /// Parses and checks everything but the data of accessors and pictures.
    ///
    /// # Errors
    /// [`Error::Data`] for whatever breaks the specification in a way that could be seen, [`Error::Missing`] for
    /// a buffer or picture that is not there.
    pub fn parse(source: &Source, notes: &mut Notes) -> Result<Self> {
        if source.byte_order_mark {
            notes.repaired("the document", "a byte-order mark before the JSON is skipped");
        }
        let root = Json::root(&source.json);
        let asset = root.need("asset", root.get("asset")?)?;
        check_version(&asset)?;
        let required = strings(&root, "extensionsRequired")?;
        extensions::check_required(&required)?;
        let mut extensions: BTreeMap<String, String> =
            strings(&root, "extensionsUsed")?.into_iter().map(|name| (name, "extensionsUsed".into())).collect();
        each_extension(&source.json, &mut Vec::new(), &mut |name, at| {
            extensions.entry(name.into()).or_insert_with(|| join(at));
        })?;
        let quantized = required.iter().any(|name| name == "KHR_mesh_quantization");

        let items = |key: &str| root.items(key);
        let (buffer_items, view_items, accessor_items) =
            (items("buffers")?, items("bufferViews")?, items("accessors")?);
        let (image_items, sampler_items, texture_items) = (items("images")?, items("samplers")?, items("textures")?);
        let (material_items, mesh_items, skin_items) = (items("materials")?, items("meshes")?, items("skins")?);
        let (camera_items, node_items, scene_items) = (items("cameras")?, items("nodes")?, items("scenes")?);
        let light_items = match root.extension("KHR_lights_punctual")? {
            Some(json) => {
                if json.object()?.get("lights").is_none() {
                    return Err(json.bad("lights", "an array", "nothing"));
                }
                json.items("lights")?
            }
            None => Vec::new(),
        };
        let variants = match root.extension("KHR_materials_variants")? {
            Some(json) => json.items("variants")?.len(),
            None => 0,
        };
        for json in buffer_items.iter().chain(&image_items) {
            if json
                .string("uri")
                .is_ok_and(|uri| uri.is_some_and(|uri| !uri.starts_with("data:") && uri.contains('\\')))
            {
                notes.repaired(&json.path("uri"), "`\\` in a path is read as `/`, unless a file has it in its name");
            }
        }
        let lengths = Lengths {
            accessors: accessor_items.len(),
            buffers: buffer_items.len(),
            cameras: camera_items.len(),
            images: image_items.len(),
            lights: light_items.len(),
            materials: material_items.len(),
            meshes: mesh_items.len(),
            nodes: node_items.len(),
            samplers: sampler_items.len(),
            scenes: scene_items.len(),
            skins: skin_items.len(),
            textures: texture_items.len(),
            variants,
        };

        let buffers = buffer_items
            .iter()
            .enumerate()
            .map(|(i, json)| Buffer::parse(json, i, source))
            .collect::<Result<Vec<_>>>()?;
        let views = view_items.iter().map(|json| View::parse(json, &lengths)).collect::<Result<Vec<_>>>()?;
        let accessors = accessor_items.iter().map(|json| Accessor::parse(json, &views)).collect::<Result<Vec<_>>>()?;
        let images = image_items
            .iter()
            .enumerate()
            .map(|(i, json)| Image::parse(json, i, source, &views))
            .collect::<Result<Vec<_>>>()?;
        let samplers = sampler_items.iter().map(|json| Sampler::parse(json, notes)).collect::<Result<Vec<_>>>()?;
        let textures = texture_items.iter().map(|json| Texture::parse(json, &lengths)).collect::<Result<Vec<_>>>()?;
        let materials =
            material_items.iter().map(|json| Material::parse(json, &lengths)).collect::<Result<Vec<_>>>()?;
        let meshes = mesh_items
            .iter()
            .map(|json| Mesh::parse(json, &lengths, &accessors, &views, &materials, quantized, notes))
            .collect::<Result<Vec<_>>>()?;
        let skins = skin_items
            .iter()
            .map(|json| Skin::parse(json, &lengths, &accessors, &views))
            .collect::<Result<Vec<_>>>()?;
        let cameras = camera_items.iter().map(cameras::parse).collect::<Result<Vec<_>>>()?;
        let lights = light_items.iter().map(|json| lights::parse(json, notes)).collect::<Result<Vec<_>>>()?;
        let nodes = node_items
            .iter()
            .map(|json| Node::parse(json, &lengths, &meshes, &accessors))
            .collect::<Result<Vec<_>>>()?;
        check_forest(&nodes)?;
        let animation_accessors = skins::check_animations(&root.items("animations")?, &lengths)?;

        // A view that sticks out of its buffer is an error, except where nothing but unused accessors stands on it.
        let mut used = vec![false; accessors.len()];
        primitives::mark_used(&meshes, &mut used);
        animation_accessors.iter().for_each(|&i| used[i] = true);
        skins.iter().filter_map(|s| s.inverse_bind).for_each(|i| used[i] = true);
        nodes.iter().flat_map(Node::instancing_accessors).for_each(|i| used[i] = true);
        accessors::check_views(&views, &buffers, &accessors, &used, &images)?;

        let scenes = scene_items
            .iter()
            .map(|json| {
                json.name()?;
                json.indices("nodes", lengths.nodes, "nodes")
            })
            .collect::<Result<Vec<_>>>()?;
        let chosen = root.index("scene", lengths.scenes, "scenes")?.unwrap_or(0);
        let mut scenes_left = scenes.into_iter().skip(chosen);
        let (roots, scene_at) = match scenes_left.next() {
            Some(roots) => (roots, format!("scenes[{chosen}]")),
            // Without scenes the file is a library: show all of it.
            None => (top_nodes(&nodes), "nodes".into()),
        };
        check_roots(&roots, &nodes, &scene_at)?;
        Ok(Self {
            generator: asset.string("generator")?.map(Into::into),
            buffers,
            views,
            accessors,
            images,
            samplers,
            textures,
            materials,
            meshes,
            skins,
            cameras,
            lights,
            nodes,
            roots,
            scene_at,
            animations: root.items("animations")?.len(),
            scenes: lengths.scenes,
            extensions,
        })
    }
}

fn strings(json: &Json, key: &str) -> Result<Vec<String>> {
    json.items(key)?.iter().map(|item| item.as_string().map(Into::into)).collect()
}

/// Major version 2; `minVersion` at most 2.0, which is what we read.
fn check_version(asset: &Json) -> Result<()> {
    let number = |key: &str, text: &str| -> Result<(u32, u32)> {
        let parts = text.split_once('.').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        parts.ok_or_else(|| asset.bad(key, "a version like \"2.0\"", format!("\"{text}\"")))
    };
    let text = asset.need("version", asset.string("version")?)?;
    if number("version", text)?.0 != 2 {
        return Err(Error::Data(format!("asset.version: glTF {text} cannot be read; convert the file to glTF 2.0")));
    }
    if let Some(text) = asset.string("minVersion")?
        && number("minVersion", text)? > (2, 0)
    {
        return Err(Error::Data(format!(
            "asset.minVersion: the file asks for a reader of glTF {text}, this one reads 2.0; export it as glTF 2.0"
        )));
    }
    Ok(())
}

fn parents(nodes: &[Node]) -> Vec<bool> {
    let mut has_parent = vec![false; nodes.len()];
    nodes.iter().flat_map(|n| &n.children).for_each(|&child| has_parent[child] = true);
    has_parent
}

fn top_nodes(nodes: &[Node]) -> Vec<usize> {
    parents(nodes).iter().enumerate().filter(|(_, has)| !**has).map(|(i, _)| i).collect()
}

/// Scenes name top nodes, each once: so no node is shown twice.
fn check_roots(roots: &[usize], nodes: &[Node], at: &str) -> Result<()> {
    let mut taken = parents(nodes);
    for (i, &root) in roots.iter().enumerate() {
        if std::mem::replace(&mut taken[root], true) {
            return Err(bad(
                &format!("{at}.nodes[{i}]"),
                "a node without a parent, listed once",
                format!("node {root}, which has a parent or is listed twice"),
            ));
        }
    }
    Ok(())
}
