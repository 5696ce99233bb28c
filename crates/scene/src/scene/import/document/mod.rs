//! The glTF document, checked: after [`Document::parse`] every sound element's indices are in range, every sound
//! accessor lies in its view, and the nodes are a forest. A faulty element stops only those who need it.

pub mod accessors;
pub mod animations;
mod buffers;
pub mod cameras;
pub mod compression;
pub mod extensions;
pub mod images;
mod json;
pub mod lights;
mod lobes;
pub mod materials;
pub mod nodes;
pub mod primitives;
pub mod skins;
mod table;
mod typed;

use std::collections::BTreeMap;

use serde_json::Value;

use crate::error::{Error, Result};
use crate::scene::choose;
use crate::scene::import::ImportOptions;
use crate::scene::import::complaint::bad;
use crate::scene::import::report::Notes;
use crate::scene::import::source::Source;
use accessors::{Accessor, View};
use animations::Animation;
use buffers::Buffer;
use cameras::Camera;
use images::{Image, ImageData, Sampler, Texture};
use json::{Json, each_extension, join};
use lights::Light;
use materials::Material;
use nodes::{Node, check_forest};
use primitives::Mesh;
use skins::Skin;
use table::Table;

/// Lengths of the document's arrays, to check indices against.
#[derive(Default)]
pub struct Lengths {
    pub accessors: usize,
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
    /// The chosen material variant.
    pub variant: Option<usize>,
}

/// A checked glTF document. Arrays and indices are those of the file.
pub struct Document {
    pub generator: Option<String>,
    pub buffers: Table<Buffer>,
    pub views: Table<View>,
    pub accessors: Table<Accessor>,
    pub images: Table<Image>,
    pub samplers: Table<Sampler>,
    pub textures: Table<Texture>,
    pub materials: Table<Material>,
    pub meshes: Table<Mesh>,
    pub skins: Table<Skin>,
    pub cameras: Table<Camera>,
    pub lights: Table<Light>,
    pub nodes: Vec<Node>,
    /// Root nodes of the scene that is shown.
    pub roots: Vec<usize>,
    /// JSON path of that scene.
    pub scene_at: String,
    pub animations: Table<Animation>,
    pub scenes: Table<Vec<usize>>,
    /// Their names; empty where there is none.
    pub scene_names: Vec<String>,
    /// Names of the material variants.
    pub variants: Vec<String>,
    /// Which of them is shown.
    pub variant: Option<usize>,
    /// Extensions that stand in the document or are declared, and where first.
    pub extensions: BTreeMap<String, String>,
}

impl Document {
    /// `json` is the source's document, or one made of it. Parses and checks everything but the data of accessors and pictures.
    ///
    /// # Errors
    /// [`Error::Data`] for whatever breaks the specification in a way that could be seen, [`Error::Missing`] for
    /// a buffer or picture that is not there.
    pub fn parse(source: &Source, json: &Value, options: &ImportOptions, notes: &mut Notes) -> Result<Self> {
        if source.byte_order_mark {
            notes.repaired("the document", "a byte-order mark before the JSON is skipped");
        }
        let root = Json::root(json);
        let asset = root.need("asset", root.get("asset")?)?;
        check_version(&asset)?;
        let required = strings(&root, "extensionsRequired")?;
        extensions::check_required(&required)?;
        let mut extensions: BTreeMap<String, String> =
            strings(&root, "extensionsUsed")?.into_iter().map(|name| (name, "extensionsUsed".into())).collect();
        each_extension(json, &mut Vec::new(), &mut |name, at| {
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
        let names = |items: &[Json]| -> Result<Vec<String>> {
            items.iter().map(|json| Ok(json.string("name")?.unwrap_or_default().into())).collect()
        };
        let variants = match root.extension("KHR_materials_variants")? {
            Some(json) => names(&json.items("variants")?)?,
            None => Vec::new(),
        };
        let scene_names = names(&scene_items)?;
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
            variants: variants.len(),
            variant: options.variant.as_deref().map(|name| choose("variant", name, &variants)).transpose()?,
        };

        let buffers = Table::parse("buffers", &buffer_items, |i, json| Buffer::parse(json, i, source));
        let views = Table::parse("bufferViews", &view_items, |_, json| View::parse(json, &buffers));
        let accessors = Table::parse("accessors", &accessor_items, |_, json| Accessor::parse(json, &views));
        let images = Table::parse("images", &image_items, |i, json| Image::parse(json, i, source, &views));
        let samplers = Table::parse("samplers", &sampler_items, |_, json| Sampler::parse(json, notes));
        let textures = Table::parse("textures", &texture_items, |_, json| Texture::parse(json, &lengths));
        let materials = Table::parse("materials", &material_items, |_, json| Material::parse(json, &lengths));
        let meshes = Table::parse("meshes", &mesh_items, |_, json| {
            Mesh::parse(json, &lengths, &accessors, &views, &materials, quantized, notes)
        });
        let skins = Table::parse("skins", &skin_items, |_, json| Skin::parse(json, &lengths, &accessors, &views));
        let cameras = Table::parse("cameras", &camera_items, |_, json| cameras::parse(json));
        let lights =
            Table::parse("extensions.KHR_lights_punctual.lights", &light_items, |_, json| lights::parse(json, notes));
        let nodes = node_items
            .iter()
            .map(|json| Node::parse(json, &lengths, &meshes, &accessors))
            .collect::<Result<Vec<_>>>()?;
        check_forest(&nodes)?;
        let animations =
            Table::parse("animations", &root.items("animations")?, |_, json| Animation::parse(json, &lengths));

        let scenes = Table::parse("scenes", &scene_items, |_, json| {
            json.name()?;
            json.indices("nodes", lengths.nodes, "nodes")
        });
        let chosen = match &options.scene {
            Some(wanted) => choose("scene", wanted, &scene_names)?,
            None => root.index("scene", lengths.scenes, "scenes")?.unwrap_or(0),
        };
        let (roots, scene_at) = match scenes.len() {
            // Without scenes the file is a library: show all of it.
            0 => (top_nodes(&nodes), "nodes".into()),
            _ => (scenes.get(chosen)?.clone(), format!("scenes[{chosen}]")),
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
            animations,
            scenes,
            scene_names,
            variants,
            variant: lengths.variant,
            extensions,
        })
    }
}

impl Document {
    /// What is wrong with the document's elements: paths and reasons, a reason again with all who need that element.
    pub fn faults(&self) -> Vec<(String, Error)> {
        let unreadable = |(_, image): (usize, &Image)| match &image.data {
            ImageData::Unreadable(error) => Some((image.at.clone(), error.clone())),
            _ => None,
        };
        let nodes = self.nodes.iter().filter_map(|node| Some((node.at.clone(), node.content().err()?)));
        let tables = self
            .buffers
            .faults()
            .chain(self.views.faults())
            .chain(self.accessors.faults())
            .chain(self.images.faults())
            .chain(self.samplers.faults())
            .chain(self.textures.faults())
            .chain(self.materials.faults())
            .chain(self.meshes.faults())
            .chain(self.skins.faults())
            .chain(self.cameras.faults())
            .chain(self.lights.faults())
            .chain(self.animations.faults())
            .chain(self.scenes.faults())
            .map(|(at, error)| (at, error.clone()));
        tables.chain(nodes).chain(self.images.sound().filter_map(unreadable)).collect()
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
