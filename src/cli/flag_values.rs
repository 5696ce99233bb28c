//! Values of flags that are library types, with the help text of each.

use std::ffi::{OsStr, OsString};
use std::path::Path;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Command};

use crate::color::ColorSpace;
use crate::film::{Denoise, View, preview};
use crate::job::LightUnit;
use crate::rays::Backend;
use crate::render::{BackFaces, Choice, GlassShadows, Ground, Integrator, PixelFilter};
use crate::{Error, Result};

/// A library type whose values are the values of a flag.
pub trait FlagValue: Copy + Send + Sync + 'static {
    /// All values, in the order of the help text.
    fn all() -> &'static [Self];
    /// The value's name on the command line.
    fn flag_name(self) -> &'static str;
    /// One line for the help text.
    fn help(self) -> &'static str;
}

/// The parser of a flag with such values.
pub fn value_of<T: FlagValue>() -> impl TypedValueParser<Value = T> {
    let values = T::all().iter().map(|value| PossibleValue::new(value.flag_name()).help(value.help()));
    let parse = |name: String| T::all().iter().find(|value| value.flag_name() == name).copied().ok_or("unknown value");
    PossibleValuesParser::new(values).try_map(parse)
}

/// Options of a command: the names of flags without dashes, and their values; `None` for switches.
pub type Options = [(String, Option<OsString>)];

/// Parses options as the command line does.
///
/// # Errors
/// [`Error::Usage`] with clap's first lines.
pub fn parse<T: Args>(name: &'static str, options: &Options, inputs: &[impl AsRef<OsStr>]) -> Result<T> {
    let command = T::augment_args(Command::new(name));
    let mut line = vec![name.into()];
    line.extend(options.iter().map(|(name, value)| match value {
        Some(value) => [format!("--{name}=").as_ref(), value.as_os_str()].into_iter().collect(),
        None => OsString::from(format!("--{name}")),
    }));
    line.push("--".into());
    line.extend(inputs.iter().map(|path| path.as_ref().to_owned()));
    let parsed = command.try_get_matches_from(line).and_then(|matches| T::from_arg_matches(&matches));
    parsed.map_err(|e| Error::Usage(reason(&e)))
}

/// The first lines of clap's error, which say why.
pub(super) fn reason(error: &clap::Error) -> String {
    let text = error.to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    text.split("\n\n").next().unwrap_or(text).trim_end().to_owned()
}

/// Has a path one of these endings, in any case?
pub(super) fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|own| endings.iter().any(|ending| own.eq_ignore_ascii_case(ending)))
}

/// Fails for a path without one of these endings. Devices have none and are allowed, for benchmarks.
pub(super) fn check_ending(flag: &str, path: &Path, endings: &[&str]) -> Result<()> {
    if has_ending(path, endings) || path.starts_with("/dev") {
        return Ok(());
    }
    let hint = match (flag, preview::has_ending(path)) {
        ("-o", true) => {
            let exr = path.with_extension("exr");
            format!(": -o {} --preview {} writes both", exr.display(), path.display())
        }
        _ => String::new(),
    };
    // .png, .jpg or .webp
    let shown: Vec<_> = endings.iter().filter(|ending| **ending != "jpeg").copied().collect();
    let mut list = shown.join(", .");
    if let Some(last) = list.rfind(", ") {
        list.replace_range(last..last + 2, " or ");
    }
    Err(Error::Usage(format!("{flag} {}: the name must end in .{list}{hint}", path.display())))
}

/// Implements [`FlagValue`] for types with a list `ALL` and a `name`.
macro_rules! flag_values {
    ($($kind:ident { $($variant:ident: $help:literal,)+ })+) => {$(
        impl FlagValue for $kind {
            fn all() -> &'static [Self] {
                &Self::ALL
            }

            fn flag_name(self) -> &'static str {
                self.name()
            }

            fn help(self) -> &'static str {
                match self {
                    $(Self::$variant => $help,)+
                }
            }
        }
    )+};
}

flag_values! {
    Integrator {
        Path: "Path tracing: emission, direct and indirect light",
        Direct: "Emission and direct light",
    }
    BackFaces {
        Cull: "Rays from the camera and their mirror images pass them",
        Show: "They are drawn",
    }
    GlassShadows {
        Off: "Shadow rays end at them; light behind is found by refracted paths",
        Straight: "Shadow rays pass them straight, dimmed by Fresnel and absorption: approximate",
    }
    Ground {
        None: "Nothing",
        Shadow: "A plane that shows shadows alone",
    }
    LightUnit {
        Lumen: "Candela and lux, as KHR_lights_punctual defines",
        Watt: "W/sr and W/m^2, multiplied by 683 lm/W as Blender's exporter does",
    }
    Choice {
        Off: "Never",
        On: "Always",
        Auto: "Where a pre-pass estimates that it pays for its cost",
    }
    PixelFilter {
        Gaussian: "Gaussian of standard deviation 0.5 pixels, truncated at 1.5 pixels",
        Box: "Box of one pixel",
        BlackmanHarris: "Blackman-Harris of radius 1.5 pixels",
    }
    Backend {
        Embree: "Embree 4, as installed on the system",
        Obvhs: "obvhs, a BVH library in pure Rust",
    }
    Denoise {
        Oidn: "Intel Open Image Denoise, if it is installed",
    }
    ColorSpace {
        Rec709: "The primaries of sRGB",
        Acescg: "ACEScg: AP1",
        Rec2020: "ITU-R BT.2020",
    }
    View {
        Agx: "AgX, base look: a soft shoulder; bright colours desaturate as on film",
        Neutral: "Khronos PBR Neutral: keeps base colours and compresses highlights",
        Aces: "ACES as fitted by Hill, as Khronos' render fidelity suite shows it",
        Srgb: "The sRGB transfer function alone; values above 1 clip",
    }
}
