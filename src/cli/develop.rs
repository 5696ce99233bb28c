//! `bismar develop IN -o OUT.png`

use std::path::{Path, PathBuf};
use std::str::FromStr;

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
    /// The sum of the layers of lights, each times a factor, in place of the beauty: a number or R:G:B. Names are those of `render
    /// --light-groups`, or of the kinds of --aov lights; layers without a factor stay as they are.
    #[arg(long, value_name = "NAME=FACTOR,...", conflicts_with = "layer")]
    mix: Option<Mix>,
}

/// Factors of layers of lights.
#[derive(Debug, Clone)]
struct Mix(Vec<(String, [f32; 3])>);

impl FromStr for Mix {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let item = |item: &str| {
            let (name, factor) = item.split_once('=')?;
            let number = |x: &str| x.trim().parse().ok().filter(|x: &f32| x.is_finite() && *x >= 0.0);
            let numbers = factor.split(':').map(number).collect::<Option<Vec<_>>>()?;
            let factor = if let [x] = numbers[..] { [x; 3] } else { numbers.try_into().ok()? };
            Some((name.trim().to_owned(), factor))
        };
        let wrong = |text| format!("'{text}' is not NAME=FACTOR with a number of at least 0, or three as R:G:B");
        text.split(',')
            .map(|text| item(text).ok_or_else(|| wrong(text)))
            .collect::<std::result::Result<_, _>>()
            .map(Self)
    }
}

impl Mix {
    /// The colours of the mix of a file's layers of lights.
    fn of(&self, path: &Path) -> Result<Vec<[f32; 3]>> {
        let channels = exr_file::channels(path)?;
        let lights = channels.iter().filter_map(|name| name.strip_prefix("light_")?.strip_suffix(".R"));
        let lights: Vec<&str> = lights.collect();
        if let Some((name, _)) = self.0.iter().find(|(name, _)| !lights.contains(&name.as_str())) {
            let have = if lights.is_empty() { "none".into() } else { lights.join(", ") };
            let path = path.display();
            let why =
                format!("{path}: --mix: no layer light_{name}; of lights (`render --light-groups`) it has {have}");
            return Err(Error::Usage(why));
        }
        let mut sum = Vec::new();
        for name in lights {
            let layer = Picture::open(path, Some(&format!("light_{name}")))?.rgb;
            let factor = self.0.iter().find(|(own, _)| own == name).map_or([1.0; 3], |(_, factor)| *factor);
            sum.resize(layer.len(), [0.0; 3]);
            for (sum, light) in sum.iter_mut().zip(layer) {
                (0..3).filter(|c| factor[*c] > 0.0).for_each(|c| sum[c] += factor[c] * light[c]);
            }
        }
        Ok(sum)
    }
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
    let mut picture = Picture::open(&args.input, args.layer.as_deref())?;
    if let Some(mix) = &args.mix {
        picture.rgb = mix.of(&args.input)?;
    }
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
