//! Plays animations: sets the values that animated properties have at one time.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DMat4, DQuat};
use serde_json::{Value, json};

use super::reader::Reader;
use crate::error::Result;
use crate::scene::choose;
use crate::scene::import::complaint::bad;
use crate::scene::import::document::accessors::{Component, Shape};
use crate::scene::import::document::animations::{Channel, Interpolation};
use crate::scene::import::document::{ANIMATED, Document};
use crate::scene::import::options::Pose;
use crate::scene::import::report::Notes;

/// Last path segments of properties that may be animated, of nodes, lights, cameras and materials. Other targets, such as
/// indices, are not played.
const ANIMATABLE: [&[&str]; 6] = [
    &["translation", "rotation", "scale", "weights", "visible"],
    &["color", "intensity", "range", "innerConeAngle", "outerConeAngle"],
    &["yfov", "xmag", "ymag", "aspectRatio", "znear", "zfar"],
    &["alphaCutoff", "ior", "emissiveStrength", "attenuationDistance", "attenuationColor", "dispersion"],
    &["anisotropyStrength", "anisotropyRotation", "offset", "strength"],
    &["iridescenceIor", "iridescenceThicknessMinimum", "iridescenceThicknessMaximum"],
];

/// Indices of the animations that are played.
/// Errors: [`Error::Usage`](crate::Error::Usage) for an animation that is not there.
pub fn chosen(document: &Document, pose: &Pose) -> Result<Range<usize>> {
    let animations = &document.animations;
    Ok(match pose.animation.as_deref() {
        None | Some("all") => 0..animations.len(),
        Some(wanted) => {
            let name = |i| animations.get(i).map(|a| a.name.clone()).unwrap_or_default();
            let index = choose("animation", wanted, &(0..animations.len()).map(name).collect::<Vec<_>>())?;
            index..index + 1
        }
    })
}

/// An element of one of the arrays [`ANIMATED`], by its index.
pub type Element = (&'static str, usize);

/// The channels that a pose plays.
pub struct Animation<'a> {
    json: &'a Value,
    channels: Vec<Playing>,
}

/// A channel: the property of an element that it changes, by its JSON pointer and by that within the element.
struct Playing {
    at: String,
    pointer: String,
    element: Element,
    inside: String,
    track: Track,
}

impl<'a> Animation<'a> {
    /// Reads the channels; `json` is the document at rest.
    /// Errors: [`Error::Usage`](crate::Error::Usage) for an animation that is not there; [`Error::Data`](crate::Error::Data)
    /// for keys that break the specification.
    pub fn read(
        document: &Document,
        json: &'a Value,
        file_bytes: u64,
        pose: &Pose,
        seconds: f64,
        notes: &mut Notes,
    ) -> Result<Self> {
        let animations = &document.animations;
        let mut reader = Reader::new(document, file_bytes);
        let (mut played, mut channels) = (Vec::new(), Vec::new());
        for index in chosen(document, pose)? {
            let animation = animations.get(index)?;
            played.push(if animation.name.is_empty() {
                format!("animations[{index}]")
            } else {
                animation.name.clone()
            });
            for channel in &animation.channels {
                let Channel { pointer, at, .. } = channel;
                let name = pointer.rsplit('/').find(|name| !name.bytes().all(|b| b.is_ascii_digit()));
                let is_known = |name: &&str| ANIMATABLE.concat().contains(name) || name.ends_with("Factor");
                let target = name.filter(is_known).and_then(|_| element_of(json, pointer));
                let Some((element, inside)) = target else {
                    notes.approximated(at, format!("{pointer} is not played"));
                    continue;
                };
                let Some(track) = Track::read(&mut reader, channel)? else {
                    notes.repaired(at, format!("{pointer}: no key is finite: not played"));
                    continue;
                };
                if track.left_out > 0 {
                    notes.repaired(at, format!("{} keys that are not finite are left out", track.left_out));
                }
                let (at, pointer, inside) = (at.clone(), pointer.clone(), inside.to_owned());
                channels.push(Playing { at, pointer, element, inside, track });
            }
        }
        let what = if played.is_empty() { "nothing: the file has no animation".into() } else { played.join(", ") };
        notes.convention("animations", format!("at {seconds} s, played: {what}"));
        Ok(Self { json, channels })
    }

    /// The elements that channels change.
    pub fn elements(&self) -> impl Iterator<Item = Element> {
        self.channels.iter().map(|channel| channel.element)
    }

    /// Gives the document's elements the values that they have at a time, clamped to each channel's keys. If two channels animate
    /// one property, the later one wins.
    /// Errors: Faults of nodes with these values; those of other elements are kept in their places.
    pub fn pose(&self, document: &mut Document, seconds: f64, notes: &mut Notes) -> Result<()> {
        let mut elements = BTreeMap::new();
        for Playing { at, pointer, element, inside, track } in &self.channels {
            // Those without a value now are as at rest again.
            let json =
                elements.entry(*element).or_insert_with(|| rest(self.json, *element).cloned().unwrap_or_default());
            let values = track.at(seconds);
            if !values.iter().all(|x| x.is_finite()) {
                notes.repaired(at, format!("{pointer} is not finite at this time: not played"));
            } else if !set_property(json, self.json, inside, &values) {
                notes.approximated(at, format!("{pointer} is not played"));
            }
        }
        // Meshes refer to materials, and nodes to meshes: in the order of their names.
        elements.iter().try_for_each(|(element, json)| document.replace(self.json, *element, json, notes))
    }
}

fn rest(json: &Value, (array, index): Element) -> Option<&Value> {
    array.split('.').fold(json, |value, key| &value[key]).get(index)
}

/// The element that a JSON pointer leads into, and the rest of the pointer.
fn element_of<'a>(json: &Value, pointer: &'a str) -> Option<(Element, &'a str)> {
    let inside = |array: &'static str| {
        let rest = pointer.strip_prefix('/')?.strip_prefix(&array.replace('.', "/"))?;
        let (index, inside) = rest.strip_prefix('/')?.split_once('/')?;
        Some(((array, index.parse().ok()?), inside))
    };
    ANIMATED.into_iter().find_map(inside).filter(|(element, _)| rest(json, *element).is_some())
}

/// The keys of a channel.
#[derive(Debug)]
pub struct Track {
    /// Times in seconds, increasing.
    pub times: Vec<f64>,
    values: Vec<f64>,
    /// Numbers of a value.
    width: usize,
    rotation: bool,
    interpolation: Interpolation,
    /// Number of keys that are not finite and no part of it.
    left_out: usize,
}

impl Track {
    /// Reads and checks a channel; `None` if none of its keys is finite.
    /// Errors: [`Error::Data`](crate::Error::Data) for keys that break the specification.
    pub fn read(reader: &mut Reader, channel: &Channel) -> Result<Option<Self>> {
        let input = reader.document.accessors.get(channel.input)?;
        if input.shape != Shape::Scalar || input.component != Component::F32 {
            return Err(bad(&input.at, "SCALAR of FLOAT, times of keys", input.format()));
        }
        let mut times: Vec<f64> = reader.floats::<1>(channel.input)?.into_iter().map(|[t]| t.into()).collect();
        let finite: Vec<f64> = times.iter().copied().filter(|t| t.is_finite()).collect();
        if let Some(i) = finite.windows(2).position(|t| t[0] >= t[1]) {
            let found = format!("{} after {} as number {}", finite[i + 1], finite[i], i + 1);
            return Err(bad(&input.at, "times that increase from key to key", found));
        }
        let mut values = reader.flat(channel.output)?;
        let values_per_key = values_per_key(channel.interpolation);
        let width = values.len() / (times.len() * values_per_key);
        let rotation = channel.pointer.starts_with("/nodes/") && channel.pointer.ends_with("/rotation");
        let fits = match channel.pointer.rsplit('/').next() {
            Some("rotation") if rotation => width == 4,
            Some("translation" | "scale") if channel.pointer.starts_with("/nodes/") => width == 3,
            _ => width > 0,
        };
        if !fits || width * times.len() * values_per_key != values.len() {
            let at = &reader.document.accessors.get(channel.output)?.at;
            let wanted = format!("values for {} keys of {}", times.len(), channel.pointer);
            return Err(bad(at, wanted, format!("{} numbers", values.len())));
        }
        let of_key = width * values_per_key;
        let keep: Vec<bool> = times
            .iter()
            .zip(values.chunks(of_key))
            .map(|(t, v)| t.is_finite() && v.iter().all(|x| x.is_finite()))
            .collect();
        let left_out = keep.iter().filter(|keep| !**keep).count();
        if left_out > 0 {
            let (mut key, mut value) = (0..keep.len(), 0..values.len());
            times.retain(|_| key.next().is_some_and(|key| keep[key]));
            values.retain(|_| value.next().is_some_and(|i| keep[i / of_key]));
        }
        let track = Self { times, values, width, rotation, interpolation: channel.interpolation, left_out };
        Ok((!track.times.is_empty()).then_some(track))
    }

    /// The value at a time in seconds.
    pub fn at(&self, seconds: f64) -> Vec<f64> {
        let Self { times, values, width, rotation, interpolation, .. } = self;
        let spline = *interpolation == Interpolation::CubicSpline;
        let part = |key: usize, part: usize| &values[(key * values_per_key(*interpolation) + part) * width..][..*width];
        let value = |key: usize| part(key, usize::from(spline));
        let after = times.partition_point(|t| *t <= seconds);
        let (Some(from), true) = (after.checked_sub(1), after < times.len()) else {
            return value(after.min(times.len() - 1)).to_vec();
        };
        let step = times[after] - times[from];
        let u = (seconds - times[from]) / step;
        let (a, b) = (value(from), value(after));
        let quaternion = |q: &[f64]| DQuat::from_xyzw(q[0], q[1], q[2], q[3]);
        match interpolation {
            Interpolation::Step => a.to_vec(),
            Interpolation::Linear if *rotation => {
                let [a, b] = [a, b].map(|q| quaternion(q).normalize());
                a.slerp(b, u).to_array().to_vec()
            }
            Interpolation::Linear => a.iter().zip(b).map(|(a, b)| a + (b - a) * u).collect(),
            // Appendix C of the glTF 2.0 specification.
            Interpolation::CubicSpline => {
                let (u2, u3) = (u * u, u * u * u);
                let (out, into) = (part(from, 2), part(after, 0));
                let spline = |i: usize| {
                    (2.0 * u3 - 3.0 * u2 + 1.0) * a[i]
                        + step * (u3 - 2.0 * u2 + u) * out[i]
                        + (3.0 * u2 - 2.0 * u3) * b[i]
                        + step * (u3 - u2) * into[i]
                };
                let values: Vec<f64> = (0..*width).map(spline).collect();
                if *rotation { quaternion(&values).normalize().to_array().to_vec() } else { values }
            }
        }
    }
}

/// Values that are stored for a key; those of a spline are in-tangent, value, out-tangent.
fn values_per_key(interpolation: Interpolation) -> usize {
    if interpolation == Interpolation::CubicSpline { 3 } else { 1 }
}

/// Writes a value at a JSON pointer within an element of the document `root`, and creates members that may be absent because they
/// have a default. `false` if the pointer does not resolve.
fn set_property(element: &mut Value, root: &Value, pointer: &str, values: &[f64]) -> bool {
    let (parent, name) = pointer.rsplit_once('/').unwrap_or(("", pointer));
    if parent == "weights" {
        add_weights(element, root);
    }
    let Some(target) = resolve(element, parent) else { return false };
    let value = match (name, values) {
        ("visible", [x]) => json!(*x != 0.0),
        ("weights", _) => json!(values),
        (_, [x]) => json!(x),
        _ => json!(values),
    };
    match target {
        Value::Object(members) => {
            if matches!(name, "translation" | "rotation" | "scale") {
                split_matrix(members);
            }
            members.insert(name.into(), value);
        }
        Value::Array(items) => match name.parse::<usize>().ok().and_then(|index| items.get_mut(index)) {
            Some(item) => *item = value,
            None => return false,
        },
        _ => return false,
    }
    true
}

/// Adds weights to a node or mesh that has none: those of the node's mesh, else zeros.
fn add_weights(owner: &mut Value, root: &Value) {
    let mesh = owner.get("mesh").and_then(Value::as_u64).map_or(&*owner, |mesh| &root["meshes"][mesh as usize]);
    let targets = mesh["primitives"][0]["targets"].as_array().map_or(0, Vec::len);
    let weights = mesh.get("weights").cloned().unwrap_or_else(|| json!(vec![0.0; targets]));
    if let Some(members) = owner.as_object_mut().filter(|_| targets > 0) {
        members.entry("weights").or_insert(weights);
    }
}

/// Resolves a JSON pointer within an element. Creates absent objects whose members all have defaults.
fn resolve<'a>(element: &'a mut Value, pointer: &str) -> Option<&'a mut Value> {
    let mut at = element;
    for name in pointer.split('/').filter(|name| !name.is_empty()) {
        let name = name.replace("~1", "/").replace("~0", "~");
        at = match at {
            Value::Object(members) => {
                if ["extensions", "pbrMetallicRoughness"].contains(&&name[..]) || name.starts_with("KHR_") {
                    members.entry(&name).or_insert_with(|| json!({}));
                }
                members.get_mut(&name)?
            }
            Value::Array(items) => items.get_mut(name.parse::<usize>().ok()?)?,
            _ => return None,
        };
    }
    Some(at)
}

/// Replaces a node's matrix by translation, rotation and scale, which animations change.
fn split_matrix(node: &mut serde_json::Map<String, Value>) {
    let Some(matrix) = node.remove("matrix") else { return };
    let numbers: Option<Vec<f64>> = matrix.as_array().map(|m| m.iter().filter_map(Value::as_f64).collect());
    let Some(Ok(matrix)) = numbers.map(<[f64; 16]>::try_from) else {
        node.insert("matrix".into(), matrix);
        return;
    };
    let (scale, rotation, translation) = DMat4::from_cols_array(&matrix).to_scale_rotation_translation();
    node.insert("scale".into(), json!(scale.to_array()));
    node.insert("rotation".into(), json!(rotation.to_array()));
    node.insert("translation".into(), json!(translation.to_array()));
}
