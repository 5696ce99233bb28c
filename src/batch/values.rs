//! Values of a batch file's tables, converted to values of command line flags.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::job::Location;

/// Kind of a flag in a batch file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flag {
    Value,
    /// Several values with this separator; a list in the file.
    List(char),
    /// The path of a file.
    File,
    /// The path of a file that is read; in a matrix it may have wildcards.
    Input,
    /// A switch: given or not.
    Switch,
    Choice,
    /// A boolean value, which stands for on or off, or a word.
    Mode,
}

/// Result with an error of the file, and where it is.
pub type FileResult<T> = std::result::Result<T, (Location, String)>;

/// A batch file that is being read.
pub struct Reader<'a> {
    pub text: &'a str,
    /// Bytes at which the lines begin.
    pub lines: Vec<usize>,
    pub folder: &'a Path,
    pub flags: &'a HashMap<String, Flag>,
}

/// A key of a table, with its values.
#[derive(Debug, Clone)]
pub struct Setting {
    pub key: String,
    /// Several in a matrix. For switches, `None` is on and `Some("")` off.
    pub values: Vec<Option<String>>,
    /// Whether the values are a list (or wildcards) of a matrix.
    pub listed: bool,
    /// Where its key is in the file.
    pub location: Location,
}

/// A table's entries in the order of the file.
pub fn sorted<'a, 'b>(table: &'a DeTable<'b>) -> Vec<(&'a Spanned<Cow<'b, str>>, &'a Spanned<DeValue<'b>>)> {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    entries
}

/// The keys of a table. With `several`, as in a matrix, a list holds alternatives.
/// Errors: A value that the flag does not take.
pub fn settings(reader: &Reader, table: &DeTable, several: bool) -> FileResult<Vec<Setting>> {
    sorted(table).into_iter().map(|(key, value)| setting(reader, key, value, several)).collect()
}

fn setting(reader: &Reader, key: &Spanned<Cow<str>>, value: &Spanned<DeValue>, several: bool) -> FileResult<Setting> {
    let name = key.get_ref().to_string();
    let wrong = |why: String| Err((reader.location(value.span()), why));
    let kind = match (name.as_str(), reader.flags.get(&name)) {
        ("name", _) => Flag::Value,
        ("scene", _) => Flag::Input,
        (_, Some(kind)) => *kind,
        _ => {
            let mut known: Vec<_> = reader.flags.keys().map(String::as_str).collect();
            known.extend(["name", "scene"]);
            known.sort_unstable();
            let why = format!("there is no key `{name}`; there are {}", known.join(", "));
            return Err((reader.location(key.span()), why));
        }
    };
    let one = |item| one(reader, &name, kind, item);
    let (values, listed) = match value.get_ref() {
        DeValue::Array(items) if items.is_empty() => return wrong(format!("`{name}` is an empty list")),
        DeValue::Array(items) if several => {
            if let Flag::List(_) = kind
                && matches!(items[0].get_ref(), DeValue::Integer(_))
            {
                let written = reader.text.get(value.span()).unwrap_or_default();
                return wrong(format!(
                    "a list in a [[matrix]] is a list of alternatives: write `{name}` = [{written}]"
                ));
            }
            (items.iter().map(one).collect::<FileResult<Vec<_>>>()?.concat(), true)
        }
        DeValue::Array(_) if !matches!(kind, Flag::List(_)) => {
            return wrong(format!("`{name}` is a list; only a [[matrix]] has lists"));
        }
        _ => {
            let values = one(value)?;
            let many = kind == Flag::Input && values.iter().flatten().any(|file| Some(file.as_str()) != text(value));
            if many && !several {
                return wrong(format!("`{name}` has wildcards, which only a [[matrix]] may have"));
            }
            (values, many)
        }
    };
    Ok(Setting { key: name, values, listed, location: reader.location(key.span()) })
}

fn text<'a>(value: &'a Spanned<DeValue>) -> Option<&'a str> {
    if let DeValue::String(text) = value.get_ref() { Some(text) } else { None }
}

/// A value of a flag; several for wildcards.
fn one(reader: &Reader, name: &str, kind: Flag, value: &Spanned<DeValue>) -> FileResult<Vec<Option<String>>> {
    let wrong = |why: String| (reader.location(value.span()), why);
    let control = |text: &str| wrong(format!("`{name}` holds a control character: {text:?}"));
    match (kind, value.get_ref()) {
        (_, DeValue::String(text)) if text.contains(char::is_control) => Err(control(text)),
        (Flag::List(between), DeValue::Array(items)) if !items.is_empty() => {
            let items: FileResult<Vec<_>> = items.iter().map(|item| one(reader, name, Flag::Value, item)).collect();
            let items: Vec<_> = items?.into_iter().flatten().flatten().collect();
            Ok(vec![Some(items.join(&between.to_string()))])
        }
        (Flag::Input, DeValue::String(pattern)) => {
            let files = files(reader.folder, pattern).map_err(|why| wrong(format!("`{name}`: {why}")))?;
            // Files that wildcards find may have control characters in their names.
            let fine =
                |file: String| if file.contains(char::is_control) { Err(control(&file)) } else { Ok(Some(file)) };
            files.into_iter().map(fine).collect()
        }
        _ => scalar(reader, name, kind, value).map(|value| vec![value]),
    }
}

/// A value that is no list, without control characters.
fn scalar(reader: &Reader, name: &str, kind: Flag, value: &Spanned<DeValue>) -> FileResult<Option<String>> {
    let wanted = |what: &str| Err((reader.location(value.span()), format!("`{name}` takes {what}")));
    match (kind, value.get_ref()) {
        (Flag::Switch, DeValue::Boolean(true)) => Ok(None),
        (Flag::Switch, DeValue::Boolean(false)) => Ok(Some(String::new())),
        (Flag::Choice, DeValue::Boolean(choice)) => Ok(Some(choice.to_string())),
        (Flag::Mode, DeValue::Boolean(on)) => Ok(Some(if *on { "on" } else { "off" }.to_owned())),
        (Flag::Mode, DeValue::String(word)) => Ok(Some(word.to_string())),
        (Flag::Switch | Flag::Choice, _) => wanted("true or false"),
        (Flag::Mode, _) => wanted("true, false or a word in quotes"),
        (_, DeValue::String(text)) => Ok(Some(text.to_string())),
        (Flag::Value | Flag::List(_), DeValue::Integer(_) | DeValue::Float(_)) => {
            // The text as written, so that 1e-3 stays 1e-3.
            Ok(reader.text.get(value.span()).map(|t| t.replace('_', "")))
        }
        (Flag::File | Flag::Input, _) => wanted("a file name in quotes"),
        _ => wanted("a number or text in quotes"),
    }
}

/// Expands the wildcards `*`, `?` and `[…]` of a file name, in alphabetical order, relative to `folder`. A name without
/// wildcards, or of an existing file, stays as it is.
fn files(folder: &Path, pattern: &str) -> Result<Vec<String>, String> {
    if !pattern.contains(['*', '?', '[']) || folder.join(pattern).exists() {
        return Ok(vec![pattern.to_owned()]);
    }
    let here = glob::Pattern::escape(&folder.to_string_lossy());
    let all = Path::new(&here).join(pattern);
    let found = glob::glob(&all.to_string_lossy()).map_err(|e| format!("invalid wildcards: {}", e.msg))?;
    let relative = |file: PathBuf| file.strip_prefix(folder).unwrap_or(&file).to_string_lossy().into_owned();
    let files: Vec<_> = found.filter_map(Result::ok).map(relative).collect();
    if files.is_empty() { Err(format!("no file is called '{pattern}'")) } else { Ok(files) }
}
