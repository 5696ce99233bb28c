//! The batch file: TOML with `[defaults]`, `[[job]]` and `[[matrix]]` (docs/batch.md), expanded into jobs.

use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

use toml::de::{DeTable, DeValue};

use super::frames::split;
use super::job::{Job, SourceLocation};
use super::numbering::with_placeholder;
pub use super::values::Flag;
use super::values::{FileResult, Reader, Setting, position, settings, sorted};
use super::views::SPLITTING;
use crate::film::lut::is_lut;
use crate::scene::import::read_text;
use crate::{Error, Result};

/// Most jobs of one file, frames included; more are assumed to be a mistake.
const MAX_JOBS: usize = 100_000;

/// Reads a batch file; `flags` are the keys that it may hold.
///
/// # Errors
/// [`Error::Config`] with line and column; [`Error::reading`].
pub fn read(path: &Path, flags: &HashMap<String, Flag>) -> Result<Vec<Job>> {
    let text = String::from_utf8(read_text(path)?);
    let text = text.map_err(|_| Error::Config(format!("{}: not UTF-8 text", path.display())))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&text, folder, flags).map_err(|(at, why)| {
        let (line, column) = position(&text, at);
        Error::Config(format!("{}:{line}:{column}: {why}", path.display()))
    })
}

fn parse(text: &str, folder: &Path, flags: &HashMap<String, Flag>) -> FileResult<Vec<Job>> {
    let table = DeTable::parse(text)
        .map_err(|e| (e.span().map_or(0, |s| s.start), e.message().trim_end().replace('\n', "; ")))?;
    let reader = Reader { text, lines: lines(text), folder, flags };
    let mut defaults = Vec::new();
    let mut groups = Vec::new();
    for (key, value) in sorted(table.get_ref()) {
        match key.get_ref().as_ref() {
            "defaults" => {
                let DeValue::Table(table) = value.get_ref() else {
                    return Err((value.span().start, "expected a table: [defaults]".into()));
                };
                defaults = settings(&reader, table, false)?;
                if let Some(setting) = defaults.iter().find(|s| s.key == "name") {
                    return Err((reader.byte(setting.location), "a name belongs to one job or matrix".into()));
                }
            }
            kind @ ("job" | "matrix") => {
                let DeValue::Array(tables) = value.get_ref() else {
                    return Err((value.span().start, format!("expected an array of tables: [[{kind}]]")));
                };
                for table in tables {
                    let DeValue::Table(entries) = table.get_ref() else {
                        return Err((table.span().start, format!("expected a table: [[{kind}]]")));
                    };
                    groups.push((table.span(), settings(&reader, entries, kind == "matrix")?));
                }
            }
            other => {
                let why = format!("there is no `{other}`; there are [defaults], [[job]] and [[matrix]]");
                return Err((key.span().start, why));
            }
        }
    }
    // TOML groups all [[job]] before all [[matrix]]; jobs are in the order of the file.
    groups.sort_by_key(|(span, _)| span.start);
    let mut jobs: Vec<Job> = Vec::new();
    for (span, own) in groups {
        reader.expand(span, &defaults, own, &mut jobs)?;
    }
    let mut all = Vec::new();
    for job in &jobs {
        let frames = split(job.clone()).map_err(|(key, why)| (reader.byte(job.location.of_key(Some(&key))), why))?;
        all.extend(frames);
        if all.len() > MAX_JOBS {
            let at = reader.byte(job.location.of_key(None));
            return Err((at, format!("with its frames this makes more than {MAX_JOBS} jobs")));
        }
    }
    reader.check_unique(&all)?;
    if jobs.is_empty() {
        return Err((0, "no jobs; write [[job]] or [[matrix]]".into()));
    }
    Ok(jobs)
}

/// Bytes at which the lines of a text begin.
fn lines(text: &str) -> Vec<usize> {
    [0].into_iter().chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect()
}

impl Reader<'_> {
    /// Line and column of a byte of the text, as [`position`].
    pub(super) fn position(&self, byte: usize) -> (usize, usize) {
        let line = self.lines.partition_point(|start| *start <= byte);
        let before = self.text.get(self.lines[line - 1]..byte).unwrap_or_default();
        (line, before.chars().count() + 1)
    }

    /// Byte of the text at a line and column.
    fn byte(&self, (line, column): (usize, usize)) -> usize {
        let start = self.lines[line - 1];
        start + self.text[start..].chars().take(column - 1).map(char::len_utf8).sum::<usize>()
    }

    /// Adds a job for every combination of a group's values; the group's keys override the defaults.
    fn expand(
        &self,
        span: Range<usize>,
        defaults: &[Setting],
        own: Vec<Setting>,
        jobs: &mut Vec<Job>,
    ) -> FileResult<()> {
        let mut settings: Vec<Setting> =
            defaults.iter().filter(|d| own.iter().all(|o| o.key != d.key)).cloned().collect();
        settings.extend(own);
        let count = settings.iter().try_fold(1_usize, |n, s| n.checked_mul(s.values.len()));
        let Some(count) = count.filter(|n| n + jobs.len() <= MAX_JOBS) else {
            return Err((span.start, format!("this makes more than {MAX_JOBS} jobs")));
        };
        for number in 0..count {
            // The last key varies fastest.
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

    fn job(&self, span: &Range<usize>, settings: &[Setting], chosen: &[Option<String>]) -> FileResult<Job> {
        let value_of = |key: &str| settings.iter().zip(chosen).find(|(s, _)| s.key == key).and_then(|(_, v)| v.clone());
        let Some(scene) = value_of("scene") else {
            return Err((span.start, "no `scene`, neither here nor in [defaults]".into()));
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
        let sequence = settings.iter().any(|s| s.key == "frames" || SPLITTING.contains(&s.key.as_str()));
        let fill = |key: &str, template: &str, name: Option<&str>| -> FileResult<String> {
            let at = settings.iter().find(|s| s.key == key).map_or(span.start, |s| self.byte(s.location));
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
            return Err((span.start, format!("'{name}' cannot be a job's name, because it becomes a file name")));
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
                        return Err((self.byte(setting.location), why));
                    };
                    Some(path.to_owned())
                }
                (_, value) => value.clone(),
            };
            flags.push((key.to_owned(), value));
        }
        let (line, column) = self.position(span.start);
        let keys = settings.iter().map(|s| (s.key.clone(), s.location)).collect();
        let location = SourceLocation { line, column, keys };
        Ok(Job { name, scene: self.folder.join(scene), flags, output, location, is_view: false })
    }

    fn check_unique(&self, jobs: &[Job]) -> FileResult<()> {
        let (mut names, mut files): (HashMap<&str, &Job>, HashMap<&str, &Job>) = Default::default();
        for job in jobs {
            let at = || self.byte(job.location.of_key(None));
            if let Some(other) = names.insert(&job.name, job) {
                let why = format!("two jobs are called '{}' (the other is in line {})", job.name, other.location.line);
                return Err((
                    at(),
                    format!("{why}; give the group a `name` with every key that differs, as in \"{{scene}}-{{seed}}\""),
                ));
            }
            let written = job.flags.iter().filter(|(key, _)| key == "preview" || key == "stats");
            let written = written.filter_map(|(_, value)| value.as_deref());
            for file in written.chain(job.output.to_str()) {
                if let Some(other) = files.insert(file, job) {
                    let why = format!("'{}' and '{}' both write {file}", other.name, job.name);
                    return Err((at(), format!("{why}; put the job's name into outputs, as in \"out/{{name}}.exr\"")));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
