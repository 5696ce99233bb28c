//! `bismar labels PICTURE.exr…`

mod arrays;
mod masks;

use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::{Value, json};

use self::masks::{Mask, RunLengths, masks};
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::film::exr_file::{read_bits, read_header};
use crate::film::{Picture, atomic, preview};
use crate::render::record::checkpoint::text;
use crate::{Error, Result};

/// Write what a data set needs beside its pictures: COCO annotations, ids, depth and normals (docs/datasets.md).
///
/// The pictures need the AOVs that are asked for: object or material, depth, normal. A pixel's mask belongs to what its last
/// path hit first.
#[derive(Debug, Args)]
pub struct LabelsArgs {
    /// Pictures that bismar has rendered with these AOVs, or folders of such pictures.
    #[arg(required = true, value_name = "PICTURE.exr")]
    pictures: Vec<PathBuf>,
    /// COCO annotations: images, categories, and for each object in each picture its mask (RLE), area and box.
    #[arg(short, long, value_name = "FILE.json", required_unless_present_any = ["ids", "depth", "normals"])]
    output: Option<PathBuf>,
    /// What has a mask.
    #[arg(long, value_enum, default_value_t)]
    by: By,
    /// Ending of the pictures' names in the annotations, such as png for the previews [default: that of the pictures].
    #[arg(long, value_name = "ENDING")]
    images: Option<String>,
    /// Also write the ids of each picture as a 16-bit PNG beside it, named as in view.object.png; 0 is nothing.
    #[arg(long)]
    ids: bool,
    #[command(flatten)]
    arrays: arrays::ArrayArgs,
}

/// What has a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum By {
    /// Placed objects: nodes of the scene
    #[default]
    Object,
    /// Materials
    Material,
}

impl By {
    fn layer(self) -> &'static str {
        match self {
            Self::Object => "object",
            Self::Material => "material",
        }
    }

    /// The header attribute with the names.
    fn attribute(self) -> &'static str {
        match self {
            Self::Object => "bismar.objects",
            Self::Material => "bismar.materials",
        }
    }
}

#[derive(Debug, Serialize)]
struct Annotation {
    id: usize,
    image_id: usize,
    category_id: usize,
    /// The id in the AOV: index + 1.
    instance_id: u32,
    name: String,
    segmentation: RunLengths,
    area: usize,
    /// Left, top, width, height in pixels.
    bbox: [usize; 4],
    iscrowd: u8,
}

#[derive(Debug, Default, Serialize)]
struct Coco {
    images: Vec<Value>,
    categories: Vec<Value>,
    annotations: Vec<Annotation>,
}

pub fn run(args: &LabelsArgs, verbosity: Verbosity) -> Result<Verdict> {
    if let Some(images) = args.images.as_ref().filter(|ending| ending.contains(['/', '\\'])) {
        return Err(Error::Usage(format!("--images {images}: not the ending of a file's name, such as png")));
    }
    let mut paths = Paths::default();
    let pictures = super::check::pictures(&args.pictures)?;
    pictures.iter().try_for_each(|picture| paths.reads("the picture", picture))?;
    if let Some(output) = &args.output {
        paths.names("-o", output)?;
        atomic::check(output)?;
    }
    let folders: Vec<PathBuf> = args
        .pictures
        .iter()
        .map(|path| if path.is_dir() { path } else { path.parent().unwrap_or(path) }.into())
        .collect();
    atomic::confine(&folders);
    let folder = args.output.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let (mut coco, mut categories) = (Coco::default(), HashMap::new());
    for picture in &pictures {
        args.arrays.write(picture, &mut paths)?;
        if args.output.is_none() && !args.ids {
            continue;
        }
        let Ids { ids, size: [width, height], names, categories: stated } = ids_of(picture, args.by)?;
        if args.ids {
            let file = picture.with_extension(format!("{}.png", args.by.layer()));
            paths.writes("--ids", &file)?;
            write_ids(&file, [width, height], &ids)?;
        }
        let shown = args.images.as_ref().map_or(picture.clone(), |ending| picture.with_extension(ending));
        let named = shown.strip_prefix(folder).unwrap_or(&shown);
        let id = coco.images.len() + 1;
        let file_name = named.display().to_string();
        coco.images.push(json!({ "id": id, "file_name": file_name, "width": width, "height": height }));
        for (instance_id, mask) in masks(&ids, [width, height]) {
            let name = names.get(instance_id as usize - 1).cloned().unwrap_or_else(|| instance_id.to_string());
            let stated = stated.get(instance_id as usize - 1).cloned().flatten();
            let category = stated.unwrap_or_else(|| category(&name).to_owned());
            let next = categories.len() + 1;
            let category_id = *categories.entry(category.clone()).or_insert(next);
            if category_id == next {
                coco.categories.push(json!({ "id": next, "name": category }));
            }
            let Mask { segmentation, area, bbox } = mask;
            let (annotation, image_id) = (coco.annotations.len() + 1, id);
            coco.annotations.push(Annotation {
                id: annotation,
                image_id,
                category_id,
                instance_id,
                name,
                segmentation,
                area,
                bbox,
                iscrowd: 0,
            });
        }
    }
    if let Some(output) = &args.output {
        atomic::write(output, |file| {
            serde_json::to_writer(&mut *file, &coco)?;
            file.write_all(b"\n")?;
            Ok(Ok(()))
        })?;
    }
    if !verbosity.quiet {
        let Coco { categories, annotations, .. } = &coco;
        let (pictures, kinds, masks) = (pictures.len(), categories.len(), annotations.len());
        match &args.output {
            Some(output) => {
                say(format_args!("{}: {masks} masks of {kinds} categories in {pictures} pictures", output.display()));
            }
            None => say(format_args!("labels of {pictures} pictures")),
        }
    }
    Ok(Verdict::Done)
}

struct Ids {
    /// Row by row.
    ids: Vec<u32>,
    /// Width and height.
    size: [usize; 2],
    /// Of the ids from 1.
    names: Vec<String>,
    /// Categories that the nodes' `extras` state, of the ids from 1; empty if none does.
    categories: Vec<Option<String>>,
}

fn ids_of(path: &Path, by: By) -> Result<Ids> {
    let channel = format!("{}.V", by.layer());
    let ids = read_bits(path)?.into_iter().find(|(name, _)| *name == channel).map(|(_, ids)| ids);
    let header = read_header(path)?;
    let names = text(&header, by.attribute()).and_then(|names| serde_json::from_str(names).ok());
    let Some((ids, names)) = ids.zip(names) else {
        let (path, layer) = (path.display(), by.layer());
        return Err(Error::Data(format!("{path}: it has no ids: render it with --aov {layer}")));
    };
    let size = Picture::open(path, Some(&channel))?.size();
    let categories = text(&header, "bismar.categories").filter(|_| by == By::Object);
    let categories = categories.and_then(|names| serde_json::from_str(names).ok()).unwrap_or_default();
    Ok(Ids { ids, size, names, categories })
}

/// The category of a name: without the number that Blender appends to copies, as in `Chair.003`.
fn category(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, number)) if !stem.is_empty() && number.len() >= 3 && number.bytes().all(|b| b.is_ascii_digit()) => {
            stem
        }
        _ => name,
    }
}

fn write_ids(path: &Path, size: [usize; 2], ids: &[u32]) -> Result<()> {
    let small: std::result::Result<Vec<u16>, _> = ids.iter().map(|id| u16::try_from(*id)).collect();
    let small =
        small.map_err(|_| Error::Data(format!("{}: ids above 65535 do not fit into 16 bits", path.display())))?;
    preview::write_png16(path, size.map(|n| n as u32), &small)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_are_of_one_category() {
        for (name, of) in
            [("Chair.003", "Chair"), ("Chair", "Chair"), ("v1.2", "v1.2"), (".001", ".001"), ("a.b.0012", "a.b")]
        {
            assert_eq!(category(name), of);
        }
    }
}
