//! Values of flags that are library types, with the help text of each.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use crate::film::{Denoise, View};
use crate::rays::Backend;
use crate::render::{BackFaces, Choice, GlassShadows, Ground, Integrator, PixelFilter};

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
    View {
        Agx: "AgX, base look: a soft shoulder; bright colours desaturate as on film",
        Neutral: "Khronos PBR Neutral: keeps base colours and compresses highlights",
        Aces: "ACES as fitted by Hill, as Khronos' render fidelity suite shows it",
        Srgb: "The sRGB transfer function alone; values above 1 clip",
    }
}
