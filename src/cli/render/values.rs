//! Values of the flags of `bismar render` that are for the command line alone.

use crate::farm::array::{ArrayTask, array_task};
use crate::render::Part;

type Parsed<T> = std::result::Result<T, String>;

/// Value of `--part`: K/N; or `auto` or `auto/N`, for the part of this task of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartFlag {
    pub part: Part,
    /// Whether the scheduler chose it, so that all parts have one command.
    pub is_auto: bool,
}

pub(crate) fn part_flag(text: &str) -> Parsed<PartFlag> {
    match text.strip_prefix("auto") {
        Some(rest) => array_task().and_then(|task| part_of(task, rest)).map(|part| PartFlag { part, is_auto: true }),
        None => text.parse().map(|part| PartFlag { part, is_auto: false }),
    }
}

/// The part of a task of an array; `rest` is what follows `auto`.
fn part_of(task: ArrayTask, rest: &str) -> Parsed<Part> {
    let ArrayTask { number, of } = task;
    let given = match rest.strip_prefix('/') {
        Some(count) => Some(count.parse().ok().filter(|n| *n > 0).ok_or("not auto/N with N parts, as in auto/8")?),
        None if rest.is_empty() => None,
        None => return Err("not auto nor auto/N, as in auto/8".into()),
    };
    let of = given.or(of).ok_or("the scheduler does not tell the number of parts: write auto/N, as in auto/8")?;
    if number > of {
        return Err(format!("this is task {number} of the array, but there are {of} parts"));
    }
    Ok(Part { number, of })
}

/// `X,Y[,N]`: a pixel of the full picture from the top left, and the index of one of its paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelPath {
    pub pixel: [u32; 2],
    pub path: Option<u32>,
}

pub(crate) fn pixel_path(text: &str) -> Parsed<PixelPath> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y]) => Ok(PixelPath { pixel: [x, y], path: None }),
        Some(&[x, y, n]) => Ok(PixelPath { pixel: [x, y], path: Some(n) }),
        _ => Err("not X,Y or X,Y,N: a pixel from the top left and the index of a path, as in 17,4,3".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_of_an_array_is_a_part() {
        let task = |number, of| ArrayTask { number, of };
        assert_eq!(part_of(task(3, Some(8)), ""), Ok(Part { number: 3, of: 8 }));
        assert_eq!(part_of(task(3, None), "/4"), Ok(Part { number: 3, of: 4 }));
        // The number of parts that the command states wins: arrays can be larger.
        assert_eq!(part_of(task(3, Some(8)), "/4"), Ok(Part { number: 3, of: 4 }));
        for (task, rest, why) in [
            (task(3, None), "", "write auto/N"),
            (task(5, None), "/4", "task 5 of the array, but there are 4 parts"),
            (task(1, None), "/0", "not auto/N"),
            (task(1, Some(2)), "matic", "not auto nor"),
        ] {
            assert!(part_of(task, rest).unwrap_err().contains(why), "{rest}");
        }
    }

    #[test]
    fn places_are_read_or_refused() {
        assert_eq!(pixel_path("17,4"), Ok(PixelPath { pixel: [17, 4], path: None }));
        assert_eq!(pixel_path("0, 0,12"), Ok(PixelPath { pixel: [0, 0], path: Some(12) }));
        for bad in ["", "1", "1,", "-1,2", "1,2,3,4", "a,b", "1.5,2", "99999999999,1"] {
            assert!(pixel_path(bad).is_err(), "{bad}");
        }
    }
}
