//! Parsers for flag values that several commands share.

use std::ffi::OsString;
use std::fmt::{self, Display};
use std::str::FromStr;

use super::host::MAX_THREADS;
use crate::render::settings::MAX_SIDE;

/// The process's arguments. `--adaptive`, which may stand alone before a file, is joined with a choice that follows it: all
/// choices are then written alike.
pub(crate) fn command_line() -> Vec<OsString> {
    joined(std::env::args_os())
}

fn joined(args: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut line: Vec<OsString> = Vec::new();
    for arg in args {
        match line.last_mut() {
            Some(last) if last == "--adaptive" && ["off", "on", "auto"].iter().any(|choice| arg == *choice) => {
                last.push("=");
                last.push(arg);
            }
            _ => line.push(arg),
        }
    }
    line
}

/// A number of threads, for `value_parser`.
pub fn threads(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| (1..=MAX_THREADS).contains(n)).ok_or("not a number from 1 to 4096".into())
}

/// A time above 0 in seconds, for `value_parser`: `90`, or with a unit, `90s`, `10m`, `1.5h`, `2d`.
pub fn seconds(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.find(|c: char| c.is_ascii_alphabetic() && c != 'e' && c != 'E') {
        Some(at) => text.split_at(at),
        None => (text, "s"),
    };
    let unit = [("s", 1.0), ("m", 60.0), ("h", 3600.0), ("d", 86400.0)].iter().find(|(name, _)| *name == unit);
    let seconds = unit.and_then(|(_, unit)| number.trim().parse::<f64>().ok().map(|number| number * unit));
    let seconds = seconds.filter(|s| *s > 0.0 && s.is_finite());
    seconds.ok_or("not a time above 0 in seconds, or with a unit: 90, 90s, 10m, 1.5h".into())
}

/// A time of 0 or more in seconds, for `value_parser`, with the units of [`seconds`].
pub fn wait(text: &str) -> Result<f64, String> {
    if text.trim().parse() == Ok(0.0) { Ok(0.0) } else { seconds(text) }
}

/// A finite number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    not_negative(text).ok().filter(|x| *x > 0.0).ok_or("not a number above 0".into())
}

/// A finite number of 0 or more.
pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| *x >= 0.0 && x.is_finite()).ok_or("not a number of 0 or more".into())
}

/// A picture's size in pixels, `WxH`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size(pub u32, pub u32);

impl Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}x{}", self.0, self.1)
    }
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |s: &str| s.parse().ok().filter(|n| (1..=MAX_SIDE).contains(n));
        let sides = text.split_once('x').and_then(|(w, h)| Some(Size(side(w)?, side(h)?)));
        sides.ok_or(format!("not WIDTHxHEIGHT in pixels, each from 1 to {MAX_SIDE}, as in 960x540"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_may_follow_a_flag_that_also_stands_alone() {
        let of = |line: &str| joined(line.split(' ').map(OsString::from)).join(" ".as_ref()).into_string().unwrap();
        assert_eq!(of("render --adaptive off a.glb"), "render --adaptive=off a.glb");
        for same in ["render --adaptive a.glb", "render --adaptive=on auto", "render a.glb --adaptive", "--guiding off"]
        {
            assert_eq!(of(same), same);
        }
    }

    #[test]
    fn times_have_units_or_are_seconds() {
        let times = ["90", "90s", "10m", "1.5h", "2d", "1e-3", "0.25"].map(seconds);
        assert_eq!(times, [90.0, 90.0, 600.0, 5400.0, 172800.0, 1e-3, 0.25].map(Ok));
        for bad in ["", "m", "0", "-1", "nan", "inf", "10 minutes", "1h30m", "10min", "1e400"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn waits_end_and_threads_are_counted() {
        assert_eq!((wait("0"), wait("0.5"), threads("4096")), (Ok(0.0), Ok(0.5), Ok(4096)));
        for bad in ["nan", "inf", "-1", ""] {
            assert!(wait(bad).is_err(), "{bad}");
        }
        for bad in ["0", "4097", "100000", "-1", "x"] {
            assert!(threads(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_are_two_numbers_of_pixels() {
        assert_eq!("960x540".parse(), Ok(Size(960, 540)));
        for bad in ["", "960", "960x", "0x5", "-1x5", "960X540", "70000x1", "1x1x1"] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
    }
}
