//! What is in a scene, and how the contents of two scenes differ, in words.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;

use crate::scene::import::{Imported, Note, Survey, summary};
use crate::scene::{Image, Material};
use crate::{Error, Result};

/// A box in world space, metres.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bounds {
    low: [f64; 3],
    high: [f64; 3],
    /// Along x, y and z.
    pub size: [f64; 3],
}

impl Bounds {
    /// The box around those that there are.
    pub fn around(a: &Option<Self>, b: &Option<Self>) -> Option<Self> {
        let (Some(a), Some(b)) = (a, b) else { return a.clone().or(b.clone()) };
        let low = std::array::from_fn(|axis| a.low[axis].min(b.low[axis]));
        let high = std::array::from_fn(|axis| a.high[axis].max(b.high[axis]));
        Some(Self { low, high, size: std::array::from_fn(|axis| high[axis] - low[axis]) })
    }
}

#[derive(Debug, Clone, Serialize)]
struct MaterialRow {
    name: String,
    features: Vec<&'static str>,
    triangles: u64,
    /// All of its values without its textures, to compare.
    #[serde(skip)]
    values: Material,
}

#[derive(Debug, Clone, Serialize)]
struct TextureRow {
    name: String,
    width: u32,
    height: u32,
    /// BLAKE3 of the picture as the file stores it; hexadecimal.
    hash: String,
}

#[derive(Debug, Clone, Serialize)]
struct LightRow {
    name: String,
    kind: &'static str,
    /// Linear RGB; lux for directional lights, candela for others.
    intensity: [f64; 3],
}

#[derive(Debug, Clone, Serialize)]
pub struct Contents {
    pub file: String,
    /// BLAKE3 of what the file and those that it refers to say; hexadecimal.
    pub hash: String,
    /// Could all of these files be read?
    pub whole: bool,
    file_bytes: u64,
    /// Over the whole animation if one is played; `None` of a scene without a triangle.
    pub bounds: Option<Bounds>,
    /// As placed: each instance counts.
    triangles: u64,
    materials: Vec<MaterialRow>,
    textures: Vec<TextureRow>,
    lights: Vec<LightRow>,
    emits: bool,
    /// Was studio light added, because the scene's own does not light it?
    pub studio_light: bool,
    animations: Vec<String>,
    cameras: Vec<String>,
    approximated: Vec<String>,
    /// What is left out although it changes the picture.
    missing: Vec<String>,
}

impl Contents {
    /// The contents of an imported scene.
    pub fn of(imported: &Imported, survey: &Survey) -> Self {
        let (scene, summary) = (&imported.scene, summary(imported));
        let bounds = scene.reach.as_ref().map(|reach| reach.bounds).or_else(|| scene.bounds());
        let origin = scene.origin.as_vec3();
        let values = |material: &Material| Material { textures: Default::default(), ..material.clone() };
        let materials = summary.materials.into_iter().zip(&scene.materials).map(|(row, material)| MaterialRow {
            name: row.name,
            features: row.features,
            triangles: row.triangles,
            values: values(material),
        });
        let texts = |notes: &[Note]| notes.iter().map(|note| note.text.clone()).collect();
        Self {
            file: summary.file,
            hash: survey.hash.clone(),
            whole: survey.is_whole,
            file_bytes: summary.file_bytes,
            bounds: bounds.map(|[low, high]| Bounds {
                low: (low + origin).to_array().map(decimal),
                high: (high + origin).to_array().map(decimal),
                size: (high - low).to_array().map(decimal),
            }),
            triangles: summary.counts.instanced_triangles,
            materials: materials.collect(),
            textures: scene.images.iter().map(|image| texture(image)).collect(),
            lights: summary
                .lights
                .into_iter()
                .map(|light| LightRow { name: light.name, kind: light.kind, intensity: light.intensity.map(decimal) })
                .collect(),
            emits: summary.has_emissive_meshes,
            studio_light: false,
            animations: summary.animations,
            // A framed view is no camera of the file.
            cameras: scene.cameras.iter().filter(|c| c.framing.is_none()).map(|c| c.name.clone()).collect(),
            approximated: texts(&summary.approximated),
            missing: texts(&summary.ignored),
        }
    }

    pub fn report(&self) -> Result<Value> {
        serde_json::to_value(self).map_err(|e| Error::Bug(format!("JSON: {e}")))
    }

    /// One line for people.
    pub fn line(&self) -> String {
        let count = |n: usize, what: &str| match n {
            0 => String::new(),
            1 => format!(", 1 {what}"),
            _ => format!(", {n} {what}s"),
        };
        let lights = count(self.lights.len(), "light");
        let (emits, studio) =
            (if self.emits { ", emits" } else { "" }, if self.studio_light { ", studio light" } else { "" });
        let inexact = count(self.approximated.len() + self.missing.len(), "feature");
        let inexact = if inexact.is_empty() { inexact } else { format!("{inexact} not exact") };
        format!(
            "{}, {} triangles{}{}{lights}{emits}{studio}{}{inexact}",
            size(self.bounds.as_ref()),
            self.triangles,
            count(self.materials.len(), "material"),
            count(self.textures.len(), "texture"),
            count(self.animations.len(), "animation")
        )
    }

    /// What differs in `new`, in words; empty if nothing does.
    pub fn differences(&self, new: &Self) -> Vec<String> {
        let mut words = Vec::new();
        let [before, after] = [self, new].map(|contents| size(contents.bounds.as_ref()));
        if self.bounds != new.bounds {
            let moved = if before == after { "moved, still " } else { "" };
            words.push(format!("bounds: {moved}{}", arrow(&before, &after)));
        }
        if self.triangles != new.triangles {
            words.push(format!("triangles: {} -> {}", self.triangles, new.triangles));
        }
        let materials = [self, new].map(|contents| by_name(&contents.materials, |m| &m.name));
        named("material", &materials, &mut words, |old, new| {
            let mut what = Vec::new();
            let said = |all: &[&'static str]| if all.is_empty() { "plain".to_owned() } else { all.join(", ") };
            if old.features != new.features {
                what.push(format!("{} -> {}", said(&old.features), said(&new.features)));
            } else if old.values != new.values {
                what.push("other values".into());
            }
            if old.triangles != new.triangles {
                what.push(format!("on {} -> {} triangles", old.triangles, new.triangles));
            }
            what.join("; ")
        });
        // A texture with the same picture is the same, whatever its name.
        let unknown = |rows: &[TextureRow], others: &[TextureRow]| {
            let unknown = rows.iter().filter(|row| !others.iter().any(|other| other.hash == row.hash));
            unknown.cloned().collect::<Vec<_>>()
        };
        let textures = [unknown(&self.textures, &new.textures), unknown(&new.textures, &self.textures)];
        let textures = [&textures[0], &textures[1]].map(|rows| by_name(rows, |row| &row.name));
        named("texture", &textures, &mut words, |old, new| {
            let size = |row: &TextureRow| format!("{} x {}", row.width, row.height);
            format!("another picture, {}", arrow(&size(old), &size(new)))
        });
        let lights = [self, new].map(|contents| by_name(&contents.lights, |light| &light.name));
        named("light", &lights, &mut words, |old, new| {
            let said = |light: &LightRow| format!("{} {:?}", light.kind, light.intensity);
            if said(old) == said(new) { String::new() } else { arrow(&said(old), &said(new)) }
        });
        for (what, old, new) in [
            ("animation", &self.animations, &new.animations),
            ("camera", &self.cameras, &new.cameras),
            ("approximated", &self.approximated, &new.approximated),
            ("missing", &self.missing, &new.missing),
        ] {
            named(what, &[by_name(old, |name| name), by_name(new, |name| name)], &mut words, |_, _| String::new());
        }
        if self.studio_light != new.studio_light {
            words.push(format!("studio light: {}", if new.studio_light { "now added" } else { "no longer added" }));
        }
        words
    }
}

/// Names of equal kind are told apart by their order.
fn by_name<T>(rows: &[T], name: impl Fn(&T) -> &String) -> BTreeMap<(String, usize), &T> {
    let mut seen = BTreeMap::<&String, usize>::new();
    let mut key = |row| {
        let count = seen.entry(name(row)).or_default();
        *count += 1;
        (name(row).clone(), *count)
    };
    rows.iter().map(|row| (key(row), row)).collect()
}

/// Adds what was added, removed and, by `change`, changed.
fn named<T>(
    what: &str,
    [old, new]: &[BTreeMap<(String, usize), &T>; 2],
    words: &mut Vec<String>,
    change: impl Fn(&T, &T) -> String,
) {
    for (key @ (name, _), before) in old {
        match new.get(key).map(|after| change(before, after)) {
            None => words.push(format!("{what} '{name}': removed")),
            Some(text) if text.is_empty() => {}
            Some(text) => words.push(format!("{what} '{name}': {text}")),
        }
    }
    let added = new.keys().filter(|key| !old.contains_key(*key));
    words.extend(added.map(|(name, _)| format!("{what} '{name}': added")));
}

/// The shortest decimal number that is this 32-bit float, for JSON.
pub(crate) fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

fn arrow(old: &str, new: &str) -> String {
    if old == new { old.to_owned() } else { format!("{old} -> {new}") }
}

fn texture(image: &Image) -> TextureRow {
    TextureRow { name: image.name.clone(), width: image.width, height: image.height, hash: image.hash.clone() }
}

/// Width, height and depth with three digits.
fn size(bounds: Option<&Bounds>) -> String {
    let short = |x: f64| {
        let digits = [1.0, 10.0, 100.0].iter().filter(|limit| x < **limit).count();
        if x == 0.0 || (0.01..1e5).contains(&x) { format!("{x:.digits$}") } else { format!("{x:.1e}") }
    };
    bounds.map_or("nothing to show".into(), |bounds| format!("{} m", bounds.size.map(short).join(" x ")))
}
