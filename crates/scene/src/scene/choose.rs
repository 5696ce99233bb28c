//! Selection of cameras, scenes, variants and animations by name or index.

use crate::{Error, Result};

/// Index of the element that `--what wanted` selects: the only one of this name, else the one of this index.
///
/// # Errors
/// [`Error::Usage`] with a list of the elements.
pub fn choose(what: &str, wanted: &str, names: &[String]) -> Result<usize> {
    let named: Vec<usize> = (0..names.len()).filter(|&i| names[i] == wanted).collect();
    let index = || wanted.parse().ok().filter(|&index: &usize| index < names.len());
    let chosen = if named.is_empty() { index() } else { named.first().copied().filter(|_| named.len() == 1) };
    chosen.ok_or_else(|| {
        let list: String = names.iter().enumerate().map(|(i, name)| format!("\n  {i}  {name}")).collect();
        let why = match (names.len(), named.len()) {
            (0, _) => format!("the file has no {what}s"),
            (_, 0) => format!("there is no such {what}; there are:{list}"),
            (_, n) => format!("{n} {what}s have this name; choose by index:{list}"),
        };
        Error::Usage(format!("--{what} {wanted}: {why}"))
    })
}
