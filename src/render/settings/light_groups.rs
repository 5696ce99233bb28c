//! Groups of lights by name or by kind, by which layers divide the beauty.

use std::collections::BTreeSet;
use std::str::FromStr;
use std::sync::Arc;

use glob::Pattern;
use serde::{Deserialize, Serialize};

use crate::integrator::PreparedScene;
use crate::integrator::data::light_layers::{LightLayerTable, MAX_LAYERS};
use crate::{Error, Result};

/// The group of lights that no other group has.
pub const REST: &str = "rest";
/// The environment's name.
const ENVIRONMENT: &str = "env";
/// The text of the groups by kind, which no list of names is.
const KINDS: &str = "by kind";

/// Most bytes of a pattern. To match a name takes at most as many steps for each of its characters.
const MAX_PATTERN: usize = 256;
/// Most bytes of all.
const MAX_TEXT: usize = 4096;

/// Groups of lights: `NAME=PATTERN,...`. A name alone, or with several patterns, one after the other, is allowed. Or those of the
/// kinds of lights.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct LightGroups {
    text: String,
    /// In the order of the text, and [`REST`]; or those of [`LightKind::layer`].
    names: Vec<String>,
    /// The numbers of groups with their patterns.
    patterns: Vec<(usize, Pattern)>,
}

impl FromStr for LightGroups {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if text.len() > MAX_TEXT {
            return Err(format!("{} bytes: at most {MAX_TEXT}; a pattern with * stands for many names", text.len()));
        }
        let (mut names, mut patterns) = (Vec::<String>::new(), Vec::new());
        for item in text.split(',').map(str::trim) {
            let (name, pattern) = item.split_once('=').map_or((item, None), |(name, pattern)| (name, Some(pattern)));
            let is_letter = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
            if name.is_empty() || name.len() > 64 || !name.chars().all(is_letter) || pattern == Some("") {
                return Err(format!("'{item}' is not NAME=PATTERN, with letters, digits, _ and - in the name"));
            }
            if name == REST {
                return Err(format!("'{REST}' is the group of all lights that no other has: choose another name"));
            }
            let group = names.iter().position(|own| own == name).unwrap_or_else(|| {
                names.push(name.into());
                names.len() - 1
            });
            if let Some(pattern) = pattern {
                if pattern.len() > MAX_PATTERN {
                    return Err(format!("a pattern of '{name}' has {} bytes: at most {MAX_PATTERN}", pattern.len()));
                }
                let pattern = Pattern::new(pattern).map_err(|e| format!("'{item}': {}", e.msg))?;
                patterns.push((group, pattern));
            }
        }
        if names.len() >= MAX_LAYERS {
            return Err(format!("{} groups: at most {}", names.len(), MAX_LAYERS - 1));
        }
        names.push(REST.into());
        Ok(Self { text: text.into(), names, patterns })
    }
}

impl TryFrom<String> for LightGroups {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        if text == KINDS { Ok(Self::kinds()) } else { text.parse() }
    }
}

impl From<LightGroups> for String {
    fn from(groups: LightGroups) -> Self {
        groups.text
    }
}

impl LightGroups {
    /// Environment, emissive surfaces, and punctual lights.
    pub fn kinds() -> Self {
        let names = ["environment", "surfaces", "punctual"].map(Into::into);
        Self { text: KINDS.into(), names: names.into(), patterns: Vec::new() }
    }

    /// Their names.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The groups of a scene's lights; `None` for those by kind.
    ///
    /// # Errors
    /// [`Error::Usage`] for groups that overlap and for a group without a light.
    pub fn table(&self, scene: &PreparedScene) -> Result<Option<Arc<LightLayerTable>>> {
        if self.text == KINDS {
            return Ok(None);
        }
        let PreparedScene { scene, lights, .. } = scene;
        let mut finder = Finder { groups: self, is_used: vec![false; self.names.len()], seen: BTreeSet::new() };
        let mut table = LightLayerTable::default();
        if scene.environment.is_some() {
            table.environment = finder.find(&[ENVIRONMENT], None)?;
        }
        for (i, light) in scene.lights.iter().enumerate() {
            let node = scene.light_nodes.get(i);
            let names = [light.name.as_str(), node.map_or("", |node| &node.name)];
            table.punctual.push(finder.find(&names, node.and_then(|node| node.group.as_deref()))?);
        }
        for (i, instance) in scene.instances.iter().enumerate() {
            let object = &scene.objects[instance.object as usize];
            for mesh in object.meshes.clone() {
                let material = &scene.materials[scene.meshes[mesh as usize].material as usize];
                if material.is_emissive() || material.unlit {
                    let names = [instance.name.as_str(), &material.name, &object.name];
                    let extra = instance.light_group.as_deref().or(material.light_group.as_deref());
                    table.surfaces.push(([i as u32, mesh], finder.find(&names, extra)?));
                }
            }
        }
        table.surfaces.sort_unstable();
        let unused = self.names.iter().zip(&finder.is_used).find(|(name, is_used)| !**is_used && *name != REST);
        if let Some((name, _)) = unused {
            let (some, more) = (finder.seen.iter().take(10), finder.seen.len().saturating_sub(10));
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let some = some.map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
            let why = format!("--light-groups: no light is in the group {name}; the names are {some}{more}");
            return Err(Error::Usage(why));
        }
        Ok(Some(Arc::new(table.with_area(lights))))
    }
}

/// Finds the groups of lights.
struct Finder<'a> {
    groups: &'a LightGroups,
    is_used: Vec<bool>,
    /// The names so far.
    seen: BTreeSet<&'a str>,
}

impl<'a> Finder<'a> {
    /// The group of a light of these names, or of its `extra`.
    fn find(&mut self, names: &[&'a str], extra: Option<&str>) -> Result<u8> {
        self.seen.extend(names.iter().filter(|name| !name.is_empty()));
        let groups = self.groups;
        let rest = groups.names.len() - 1;
        let own = extra.and_then(|extra| groups.names.iter().position(|name| name == extra));
        let matching = |(_, pattern): &&(usize, Pattern)| names.iter().any(|name| pattern.matches(name));
        let mut found = groups.patterns.iter().filter(matching).map(|(group, _)| *group);
        let group = own.or_else(|| found.next()).unwrap_or(rest);
        if let (None, Some(other)) = (own, found.find(|other| *other != group)) {
            let [a, b] = [group, other].map(|group| &groups.names[group]);
            let light = names.iter().find(|name| !name.is_empty()).copied().unwrap_or_default();
            return Err(Error::Usage(format!("--light-groups: '{light}' is in two groups, {a} and {b}")));
        }
        self.is_used[group] = true;
        Ok(group as u8)
    }
}
