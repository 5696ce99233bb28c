//! Values of flags that several commands take.

use std::str::FromStr;

/// A number of threads, for `value_parser`.
///
/// # Errors
/// What is wrong with it, for clap.
pub fn threads(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| (1..=4096).contains(n)).ok_or("not a number from 1 to 4096".into())
}

/// A picture's size in pixels, `WxH`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size(pub u32, pub u32);

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const MOST: u32 = 1 << 16;
        let side = |s: &str| s.parse().ok().filter(|n| (1..=MOST).contains(n));
        let sides = text.split_once('x').and_then(|(w, h)| Some(Size(side(w)?, side(h)?)));
        sides.ok_or(format!("not WIDTHxHEIGHT in pixels, each from 1 to {MOST}, as in 960x540"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_numbers_of_pixels() {
        assert_eq!("960x540".parse(), Ok(Size(960, 540)));
        for bad in ["", "960", "960x", "0x5", "-1x5", "960X540", "70000x1", "1x1x1"] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
    }
}
