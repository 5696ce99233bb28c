//! The values of a batch file's tables, as the command line has them.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::file::{At, Flag, Reader, position};

/// A key's values, and where it stands.
#[derive(Debug, Clone)]
pub struct Setting {
    pub key: String,
    /// More than one in a matrix. For switches `None` means on and `Some("")` off.
    pub values: Vec<Option<String>>,
    pub listed: bool,
    /// Line and column.
    pub place: (usize, usize),
}

/// A table's entries in the order of the file.
pub fn sorted<'a, 'b>(table: &'a DeTable<'b>) -> Vec<(&'a Spanned<Cow<'b, str>>, &'a Spanned<DeValue<'b>>)> {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    entries
}

/// A table's values; with `several`, as in a matrix, a list of them is a choice.
///
/// # Errors
/// The byte, and what is wrong there.
pub fn settings(reader: &Reader, table: &DeTable, several: bool) -> At<Vec<Setting>> {
    sorted(table).into_iter().map(|(key, value)| setting(reader, key, value, several)).collect()
}

fn setting(reader: &Reader, key: &Spanned<Cow<str>>, value: &Spanned<DeValue>, several: bool) -> At<Setting> {
    let name = key.get_ref().to_string();
    let wrong = |why: String| Err((value.span().start, why));
    let kind = match (name.as_str(), reader.flags.get(&name)) {
        ("name", _) => Flag::Value,
        ("scene", _) => Flag::Input,
        (_, Some(kind)) => *kind,
        _ => {
            let mut known: Vec<_> = reader.flags.keys().map(String::as_str).collect();
            known.extend(["name", "scene"]);
            known.sort_unstable();
            return Err((key.span().start, format!("there is no key `{name}`; there are {}", known.join(", "))));
        }
    };
    let one = |item| one(reader, &name, kind, item);
    let (values, listed) = match value.get_ref() {
        DeValue::Array(items) if items.is_empty() => return wrong(format!("`{name}` lists nothing")),
        DeValue::Array(items) if several => {
            if let Flag::List(_) = kind
                && matches!(items[0].get_ref(), DeValue::Integer(_))
            {
                let written = reader.text.get(value.span()).unwrap_or_default();
                return wrong(format!("a list in a [[matrix]] is a choice: write `{name}` = [{written}]"));
            }
            (items.iter().map(one).collect::<At<Vec<_>>>()?.concat(), true)
        }
        DeValue::Array(_) if !matches!(kind, Flag::List(_)) => {
            return wrong(format!("`{name}` is a list; only a [[matrix]] has lists"));
        }
        _ => {
            let values = one(value)?;
            let many = kind == Flag::Input && values.iter().flatten().any(|file| Some(file.as_str()) != text(value));
            if many && !several {
                return wrong(format!("`{name}` has wildcards; only a [[matrix]] has several"));
            }
            (values, many)
        }
    };
    Ok(Setting { key: name, values, listed, place: position(reader.text, key.span().start) })
}

fn text<'a>(value: &'a Spanned<DeValue>) -> Option<&'a str> {
    if let DeValue::String(text) = value.get_ref() { Some(text) } else { None }
}

/// A value as the command line has it; of wildcards, all files.
fn one(reader: &Reader, name: &str, kind: Flag, value: &Spanned<DeValue>) -> At<Vec<Option<String>>> {
    let control = |text: &str| (value.span().start, format!("`{name}` holds a control character: {text:?}"));
    match (kind, value.get_ref()) {
        (_, DeValue::String(text)) if text.contains(char::is_control) => Err(control(text)),
        (Flag::List(between), DeValue::Array(items)) if !items.is_empty() => {
            let items: At<Vec<_>> = items.iter().map(|item| scalar(reader, name, Flag::Value, item)).collect();
            let items: Vec<_> = items?.into_iter().flatten().collect();
            Ok(vec![Some(items.join(&between.to_string()))])
        }
        (Flag::Input, DeValue::String(pattern)) => {
            let files =
                files(reader.folder, pattern).map_err(|why| (value.span().start, format!("`{name}`: {why}")))?;
            // Also what wildcards find is a name.
            let fine =
                |file: String| if file.contains(char::is_control) { Err(control(&file)) } else { Ok(Some(file)) };
            files.into_iter().map(fine).collect()
        }
        _ => scalar(reader, name, kind, value).map(|value| vec![value]),
    }
}

fn scalar(reader: &Reader, name: &str, kind: Flag, value: &Spanned<DeValue>) -> At<Option<String>> {
    let wanted = |what: &str| Err((value.span().start, format!("`{name}` wants {what}")));
    match (kind, value.get_ref()) {
        (Flag::Switch, DeValue::Boolean(true)) => Ok(None),
        (Flag::Switch, DeValue::Boolean(false)) => Ok(Some(String::new())),
        (Flag::Choice, DeValue::Boolean(choice)) => Ok(Some(choice.to_string())),
        (Flag::Switch | Flag::Choice, _) => wanted("true or false"),
        (_, DeValue::String(text)) if text.contains(char::is_control) => {
            Err((value.span().start, format!("`{name}` holds a control character: {text:?}")))
        }
        (_, DeValue::String(text)) => Ok(Some(text.to_string())),
        (Flag::Value | Flag::List(_), DeValue::Integer(_) | DeValue::Float(_)) => {
            // As it is written: 1e-3 stays that.
            Ok(reader.text.get(value.span()).map(|t| t.replace('_', "")))
        }
        (Flag::File | Flag::Input, _) => wanted("the name of a file, in quotes"),
        _ => wanted("a number or text in quotes"),
    }
}

/// What a file's name with `*`, `?` or `[…]` stands for, in alphabetical order, relative to `folder` as it is; a name
/// without them, and one that a file really has, for itself.
fn files(folder: &Path, pattern: &str) -> Result<Vec<String>, String> {
    if !pattern.contains(['*', '?', '[']) || folder.join(pattern).exists() {
        return Ok(vec![pattern.to_owned()]);
    }
    let here = glob::Pattern::escape(&folder.to_string_lossy());
    let all = Path::new(&here).join(pattern);
    let found = glob::glob(&all.to_string_lossy()).map_err(|e| format!("its wildcards cannot be used: {}", e.msg))?;
    let relative = |file: PathBuf| file.strip_prefix(folder).unwrap_or(&file).to_string_lossy().into_owned();
    let files: Vec<_> = found.filter_map(Result::ok).map(relative).collect();
    if files.is_empty() { Err(format!("no file is called '{pattern}'")) } else { Ok(files) }
}
