//! Counts what a document's elements become in memory, without reading their data.

use serde_json::Value;

use super::reach::{Reach, index, items};

/// Numbers of the elements that some scene of the document can show, as the document states them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Census {
    pub vertices: u64,
    pub triangles: u64,
    pub meshes: u64,
    pub instances: u64,
    /// Emissive triangles, counted for each placement.
    pub emissive_triangles: u64,
    /// Values in the document's text.
    pub values: u64,
    /// Names of the placed cameras, and their width over height where the file says it.
    pub cameras: Vec<(String, Option<f32>)>,
}

/// Largest count of an accessor that a sound document has: the others are left for the import to refuse.
const MOST: u64 = 1 << 40;

/// A sum that leaves room for products: no memory holds so much.
fn add(sum: &mut u64, more: u64) {
    *sum = sum.saturating_add(more).min(1 << 44);
}

/// Counts the elements that some scene of the document can show.
pub fn census(json: &Value, reach: &Reach) -> Census {
    let mut census = Census { values: values(json), ..Default::default() };
    // Vertices, triangles, emissive triangles, primitives.
    let size = |mesh: &Value| {
        let mut size = [0; 4];
        for primitive in items(&mesh["primitives"]) {
            let vertices = count(json, &primitive["attributes"]["POSITION"]);
            let corners = if primitive["indices"].is_null() { vertices } else { count(json, &primitive["indices"]) };
            let triangles = match primitive["mode"].as_u64() {
                None | Some(4) => corners / 3,
                Some(5 | 6) => corners.saturating_sub(2),
                _ => continue,
            };
            let emissive = index(&primitive["material"]).is_some_and(|index| shines(&json["materials"][index]));
            let own = [vertices, triangles, if emissive { triangles } else { 0 }, 1];
            size.iter_mut().zip(own).for_each(|(sum, more)| add(sum, more));
        }
        size
    };
    let sizes: Vec<_> = items(&json["meshes"]).map(size).collect();
    for ([vertices, triangles, _, primitives], _) in sizes.iter().zip(&reach.meshes).filter(|(_, shown)| **shown) {
        add(&mut census.vertices, *vertices);
        add(&mut census.triangles, *triangles);
        add(&mut census.meshes, *primitives);
    }
    let cameras: Vec<_> = items(&json["cameras"]).collect();
    for (node, _) in items(&json["nodes"]).zip(&reach.nodes).filter(|(_, shown)| **shown) {
        if let Some(size) = index(&node["mesh"]).and_then(|mesh| sizes.get(mesh)) {
            let places = placements(json, node);
            add(&mut census.instances, places);
            add(&mut census.emissive_triangles, places.saturating_mul(size[2]));
        }
        if let Some(camera) = index(&node["camera"]).and_then(|camera| cameras.get(camera)) {
            let name = node["name"].as_str().or(camera["name"].as_str()).unwrap_or_default();
            census.cameras.push((name.to_owned(), aspect(camera)));
        }
    }
    census
}

/// May a material emit light?
pub fn shines(material: &Value) -> bool {
    items(&material["emissiveFactor"]).any(|x| x.as_f64().is_some_and(|x| x > 0.0))
}

/// Width over height of a camera.
fn aspect(camera: &Value) -> Option<f32> {
    let (xmag, ymag) = (&camera["orthographic"]["xmag"], &camera["orthographic"]["ymag"]);
    let orthographic = || Some((xmag.as_f64()? / ymag.as_f64()?).abs());
    camera["perspective"]["aspectRatio"].as_f64().or_else(orthographic).map(|aspect| aspect as f32)
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

fn count(json: &Value, accessor: &Value) -> u64 {
    let count = index(accessor).and_then(|i| json["accessors"][i]["count"].as_u64()).unwrap_or(0);
    if count < MOST { count } else { 0 }
}

fn values(json: &Value) -> u64 {
    1 + match json {
        Value::Array(list) => list.iter().map(values).sum(),
        Value::Object(members) => members.values().map(values).sum(),
        _ => 0,
    }
}
