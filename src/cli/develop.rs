//! `bismar develop IN -o OUT.png`

use std::path::{Path, PathBuf};

use clap::Args;

use crate::cli::options::check_ending;
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::film::denoise::DENOISED;
use crate::film::{Exposure, Look, Picture, ViewTransform, atomic, exr_file, preview};
use crate::job::ViewOptions;
use crate::render::record::checkpoint::text;
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
    view: ViewOptions,
    /// Exposure in stops, or auto: the log-mean of all parts that are not dark becomes middle grey. The value is printed.
    #[arg(long, value_name = "EV", default_value_t = Exposure::Auto, allow_negative_numbers = true)]
    exposure: Exposure,
    /// Layer or channel to show instead of the beauty, such as albedo or depth.Z.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// The sum of the layers of lights, each times a factor, in place of the beauty: a number or R:G:B. Names are those of `render
    /// --light-groups`, or of the kinds of --aov lights; layers without a factor stay as they are. With --layer denoised, of the
    /// denoised layers.
    #[arg(long, value_parser = mix, value_name = "NAME=FACTOR,...")]
    mix: Option<Mix>,
}

/// Factors of layers of lights.
#[derive(Debug, Clone)]
struct Mix(Vec<(String, [f32; 3])>);

fn mix(text: &str) -> std::result::Result<Mix, String> {
    let item = |item: &str| {
        let (name, factor) = item.split_once('=')?;
        let number = |x: &str| x.trim().parse().ok().filter(|x: &f32| x.is_finite() && *x >= 0.0);
        let numbers = factor.split(':').map(number).collect::<Option<Vec<_>>>()?;
        let factor = if let [x] = numbers[..] { [x; 3] } else { numbers.try_into().ok()? };
        Some((name.trim().to_owned(), factor))
    };
    let wrong = |text| format!("'{text}' is not NAME=FACTOR with a number of at least 0, or three as R:G:B");
    let items = text.split(',').map(|text| item(text).ok_or_else(|| wrong(text)));
    items.collect::<std::result::Result<_, _>>().map(Mix)
}

impl Mix {
    /// A file's beauty with the mix of its layers of lights in place of its colours.
    fn of(&self, path: &Path, layer: Option<&str>) -> Result<Picture> {
        let prefix = match layer {
            None => "light_",
            Some(DENOISED) => "denoised_",
            Some(_) => return Err(Error::Usage("--mix: the only --layer that it can be of is denoised".into())),
        };
        let channels = exr_file::channels(path)?;
        let layers = channels.iter().filter_map(|name| name.strip_suffix(".R").filter(|name| name.starts_with(prefix)));
        let layers: Vec<&str> = layers.collect();
        let lights: Vec<&str> = layers.iter().filter_map(|name| name.strip_prefix(prefix)).collect();
        if let Some((name, _)) = self.0.iter().find(|(name, _)| !lights.contains(&name.as_str())) {
            let have = if lights.is_empty() { "none".into() } else { lights.join(", ") };
            let path = path.display();
            let why =
                format!("{path}: --mix: no layer {prefix}{name}; of lights (`render --light-groups`) it has {have}");
            return Err(Error::Usage(why));
        }
        let wanted: Vec<_> = [None].into_iter().chain(layers.into_iter().map(Some)).collect();
        let mut pictures = Picture::open_all(path, &wanted)?.into_iter();
        let mut picture = pictures.next().ok_or_else(|| Error::Bug("no beauty".into()))?;
        picture.rgb.fill([0.0; 3]);
        for (name, layer) in lights.into_iter().zip(pictures) {
            let factor = self.0.iter().find(|(own, _)| own == name).map_or([1.0; 3], |(_, factor)| *factor);
            for (sum, light) in picture.rgb.iter_mut().zip(layer.rgb) {
                (0..3).filter(|c| factor[*c] > 0.0).for_each(|c| sum[c] += factor[c] * light[c]);
            }
        }
        Ok(picture)
    }
}

pub fn run(args: &DevelopArgs, verbosity: Verbosity) -> Result<Verdict> {
    let output = args.output.clone().unwrap_or_else(|| args.input.with_extension("png"));
    check_ending("-o", &output, &preview::ENDINGS)?;
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
    let layer = args.layer.as_deref();
    let picture =
        args.mix.as_ref().map_or_else(|| Picture::open(&args.input, layer), |mix| mix.of(&args.input, layer))?;
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
