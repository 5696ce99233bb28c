//! Counts what a document's elements become in memory, without reading their data.

use std::collections::{HashMap, HashSet};

use serde_json::{Map, Value};

use super::reach::{Reach, items};

/// Numbers of a scene's elements, as the document states them. They count all scenes of the document and are upper bounds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Census {
    /// Triangles in memory. Meshes that deform in several ways count as often.
    pub triangles: u64,
    /// Bytes of vertices and indices in memory.
    pub geometry_bytes: u64,
    /// Bytes of the largest mesh's data while it is read, besides those that remain.
    pub reading_bytes: u64,
    /// Meshes in memory.
    pub meshes: u64,
    /// Placements of meshes.
    pub instances: u64,
    /// Emissive triangles, counted for each placement.
    pub emissive_triangles: u64,
    /// Placements that an animation may move.
    pub moving: u64,
    /// Vertices that deform with joints or morph targets while an animation plays.
    pub deforming_vertices: u64,
    /// Nodes of the document.
    pub nodes: u64,
    /// Bytes of the parsed document.
    pub json_bytes: u64,
    /// Names of the placed cameras, and their width over height where the file says it.
    pub cameras: Vec<(String, Option<f32>)>,
}

/// Largest count of an accessor that a sound document has: the others are left for the import to refuse.
const MOST: u64 = 1 << 40;

/// A sum that leaves room for products: no memory holds so much.
fn add(a: u64, b: u64) -> u64 {
    a.saturating_add(b).min(1 << 44)
}

/// A primitive's share of memory.
#[derive(Debug, Clone, Copy, Default)]
struct Size {
    vertices: u64,
    triangles: u64,
    emissive: u64,
    bytes: u64,
    reading: u64,
    meshes: u64,
}

/// Counts the elements that some scene of the document can show.
pub fn census(json: &Value, reach: &Reach) -> Census {
    let nodes = || items(&json["nodes"]).enumerate();
    let mut census = Census { nodes: nodes().count() as u64, json_bytes: value_bytes(json), ..Default::default() };
    let animated = Animated::of(json);
    let (shown, moving) = (&reach.nodes, below(json, animated.moving));
    let shading = |(index, material): (usize, &Value)| {
        let text = material.to_string();
        Shading {
            emissive: shines(material) || animated.shining.contains(&index),
            textured: text.contains("Texture"),
            tangents: text.contains("ormalTexture") || text.contains("anisotropy"),
        }
    };
    let materials: Vec<Shading> = items(&json["materials"]).enumerate().map(shading).collect();
    let sizes: Vec<Size> = items(&json["meshes"]).map(|mesh| size(json, mesh, &materials)).collect();
    // Nodes whose meshes have the same form share them.
    let mut forms: HashMap<(usize, String), u64> = HashMap::new();
    for (index, node) in nodes().filter(|(index, _)| shown.get(*index) == Some(&true)) {
        let Some(mesh) = number(&node["mesh"]).filter(|mesh| *mesh < sizes.len()) else { continue };
        let places = placements(json, node);
        let size = sizes[mesh];
        census.instances = add(census.instances, places);
        census.emissive_triangles = add(census.emissive_triangles, places.saturating_mul(size.emissive));
        let (skin, weights) = (&node["skin"], &node["weights"]);
        let own = if animated.weights.contains(&index) { format!("{index}") } else { String::new() };
        let deforms = !skin.is_null() && !animated.is_empty || animated.weights.contains(&index);
        let placed = forms.entry((mesh, format!("{skin} {weights} {own}"))).or_default();
        if *placed == 0 {
            census.triangles = add(census.triangles, size.triangles);
            census.geometry_bytes = add(census.geometry_bytes, size.bytes);
            census.reading_bytes = census.reading_bytes.max(size.reading);
            census.meshes += size.meshes;
            census.deforming_vertices = add(census.deforming_vertices, if deforms { size.vertices } else { 0 });
        }
        *placed = add(*placed, places);
        if moving[index] && skin.is_null() {
            census.moving = add(census.moving, places);
        }
    }
    let list: Vec<_> = items(&json["cameras"]).collect();
    let cameras = nodes().filter(|(index, _)| shown.get(*index) == Some(&true));
    census.cameras = cameras
        .filter_map(|(_, node)| {
            let camera = list.get(number(&node["camera"])?)?;
            let name = node["name"].as_str().or(camera["name"].as_str()).unwrap_or_default();
            Some((name.to_owned(), aspect(camera)))
        })
        .collect();
    census
}

/// Width over height of a camera.
fn aspect(camera: &Value) -> Option<f32> {
    let (xmag, ymag) = (&camera["orthographic"]["xmag"], &camera["orthographic"]["ymag"]);
    let orthographic = || Some((xmag.as_f64()? / ymag.as_f64()?).abs());
    camera["perspective"]["aspectRatio"].as_f64().or_else(orthographic).map(|aspect| aspect as f32)
}

/// What animations change.
struct Animated {
    is_empty: bool,
    /// By node.
    moving: Vec<bool>,
    weights: HashSet<usize>,
    /// Materials whose emission they change.
    shining: HashSet<usize>,
}

impl Animated {
    fn of(json: &Value) -> Self {
        let moving = vec![false; items(&json["nodes"]).count()];
        let mut found = Self { is_empty: true, moving, weights: HashSet::new(), shining: HashSet::new() };
        for channel in items(&json["animations"]).flat_map(|animation| items(&animation["channels"])) {
            let target = &channel["target"];
            let pointer = target["extensions"]["KHR_animation_pointer"]["pointer"].as_str().unwrap_or_default();
            let mut steps = pointer.split('/').skip(1);
            let (list, index) = (steps.next(), steps.next().and_then(|index| index.parse::<usize>().ok()));
            let node = number(&target["node"]).or(index.filter(|_| list == Some("nodes")));
            found.is_empty = false;
            match node {
                Some(node) if target["path"] == "weights" || pointer.contains("/weights") => {
                    found.weights.insert(node);
                }
                Some(node) => {
                    found.moving.get_mut(node).into_iter().for_each(|moves| *moves = true);
                }
                None if list == Some("materials") && pointer.contains("emissive") => found.shining.extend(index),
                // The weights of a mesh: of all nodes that show it.
                None if list == Some("meshes") => {
                    let shows = |(_, node): &(usize, &Value)| number(&node["mesh"]) == index;
                    found.weights.extend(items(&json["nodes"]).enumerate().filter(shows).map(|(index, _)| index));
                }
                None => {}
            }
        }
        found
    }
}

/// The marked nodes and all below them.
fn below(json: &Value, mut marked: Vec<bool>) -> Vec<bool> {
    let list: Vec<_> = items(&json["nodes"]).collect();
    let mut stack: Vec<usize> = (0..marked.len()).filter(|&node| marked[node]).collect();
    while let Some(node) = stack.pop() {
        for child in items(&list[node]["children"]).filter_map(number) {
            if marked.get(child) == Some(&false) {
                marked[child] = true;
                stack.push(child);
            }
        }
    }
    marked
}

/// Number of times that a node shows its mesh.
fn placements(json: &Value, node: &Value) -> u64 {
    let attributes = &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
    match attributes.as_object().and_then(|map| map.values().next()) {
        // Joints place skinned meshes, once.
        Some(index) if node["skin"].is_null() => count(json, index),
        _ => 1,
    }
}

/// Number of an accessor's elements.
fn count(json: &Value, index: &Value) -> u64 {
    let count = number(index).and_then(|i| json["accessors"][i]["count"].as_u64()).unwrap_or(0);
    if count < MOST { count } else { 0 }
}

/// What a material needs of its meshes, and whether they shine.
#[derive(Debug, Clone, Copy, Default)]
struct Shading {
    emissive: bool,
    textured: bool,
    tangents: bool,
}

fn size(json: &Value, mesh: &Value, materials: &[Shading]) -> Size {
    let shading = |index: &Value| number(index).and_then(|index| materials.get(index)).copied().unwrap_or_default();
    let mut all = Size::default();
    for primitive in items(&mesh["primitives"]) {
        let attributes = &primitive["attributes"];
        let vertices = count(json, &attributes["POSITION"]);
        let corners = if primitive["indices"].is_null() { vertices } else { count(json, &primitive["indices"]) };
        let triangles = match primitive["mode"].as_u64() {
            None | Some(4) => corners / 3,
            Some(5 | 6) => corners.saturating_sub(2),
            _ => continue,
        };
        let Shading { textured, tangents, .. } = shading(&primitive["material"]);
        let bytes_of = |name: &str| match name {
            "POSITION" | "NORMAL" => 12,
            "TANGENT" if tangents => 16,
            "COLOR_0" => 16,
            name if name.starts_with("TEXCOORD_") && textured => 8,
            _ => 0,
        };
        let named = attributes.as_object().into_iter().flatten().filter(|(_, accessor)| accessor.is_u64());
        let bytes_per_vertex: u64 = named.map(|(name, _)| bytes_of(name)).sum();
        let made = tangents && attributes["TANGENT"].is_null();
        // Tangents that are made split vertices, up to one for each corner.
        let (kept, corners) = if made { (0, 3 * triangles * (bytes_per_vertex + 16)) } else { (vertices, 0) };
        let variants = items(&primitive["extensions"]["KHR_materials_variants"]["mappings"]);
        let mut all_variants = variants.map(|mapping| &mapping["material"]).chain([&primitive["material"]]);
        let shines = all_variants.any(|index| shading(index).emissive);
        let targets = items(&primitive["targets"]).count() as u64;
        let skinned = !attributes["JOINTS_0"].is_null();
        let bytes = kept * bytes_per_vertex + corners + 12 * triangles;
        // Indices as they are in the file; displacements of a target; matrices of a skin.
        let reading =
            12 * triangles + if targets > 0 { 12 * vertices } else { 0 } + if skinned { 168 * vertices } else { 0 };
        all.vertices = add(all.vertices, vertices);
        all.triangles = add(all.triangles, triangles);
        all.emissive = add(all.emissive, if shines { triangles } else { 0 });
        all.bytes = add(all.bytes, bytes);
        all.reading = all.reading.max(reading + if made { 2 * corners } else { 0 });
        all.meshes += 1;
    }
    all
}

fn shines(material: &Value) -> bool {
    items(&material["emissiveFactor"]).any(|x| x.as_f64().is_some_and(|x| x > 0.0))
}

/// Memory of a parsed value, as the allocator counts it.
fn value_bytes(json: &Value) -> u64 {
    /// A leaf of a map: eleven keys and values.
    const LEAF: u64 = 11 * (size_of::<String>() + size_of::<Value>()) as u64 + 32;
    const HEAD: u64 = 16;
    let text = |text: &str| if text.is_empty() { 0 } else { (text.len() as u64).next_multiple_of(16).max(16) + HEAD };
    let map = |map: &Map<String, Value>| {
        let members = map.iter().map(|(key, value)| text(key) + value_bytes(value)).sum::<u64>();
        members + if map.is_empty() { 0 } else { (map.len() as u64).div_ceil(8) * LEAF }
    };
    match json {
        Value::String(string) => text(string),
        Value::Array(list) => {
            list.iter().map(value_bytes).sum::<u64>() + (list.len() * size_of::<Value>()) as u64 + HEAD
        }
        Value::Object(members) => map(members),
        _ => 0,
    }
}

fn number(json: &Value) -> Option<usize> {
    json.as_u64().map(|n| n as usize)
}
