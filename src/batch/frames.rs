//! Frames of a sequence: which ones, and where their numbers stand in names.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fmt;
use std::fs;
use std::ops::Range;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::file::Job;
use crate::Error;

/// Numbers of frames, each once, in the order in which they are rendered; at least one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Frames(Vec<u32>);

/// More frames in one sequence are taken for a mistake.
const MOST: usize = 100_000;
/// Likewise, higher numbers.
const HIGHEST: u32 = 9_999_999;
/// Files of a job whose names hold the frame's number, besides its picture.
const WRITTEN: [&str; 2] = ["preview", "stats"];

impl Frames {
    /// Their numbers.
    pub fn numbers(&self) -> &[u32] {
        &self.0
    }

    /// So many at a time.
    pub fn chunks(&self, each: usize) -> impl Iterator<Item = Self> {
        self.0.chunks(each.max(1)).map(|numbers| Self(numbers.to_vec()))
    }

    /// Numbers as ranges, with `by` before a step that is not 1.
    pub fn text_of(numbers: &[u32], by: char) -> String {
        let range = |[first, last, step]: [u32; 3]| match (first == last, step) {
            (true, _) => first.to_string(),
            (false, 1) => format!("{first}-{last}"),
            (false, step) => format!("{first}-{last}{by}{step}"),
        };
        Self::ranges_of(numbers).into_iter().map(range).collect::<Vec<_>>().join(",")
    }

    /// First, last and step of each row of equal steps.
    fn ranges_of(numbers: &[u32]) -> Vec<[u32; 3]> {
        let mut ranges: Vec<[u32; 3]> = Vec::new();
        for &n in numbers {
            match ranges.last_mut() {
                Some([first, last, step]) if n > *last && (first == last || n - *last == *step) => {
                    (*step, *last) = (n - *last, n);
                }
                _ => ranges.push([n, n, 1]),
            }
        }
        // Two make no row, unless they are neighbours.
        let pair = |[first, last, step]: &[u32; 3]| step > &1 && last - first == *step;
        ranges
            .into_iter()
            .flat_map(|r| if pair(&r) { vec![[r[0], r[0], 1], [r[1], r[1], 1]] } else { vec![r] })
            .collect()
    }
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str, what: &str| {
            let digits = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            let number = if digits { text.parse().ok().filter(|n| *n <= HIGHEST) } else { None };
            number.ok_or(format!(
                "'{text}' is no {what}: whole numbers from 0 to {HIGHEST}, as in 1-240, 1-240x2 or 7,12,40-44"
            ))
        };
        let (mut frames, mut seen) = (Vec::new(), BTreeSet::new());
        for item in text.split(',').map(str::trim) {
            let (range, step) = match item.split_once('x') {
                Some((range, step)) => (range, number(step.trim(), "step between frames")?),
                None => (item, 1),
            };
            let (first, last) = match range.split_once('-') {
                Some((first, last)) => (number(first.trim(), "frame")?, number(last.trim(), "frame")?),
                None if item == range => (number(range, "frame")?, number(range, "frame")?),
                None => return Err(format!("'{item}': a step belongs to a range, as in 1-240x2")),
            };
            if step == 0 {
                return Err(format!("'{item}': a step is 1 or more"));
            }
            if last < first {
                return Err(format!("'{item}' ends before it begins; write {last}-{first}"));
            }
            if frames.len() + ((last - first) / step) as usize >= MOST {
                return Err(format!("'{text}' is more than {MOST} frames"));
            }
            for frame in (first..=last).step_by(step as usize) {
                if !seen.insert(frame) {
                    return Err(format!("'{text}' names frame {frame} twice"));
                }
                frames.push(frame);
            }
        }
        Ok(Self(frames))
    }
}

impl fmt::Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&Self::text_of(&self.0, 'x'))
    }
}

impl From<Frames> for String {
    fn from(frames: Frames) -> Self {
        frames.to_string()
    }
}

impl TryFrom<String> for Frames {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// Where a frame's number first stands in a name, and how many digits it has at least: the first `{frame}` or `{frame:04}`,
/// else the last row of `#`.
fn place(name: &[u8]) -> Option<(Range<usize>, usize)> {
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
    while let Some((range, digits)) = place(&name) {
        let last = name[range.start] == b'#';
        name.splice(range, format!("{frame:0digits$}").into_bytes());
        found = true;
        if last {
            break;
        }
    }
    found.then_some(name)
}

/// A name with a frame's number wherever it has a place for it (every `{frame:04}`, the last row of `#`); `None` if it has
/// none.
pub fn numbered_name(name: &str, frame: u32) -> Option<String> {
    numbered_bytes(name.as_bytes(), frame).and_then(|bytes| String::from_utf8(bytes).ok())
}

/// As [`numbered_name`], of a path, whose folders hold no frame's number.
pub fn numbered(path: &Path, frame: u32) -> Option<PathBuf> {
    let name = numbered_bytes(path.file_name()?.as_bytes(), frame)?;
    Some(path.with_file_name(OsString::from_vec(name)))
}

/// The frame whose number stands in this name, where the pattern has its place.
pub fn number_of(pattern: &Path, name: &Path) -> Option<u32> {
    let (start, bytes) = (place(pattern.file_name()?.as_bytes())?.0.start, name.file_name()?.as_bytes());
    let digits = bytes.get(start..)?.iter().take_while(|b| b.is_ascii_digit()).count();
    // Digits may go on behind the place: the longest number that gives this very name is meant.
    let number = |end: usize| std::str::from_utf8(&bytes[start..end]).ok()?.parse().ok();
    (start + 1..=start + digits).rev().filter_map(number).find(|&n| numbered(pattern, n).as_deref() == Some(name))
}

/// Numbers of the frames whose files are there under such a name, in order.
///
/// # Errors
/// As the folder's system says.
pub fn present(pattern: &Path) -> Result<Vec<u32>, Error> {
    let folder = pattern.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = fs::read_dir(folder).map_err(|e| Error::reading(folder, &e))?;
    let names = entries.flatten().map(|entry| pattern.with_file_name(entry.file_name()));
    let mut numbers: Vec<u32> = names.filter_map(|name| number_of(pattern, &name)).collect();
    numbers.sort_unstable();
    Ok(numbers)
}

/// A name with a place for a frame's number, at its end if it has none.
pub fn with_place(name: String) -> String {
    if place(name.as_bytes()).is_some() { name } else { name + ".####" }
}

/// A job for each frame of one with `frames`; a job without them, as it is.
///
/// # Errors
/// The flag, and what is wrong with it.
pub fn split(job: Job) -> Result<Vec<Job>, (String, String)> {
    let Some(at) = job.flags.iter().position(|(name, _)| name == "frames") else { return Ok(vec![job]) };
    let mut job = job;
    let (flag, text) = job.flags.remove(at);
    let frames: Frames = text.unwrap_or_default().parse().map_err(|why| (flag.clone(), format!("`frames`: {why}")))?;
    let own_seeds = job.flags.iter().any(|(name, _)| name == "seed-per-frame");
    let no_place = |name: &str, file: &Path| {
        let why =
            format!("{} names one file for all frames; write their number as #### or {{frame:04}}", file.display());
        (name.to_owned(), format!("`{name}`: {why}"))
    };
    let one = |&frame: &u32| -> Result<Job, (String, String)> {
        let mut one = job.clone();
        one.name = numbered_name(&with_place(job.name.clone()), frame).unwrap_or_default();
        one.output = numbered(&job.output, frame).ok_or_else(|| no_place("output", &job.output))?;
        for (name, value) in one.flags.iter_mut().filter(|(name, _)| WRITTEN.contains(&name.as_str())) {
            let Some(file) = value else { continue };
            let path = numbered(Path::new(&file), frame).ok_or_else(|| no_place(name, Path::new(&file)))?;
            *file = path.to_string_lossy().into_owned();
        }
        one.flags.push(("frame".into(), Some(frame.to_string())));
        if !own_seeds {
            one.flags.push(("seed-per-frame".into(), Some("true".into())));
        }
        Ok(one)
    };
    frames.numbers().iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_steps_and_lists_are_read_and_written() {
        for (text, numbers, written) in [
            ("1-5", vec![1, 2, 3, 4, 5], "1-5"),
            ("1-10x4", vec![1, 5, 9], "1-9x4"),
            ("7, 12 ,40-42", vec![7, 12, 40, 41, 42], "7,12,40-42"),
            ("0", vec![0], "0"),
            ("5,3,1", vec![5, 3, 1], "5,3,1"),
            ("1,2", vec![1, 2], "1-2"),
            ("1-2x1", vec![1, 2], "1-2"),
            ("10-10x7", vec![10], "10"),
        ] {
            let frames: Frames = text.parse().unwrap();
            assert_eq!((frames.numbers(), frames.to_string().as_str()), (&numbers[..], written));
            assert_eq!(written.parse::<Frames>().unwrap(), frames);
        }
        let chunks: Vec<_> = "1-7".parse::<Frames>().unwrap().chunks(3).map(String::from).collect();
        assert_eq!(chunks, ["1-3", "4-6", "7"]);
    }

    #[test]
    fn what_is_no_frames_says_why() {
        for (text, why) in [
            ("", "is no frame"),
            ("1-1e9", "is no frame"),
            ("1-1000000000", "is no frame"),
            ("0-9999999", "more than"),
            ("5-1", "write 1-5"),
            ("1-5x0", "1 or more"),
            ("5x2", "belongs to a range"),
            ("-3", "is no frame"),
            ("1--3", "is no frame"),
            ("+1", "is no frame"),
            ("1.5", "is no frame"),
            ("1,,2", "is no frame"),
            ("1-5,3", "frame 3 twice"),
            ("١", "is no frame"),
            ("1-5x2x2", "is no step"),
        ] {
            let refused = text.parse::<Frames>().unwrap_err();
            assert!(refused.contains(why), "{text}: {refused}");
        }
    }

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
        assert_eq!((with_place("hall".into()), with_place("h#".into())), ("hall.####".into(), "h#".into()));
    }
}
