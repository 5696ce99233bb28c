//! Objects of the document as types of the crate `gltf`, where those hold ([which do](../../../../vendor-notes.md)).

use serde::de::DeserializeOwned;
use serde_json::{Map, Number, Value};

use super::json::{Json, shown};
use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;

/// Reads an object into a type of the crate `gltf`. The crate rejects integers with a decimal point, truncates indices to 32
/// bits, and reads numbers beyond a float's range as infinity: the JSON is normalized first.
///
/// # Errors
/// [`Error::Data`] with the path of what has the wrong type.
pub fn read<T: DeserializeOwned>(json: &Json) -> Result<T> {
    json.object()?;
    let normalized = normalize(json.value(), &json.at)?;
    serde_path_to_error::deserialize(normalized).map_err(|error| {
        let inside = error.path().to_string();
        let at = if inside == "." { json.at.clone() } else { json.path(&inside) };
        complaint(&at, &error.into_inner().to_string())
    })
}

/// Whole numbers below 2^32 as integers, all others as floats that are finite in 32 bits; `extras` left out.
fn normalize(value: &Value, at: &str) -> Result<Value> {
    Ok(match value {
        Value::Null => return Err(bad(at, "a value", "null")),
        Value::Number(number) => {
            let x = number.as_f64().filter(|x| (*x as f32).is_finite());
            let x = x.ok_or_else(|| bad(at, "a number that a 32-bit float can hold", shown(value)))?;
            let whole = x.fract() == 0.0 && x.is_sign_positive() && x <= f64::from(u32::MAX);
            Value::Number(if whole { (x as u32).into() } else { Number::from_f64(x).unwrap_or_else(|| 0.into()) })
        }
        Value::Array(items) => {
            let item = |(i, item)| normalize(item, &format!("{at}[{i}]"));
            Value::Array(items.iter().enumerate().map(item).collect::<Result<_>>()?)
        }
        Value::Object(members) => {
            let members = members.iter().filter(|(key, _)| *key != "extras");
            let member = |(key, member): (&String, _)| Ok((key.clone(), normalize(member, &format!("{at}.{key}"))?));
            Value::Object(members.map(member).collect::<Result<Map<_, _>>>()?)
        }
        other => other.clone(),
    })
}

/// Translates an error of serde: "invalid type: string \"x\", expected f32", "missing field `index`".
fn complaint(at: &str, text: &str) -> Error {
    if let Some(field) = text.strip_prefix("missing field `").and_then(|rest| rest.split('`').next()) {
        return bad(&format!("{at}.{field}"), "a value", "nothing");
    }
    let (found, wanted) = text.split_once(", expected ").unwrap_or((text, "something else"));
    let found = found.trim_start_matches("invalid type: ").trim_start_matches("invalid value: ");
    let wanted = match wanted {
        "f32" => "a number",
        "u32" => "an integer of at least 0",
        "index into child of root" => "an index",
        wanted if wanted.starts_with("struct ") => "an object",
        wanted => wanted,
    };
    bad(at, wanted, found)
}
