//! The result of a look.

use maud::Markup;
use serde_json::Value;

use super::sheet::Sheet;
use super::shots::Shot;
use crate::console::Verdict;

pub struct Looked {
    pub sheet: Sheet,
    /// The views, frame by frame; of a pair the old ones, then the new ones; none of folders.
    pub shots: Vec<Shot>,
    pub report: Value,
    /// What a person should read besides the sheet, line by line.
    pub lines: Vec<String>,
    /// The exit code's meaning.
    pub verdict: Verdict,
    /// The page of a pair, if it was asked for.
    pub page: Option<Markup>,
}

pub const SCHEMA: u32 = 1;
