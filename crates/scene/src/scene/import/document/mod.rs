//! The checked glTF document: after [`Document::parse`] the indices of every valid element are in range, every valid
//! accessor lies within its view, and the nodes are a forest. A faulty element is an error only where it is needed.

pub mod accessors;
pub mod animations;
pub mod attributes;
mod buffers;
pub mod cameras;
pub mod draco;
pub mod extensions;
pub mod images;
mod json;
pub mod lights;
mod lobes;
pub mod materials;
pub mod meshopt;
pub mod nodes;
pub mod primitives;
pub mod skins;
mod table;
pub mod texture_info;
mod typed;

use std::cell::RefCell;
use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::scene::choose;
use crate::scene::import::complaint::bad;
use crate::scene::import::options::ImportOptions;
use crate::scene::import::report::Notes;
use crate::scene::import::source::Source;
use accessors::{Accessor, View};
use animations::Animation;
use buffers::Buffer;
use cameras::Camera;
use images::{Image, ImageData, Sampler, Texture};
use json::Json;
use lights::{LIGHTS, Light};
use materials::Material;
use nodes::{Node, check_forest, have_parents, top_nodes};
use primitives::{Mesh, References};
use skins::Skin;
use table::Table;

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
    /// JSON path of the shown scene.
    pub scene_at: String,
    /// Of the built scene's coordinates, in the file's: [`crate::scene::Scene::origin`].
    pub origin: DVec3,
    pub animations: Table<Animation>,
    pub scenes: Table<Vec<usize>>,
    /// Names of the scenes; empty for those without.
    pub scene_names: Vec<String>,
    pub variants: Vec<String>,
    pub variant: Option<usize>,
    /// Whether the document requires KHR_mesh_quantization.
    quantized: bool,
    /// Extensions that are declared or occur in the document, with the JSON path of the first occurrence.
    pub extensions: BTreeMap<String, String>,
}

/// Paths of the arrays whose elements animations change.
pub const ANIMATED: [&str; 5] = ["materials", "meshes", "cameras", LIGHTS, "nodes"];

/// What glTF 2.1 adds to a document that pictures may need.
const BEYOND: [(&str, &str); 3] =
    [("externalAssets", "scenes in other files"), ("files", "files"), ("shapes", "shapes without triangles")];

impl Document {
    /// Parses and checks everything but the data of accessors and pictures. `json` is the source's document.
    /// Errors: [`Error::Data`] for what breaks the specification in a way that concerns the document as a whole,
    /// [`Error::Usage`] for a scene or variant that does not exist. Faulty elements are kept as errors in their tables.
    pub fn parse(source: &Source, json: &Value, options: &ImportOptions, notes: &mut Notes) -> Result<Self> {
        source.repairs.iter().for_each(|(at, text)| notes.repaired(at.trim_start_matches('.'), *text));
        let kept = RefCell::new(std::mem::take(notes));
        let root = Json::root(json, &kept);
        let asset = root.need("asset", root.get("asset")?)?;
        check_version(&asset)?;
        let required = strings(&root, "extensionsRequired")?;
        extensions::check_required(&required)?;
        let extensions = extension_places(&root)?;
        let quantized = required.iter().any(|name| name == "KHR_mesh_quantization");
        if let Some(json) = root.extension("KHR_lights_punctual")?.filter(|json| json.value().get("lights").is_none()) {
            return Err(json.bad("lights", "an array", "nothing"));
        }
        let variants = names(&root, "extensions.KHR_materials_variants.variants")?;
        let scene_names = names(&root, "scenes")?;
        note_backslashes(&root)?;
        let variant = options.variant.as_deref().map(|name| choose("variant", name, &variants)).transpose()?;

        let buffers = Table::parse(&root, "buffers", |i, json| Buffer::parse(json, i, source))?;
        let views = Table::parse(&root, "bufferViews", |_, json| View::parse(json, &buffers))?;
        let accessors = Table::parse(&root, "accessors", |_, json| Accessor::parse(json, &views))?;
        let images = Table::parse(&root, "images", |i, json| Image::parse(json, i, source, &views))?;
        let samplers = Table::parse(&root, "samplers", |_, json| Sampler::parse(json))?;
        let textures = Table::parse(&root, "textures", |_, json| Texture::parse(json))?;
        let materials = Table::parse(&root, "materials", |_, json| Material::parse(json))?;
        let references = References { accessors: &accessors, views: &views, materials: &materials, quantized, variant };
        let meshes = Table::parse(&root, "meshes", |_, json| Mesh::parse(json, references))?;
        let skins = Table::parse(&root, "skins", |_, json| Skin::parse(json, &accessors, &views))?;
        let cameras = Table::parse(&root, "cameras", |_, json| cameras::parse(json))?;
        let lights = Table::parse(&root, LIGHTS, |_, json| lights::parse(json))?;
        let node = |json| Node::parse(json, &meshes, &accessors);
        let nodes = root.items("nodes")?.iter().map(node).collect::<Result<Vec<_>>>()?;
        check_forest(&nodes)?;
        let animations = Table::parse(&root, "animations", |_, json| Animation::parse(json))?;
        let scenes = Table::parse(&root, "scenes", |_, json| {
            json.name()?;
            json.indices("nodes", "nodes")
        })?;
        let (roots, scene_at) = choose_scene(&root, options, &scene_names, &scenes, &nodes)?;
        let generator = asset.string("generator")?.map(Into::into);
        *notes = kept.take();
        for (key, what) in BEYOND {
            if let Some(list) = json.get(key).and_then(Value::as_array).filter(|list| !list.is_empty()) {
                notes.ignored(key, format!("{} {what} (glTF 2.1), which are not read", list.len()));
            }
        }
        Ok(Self {
            generator,
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
            origin: DVec3::ZERO,
            animations,
            scenes,
            scene_names,
            variants,
            variant,
            quantized,
            extensions,
        })
    }

    /// Replaces an element of one of the arrays [`ANIMATED`] by that of a copy of the document `root` with other values.
    /// Errors: A faulty node. Others keep their faults in their places.
    pub fn replace(
        &mut self,
        root: &Value,
        (array, index): (&str, usize),
        element: &Value,
        notes: &mut Notes,
    ) -> Result<()> {
        let kept = RefCell::new(Notes::default());
        let json = &Json::root(root, &kept).inside(element, format!("{array}[{index}]"));
        match array {
            "materials" => self.materials.set(index, Material::parse(json)),
            "meshes" => {
                let Self { accessors, views, materials, quantized, variant, .. } = &*self;
                let references = References { accessors, views, materials, quantized: *quantized, variant: *variant };
                let mesh = Mesh::parse(json, references);
                self.meshes.set(index, mesh);
            }
            "cameras" => self.cameras.set(index, cameras::parse(json)),
            "nodes" => self.nodes[index] = Node::parse(json, &self.meshes, &self.accessors)?,
            _ => self.lights.set(index, lights::parse(json)),
        }
        notes.join(kept.take());
        Ok(())
    }

    /// Every node's transform to world space from [`Self::origin`], also of nodes that no scene shows.
    pub(crate) fn world_transforms(&self) -> Vec<DAffine3> {
        let mut worlds = vec![self.base(); self.nodes.len()];
        let mut stack: Vec<_> = top_nodes(&self.nodes).into_iter().map(|i| (i, self.base())).collect();
        while let Some((index, parent)) = stack.pop() {
            worlds[index] = parent * self.nodes[index].transform;
            stack.extend(self.nodes[index].children.iter().map(|&child| (child, worlds[index])));
        }
        worlds
    }

    /// From the file's coordinates to those from [`Self::origin`].
    pub fn base(&self) -> DAffine3 {
        DAffine3::from_translation(-self.origin)
    }

    /// May the animations change a material's alpha?
    pub(crate) fn fades(&self, material: usize) -> bool {
        let start = format!("/materials/{material}/");
        let fades = |name: &str| ["baseColorFactor", "diffuseFactor", "alphaCutoff"].contains(&name);
        let mut channels = self.animations.sound().flat_map(|(_, animation)| &animation.channels);
        channels.any(|c| c.pointer.starts_with(&start) && c.pointer.rsplit('/').next().is_some_and(fades))
    }

    /// Faulty elements: JSON paths and faults. A fault is repeated for every element that depends on the faulty one.
    pub(crate) fn faults(&self) -> Vec<(String, Error)> {
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

/// Extensions that are declared or occur in the document, each with the JSON path of its first occurrence.
fn extension_places(root: &Json) -> Result<BTreeMap<String, String>> {
    let declared = strings(root, "extensionsUsed")?;
    let mut places: BTreeMap<String, String> =
        declared.into_iter().map(|name| (name, "extensionsUsed".into())).collect();
    root.each_extension(&mut |name, at| {
        places.entry(name.into()).or_insert_with(|| at.into());
    })?;
    Ok(places)
}

/// Names of an array's elements; empty for those without.
fn names(root: &Json, array: &str) -> Result<Vec<String>> {
    root.items(array)?.iter().map(|json| Ok(json.string("name")?.unwrap_or_default().into())).collect()
}

/// Notes paths of buffers and pictures that use `\` as a separator.
fn note_backslashes(root: &Json) -> Result<()> {
    for json in [root.items("buffers")?, root.items("images")?].iter().flatten() {
        let uri = json.string("uri").ok().flatten();
        if uri.is_some_and(|uri| !uri.starts_with("data:") && uri.contains('\\')) {
            json.repaired("uri", "`\\` in a path is read as `/`, unless a file has it in its name");
        }
    }
    Ok(())
}

/// Root nodes and JSON path of the chosen scene, else of the document's default; of all nodes if there are no scenes.
fn choose_scene(
    root: &Json,
    options: &ImportOptions,
    names: &[String],
    scenes: &Table<Vec<usize>>,
    nodes: &[Node],
) -> Result<(Vec<usize>, String)> {
    let chosen = match &options.scene {
        Some(wanted) => choose("scene", wanted, names)?,
        None => root.index("scene", "scenes")?.unwrap_or(0),
    };
    let (roots, at) = match scenes.len() {
        // A file without scenes is a library of nodes: all of it is shown.
        0 => (top_nodes(nodes), "nodes".into()),
        _ => (scenes.get(chosen)?.clone(), format!("scenes[{chosen}]")),
    };
    check_roots(&roots, nodes, &at)?;
    Ok((roots, at))
}

fn strings(json: &Json, key: &str) -> Result<Vec<String>> {
    json.items(key)?.iter().map(|item| item.as_string().map(Into::into)).collect()
}

/// Checks that the major version is 2 and `minVersion` at most 2.0.
fn check_version(asset: &Json) -> Result<()> {
    let number = |key: &str, text: &str| -> Result<(u32, u32)> {
        if let Ok(major) = text.parse() {
            asset.repaired(key, format!("\"{text}\" is read as \"{text}.0\""));
            return Ok((major, 0));
        }
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
            "asset.minVersion: the file requires glTF {text}, but only 2.0 is supported; export it as glTF 2.0"
        )));
    }
    Ok(())
}

/// Checks that a scene lists root nodes, each once, so that no node is shown twice.
fn check_roots(roots: &[usize], nodes: &[Node], at: &str) -> Result<()> {
    let mut taken = have_parents(nodes);
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
