//! Names and values of settings, for files and comparisons.

use std::collections::BTreeMap;

use serde::Serialize;

/// Named values, for comparison.
pub type Values = BTreeMap<String, String>;

/// The serialised name of a variant: that of files and of the command line.
pub(super) fn variant_name(variant: &impl Serialize) -> String {
    let name = serde_json::to_value(variant).ok();
    name.and_then(|n| n.as_str().map(str::to_owned)).unwrap_or_default()
}
