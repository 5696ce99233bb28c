//! Two scenes in one framing: view by view old, new and FLIP, and in words what differs.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use maud::{Markup, html};
use serde_json::{Value, json};

use super::args::LookArgs;
use super::contents::{Bounds, decimal};
use super::direction::Direction;
use super::looked::{Looked, SCHEMA};
use super::sheet::{Cell, Sheet, picture};
use super::shots::{Shot, Sphere, Subject, exposure_of, hash_of};
use crate::cli::compare::false_color;
use crate::cli::compare::page::{page, shown};
use crate::cli::compare::report::short;
use crate::console::{Paths, Verdict};
use crate::film::compare::{compare, flip_map};
use crate::film::preview::to_byte;
use crate::{Error, Result};

/// Two scenes that were looked at.
pub struct Pair {
    /// Old, new and FLIP error map of each view.
    pub cells: Vec<Cell>,
    /// What differs, in words; at last the pictures.
    pub words: Vec<String>,
    /// Views whose FLIP error is too large, in words.
    pub failures: Vec<String>,
    /// JSON of both scenes and of the views.
    pub report: Value,
    subjects: [Subject; 2],
    shots: [Vec<Shot>; 2],
    exposure: f32,
}

/// Looks at two scenes, old and new.
pub fn look(args: &LookArgs, scenes: [&Path; 2], paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    let pair = Pair::look(args, scenes, &args.views, paths, stop)?;
    let size = [args.size.0, args.size.1];
    let page = args.page.as_ref().map(|_| pair.page(scenes, size)).transpose()?;
    let Pair { cells, words, failures, mut report, subjects, shots: [mut shots, new], .. } = pair;
    let title = [0, 1].map(|i| {
        let name = scenes[i].file_name().unwrap_or_default().to_string_lossy();
        format!("{}: {name}, {}", ["old", "new"][i], subjects[i].contents.line())
    });
    let sheet = Sheet::of(&title, cells, 3, size);
    report["schema"] = json!(SCHEMA);
    report["size"] = json!(size);
    report["spp"] = json!(args.spp);
    shots.extend(new);
    let verdict = if failures.is_empty() { Verdict::Done } else { Verdict::Beyond };
    Ok(Looked { sheet, shots, report, lines: [words, failures].concat(), verdict, page })
}

impl Pair {
    /// Looks at two scenes; `views` are those of a single scene if there are none.
    pub fn look(
        args: &LookArgs,
        scenes: [&Path; 2],
        views: &[Direction],
        paths: &mut Paths,
        stop: &AtomicBool,
    ) -> Result<Self> {
        let [mut old, mut new] = [Subject::open(args, scenes[0], paths)?, Subject::open(args, scenes[1], paths)?];
        let sphere = around(old.sphere, new.sphere);
        let chosen = match views {
            [] => args.views(Bounds::around(&old.contents.bounds, &new.contents.bounds).as_ref()),
            given => given.to_vec(),
        };
        let shots = [&mut old, &mut new].map(|subject| subject.shots(&chosen, args.frames.as_ref(), sphere, stop));
        let [first, second] = shots;
        let (first, second) = (first?, second?);
        let exposure = exposure_of(first.iter().chain(&second));
        let (mut cells, mut views, mut failures) = (Vec::new(), Vec::new(), Vec::new());
        let mut worst: Option<(f64, String)> = None;
        for (before, after) in first.iter().zip(&second) {
            let label = before.label();
            let [a, b] = [before, after].map(|shot| shot.developed(exposure));
            let size = [args.size.0, args.size.1];
            let is_equal = before.has_bits_of(after);
            let map = match is_equal {
                true => vec![0.0; a.len() / 3],
                false => flip_map(&picture(&a, size), &picture(&b, size)),
            };
            let flip = map.iter().map(|e| f64::from(*e)).sum::<f64>() / map.len().max(1) as f64;
            if !is_equal && worst.as_ref().is_none_or(|(most, _)| flip > *most) {
                worst = Some((flip, label.clone()));
            }
            if let Some(most) = args.max_flip.filter(|most| flip.is_nan() || flip > *most) {
                failures.push(format!("{label}: FLIP {} is beyond {most}", short(flip)));
            }
            let colors = map.iter().flat_map(|e| false_color(*e).map(to_byte)).collect();
            let error = if is_equal { "equal bits".into() } else { format!("FLIP {}", short(flip)) };
            cells.extend([(format!("{label}, old"), a), (format!("{label}, new"), b)]);
            cells.push((format!("{label}, {error}"), colors));
            let mut view = after.report(exposure);
            view["old"] = before.report(exposure);
            view["flip"] = json!(flip);
            view["equal"] = json!(is_equal);
            views.push(view);
        }
        let same_files = old.contents.whole && new.contents.whole && old.contents.hash == new.contents.hash;
        let mut words = old.contents.differences(&new.contents);
        if words.is_empty() {
            let why = if same_files {
                "files: the same contents"
            } else {
                "contents: no difference but in vertices or nodes"
            };
            words.push(why.into());
        }
        words.push(match &worst {
            None => "pictures: equal bits in all views".into(),
            Some((flip, label)) => format!("pictures: FLIP at most {}, {label}", short(*flip)),
        });
        let report = json!({
            "hash": { "old": hash_of(&first), "new": hash_of(&second) },
            "exposure": decimal(exposure),
            "same_files": same_files,
            "equal": worst.is_none(),
            "differences": words,
            "flip": worst.as_ref().map_or(0.0, |(flip, _)| *flip),
            "max_flip": args.max_flip,
            "within": failures.is_empty(),
            "views": views,
            "old": old.contents.report()?,
            "new": new.contents.report()?,
        });
        Ok(Self { cells, words, failures, report, subjects: [old, new], shots: [first, second], exposure })
    }

    /// A page as `compare` writes it: all views of both under a slider, and what differs.
    fn page(&self, names: [&Path; 2], size: [u32; 2]) -> Result<Markup> {
        let columns = (self.shots[0].len() as f64).sqrt().ceil() as usize;
        let cell = |shot: &Shot| (shot.label(), shot.developed(self.exposure));
        let [a, b] = [0, 1].map(|i| Sheet::of(&[], self.shots[i].iter().map(cell).collect(), columns, size).picture());
        let comparison = compare(&a, &b).map_err(Error::Bug)?;
        let above = html! {
            p { "A is the old scene, B the new one." }
            ul { @for text in &self.words { li { (shown(text)) } } }
        };
        page(names, [&a, &b], &comparison, &above)
    }
}

fn around(a: Sphere, b: Sphere) -> Sphere {
    let apart = a.0.distance(b.0);
    // One that holds the other is the answer: equal scenes keep their framing. So is the other of a scene without extent.
    if b.1 == 0.0 && b.0 == glam::DVec3::ZERO || apart + b.1 <= a.1 {
        return a;
    }
    if a.1 == 0.0 && a.0 == glam::DVec3::ZERO || apart + a.1 <= b.1 {
        return b;
    }
    let radius = 0.5 * (apart + a.1 + b.1);
    (a.0 + (b.0 - a.0) * ((radius - a.1) / apart), radius)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_sphere_around_two_touches_both_or_is_the_one_that_holds_the_other() {
        let (a, b) = ((DVec3::ZERO, 2.0), (DVec3::new(6.0, 0.0, 0.0), 1.0));
        assert_eq!(around(a, b), (DVec3::new(2.5, 0.0, 0.0), 4.5));
        assert_eq!(around(b, a), (DVec3::new(2.5, 0.0, 0.0), 4.5));
        assert_eq!(around(a, (DVec3::X, 1.0)), a);
        assert_eq!(around(a, a), a);
        assert_eq!([around((DVec3::ZERO, 0.0), b), around(b, (DVec3::ZERO, 0.0))], [b, b]);
    }
}
