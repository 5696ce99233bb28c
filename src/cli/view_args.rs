//! `--view` and `--view-space`: a view transform of the program, or a LUT.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::sync::Arc;

use clap::builder::{PossibleValue, TypedValueParser};
use clap::{Arg, Args, Command, ValueHint};
use tracing::warn;

use super::flag_values::value_of;
use crate::film::lut::is_lut;
use crate::film::{Lut, LutInput, View, ViewTransform};
use crate::scene::import::read_regular;
use crate::{Error, Result};

/// How a picture to look at is made.
#[derive(Debug, Clone, Args)]
pub struct ViewArgs {
    /// View transform of the PNG: one of these, or a LUT (.cube) whose result is display-encoded.
    #[arg(long, value_parser = ViewParser, default_value = View::Agx.name(), value_name = "VIEW|FILE.cube",
        value_hint = ValueHint::Other, help_heading = "Output")]
    pub view: PathBuf,
    /// What the LUT takes: linear rec709, acescg or rec2020; acescct; or log2:MIN,MAX, in stops of linear Rec. 709 (also
    /// acescg-log2:MIN,MAX) [default: as its comment `# input space: SPACE` says, else rec709].
    #[arg(long, value_name = "SPACE", allow_hyphen_values = true, help_heading = "Output")]
    view_space: Option<LutInput>,
}

/// Largest file of a LUT in bytes.
const MOST_BYTES: u64 = 1 << 27;

/// Names of views, and of files.
#[derive(Clone)]
struct ViewParser;

impl TypedValueParser for ViewParser {
    type Value = PathBuf;

    fn parse_ref(
        &self,
        command: &Command,
        arg: Option<&Arg>,
        value: &OsStr,
    ) -> std::result::Result<PathBuf, clap::Error> {
        if !is_lut(value) {
            value_of::<View>().parse_ref(command, arg, value)?;
        }
        Ok(value.into())
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(value_of::<View>().possible_values()?.collect::<Vec<_>>().into_iter()))
    }
}

impl ViewArgs {
    /// The view transform; reads the LUT.
    ///
    /// # Errors
    /// [`Error::reading`]; [`Error::Data`] for a file that is no LUT; [`Error::Usage`] for a space without a LUT.
    pub fn transform(&self) -> Result<ViewTransform> {
        if let Some(view) = View::ALL.into_iter().find(|view| self.view.as_os_str() == view.name()) {
            return match self.view_space {
                None => Ok(view.into()),
                Some(_) => Err(Error::Usage(format!(
                    "--view-space is the input of a LUT, which --view {} is not",
                    view.name()
                ))),
            };
        }
        let bytes = read_regular(&self.view, MOST_BYTES)?;
        let path = self.view.display();
        let (lut, assumed) = Lut::parse(&String::from_utf8_lossy(&bytes), self.view_space)
            .map_err(|why| Error::Data(format!("{path}: cannot use this LUT: {why}")))?;
        if assumed {
            warn!("{path} does not say what it takes: linear Rec. 709 is assumed; --view-space says it");
        }
        let key = format!("lut {} of {:?}", blake3::hash(&bytes).to_hex(), self.view_space);
        Ok(ViewTransform::Lut(Arc::new(lut), self.view.clone(), key))
    }
}
