//! Scenes and pictures: what an importer fills, what files hold, and the errors and tools that all of the renderer shares.
//!
//! A part of [bismar](https://docs.rs/bismar), which shows all of it by the same paths; a crate of its own only so that it is
//! compiled in parallel with the others.
#![allow(missing_docs, reason = "a name that says all needs no line")]

/// Gives an enum the list `ALL` of its variants, in the order of the command line's help, and their names there.
#[macro_export]
macro_rules! named_variants {
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
