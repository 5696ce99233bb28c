//! `bismar develop IN -o OUT.png`

use std::path::PathBuf;

use clap::Args;

use crate::cli::view_args::ViewArgs;
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::film::{Exposure, Look, Picture, ViewTransform, atomic, exr_file, preview};
use crate::render::checkpoint::text;
use crate::{Error, Result};

/// Convert an OpenEXR or HDR picture to PNG, JPEG or WebP with a view transform and an exposure.
#[derive(Debug, Args)]
pub struct DevelopArgs {
    /// The picture: .exr of any program, or .hdr.
    input: PathBuf,
    /// Output: .png, .jpg or .webp [default: the picture's name with .png, in the same folder].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    view: ViewArgs,
    /// Exposure in stops, or auto: the log-mean of all parts that are not dark becomes middle grey. The value is printed.
    #[arg(long, value_name = "EV", default_value_t = Exposure::Auto, allow_negative_numbers = true)]
    exposure: Exposure,
    /// Layer or channel to show instead of the beauty, such as albedo or depth.Z.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
}

pub fn run(args: &DevelopArgs, verbosity: Verbosity) -> Result<Verdict> {
    let output = args.output.clone().unwrap_or_else(|| args.input.with_extension("png"));
    if !preview::has_ending(&output) && !output.starts_with("/dev") {
        return Err(Error::Usage(format!("-o {}: the name must end in .png, .jpg or .webp", output.display())));
    }
    let mut paths = Paths::default();
    paths.reads("the picture", &args.input)?;
    args.output.iter().for_each(|output| atomic::named(output));
    atomic::confine(&[]);
    paths.writes("-o", &output)?;
    atomic::check(&output)?;
    let view = args.view.transform()?;
    if let ViewTransform::Lut(_, path, _) = &view {
        paths.reads("--view", path)?;
    }
    let picture = Picture::open(&args.input, args.layer.as_deref())?;
    // bismar always writes A; only pictures of --transparent are meant to be composited.
    let header = exr_file::read_header(&args.input).unwrap_or_default();
    let opaque = !header.is_empty() && text(&header, "bismar.background") != Some("transparent");
    let exposure = args.exposure.of(picture.colors());
    let name = view.name();
    preview::write_picture(&output, &picture, opaque, &Look { view, exposure }, "")?;
    if !verbosity.quiet {
        say(format_args!("{}: view {name}, exposure {exposure} EV", output.display()));
    }
    Ok(Verdict::Done)
}
