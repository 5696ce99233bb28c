//! Scenes and pictures: what an importer fills, what files hold, and the errors and tools that all of the renderer shares.
//!
//! A part of [bismar](https://docs.rs/bismar), which shows all of it by the same paths; a crate of its own only so that it is
//! compiled in parallel with the others.
#![allow(missing_docs, reason = "a name that says all needs no line")]

/// An enum whose variants are values of a flag.
pub trait Named: Copy + Send + Sync + 'static {
    /// Its variants in the order of the command line's help, with their names there and their help.
    const VALUES: &'static [(Self, &'static str, &'static str)];
}

/// Gives an enum the list `ALL` of its variants, in the order of the command line's help, and their names there. An enum that is
/// declared by it is [`Named`]: its first variant is the default, and what is written above a variant is its help.
#[macro_export]
macro_rules! named_variants {
    ($(#[$about:meta])* pub enum $kind:ident { $($(#[doc = $help:literal])+ $variant:ident = $name:literal),+ $(,)? }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, ::serde::Serialize, ::serde::Deserialize)]
        pub enum $kind { $($(#[doc = $help])+ #[serde(rename = $name)] $variant),+ }

        $crate::named_variants! { $kind { $($variant = $name),+ } }

        impl Default for $kind {
            fn default() -> Self {
                Self::ALL[0]
            }
        }

        impl $crate::Named for $kind {
            const VALUES: &'static [(Self, &'static str, &'static str)] =
                &[$((Self::$variant, $name, concat!($($help),+))),+];
        }
    };
    ($kind:ident { $($variant:ident = $name:literal),+ $(,)? }) => {
        impl $kind {
            /// All of them, in the order of the command line's help.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// Name on the command line.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }
    };
}

pub mod color;
pub mod error;
pub mod film;
pub mod guard;
pub mod scene;

pub use error::{Error, Result};
