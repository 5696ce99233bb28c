//! Frame numbers in file names.

use std::ffi::OsString;
use std::fs;
use std::ops::Range;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

use crate::Error;
use crate::film::atomic::folder_of;

/// Byte range of the first placeholder for the frame number in a name, and its minimum number of digits: the first `{frame}`
/// or `{frame:04}`, else the last run of `#`.
fn placeholder(name: &[u8]) -> Option<(Range<usize>, usize)> {
    const OPEN: &[u8] = b"{frame";
    for start in 0..name.len() {
        let Some(rest) = name[start..].strip_prefix(OPEN) else { continue };
        match rest {
            [b'}', ..] => return Some((start..start + OPEN.len() + 1, 1)),
            [b':', b'0', digit @ b'1'..=b'9', b'}', ..] => {
                return Some((start..start + OPEN.len() + 4, usize::from(digit - b'0')));
            }
            _ => {}
        }
    }
    let end = name.iter().rposition(|b| *b == b'#')? + 1;
    let start = name[..end].iter().rposition(|b| *b != b'#').map_or(0, |at| at + 1);
    Some((start..end, end - start))
}

fn numbered_bytes(name: &[u8], frame: u32) -> Option<Vec<u8>> {
    let (mut name, mut found) = (name.to_vec(), false);
    while let Some((range, digits)) = placeholder(&name) {
        let last = name[range.start] == b'#';
        name.splice(range, format!("{frame:0digits$}").into_bytes());
        found = true;
        if last {
            break;
        }
    }
    found.then_some(name)
}

/// The name with the frame number in place of every `{frame:04}` and of the last run of `#`; `None` if it has no
/// placeholder.
pub(crate) fn numbered_name(name: &str, frame: u32) -> Option<String> {
    numbered_bytes(name.as_bytes(), frame).and_then(|bytes| String::from_utf8(bytes).ok())
}

/// The path with the frame number in its file name (see [`numbered_name`]); folders have no placeholders.
pub(crate) fn numbered(path: &Path, frame: u32) -> Option<PathBuf> {
    let name = numbered_bytes(path.file_name()?.as_bytes(), frame)?;
    Some(path.with_file_name(OsString::from_vec(name)))
}

/// The frame number that `name` has where `pattern` has its placeholder.
fn number_of(pattern: &Path, name: &Path) -> Option<u32> {
    let (start, bytes) = (placeholder(pattern.file_name()?.as_bytes())?.0.start, name.file_name()?.as_bytes());
    let digits = bytes.get(start..)?.iter().take_while(|b| b.is_ascii_digit()).count();
    // Digits may follow the placeholder: the longest number that gives this name is the frame.
    let number = |end: usize| std::str::from_utf8(&bytes[start..end]).ok()?.parse().ok();
    (start + 1..=start + digits).rev().filter_map(number).find(|&n| numbered(pattern, n).as_deref() == Some(name))
}

/// Numbers of the frames whose files exist, ascending.
/// Errors: [`Error::reading`] of the folder.
pub fn present(pattern: &Path) -> Result<Vec<u32>, Error> {
    let folder = folder_of(pattern);
    let entries = fs::read_dir(folder).map_err(|e| Error::reading(folder, &e))?;
    let names = entries.flatten().map(|entry| pattern.with_file_name(entry.file_name()));
    let mut numbers: Vec<u32> = names.filter_map(|name| number_of(pattern, &name)).collect();
    numbers.sort_unstable();
    Ok(numbers)
}

/// The name with a placeholder for the frame number, appended if it has none.
pub(crate) fn with_placeholder(name: String) -> String {
    if placeholder(name.as_bytes()).is_some() { name } else { name + ".####" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_where_the_last_place_is() {
        for (name, numbered) in [
            ("a.####.exr", Some("a.0042.exr")),
            ("a#b.##.exr", Some("a#b.42.exr")),
            ("a.{frame:06}.exr", Some("a.000042.exr")),
            ("{frame}-{frame:03}-##.exr", Some("42-042-42.exr")),
            ("#", Some("42")),
            ("a.exr", None),
            ("a.{frame:4}.exr", None),
            ("a.{frame:04.exr", None),
        ] {
            assert_eq!(numbered_name(name, 42).as_deref(), numbered, "{name}");
        }
        assert_eq!(numbered(Path::new("c#/out.exr"), 1), None);
        assert_eq!(numbered(Path::new("c#/o#.exr"), 12345), Some("c#/o12345.exr".into()));
        let of = |pattern: &str, name: &str| number_of(Path::new(pattern), Path::new(name));
        assert_eq!(of("d/a.####.png", "d/a.0042.png"), Some(42));
        assert_eq!(of("a#7.png", "a127.png"), Some(12));
        for (pattern, name) in [("a.##.png", "a.7.png"), ("a.#.png", "a.07.png"), ("a.#.png", "b.7.png"), ("a", "a")] {
            assert_eq!(of(pattern, name), None, "{pattern} {name}");
        }
        assert_eq!((with_placeholder("hall".into()), with_placeholder("h#".into())), ("hall.####".into(), "h#".into()));
    }
}
