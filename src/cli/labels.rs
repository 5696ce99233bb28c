//! `bismar labels PICTURE.exr…`

use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::console::{Paths, Verbosity, Verdict, say};
use crate::film::exr_file::{read_bits, read_header};
use crate::film::{Picture, atomic, preview};
use crate::render::checkpoint::text;
use crate::{Error, Result};

/// Write the masks of objects or materials as COCO annotations, and their ids as 16-bit PNG (docs/datasets.md).
///
/// The pictures need the AOV object or material. A pixel belongs to what its last path hit first.
#[derive(Debug, Args)]
pub struct LabelsArgs {
    /// Pictures that bismar has rendered with --aov object or material.
    #[arg(required = true, value_name = "PICTURE.exr")]
    pictures: Vec<PathBuf>,
    /// COCO annotations: images, categories, and for each object in each picture its mask (RLE), area and box.
    #[arg(short, long, value_name = "FILE.json")]
    output: PathBuf,
    /// What has a mask.
    #[arg(long, value_enum, default_value_t)]
    by: By,
    /// Ending of the pictures' names in the annotations, such as png for the previews [default: that of the pictures].
    #[arg(long, value_name = "ENDING")]
    images: Option<String>,
    /// Also write the ids of each picture as a 16-bit PNG beside it, named as in view.object.png; 0 is nothing.
    #[arg(long)]
    ids: bool,
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
struct Image {
    id: usize,
    file_name: String,
    width: usize,
    height: usize,
}

#[derive(Debug, Serialize)]
struct Category {
    id: usize,
    name: String,
}

/// A mask as COCO's run lengths: of 0, of 1, of 0, … column by column.
#[derive(Debug, PartialEq, Serialize)]
struct RunLengths {
    counts: Vec<usize>,
    /// Height and width.
    size: [usize; 2],
}

#[derive(Debug, Serialize)]
struct Annotation {
    id: usize,
    image_id: usize,
    category_id: usize,
    /// The id in the AOV: index + 1.
    instance_id: u32,
    /// Name of the object or material.
    name: String,
    segmentation: RunLengths,
    area: usize,
    /// Left, top, width, height in pixels.
    bbox: [usize; 4],
    iscrowd: u8,
}

#[derive(Debug, Default, Serialize)]
struct Coco {
    images: Vec<Image>,
    categories: Vec<Category>,
    annotations: Vec<Annotation>,
}

pub fn run(args: &LabelsArgs, verbosity: Verbosity) -> Result<Verdict> {
    let mut paths = Paths::default();
    args.pictures.iter().try_for_each(|picture| paths.reads("the picture", picture))?;
    paths.writes("-o", &args.output)?;
    atomic::check(&args.output)?;
    let folder = args.output.parent().unwrap_or(Path::new(""));
    let (mut coco, mut categories) = (Coco::default(), HashMap::new());
    for picture in &args.pictures {
        let (ids, [width, height], names) = ids_of(picture, args.by)?;
        if args.ids {
            let file = picture.with_extension(format!("{}.png", args.by.layer()));
            paths.writes("--ids", &file)?;
            write_ids(&file, [width, height], &ids)?;
        }
        let shown = args.images.as_ref().map_or(picture.clone(), |ending| picture.with_extension(ending));
        let named = shown.strip_prefix(folder).unwrap_or(&shown);
        let id = coco.images.len() + 1;
        coco.images.push(Image { id, file_name: named.display().to_string(), width, height });
        for (instance_id, mask) in masks(&ids, [width, height]) {
            let name = names.get(instance_id as usize - 1).cloned().unwrap_or_else(|| instance_id.to_string());
            let category = category(&name).to_owned();
            let next = categories.len() + 1;
            let category_id = *categories.entry(category.clone()).or_insert(next);
            if category_id == next {
                coco.categories.push(Category { id: next, name: category });
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
    atomic::write(&args.output, |file| {
        serde_json::to_writer(&mut *file, &coco)?;
        file.write_all(b"\n")?;
        Ok(Ok(()))
    })?;
    if !verbosity.quiet {
        let Coco { images, categories, annotations } = &coco;
        let (pictures, kinds, masks) = (images.len(), categories.len(), annotations.len());
        say(format_args!("{}: {masks} masks of {kinds} categories in {pictures} pictures", args.output.display()));
    }
    Ok(Verdict::Done)
}

/// The ids of a picture row by row, its width and height, and the names of the ids from 1.
fn ids_of(path: &Path, by: By) -> Result<(Vec<u32>, [usize; 2], Vec<String>)> {
    let channel = format!("{}.V", by.layer());
    let ids = read_bits(path)?.into_iter().find(|(name, _)| *name == channel).map(|(_, ids)| ids);
    let names = text(&read_header(path)?, by.attribute()).and_then(|names| serde_json::from_str(names).ok());
    let Some((ids, names)) = ids.zip(names) else {
        let (path, layer) = (path.display(), by.layer());
        return Err(Error::Data(format!("{path}: it has no ids: render it with --aov {layer}")));
    };
    let size = Picture::open(path, Some(&channel))?.size();
    Ok((ids, size, names))
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

struct Mask {
    segmentation: RunLengths,
    area: usize,
    bbox: [usize; 4],
}

/// The mask of each id but 0, by id.
fn masks(ids: &[u32], [width, height]: [usize; 2]) -> BTreeMap<u32, Mask> {
    /// Runs so far, the end of the last one in column order, and the box: left, top, right, bottom.
    struct Open {
        counts: Vec<usize>,
        end: usize,
        bounds: [usize; 4],
        area: usize,
    }
    let mut open: BTreeMap<u32, Open> = BTreeMap::new();
    for (at, (x, y)) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))).enumerate() {
        let id = ids[y * width + x];
        if id == 0 {
            continue;
        }
        let new = || Open { counts: vec![0, 0], end: 0, bounds: [x, y, x, y], area: 0 };
        let mask = open.entry(id).or_insert_with(new);
        if mask.area == 0 {
            mask.counts[0] = at;
        } else if mask.end < at {
            mask.counts.extend([at - mask.end, 0]);
        }
        if let Some(run) = mask.counts.last_mut() {
            *run += 1;
        }
        let [left, top, right, bottom] = mask.bounds;
        mask.bounds = [left.min(x), top.min(y), right.max(x), bottom.max(y)];
        (mask.end, mask.area) = (at + 1, mask.area + 1);
    }
    let closed = |(id, Open { mut counts, end, bounds: [left, top, right, bottom], area })| {
        if end < width * height {
            counts.push(width * height - end);
        }
        let segmentation = RunLengths { counts, size: [height, width] };
        (id, Mask { segmentation, area, bbox: [left, top, right - left + 1, bottom - top + 1] })
    };
    open.into_iter().map(closed).collect()
}

fn write_ids(path: &Path, size: [usize; 2], ids: &[u32]) -> Result<()> {
    let small: std::result::Result<Vec<u16>, _> = ids.iter().map(|id| u16::try_from(*id)).collect();
    let small =
        small.map_err(|_| Error::Data(format!("{}: ids above 65535 do not fit into 16 bits", path.display())))?;
    preview::write_grey16(path, size.map(|n| n as u32), &small)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn copies_are_of_one_category() {
        for (name, of) in
            [("Chair.003", "Chair"), ("Chair", "Chair"), ("v1.2", "v1.2"), (".001", ".001"), ("a.b.0012", "a.b")]
        {
            assert_eq!(category(name), of);
        }
    }

    proptest! {
        #[test]
        fn run_lengths_are_the_mask_column_by_column(
            (width, height) in (1usize..9, 1usize..9), seeds in proptest::collection::vec(0u32..4, 64)
        ) {
            let ids: Vec<u32> = seeds[..width * height].to_vec();
            let found = masks(&ids, [width, height]);
            for id in 1..4 {
                let pixels: Vec<_> = (0..ids.len()).filter(|i| ids[*i] == id).map(|i| (i % width, i / width)).collect();
                let Some(Mask { segmentation, area, bbox: [x, y, w, h] }) = found.get(&id) else {
                    prop_assert!(pixels.is_empty());
                    continue;
                };
                prop_assert_eq!(*area, pixels.len());
                prop_assert_eq!(segmentation.counts.iter().sum::<usize>(), ids.len());
                let mut decoded = Vec::new();
                for (i, count) in segmentation.counts.iter().enumerate() {
                    decoded.extend(std::iter::repeat_n(i % 2 == 1, *count));
                }
                for (at, inside) in decoded.into_iter().enumerate() {
                    prop_assert_eq!(inside, ids[at % height * width + at / height] == id);
                }
                let extent = |of: &dyn Fn(&(usize, usize)) -> usize| {
                    (pixels.iter().map(of).min().unwrap(), pixels.iter().map(of).max().unwrap() + 1)
                };
                prop_assert_eq!(extent(&|p| p.0), (*x, x + w));
                prop_assert_eq!(extent(&|p| p.1), (*y, y + h));
            }
        }
    }
}
