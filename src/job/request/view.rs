//! `--view` and `--view-space`: a view transform of the program, or a LUT.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::sync::Arc;

use clap::builder::{PossibleValue, TypedValueParser};
use clap::{Arg, Args, Command, ValueHint};
use serde::{Deserialize, Serialize};
use tracing::warn;

use super::values::value_of;
use super::wire;

use crate::film::lut::is_lut;
use crate::film::{Lut, LutInput, View, ViewTransform};
use crate::scene::import::read_regular;
use crate::{Error, Result};

/// How a picture to look at is made.
#[derive(Debug, Clone, Args, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub struct ViewOptions {
    /// View transform of the PNG: one of these, or a LUT (.cube) whose result is display-encoded.
    #[arg(long, value_parser = ViewParser, default_value = View::Agx.name(), value_name = "VIEW|FILE.cube",
        value_hint = ValueHint::Other, help_heading = "Output")]
    #[serde(with = "wire::path")]
    pub view: PathBuf,
    /// What the LUT takes: linear rec709, acescg or rec2020; acescct; or log2:MIN,MAX, in stops of linear Rec. 709 (also
    /// acescg-log2:MIN,MAX) [default: as its comment `# input space: SPACE` says, else rec709].
    #[arg(long, value_name = "SPACE", allow_hyphen_values = true, help_heading = "Output")]
    #[serde(with = "wire::optional_text")]
    view_space: Option<LutInput>,
}

impl Default for ViewOptions {
    fn default() -> Self {
        Self { view: View::Agx.name().into(), view_space: None }
    }
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

impl ViewOptions {
    /// Checks that a space is that of a LUT.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self) -> Result<()> {
        if self.view_space.is_none() || is_lut(&self.view) {
            return Ok(());
        }
        let view = self.view.display();
        Err(Error::Usage(format!("--view-space is the input of a LUT, which --view {view} is not")))
    }

    /// The view transform; reads the LUT.
    ///
    /// # Errors
    /// [`Error::reading`]; [`Error::Data`] for a file that is no LUT; [`Error::Usage`] for a space without a LUT.
    pub fn transform(&self) -> Result<ViewTransform> {
        self.check()?;
        if let Some(view) = View::ALL.into_iter().find(|view| self.view.as_os_str() == view.name()) {
            return Ok(view.into());
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
