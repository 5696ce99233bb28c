//! Values of flags that are library types, with the help text of each.

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::film::{Denoise, View};
use crate::rays::Backend;
use crate::render::{Guiding, Integrator, PixelFilter};

/// Implements clap's [`ValueEnum`] for library types with a list `ALL` and a `name`.
macro_rules! flag_values {
    ($($kind:ident { $($variant:ident: $help:literal,)+ })+) => {$(
        impl ValueEnum for $kind {
            fn value_variants<'a>() -> &'a [Self] {
                &Self::ALL
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                let help = match self {
                    $(Self::$variant => $help,)+
                };
                Some(PossibleValue::new(self.name()).help(help))
            }
        }
    )+};
}

flag_values! {
    Integrator {
        Path: "Path tracing: emission, direct and indirect light",
        Direct: "Emission and direct light",
    }
    Guiding {
        Off: "No path guiding",
        On: "Guide all paths",
        Auto: "Guide paths where a pre-pass estimates that guiding pays for its cost",
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
        Srgb: "The sRGB transfer function alone; values above 1 clip",
    }
}
