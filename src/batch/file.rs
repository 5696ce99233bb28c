//! The batch file: TOML with `[defaults]`, `[[job]]` and `[[matrix]]` (docs/batch.md), expanded into jobs.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use super::job::{Job, Location, SourceLocation};
use super::numbering::with_placeholder;
use super::split::split;
pub use super::values::Flag;
use super::values::{FileResult, Reader, Setting, settings, sorted};
use crate::film::lut::is_lut;
use crate::scene::import::read_text;
use crate::{Error, Result};

/// Most jobs of one file, frames included; more are assumed to be a mistake.
const MAX_JOBS: usize = 100_000;

/// Keys that make one job many pictures.
const SEQUENCES: [&str; 3] = ["frames", "turntable", "cameras"];

/// A job as the file has it.
#[derive(Debug, Clone)]
pub struct JobText {
    /// Name, unique in its file.
    pub name: String,
    /// Path of the scene, resolved against the file's folder.
    pub scene: PathBuf,
    /// Path of the picture, likewise.
    pub output: PathBuf,
    /// Other flags of `bismar render`, with dashes and values. Paths are resolved.
    pub flags: Vec<String>,
    /// Where it is in the file.
    pub location: SourceLocation,
}

/// Reads a batch file; `flags` are the keys that it may hold.
/// Errors: [`Error::Config`] with line and column; [`Error::reading`].
pub fn read(path: &Path, flags: &HashMap<String, Flag>) -> Result<Vec<JobText>> {
    let text = String::from_utf8(read_text(path)?);
    let text = text.map_err(|_| Error::Config(format!("{}: not UTF-8 text", path.display())))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&text, folder, flags)
        .map_err(|((line, column), why)| Error::Config(format!("{}:{line}:{column}: {why}", path.display())))
}

fn parse(text: &str, folder: &Path, flags: &HashMap<String, Flag>) -> FileResult<Vec<JobText>> {
    let reader = Reader { text, lines: lines(text), folder, flags };
    let table = DeTable::parse(text)
        .map_err(|e| (reader.location(e.span().unwrap_or_default()), e.message().trim_end().replace('\n', "; ")))?;
    let mut defaults = Vec::new();
    let mut groups = Vec::new();
    for (key, value) in sorted(table.get_ref()) {
        match key.get_ref().as_ref() {
            "defaults" => {
                let DeValue::Table(table) = value.get_ref() else {
                    return Err((reader.location(value.span()), "expected a table: [defaults]".into()));
                };
                defaults = settings(&reader, table, false)?;
                if let Some(setting) = defaults.iter().find(|s| s.key == "name") {
                    return Err((setting.location, "a name belongs to one job or matrix".into()));
                }
            }
            kind @ ("job" | "matrix") => {
                let DeValue::Array(tables) = value.get_ref() else {
                    return Err((reader.location(value.span()), format!("expected an array of tables: [[{kind}]]")));
                };
                for table in tables {
                    let DeValue::Table(entries) = table.get_ref() else {
                        return Err((reader.location(table.span()), format!("expected a table: [[{kind}]]")));
                    };
                    groups.push((reader.location(table.span()), settings(&reader, entries, kind == "matrix")?));
                }
            }
            other => {
                let why = format!("there is no `{other}`; there are [defaults], [[job]] and [[matrix]]");
                return Err((reader.location(key.span()), why));
            }
        }
    }
    // TOML groups all [[job]] before all [[matrix]]; jobs are in the order of the file.
    groups.sort_by_key(|(at, _)| *at);
    let mut jobs = Vec::new();
    for (at, own) in groups {
        reader.expand(at, &defaults, own, &mut jobs)?;
    }
    if jobs.is_empty() {
        return Err(((1, 1), "no jobs; write [[job]] or [[matrix]]".into()));
    }
    Ok(jobs)
}

/// Bytes at which the lines of a text begin.
fn lines(text: &str) -> Vec<usize> {
    [0].into_iter().chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect()
}

impl Reader<'_> {
    /// Where a range of bytes of the text begins.
    pub(super) fn location(&self, Range { start, .. }: Range<usize>) -> Location {
        let line = self.lines.partition_point(|line| *line <= start);
        let before = self.text.get(self.lines[line - 1]..start).unwrap_or_default();
        (line, before.chars().count() + 1)
    }

    /// Adds a job for every combination of a group's values; the group's keys override the defaults.
    fn expand(&self, at: Location, defaults: &[Setting], own: Vec<Setting>, jobs: &mut Vec<JobText>) -> FileResult<()> {
        let mut settings: Vec<Setting> =
            defaults.iter().filter(|d| own.iter().all(|o| o.key != d.key)).cloned().collect();
        settings.extend(own);
        let count = settings.iter().try_fold(1_usize, |n, s| n.checked_mul(s.values.len()));
        let Some(count) = count.filter(|n| n + jobs.len() <= MAX_JOBS) else {
            return Err((at, format!("this makes more than {MAX_JOBS} jobs")));
        };
        for number in 0..count {
            // The last key varies fastest.
            let mut rest = number;
            let mut chosen: Vec<Option<String>> = vec![None; settings.len()];
            for (slot, setting) in chosen.iter_mut().zip(&settings).rev() {
                slot.clone_from(&setting.values[rest % setting.values.len()]);
                rest /= setting.values.len();
            }
            jobs.push(self.job(at, &settings, &chosen)?);
        }
        Ok(())
    }

    fn job(&self, at: Location, settings: &[Setting], chosen: &[Option<String>]) -> FileResult<JobText> {
        let value_of = |key: &str| settings.iter().zip(chosen).find(|(s, _)| s.key == key).and_then(|(_, v)| v.clone());
        let Some(scene) = value_of("scene") else {
            return Err((at, "no `scene`, neither here nor in [defaults]".into()));
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
        let sequence = settings.iter().any(|s| SEQUENCES.contains(&s.key.as_str()));
        let fill = |key: &str, template: &str, name: Option<&str>| -> FileResult<String> {
            let at = settings.iter().find(|s| s.key == key).map_or(at, |s| s.location);
            let mut out = String::new();
            let mut rest = template;
            while let Some((before, after)) = rest.split_once('{') {
                let Some((word, after)) = after.split_once('}') else {
                    return Err((at, format!("`{key}`: {{ without }}")));
                };
                out += before;
                let value = settings.iter().zip(chosen).find(|(s, _)| s.key == word);
                match (word, name, value) {
                    _ if sequence && (word == "frame" || word.starts_with("frame:")) => out += &format!("{{{word}}}"),
                    ("name", Some(name), _) => out += name,
                    (_, _, Some((_, value))) if word != key && word != "name" => {
                        out += &shown(word, value).replace('/', "_");
                    }
                    _ => return Err((at, format!("`{key}`: {{{word}}} is not a key of this job"))),
                }
                rest = after;
            }
            Ok(out + rest)
        };
        let name = match value_of("name") {
            Some(template) => fill("name", &template, None)?,
            None => default_name(),
        };
        let name = if sequence { with_placeholder(name) } else { name };
        if name.is_empty() || name.contains('/') || name.starts_with('.') {
            return Err((at, format!("'{name}' cannot be a job's name, because it becomes a file name")));
        }
        let mut flags = Vec::new();
        let mut output = self.folder.join(format!("{name}.exr"));
        for (setting, value) in settings.iter().zip(chosen) {
            let key = setting.key.as_str();
            let value = match (kind(key), value) {
                _ if key == "name" || key == "scene" => continue,
                (Some(Flag::Switch), None) => None,
                (Some(Flag::Switch), Some(_)) => continue,
                (of, Some(value)) if matches!(of, Some(Flag::File | Flag::Input)) || key == "view" && is_lut(value) => {
                    let path = self.folder.join(fill(key, value, Some(&name))?);
                    if key == "output" {
                        output = path;
                        continue;
                    }
                    let Some(path) = path.to_str() else {
                        let why = format!("`{key}`: {path:?} is not UTF-8; rename the folder");
                        return Err((setting.location, why));
                    };
                    Some(path.to_owned())
                }
                (_, value) => value.clone(),
            };
            flags.push(value.map_or(format!("--{key}"), |value| format!("--{key}={value}")));
        }
        let keys = settings.iter().map(|s| (s.key.clone(), s.location)).collect();
        let location = SourceLocation { at, keys };
        Ok(JobText { name, scene: self.folder.join(scene), output, flags, location })
    }
}

/// Splits sequences into one job per picture. No two have one name, or write one file.
pub(crate) fn split_all(jobs: &[Job]) -> FileResult<Vec<Job>> {
    let mut all = Vec::new();
    for job in jobs {
        all.extend(split(job).map_err(|(key, why)| (job.location.of_key(&key), why))?);
        if all.len() > MAX_JOBS {
            let why = format!("with its frames this makes more than {MAX_JOBS} jobs");
            return Err((job.location.at, why));
        }
    }
    check_unique(&all)?;
    Ok(all)
}

fn check_unique(jobs: &[Job]) -> FileResult<()> {
    let (mut names, mut files): (HashMap<&str, &Job>, HashMap<&Path, &Job>) = Default::default();
    for job in jobs {
        let at = job.location.at;
        if let Some(other) = names.insert(&job.name, job) {
            let why = format!("two jobs are called '{}' (the other is in line {})", job.name, other.location.at.0);
            let help = "give the group a `name` with every key that differs, as in \"{scene}-{seed}\"";
            return Err((at, format!("{why}; {help}")));
        }
        for file in job.request.outputs() {
            if let Some(other) = files.insert(file, job) {
                let file = file.display();
                let why = format!("'{}' and '{}' both write {file}", other.name, job.name);
                return Err((at, format!("{why}; put the job's name into outputs, as in \"out/{{name}}.exr\"")));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
