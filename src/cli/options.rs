//! Options as data: keywords and values, as callers of other languages give them. Also endings of file names.

use std::any::TypeId;
use std::ffi::{OsStr, OsString};
use std::path::Path;

use clap::{Arg, Args, Command};
use serde::Deserialize;
use serde_json::{Map, Value};

use crate::film::preview;
use crate::{Error, Result};

/// Options of a command: values by names of flags, with or without dashes in them. Numbers, texts and lists are what flags take;
/// true and false switches, and on and off where a flag takes these. Null is as if the option was not there.
pub type Options = Map<String, Value>;

/// Parses options as the command line does.
/// Errors: [`Error::Usage`], with the option's name.
pub fn parse<T: Args>(name: &'static str, options: &Options, inputs: &[impl AsRef<OsStr>]) -> Result<T> {
    let command = T::augment_args(Command::new(name));
    let mut line = vec![name.into()];
    for (key, value) in options {
        let known = |arg: &&Arg| {
            let names = arg.get_long().into_iter().chain(arg.get_all_aliases().unwrap_or_default());
            names.into_iter().any(|name| name == key.replace('_', "-"))
        };
        let arg =
            command.get_arguments().find(known).ok_or_else(|| Error::Usage(format!("there is no option {key}")))?;
        let mut flag = OsString::from(format!("--{}", arg.get_long().unwrap_or_default()));
        let takes_value = arg.get_action().takes_values();
        match (text(arg, value).ok_or_else(|| Error::Usage(format!("{key}: {value} cannot be used")))?, takes_value) {
            (None, _) => continue,
            (Some(_), false) => {}
            (Some(text), true) => {
                flag.push("=");
                flag.push(text);
            }
        }
        line.push(flag);
    }
    line.push("--".into());
    line.extend(inputs.iter().map(|path| path.as_ref().to_owned()));
    let parsed = command.try_get_matches_from(line).and_then(|matches| T::from_arg_matches(&matches));
    parsed.map_err(|e| Error::Usage(reason(&e)))
}

/// The value of a flag; none for a switch that is off, and for an option that is not given.
fn text(arg: &Arg, value: &Value) -> Option<Option<OsString>> {
    let choices = arg.get_possible_values();
    let separator = if arg.get_value_names().is_some_and(|names| names[0] == "WxH") { "x" } else { "," };
    Some(Some(match value {
        Value::Null => return Some(None),
        Value::Bool(on) if !arg.get_action().takes_values() || choices.len() == 1 => {
            return Some(on.then(|| choices.first().map_or("", |only| only.get_name()).into()));
        }
        Value::Bool(on) if arg.get_value_parser().type_id() == TypeId::of::<bool>() => on.to_string().into(),
        Value::Bool(on) => if *on { "on" } else { "off" }.into(),
        Value::Number(number) => number.to_string().into(),
        Value::String(text) => text.into(),
        Value::Array(items) if items.is_empty() => "none".into(),
        Value::Array(items) => {
            let items = items.iter().map(|item| text(arg, item)?).collect::<Option<Vec<_>>>()?;
            items.join(OsStr::new(separator))
        }
        // A text that is not UTF-8, by its bytes.
        Value::Object(_) => OsString::deserialize(value).ok()?,
    }))
}

/// A text with names of flags in it, with those of keywords in their place: `--light-groups` is `light_groups`.
pub fn with_keywords(text: &str) -> String {
    let mut pieces = text.split("--");
    let mut out = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let end = piece.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(piece.len());
        if end == 0 {
            out += "--";
        }
        out += &piece[..end].replace('-', "_");
        out += &piece[end..];
    }
    out
}

/// The first lines of clap's error, which say why.
pub(super) fn reason(error: &clap::Error) -> String {
    let text = error.to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    text.split("\n\n").next().unwrap_or(text).trim_end().to_owned()
}

/// Has a path one of these endings, in any case?
pub(super) fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|own| endings.iter().any(|ending| own.eq_ignore_ascii_case(ending)))
}

/// Fails for a path without one of these endings. Devices have none and are allowed, for benchmarks.
pub(super) fn check_ending(flag: &str, path: &Path, endings: &[&str]) -> Result<()> {
    if has_ending(path, endings) || path.starts_with("/dev") {
        return Ok(());
    }
    let hint = match (flag, preview::has_ending(path)) {
        ("-o", true) => {
            let exr = path.with_extension("exr");
            format!(": -o {} --preview {} writes both", exr.display(), path.display())
        }
        _ => String::new(),
    };
    // .png, .jpg or .webp
    let shown: Vec<_> = endings.iter().filter(|ending| **ending != "jpeg").copied().collect();
    let mut list = shown.join(", .");
    if let Some(last) = list.rfind(", ") {
        list.replace_range(last..last + 2, " or ");
    }
    Err(Error::Usage(format!("{flag} {}: the name must end in .{list}{hint}", path.display())))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::job::RenderRequest;

    #[test]
    fn options_are_those_of_the_command_line() {
        let of = |options: Value| {
            let Value::Object(options) = options else { panic!() };
            parse::<RenderRequest>("render", &options, &[] as &[&str])
                .map(|request| request.arguments().unwrap().join(" "))
        };
        for (options, line) in [
            (
                json!({"size": [64, 48], "aovs": ["depth", "uv"], "spp": 8, "noise": 1e-3}),
                "--aov=depth,uv --noise=0.001 --size=64x48 --spp=8",
            ),
            (
                json!({"scene": 0, "denoise": true, "no_clip": true, "sky": false, "crop": null}),
                "--denoise=oidn --no-clip --scene-name=0",
            ),
            (
                json!({"guiding": false, "path-reuse": true, "energy_compensation": false, "seed_per_frame": true}),
                "--energy-compensation=off --guiding=off --path-reuse=on --seed-per-frame",
            ),
            (json!({"path_reuse": "4:2", "aovs": [], "env": {"Unix": [97]}}), "--aov=none --env=a --path-reuse=4:2"),
        ] {
            assert_eq!(of(options).unwrap(), line);
        }
        for (options, why) in [
            (json!({"sppp": 1}), "there is no option sppp"),
            (json!({"spp": true}), "invalid value 'on' for '--spp"),
            (json!({"spp": {"a": 1}}), "spp: {\"a\":1} cannot be used"),
            (json!({"crop": [1, 2]}), "--crop"),
        ] {
            let refused = of(options).unwrap_err().to_string();
            assert!(refused.contains(why), "{refused}");
        }
        assert_eq!(with_keywords("'--light-groups <A>' -- b--c"), "'light_groups <A>' -- bc");
    }
}
