//! The batch file: TOML with `[defaults]`, `[[job]]` and `[[matrix]]` (docs/batch.md), expanded into jobs.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use toml::de::{DeTable, DeValue};

use super::frames::{split, with_place};
use super::values::{Setting, settings, sorted};
use crate::{Error, Result};

/// One render, or one of each of its `frames`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Job {
    /// Unique in its file.
    pub name: String,
    /// The scene, relative to the folder of the file resolved.
    #[serde(with = "any_name")]
    pub scene: PathBuf,
    /// Flags of `bismar render`, without dashes; `None` for switches. Paths are resolved.
    pub flags: Vec<(String, Option<String>)>,
    /// Where the picture goes.
    #[serde(with = "any_name")]
    pub output: PathBuf,
    /// Where it stands in the file.
    #[serde(skip)]
    pub at: Place,
}

/// Paths that need not be UTF-8.
mod any_name {
    use std::ffi::OsString;
    use std::path::{Path, PathBuf};

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
        path.as_os_str().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<PathBuf, D::Error> {
        Ok(OsString::deserialize(from)?.into())
    }
}

/// Line and column in the file, from 1, and those of each of a job's keys.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Place {
    line: usize,
    column: usize,
    keys: HashMap<String, (usize, usize)>,
}

/// A flag that may stand in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flag {
    /// Takes a value.
    Value,
    /// Takes several, with this between them; a list in the file.
    List(char),
    /// Takes the name of a file.
    File,
    /// Takes the name of a file that is read: in a matrix, wildcards stand for all there are.
    Input,
    /// Is there or not.
    Switch,
    /// Is true or false.
    Choice,
}

/// More jobs in one file are taken for a mistake.
const MOST_JOBS: usize = 100_000;

impl Job {
    /// The job's flags as arguments: `--name=value`, `--name`.
    pub fn arguments(&self) -> Vec<String> {
        let flag = |(name, value): &(String, Option<String>)| match value {
            Some(value) => format!("--{name}={value}"),
            None => format!("--{name}"),
        };
        self.flags.iter().map(flag).collect()
    }
}

impl Place {
    /// `file:line:column` of a key, or of the whole job.
    pub fn of(&self, file: &Path, key: Option<&str>) -> String {
        let own = key.and_then(|key| self.keys.get(key)).copied();
        let (line, column) = own.unwrap_or((self.line, self.column));
        format!("{}:{line}:{column}", file.display())
    }
}

/// Reads a batch file; `flags` are what may stand in it.
///
/// # Errors
/// [`Error::Config`] with line and column; [`Error::reading`].
pub fn read(path: &Path, flags: &HashMap<String, Flag>) -> Result<Vec<Job>> {
    let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => Error::Config(format!("{}: is not UTF-8 text", path.display())),
        _ => Error::reading(path, &e),
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&text, folder, flags).map_err(|(at, why)| {
        let (line, column) = position(&text, at);
        Error::Config(format!("{}:{line}:{column}: {why}", path.display()))
    })
}

/// An error: byte of the text, and what is wrong there.
pub(super) type At<T> = std::result::Result<T, (usize, String)>;

pub(super) fn position(text: &str, byte: usize) -> (usize, usize) {
    let before = text.get(..byte).unwrap_or(text);
    let line = before.rfind('\n').map_or(before, |at| &before[at + 1..]);
    (before.matches('\n').count() + 1, line.chars().count() + 1)
}

fn parse(text: &str, folder: &Path, flags: &HashMap<String, Flag>) -> At<Vec<Job>> {
    let table = DeTable::parse(text)
        .map_err(|e| (e.span().map_or(0, |s| s.start), e.message().trim_end().replace('\n', "; ")))?;
    let reader = Reader { text, folder, flags };
    let mut defaults = Vec::new();
    let mut groups = Vec::new();
    for (key, value) in sorted(table.get_ref()) {
        match key.get_ref().as_ref() {
            "defaults" => {
                let DeValue::Table(table) = value.get_ref() else {
                    return Err((value.span().start, "wanted a table: [defaults]".into()));
                };
                defaults = settings(&reader, table, false)?;
                if let Some(found) = defaults.iter().find(|s| s.key == "name") {
                    return Err((reader.byte(found.place), "a name belongs to one job or matrix".into()));
                }
            }
            kind @ ("job" | "matrix") => {
                let DeValue::Array(tables) = value.get_ref() else {
                    return Err((value.span().start, format!("wanted an array of tables: [[{kind}]]")));
                };
                for table in tables {
                    let DeValue::Table(own) = table.get_ref() else {
                        return Err((table.span().start, format!("wanted a table: [[{kind}]]")));
                    };
                    groups.push((table.span(), settings(&reader, own, kind == "matrix")?));
                }
            }
            other => {
                let why = format!("there is no `{other}`; there are [defaults], [[job]] and [[matrix]]");
                return Err((key.span().start, why));
            }
        }
    }
    // Jobs first and matrices second would be the order of the keys: this is that of the file.
    groups.sort_by_key(|(span, _)| span.start);
    let mut jobs: Vec<Job> = Vec::new();
    for (span, own) in groups {
        reader.expand(span, &defaults, own, &mut jobs)?;
    }
    let mut all = Vec::new();
    for job in &jobs {
        let frames = split(job.clone()).map_err(|(key, why)| {
            let place = job.at.keys.get(&key).copied().unwrap_or((job.at.line, job.at.column));
            (reader.byte(place), why)
        })?;
        all.extend(frames);
        if all.len() > MOST_JOBS {
            let place = (job.at.line, job.at.column);
            return Err((reader.byte(place), format!("with its frames this makes more than {MOST_JOBS} jobs")));
        }
    }
    reader.check_unique(&all)?;
    if jobs.is_empty() {
        return Err((0, "holds no jobs; write [[job]] or [[matrix]]".into()));
    }
    Ok(jobs)
}

/// What values are read with.
pub(super) struct Reader<'a> {
    pub text: &'a str,
    pub folder: &'a Path,
    pub flags: &'a HashMap<String, Flag>,
}

impl Reader<'_> {
    fn byte(&self, (line, column): (usize, usize)) -> usize {
        let start: usize = self.text.split_inclusive('\n').take(line - 1).map(str::len).sum();
        start + self.text[start..].chars().take(column - 1).map(char::len_utf8).sum::<usize>()
    }

    /// All combinations of a group's values, defaults behind them.
    fn expand(&self, span: Range<usize>, defaults: &[Setting], own: Vec<Setting>, jobs: &mut Vec<Job>) -> At<()> {
        let mut settings: Vec<Setting> =
            defaults.iter().filter(|d| own.iter().all(|o| o.key != d.key)).cloned().collect();
        settings.extend(own);
        let count = settings.iter().try_fold(1_usize, |n, s| n.checked_mul(s.values.len()));
        let Some(count) = count.filter(|n| n + jobs.len() <= MOST_JOBS) else {
            return Err((span.start, format!("this makes more than {MOST_JOBS} jobs")));
        };
        for number in 0..count {
            // The last key's values change fastest.
            let mut rest = number;
            let mut chosen: Vec<Option<String>> = vec![None; settings.len()];
            for (slot, setting) in chosen.iter_mut().zip(&settings).rev() {
                slot.clone_from(&setting.values[rest % setting.values.len()]);
                rest /= setting.values.len();
            }
            jobs.push(self.job(&span, &settings, &chosen)?);
        }
        Ok(())
    }

    fn job(&self, span: &Range<usize>, settings: &[Setting], chosen: &[Option<String>]) -> At<Job> {
        let of = |key: &str| settings.iter().zip(chosen).find(|(s, _)| s.key == key).and_then(|(_, v)| v.clone());
        let Some(scene) = of("scene") else {
            return Err((span.start, "this has no `scene`, and neither have the defaults".into()));
        };
        let kind = |key: &str| if key == "scene" { Some(Flag::Input) } else { self.flags.get(key).copied() };
        let shown = |key: &str, value: &Option<String>| match (kind(key), value) {
            (Some(Flag::Switch), value) => if value.is_none() { "on" } else { "off" }.to_owned(),
            (Some(Flag::File | Flag::Input), Some(value)) => {
                Path::new(value).file_stem().unwrap_or_default().to_string_lossy().into_owned()
            }
            (_, value) => value.clone().unwrap_or_default(),
        };
        let default_name = || {
            let listed = settings.iter().zip(chosen).filter(|(s, _)| s.listed && s.key != "scene");
            let parts = listed.map(|(s, v)| format!("-{}", shown(&s.key, v)));
            format!("{}{}", shown("scene", &Some(scene.clone())), parts.collect::<String>())
        };
        let sequence = settings.iter().any(|s| s.key == "frames");
        let fill = |key: &str, template: &str, name: Option<&str>| -> At<String> {
            let place = settings.iter().find(|s| s.key == key).map_or(span.start, |s| self.byte(s.place));
            let mut out = String::new();
            let mut rest = template;
            while let Some((before, after)) = rest.split_once('{') {
                let Some((word, after)) = after.split_once('}') else {
                    return Err((place, format!("`{key}`: a {{ without its }}")));
                };
                out += before;
                let value = settings.iter().zip(chosen).find(|(s, _)| s.key == word);
                match (word, name, value) {
                    _ if sequence && (word == "frame" || word.starts_with("frame:")) => out += &format!("{{{word}}}"),
                    ("name", Some(name), _) => out += name,
                    (_, _, Some((_, value))) if word != key && word != "name" => {
                        out += &shown(word, value).replace('/', "_");
                    }
                    _ => return Err((place, format!("`{key}`: {{{word}}} stands for nothing here"))),
                }
                rest = after;
            }
            Ok(out + rest)
        };
        let name = match of("name") {
            Some(template) => fill("name", &template, None)?,
            None => default_name(),
        };
        let name = if sequence { with_place(name) } else { name };
        if name.is_empty() || name.contains('/') || name.starts_with('.') {
            return Err((span.start, format!("'{name}' cannot be a job's name: it becomes a file's name")));
        }
        let mut flags = Vec::new();
        let mut output = self.folder.join(format!("{name}.exr"));
        for (setting, value) in settings.iter().zip(chosen) {
            let key = setting.key.as_str();
            let value = match (kind(key), value) {
                _ if key == "name" || key == "scene" => continue,
                (Some(Flag::Switch), None) => None,
                (Some(Flag::Switch), Some(_)) => continue,
                (Some(Flag::File | Flag::Input), Some(value)) => {
                    let path = self.folder.join(fill(key, value, Some(&name))?);
                    if key == "output" {
                        output = path;
                        continue;
                    }
                    let Some(path) = path.to_str() else {
                        let why = format!("`{key}`: {path:?} is not UTF-8; rename the folder");
                        return Err((self.byte(setting.place), why));
                    };
                    Some(path.to_owned())
                }
                (_, value) => value.clone(),
            };
            flags.push((key.to_owned(), value));
        }
        let (line, column) = position(self.text, span.start);
        let keys = settings.iter().map(|s| (s.key.clone(), s.place)).collect();
        Ok(Job { name, scene: self.folder.join(scene), flags, output, at: Place { line, column, keys } })
    }

    fn check_unique(&self, jobs: &[Job]) -> At<()> {
        let (mut names, mut files): (HashMap<&str, &Job>, HashMap<&str, &Job>) = Default::default();
        for job in jobs {
            let place = self.byte((job.at.line, job.at.column));
            if let Some(other) = names.insert(&job.name, job) {
                let why = format!("two jobs are called '{}' (the other is in line {})", job.name, other.at.line);
                return Err((
                    place,
                    format!("{why}; give the group a `name` with all that differs, as in \"{{scene}}-{{seed}}\""),
                ));
            }
            let written = job.flags.iter().filter(|(key, _)| key == "preview" || key == "stats");
            let written = written.filter_map(|(_, value)| value.as_deref());
            for file in written.chain(job.output.to_str()) {
                if let Some(other) = files.insert(file, job) {
                    let why = format!("'{}' and '{}' both write {file}", other.name, job.name);
                    return Err((place, format!("{why}; name outputs by the job, as in \"out/{{name}}.exr\"")));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
