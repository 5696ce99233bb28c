//! `bismar inspect SCENE`

use std::fmt::Write;
use std::io::stdin;
use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use crate::Result;
use crate::console::{Verdict, print, print_json};
use crate::integrator::PreparedScene;
use crate::job::SceneSelection;
use crate::job::memory::{self, Need};
use crate::job::size;
use crate::rays::Backend;
use crate::render::RenderSettings;
use crate::render::prepass::default_light::{self, OwnLight};
use crate::render::settings::clipped;
use crate::scene::Scene;
use crate::scene::import::{self, EnvironmentFile, EnvironmentSize, Note, STANDARD_INPUT, SceneFiles, Summary};

/// Print the contents of a scene, and which features are supported, approximated or ignored.
#[derive(Debug, Args)]
pub struct InspectArgs {
    /// The scene file, .gltf or .glb; or -, a GLB from standard input.
    scene: PathBuf,
    #[command(flatten)]
    selection: SceneSelection,
    /// Environment map that the scene is to have, an equirectangular .hdr or .exr. No studio light is then added.
    #[arg(long, value_name = "FILE")]
    env: Option<PathBuf>,
    /// Print JSON with the complete lists.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &InspectArgs) -> Result<Verdict> {
    let limit = memory::limit(None)?;
    let from_pipe = args.scene.as_os_str() == "-";
    let files =
        if from_pipe { SceneFiles::read_glb(&mut stdin().lock(), limit.0) } else { SceneFiles::open(&args.scene) }?;
    let survey = files.survey();
    let name = if from_pipe { STANDARD_INPUT.into() } else { args.scene.display().to_string() };
    let threads = rayon::current_num_threads();
    memory::check(&name, Need::of_scene(&survey, Backend::default(), threads), limit)?;
    memory::hold(limit);
    let environment = args.env.as_deref().map(EnvironmentFile::open).transpose()?;
    let map = environment.as_ref().map(EnvironmentFile::size);
    // Decoded to report a fault.
    environment.map(|file| file.decode(0.0, 1.0)).transpose()?;
    let selection = &args.selection;
    let imported = files.import(&selection.options(false, false))?;
    let at_rest = selection.is_posed().then(|| files.import(&selection.at_rest().options(false, false)));
    let at_rest = at_rest.transpose()?.map(|imported| Arc::new(imported.scene));
    drop(files);
    let summary = import::summary(&imported);
    let (width, height) = size(&imported.scene.cameras[0]);
    let pixels = u64::from(width) * u64::from(height);
    let need = Need {
        scene: &survey,
        environment: map,
        settings: &RenderSettings { width, height, ..Default::default() },
        pixels,
        window_pixels: pixels,
        saves: false,
        denoises: false,
        rays: Backend::default(),
        threads,
    };
    let render_bytes = need.bytes();
    let scene = Arc::new(imported.scene);
    let hidden = hidden_by_far_planes(&scene)?;
    let own_light = if map.is_none() { own_light(at_rest.unwrap_or(scene))? } else { None };
    let environment = args.env.as_deref().zip(map).map(|(path, EnvironmentSize { width, height, .. })| Map {
        file: path.display().to_string(),
        width,
        height,
    });
    if args.json {
        let default_light = match own_light {
            _ if map.is_some() => false,
            Some(found) => !found.is_enough(),
            None => summary.lights.is_empty() && !has_emissive(&summary) && !is_unlit(&summary),
        };
        let hidden_by_zfar = &hidden;
        print_json(&Report { summary: &summary, environment, own_light, default_light, hidden_by_zfar, render_bytes })?
    } else {
        print(text(&summary, environment, own_light, &hidden, render_bytes).trim_end())?
    }
    Ok(Verdict::Done)
}

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    /// The map of `--env`.
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<Map>,
    /// What the file's own light does in the view of the first camera; absent where that is not in question.
    #[serde(skip_serializing_if = "Option::is_none")]
    own_light: Option<OwnLight>,
    /// Does `render` add studio light?
    default_light: bool,
    /// By camera, the share of what is in its view that its far clipping plane hides.
    hidden_by_zfar: &'a [f32],
    /// Estimated peak memory of a render with default settings, in bytes.
    render_bytes: u64,
}

#[derive(Serialize)]
struct Map {
    file: String,
    /// In pixels.
    width: u64,
    height: u64,
}

/// What the scene's own light does in the view of the first camera, where that decides whether `render` adds light.
fn own_light(scene: Arc<Scene>) -> Result<Option<OwnLight>> {
    if !default_light::is_in_question(&scene) {
        return Ok(None);
    }
    let prepared = PreparedScene::build(scene, Backend::Embree)?;
    Ok(Some(default_light::own_light(&prepared, 0, &RenderSettings::default())))
}

/// By camera, the share of what is in its view that its far clipping plane hides.
fn hidden_by_far_planes(scene: &Arc<Scene>) -> Result<Vec<f32>> {
    if !scene.cameras.iter().any(|camera| clipped::may_hide(scene, camera)) {
        return Ok(vec![0.0; scene.cameras.len()]);
    }
    let prepared = PreparedScene::build(Arc::clone(scene), Backend::Embree)?;
    Ok(scene.cameras.iter().map(|camera| clipped::hidden_share(&prepared, camera)).collect())
}

fn has_emissive(summary: &Summary) -> bool {
    summary.materials.iter().any(|m| m.features.contains(&"emissive"))
}

fn is_unlit(summary: &Summary) -> bool {
    !summary.materials.is_empty() && summary.materials.iter().all(|m| m.features.contains(&"unlit"))
}

/// Rows shown of each list.
const MAX_ROWS: usize = 12;

fn text(
    s: &Summary,
    environment: Option<Map>,
    own_light: Option<OwnLight>,
    hidden: &[f32],
    render_bytes: u64,
) -> String {
    let mut out = s.file.clone();
    if let Some(generator) = &s.generator {
        let _ = write!(out, "  (by {generator})");
    }
    let c = &s.counts;
    let _ = writeln!(out, "\n{} on disk, read in {:.2} s\n", bytes(s.file_bytes), s.read_seconds);
    let placed = if c.instanced_triangles == c.triangles {
        String::new()
    } else {
        format!(", {} as placed", c.instanced_triangles)
    };
    let sizes = [
        ("triangles", format!("{}{placed}", c.triangles)),
        ("meshes", format!("{} in {} objects, placed {} times", c.meshes, c.objects, c.instances)),
        ("memory", format!("{} geometry, {} images", bytes(c.geometry_bytes), bytes(c.image_bytes))),
        ("a render", format!("needs about {} MiB of memory with default settings", render_bytes.div_ceil(1 << 20))),
    ];
    out += &table(sizes.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect(), "");

    let cameras = s.cameras.iter().map(|c| {
        let vertical = match c.projection {
            "perspective" => format!("{:.1} degrees high", c.vertical),
            _ => format!("{} m to the top", number(c.vertical)),
        };
        let aspect = c.aspect.map(|a| format!("aspect {a:.3}")).unwrap_or_default();
        vec![
            c.index.to_string(),
            c.name.clone(),
            c.projection.into(),
            vertical,
            aspect,
            format!("at {}", vector(&c.position)),
            match (c.znear, c.zfar) {
                _ if c.fault.is_some() => "faulty".into(),
                (Some(near), Some(far)) => {
                    format!("znear {} m, zfar {} m{}", number(near), number(far), hides(hidden[c.index]))
                }
                (Some(near), None) => format!("znear {} m", number(near)),
                _ => String::new(),
            },
        ]
    });
    section(&mut out, "cameras", cameras.collect());

    let mut lights: Vec<_> = s
        .lights
        .iter()
        .map(|l| {
            let unit = if l.kind == "directional" { "lx" } else { "cd" };
            let range = l.range.map(|range| format!("up to {} m", number(range))).unwrap_or_default();
            vec![l.name.clone(), l.kind.to_owned(), format!("{} {unit}", vector(&l.intensity)), range]
        })
        .collect();
    let emissive = s.materials.iter().filter(|m| m.features.contains(&"emissive"));
    lights.extend(emissive.map(|m| vec![m.name.clone(), "emissive".into(), format!("{} triangles", m.triangles)]));
    lights
        .extend(environment.map(|map| vec![map.file, "environment".into(), format!("{} x {}", map.width, map.height)]));
    if lights.is_empty() {
        lights.push(vec!["none: without --env soft studio light is added".into()]);
    }
    section(&mut out, "lights", lights);
    if let Some(found) = own_light {
        let OwnLight { surfaces, lit, .. } = found;
        let added = if found.is_enough() { "no light is added" } else { "without --env soft studio light is added" };
        let _ = writeln!(
            out,
            "  reach {lit} of {surfaces} pixels of surfaces in a first pass of the first camera: {added}"
        );
    }

    let mut materials = s.materials.iter().collect::<Vec<_>>();
    materials.sort_by_key(|m| std::cmp::Reverse(m.triangles));
    let materials =
        materials.iter().map(|m| vec![m.name.clone(), format!("{} triangles", m.triangles), m.features.join(", ")]);
    section(&mut out, "materials", materials.collect());

    let mut images = s.images.iter().collect::<Vec<_>>();
    images.sort_by_key(|i| std::cmp::Reverse(i.bytes));
    let images = images.iter().map(|i| vec![i.name.clone(), format!("{} x {}", i.width, i.height), bytes(i.bytes)]);
    section(&mut out, "images", images.collect());

    for (title, names) in [("scenes", &s.scenes), ("material variants", &s.variants), ("animations", &s.animations)] {
        if names.len() > usize::from(title == "scenes") {
            let rows = names.iter().enumerate().map(|(index, name)| vec![index.to_string(), name.clone()]);
            section(&mut out, title, rows.collect());
        }
    }

    let extensions = [
        ("supported", &s.extensions_used),
        ("approximated", &s.extensions_approximated),
        ("ignored", &s.extensions_ignored),
    ];
    let rows = extensions.into_iter().filter(|(_, names)| !names.is_empty());
    section(&mut out, "extensions", rows.map(|(how, names)| vec![how.to_owned(), names.join(", ")]).collect());
    section(&mut out, "approximated", notes(&s.approximated));
    section(&mut out, "ignored, although they change the picture", notes(&s.ignored));
    section(&mut out, "not loaded, because the picture does not need them", notes(&s.not_loaded));
    section(&mut out, "remarks", notes(&s.remarks));
    out
}

fn hides(share: f32) -> String {
    if share > clipped::MIN_HIDDEN_SHARE {
        format!(", hides {:.0} % of what is in view", 100.0 * share)
    } else {
        String::new()
    }
}

fn notes(notes: &[Note]) -> Vec<Vec<String>> {
    let row = |n: &Note| {
        let more = if n.count > 1 { format!(" and {} more", n.count - 1) } else { String::new() };
        vec![format!("{}  [{}{more}]", n.text, n.at)]
    };
    notes.iter().map(row).collect()
}

fn section(out: &mut String, title: &str, mut rows: Vec<Vec<String>>) {
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(out, "\n{title}");
    let more = rows.len().saturating_sub(MAX_ROWS);
    rows.truncate(MAX_ROWS);
    *out += &table(rows, "  ");
    if more > 0 {
        let _ = writeln!(out, "  and {more} more: --json lists all");
    }
}

/// Columns as wide as their widest cell, in characters. Control characters, which may be in names, are shown as `?`.
fn table(mut rows: Vec<Vec<String>>, indent: &str) -> String {
    for cell in rows.iter_mut().flatten() {
        *cell = cell.replace(char::is_control, "?");
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|x| x.chars().count()).max().unwrap_or(0);
    let widths = (0..columns).map(width).collect::<Vec<_>>();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:<width$}")).collect::<Vec<_>>();
        format!("{}\n", format!("{indent}{}", cells.join("  ")).trim_end())
    };
    rows.iter().map(line).collect()
}

fn vector(v: &[f32; 3]) -> String {
    format!("({})", v.map(number).join(", "))
}

/// Up to three decimals, without trailing zeros; very small and very large numbers in scientific notation.
fn number(x: f32) -> String {
    let text = if x != 0.0 && !(1e-3..1e6).contains(&x.abs()) { return format!("{x:.2e}") } else { format!("{x:.3}") };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn bytes(n: u64) -> String {
    match n {
        0..1024 => format!("{n} B"),
        1024..1_048_576 => format!("{:.1} KiB", n as f64 / 1024.0),
        _ => format!("{:.1} MiB", n as f64 / 1_048_576.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_by_characters_and_numbers_are_short() {
        let rows = vec![vec!["ä".to_owned(), "1".into()], vec!["a\u{1b}c".into(), "22".into()]];
        assert_eq!(table(rows, " "), " ä    1\n a?c  22\n");
        assert_eq!([0.0, -1.5, 2.0, 0.1234, 1e-5].map(number), ["0", "-1.5", "2", "0.123", "1.00e-5"]);
        assert_eq!([10, 2048, 3 << 20].map(bytes), ["10 B", "2.0 KiB", "3.0 MiB"]);
    }
}
