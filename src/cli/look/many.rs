//! One scene, or any number of scenes side by side, each in its own framing and exposure.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::args::LookArgs;
use super::contents::decimal;
use super::direction::Direction;
use super::folders::verdict;
use super::looked::{Looked, SCHEMA};
use super::sheet::{Cell, Sheet};
use super::shots::{Shot, Subject, exposure_of, hash_of};
use crate::console::{Paths, Verdict};
use crate::{Error, Result};

/// A scene that was looked at.
struct One {
    /// What is in it, in a line.
    contents: String,
    columns: usize,
    cells: Vec<Cell>,
    shots: Vec<Shot>,
    report: Value,
    lines: Vec<String>,
}

impl One {
    /// `views` are those of its bounds if there are none.
    fn look(args: &LookArgs, scene: &Path, views: &[Direction], paths: &mut Paths, stop: &AtomicBool) -> Result<Self> {
        let mut subject = Subject::open(args, scene, paths)?;
        let views = if views.is_empty() { args.views(subject.contents.bounds.as_ref()) } else { views.to_vec() };
        let shots = subject.shots(&views, args.frames.as_ref(), subject.sphere, stop)?;
        let exposure = exposure_of(shots.iter());
        let contents = subject.contents.line();
        let columns = if args.frames.is_some() { views.len() } else { (views.len() as f64).sqrt().ceil() as usize };
        let cells = shots.iter().map(|shot| (shot.label(), shot.developed(exposure))).collect();
        let views: Vec<_> = shots.iter().map(|shot| shot.report(exposure)).collect();
        let report = json!({ "hash": hash_of(&shots), "exposure": decimal(exposure), "views": views,
            "scene": subject.contents.report()? });
        let mut lines = vec![format!("{}: {contents}", scene.display())];
        if subject.contents.bounds.is_some() && shots.iter().all(|shot| shot.shown() == 0.0) {
            lines.push(
                "the views show nothing: all surfaces face away or are transparent; try --views bottom,left".into(),
            );
        }
        Ok(Self { contents, columns, cells, shots, report, lines })
    }
}

fn name_of(scene: &Path) -> String {
    scene.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

pub fn one(args: &LookArgs, scene: &Path, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    let One { contents, columns, cells, shots, mut report, lines } = One::look(args, scene, &args.views, paths, stop)?;
    let size = [args.size.0, args.size.1];
    let sheet = Sheet::of(&[name_of(scene), contents], cells, columns, size);
    for (key, value) in [("schema", json!(SCHEMA)), ("size", json!(size)), ("spp", json!(args.spp))] {
        report[key] = value;
    }
    Ok(Looked { sheet, shots, report, lines, verdict: Verdict::Done, page: None })
}

/// Looks at three scenes or more.
/// Errors: [`Error::Interrupted`]. Errors of single scenes are in the JSON and in the lines, and decide the exit code.
pub fn look(args: &LookArgs, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    let views = if args.views.is_empty() { &[Direction::ThreeQuarters] } else { &args.views[..] };
    let (mut cells, mut shots, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    let (mut scenes, mut failed, mut codes) = (Vec::new(), Vec::new(), Vec::new());
    for scene in &args.scenes {
        // Scenes of one name in several folders are told apart.
        let is_namesake = |other: &&PathBuf| other.file_name() == scene.file_name();
        let alone = args.scenes.iter().filter(is_namesake).count() == 1;
        let name = if alone { name_of(scene) } else { scene.display().to_string() };
        match One::look(args, scene, views, paths, stop) {
            Ok(one) => {
                cells.extend(one.cells.into_iter().map(|(label, cell)| (format!("{name}: {label}"), cell)));
                shots.extend(one.shots);
                scenes.push(one.report);
                lines.extend(one.lines);
            }
            Err(error @ Error::Interrupted(_)) => return Err(error),
            Err(error) => {
                let (name, code) = (scene.display().to_string(), error.exit_code());
                lines.push(error.to_string());
                codes.push(code);
                failed.push(json!({ "name": name, "error": error.to_string(), "exit_code": code }));
            }
        }
    }
    let size = [args.size.0, args.size.1];
    // A row for each scene, or for each of its frames.
    let columns = match (views.len(), &args.frames) {
        (1, None) => (cells.len() as f64).sqrt().ceil() as usize,
        (1, Some(frames)) => frames.numbers().len(),
        (columns, _) => columns,
    };
    let counts = format!("{} scenes, {} failed", scenes.len(), failed.len());
    let sheet = Sheet::of(std::slice::from_ref(&counts), cells, columns, size);
    lines.push(counts);
    let report = json!({ "schema": SCHEMA, "size": size, "spp": args.spp, "scenes": scenes, "failed": failed });
    Ok(Looked { sheet, shots, report, lines, verdict: verdict(&codes), page: None })
}
