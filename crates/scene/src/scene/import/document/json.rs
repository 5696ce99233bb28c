//! JSON values with their path, so that every error says where it is.

use std::cell::RefCell;
use std::fmt::Display;
use std::sync::Arc;

use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;
use crate::scene::import::report::Notes;

/// A JSON value and its path (`meshes[3].primitives[0]`) in a document, with the document's notes.
#[derive(Clone)]
pub struct Json<'a> {
    root: &'a Value,
    value: &'a Value,
    notes: &'a RefCell<Notes>,
    pub at: String,
}

impl<'a> Json<'a> {
    pub fn root(value: &'a Value, notes: &'a RefCell<Notes>) -> Self {
        Self { root: value, value, notes, at: String::new() }
    }

    /// A value within this document, with its path.
    pub fn inside(&self, value: &'a Value, at: String) -> Self {
        Self { root: self.root, value, notes: self.notes, at }
    }

    pub fn value(&self) -> &'a Value {
        self.value
    }

    pub fn path(&self, key: &str) -> String {
        if self.at.is_empty() { key.into() } else { format!("{}.{key}", self.at) }
    }

    pub fn bad(&self, key: &str, wanted: impl Display, found: impl Display) -> Error {
        bad(&self.path(key), wanted, found)
    }

    /// Notes a small fault of a member that has one sensible interpretation.
    pub fn repaired(&self, key: &str, text: impl Into<String>) {
        self.notes.borrow_mut().repaired(&self.path(key), text);
    }

    pub fn object(&self) -> Result<&'a Map<String, Value>> {
        self.value.as_object().ok_or_else(|| bad(&self.at, "an object", kind(self.value)))
    }

    fn field(&self, key: &str) -> Result<Option<&'a Value>> {
        Ok(self.object()?.get(key))
    }

    /// A member converted by `read`; `None` if absent, an error if of another type.
    fn typed<T>(&self, key: &str, wanted: &str, read: impl Fn(&'a Value) -> Option<T>) -> Result<Option<T>> {
        match self.field(key)? {
            None => Ok(None),
            Some(value) => read(value).map(Some).ok_or_else(|| self.bad(key, wanted, kind(value))),
        }
    }

    /// Makes an absent member an error.
    pub fn need<T>(&self, key: &str, member: Option<T>) -> Result<T> {
        member.ok_or_else(|| self.bad(key, "a value", "nothing"))
    }

    pub fn get(&self, key: &str) -> Result<Option<Json<'a>>> {
        let member = self.typed(key, "an object", |v| v.is_object().then_some(v))?;
        Ok(member.map(|value| self.inside(value, self.path(key))))
    }

    /// The elements of an array, given by its path from here; empty if absent.
    pub fn items(&self, path: &str) -> Result<Vec<Json<'a>>> {
        if let Some((key, rest)) = path.split_once('.') {
            return self.get(key)?.map_or_else(|| Ok(Vec::new()), |json| json.items(rest));
        }
        let Some(array) = self.typed(path, "an array", Value::as_array)? else { return Ok(Vec::new()) };
        let path = self.path(path);
        let item = |(i, value)| self.inside(value, format!("{path}[{i}]"));
        Ok(array.iter().enumerate().map(item).collect())
    }

    pub fn string(&self, key: &str) -> Result<Option<&'a str>> {
        self.typed(key, "a string", Value::as_str)
    }

    pub(crate) fn as_string(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| bad(&self.at, "a string", kind(self.value)))
    }

    /// The element's name, else its JSON path.
    pub fn name(&self) -> Result<String> {
        Ok(match self.string("name")? {
            Some(name) if !name.is_empty() => name.into(),
            _ => self.at.clone(),
        })
    }

    pub fn boolean(&self, key: &str, default: bool) -> Result<bool> {
        Ok(self.typed(key, "true or false", Value::as_bool)?.unwrap_or(default))
    }

    /// An integer ≥ 0; `3.0` counts as one.
    pub(crate) fn integer(&self, key: &str) -> Result<Option<u64>> {
        self.typed(key, "an integer of at least 0", whole)
    }

    /// An index into an array of the document, given by its path.
    pub fn index(&self, key: &str, array: &str) -> Result<Option<usize>> {
        self.index_below(key, self.length(array), array)
    }

    pub(crate) fn index_below(&self, key: &str, len: usize, what: &str) -> Result<Option<usize>> {
        match self.typed(key, &format!("an index into {what}"), whole)? {
            None => Ok(None),
            Some(index) if index < len as u64 => Ok(Some(index as usize)),
            Some(index) => Err(self.bad(key, format!("an index into {what}, of which there are {len}"), index)),
        }
    }

    /// An array of indices into an array of the document, given by its path; empty if absent.
    pub fn indices(&self, key: &str, what: &str) -> Result<Vec<usize>> {
        let Some(array) = self.typed(key, "an array", Value::as_array)? else { return Ok(Vec::new()) };
        let len = self.length(what);
        let element = |(i, value): (usize, &Value)| match whole(value) {
            Some(index) if index < len as u64 => Ok(index as usize),
            _ => Err(bad(
                &format!("{}[{i}]", self.path(key)),
                format!("an index into {what}, of which there are {len}"),
                shown(value),
            )),
        };
        array.iter().enumerate().map(element).collect()
    }

    /// Length of an array of the document, given by its path; 0 if there is none.
    fn length(&self, array: &str) -> usize {
        array.split('.').fold(self.root, |value, key| &value[key]).as_array().map_or(0, Vec::len)
    }

    /// Is this the index of one of the document's accessors that has no elements?
    pub(crate) fn is_empty_accessor(&self, index: usize) -> bool {
        self.root["accessors"][index]["count"] == 0
    }

    /// A number that is finite as a 32-bit float.
    pub fn number(&self, key: &str) -> Result<Option<f64>> {
        self.typed(key, "a number", finite)
    }

    pub fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>> {
        let Some(array) = self.typed(key, "an array of numbers", Value::as_array)? else { return Ok(None) };
        let element = |(i, value): (usize, &Value)| {
            finite(value).ok_or_else(|| bad(&format!("{}[{i}]", self.path(key)), "a number", shown(value)))
        };
        array.iter().enumerate().map(element).collect::<Result<_>>().map(Some)
    }

    pub fn vector<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>> {
        let Some(numbers) = self.numbers(key)? else { return Ok(None) };
        let len = numbers.len();
        let wanted = || self.bad(key, format!("{N} numbers"), format!("{len}"));
        <[f64; N]>::try_from(numbers).map(Some).map_err(|_| wanted())
    }

    pub fn extension(&self, name: &str) -> Result<Option<Json<'a>>> {
        self.get("extensions")?.map_or(Ok(None), |extensions| extensions.get(name))
    }

    pub(crate) fn extension_names(&self) -> Result<Vec<String>> {
        let extensions = self.get("extensions")?;
        Ok(extensions.iter().flat_map(|json| json.value.as_object()).flatten().map(|(name, _)| name.clone()).collect())
    }

    /// Visits every extension in this value, except in `extras`, with the path of its `extensions` object. Recursion depth is
    /// bounded by the JSON parser's limit.
    /// Errors: An `extensions` member, or an extension, that is not an object.
    pub(crate) fn each_extension(&self, seen: &mut impl FnMut(&str, &str)) -> Result<()> {
        let holds_more = |value: &Value| value.is_object() || value.is_array();
        if let Value::Array(items) = self.value {
            for (i, value) in items.iter().enumerate().filter(|(_, value)| holds_more(value)) {
                self.inside(value, format!("{}[{i}]", self.at)).each_extension(seen)?;
            }
        }
        for (key, value) in self.value.as_object().into_iter().flatten().filter(|(key, _)| *key != "extras") {
            if key != "extensions" && !holds_more(value) {
                continue;
            }
            let member = self.inside(value, self.path(key));
            if key == "extensions" {
                for (name, extension) in member.object()? {
                    if !extension.is_object() {
                        return Err(member.bad(name, "an object", kind(extension)));
                    }
                    seen(name, &member.at);
                }
            }
            member.each_extension(seen)?;
        }
        Ok(())
    }
}

fn finite(value: &Value) -> Option<f64> {
    value.as_f64().filter(|x| (*x as f32).is_finite())
}

fn whole(value: &Value) -> Option<u64> {
    const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53
    value.as_u64().or_else(|| value.as_f64().filter(|x| x.fract() == 0.0 && (0.0..EXACT).contains(x)).map(|x| x as u64))
}

fn kind(value: &Value) -> String {
    match value {
        Value::Array(_) => "an array".into(),
        Value::Object(_) => "an object".into(),
        other => shown(other),
    }
}

pub fn shown(value: &Value) -> String {
    const LONGEST: usize = 40;
    let text = match value {
        Value::Array(_) | Value::Object(_) => return kind(value),
        other => other.to_string(),
    };
    if text.chars().count() <= LONGEST { text } else { text.chars().take(LONGEST).chain(['…']).collect() }
}

/// A text in `extras`, which may be anything: what is no text, or empty, is `None`.
pub fn extra(json: &Json, name: &str) -> Option<Arc<str>> {
    let text = json.value().get("extras")?.get(name)?.as_str()?;
    (!text.is_empty()).then(|| text.into())
}
