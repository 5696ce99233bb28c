//! Elements of a document that some scene can show at some time. The others need not be read.

use std::ops::Range;

use serde_json::Value;

/// Reachable elements, by array.
#[derive(Debug)]
pub struct Reach {
    pub nodes: Vec<bool>,
    pub meshes: Vec<bool>,
    pub images: Vec<bool>,
    materials: Vec<bool>,
    textures: Vec<bool>,
    accessors: Vec<bool>,
    views: Vec<bool>,
}

impl Reach {
    /// Follows the references of a document that is not checked yet; invalid references are skipped.
    pub fn of(json: &Value) -> Self {
        let none = |list: &str| vec![false; items(&json[list]).count()];
        let mut reach = Self {
            meshes: none("meshes"),
            images: none("images"),
            materials: none("materials"),
            textures: none("textures"),
            accessors: none("accessors"),
            views: none("bufferViews"),
            nodes: Vec::new(),
        };
        let mut nodes = none("nodes");
        match items(&json["scenes"]).next() {
            Some(_) => items(&json["scenes"]).for_each(|scene| mark_all(&mut nodes, &scene["nodes"])),
            None => nodes.fill(true),
        }
        descend(json, &mut nodes);
        for index in indices(&nodes) {
            reach.node(json, &json["nodes"][index]);
        }
        reach.nodes = nodes;
        for sampler in items(&json["animations"]).flat_map(|animation| items(&animation["samplers"])) {
            mark(&mut reach.accessors, &sampler["input"]);
            mark(&mut reach.accessors, &sampler["output"]);
        }
        for index in indices(&reach.meshes) {
            for primitive in items(&json["meshes"][index]["primitives"]) {
                reach.primitive(primitive);
            }
        }
        for index in indices(&reach.materials) {
            reach.material(&json["materials"][index]);
        }
        for index in indices(&reach.textures) {
            let texture = &json["textures"][index];
            mark(&mut reach.images, &texture["source"]);
            extensions(texture).for_each(|extension| mark(&mut reach.images, &extension["source"]));
        }
        for index in indices(&reach.images) {
            mark(&mut reach.views, &json["images"][index]["bufferView"]);
        }
        for index in indices(&reach.accessors) {
            let accessor = &json["accessors"][index];
            let sparse = &accessor["sparse"];
            for part in [accessor, &sparse["indices"], &sparse["values"]] {
                mark(&mut reach.views, &part["bufferView"]);
            }
        }
        reach
    }

    fn node(&mut self, json: &Value, node: &Value) {
        mark(&mut self.meshes, &node["mesh"]);
        if let Some(skin) = index(&node["skin"]) {
            mark(&mut self.accessors, &json["skins"][skin]["inverseBindMatrices"]);
        }
        extensions(node).for_each(|instancing| mark_all(&mut self.accessors, &instancing["attributes"]));
    }

    fn primitive(&mut self, primitive: &Value) {
        mark_all(&mut self.accessors, &primitive["attributes"]);
        mark(&mut self.accessors, &primitive["indices"]);
        items(&primitive["targets"]).for_each(|target| mark_all(&mut self.accessors, target));
        mark(&mut self.materials, &primitive["material"]);
        for extension in extensions(primitive) {
            mark(&mut self.views, &extension["bufferView"]);
            items(&extension["mappings"]).for_each(|mapping| mark(&mut self.materials, &mapping["material"]));
        }
    }

    /// Marks a material's textures, including those of any extension.
    fn material(&mut self, part: &Value) {
        for (key, value) in part.as_object().into_iter().flatten() {
            if key.ends_with("Texture") {
                mark(&mut self.textures, &value["index"]);
            }
            self.material(value);
        }
    }

    pub fn ranges(&self, json: &Value, buffer: usize) -> Vec<Range<u64>> {
        let range = |part: &Value| {
            let start = part["byteOffset"].as_u64().unwrap_or(0);
            let of_buffer = index(&part["buffer"]) == Some(buffer);
            of_buffer.then(|| start..start.saturating_add(part["byteLength"].as_u64().unwrap_or(0)))
        };
        let views = indices(&self.views).into_iter().map(|index| &json["bufferViews"][index]);
        views.flat_map(|view| extensions(view).chain([view]).filter_map(range)).collect()
    }
}

pub fn index(value: &Value) -> Option<usize> {
    value.as_u64().map(|index| index as usize)
}

fn mark(list: &mut [bool], value: &Value) {
    if let Some(reached) = index(value).and_then(|index| list.get_mut(index)) {
        *reached = true;
    }
}

/// Marks the indices in an array, or under the keys of an object.
fn mark_all(list: &mut [bool], value: &Value) {
    items(value).chain(value.as_object().into_iter().flat_map(|map| map.values())).for_each(|item| mark(list, item));
}

/// Marks the descendants of marked nodes.
fn descend(json: &Value, nodes: &mut [bool]) {
    let mut stack = indices(nodes);
    while let Some(next) = stack.pop() {
        for child in items(&json["nodes"][next]["children"]).filter_map(index) {
            if nodes.get(child) == Some(&false) {
                nodes[child] = true;
                stack.push(child);
            }
        }
    }
}

fn indices(list: &[bool]) -> Vec<usize> {
    (0..list.len()).filter(|&i| list[i]).collect()
}

/// The elements of an array; none for other values.
pub fn items(json: &Value) -> impl Iterator<Item = &Value> {
    json.as_array().into_iter().flatten()
}

fn extensions(json: &Value) -> impl Iterator<Item = &Value> {
    json["extensions"].as_object().into_iter().flat_map(|map| map.values())
}
