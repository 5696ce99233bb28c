//! Frames of a sequence.

use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Frame numbers in the order in which they are rendered; at least one, none twice. Text form: `1-240x2,250`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Frames(Vec<u32>);

/// Most frames of a sequence; more are assumed to be a mistake.
const MAX_FRAMES: usize = 100_000;
/// Largest frame number; larger ones are assumed to be a mistake.
const MAX_FRAME_NUMBER: u32 = 9_999_999;

impl Frames {
    pub fn numbers(&self) -> &[u32] {
        &self.0
    }

    /// Splits the frames into sequences of at most `each`.
    pub fn chunks(&self, each: usize) -> impl Iterator<Item = Self> {
        self.0.chunks(each.max(1)).map(|numbers| Self(numbers.to_vec()))
    }

    /// Text of frame numbers as ranges, with `by` before a step other than 1.
    pub(crate) fn text_of(numbers: &[u32], by: char) -> String {
        let range = |[first, last, step]: [u32; 3]| match (first == last, step) {
            (true, _) => first.to_string(),
            (false, 1) => format!("{first}-{last}"),
            // Two numbers are a range only if they are consecutive.
            (false, step) if last - first == step => format!("{first},{last}"),
            (false, step) => format!("{first}-{last}{by}{step}"),
        };
        Self::ranges_of(numbers).into_iter().map(range).collect::<Vec<_>>().join(",")
    }

    /// First, last and step of each arithmetic progression.
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
        ranges
    }
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str, what: &str| {
            let digits = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            let number = if digits { text.parse().ok().filter(|n| *n <= MAX_FRAME_NUMBER) } else { None };
            number.ok_or(format!(
                "'{text}' is not a {what}: whole numbers from 0 to {MAX_FRAME_NUMBER}, as in 1-240, 1-240x2 or 7,12,40-44"
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
            if frames.len() + ((last - first) / step) as usize >= MAX_FRAMES {
                return Err(format!("'{text}' is more than {MAX_FRAMES} frames"));
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

/// What makes a job many pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Sequence {
    Frames(Frames),
    /// This number of views around the scene.
    Turntable(u32),
    /// The cameras of a file.
    Cameras(PathBuf),
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
            ("", "is not a frame"),
            ("1-1e9", "is not a frame"),
            ("1-1000000000", "is not a frame"),
            ("0-9999999", "more than"),
            ("5-1", "write 1-5"),
            ("1-5x0", "1 or more"),
            ("5x2", "belongs to a range"),
            ("-3", "is not a frame"),
            ("1--3", "is not a frame"),
            ("+1", "is not a frame"),
            ("1.5", "is not a frame"),
            ("1,,2", "is not a frame"),
            ("1-5,3", "frame 3 twice"),
            ("١", "is not a frame"),
            ("1-5x2x2", "is not a step"),
        ] {
            let refused = text.parse::<Frames>().unwrap_err();
            assert!(refused.contains(why), "{text}: {refused}");
        }
    }
}
