//! Lookup tables of colours (LUTs) in `.cube` files, as Resolve, Nuke, OpenColorIO and Adobe's programs write them: a table for
//! each channel, a table of three dimensions, or the first (a shaper) before the second. Adobe's "Cube LUT Specification" 1.0,
//! and Resolve's input ranges.

use std::fmt::{self, Display};
use std::path::Path;
use std::str::FromStr;

use glam::Vec3;

use crate::color::ColorSpace;

/// Most nodes along a side of a table of three dimensions.
const MOST_3D: usize = 129;
/// Most nodes of a table of one dimension, as Adobe's specification allows.
const MOST_1D: usize = 65_536;

/// What a LUT takes: scene-linear radiance in the primaries of a space, through a curve. Text form: `rec709`, `acescg`,
/// `rec2020` (linear); `acescct`; `log2:MIN,MAX`, of Rec. 709, or after `acescg-` or `rec2020-`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LutInput {
    primaries: ColorSpace,
    curve: Curve,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Curve {
    Linear,
    /// S-2016-001.
    Acescct,
    /// From log2 = `min`, which becomes 0, to log2 = `max`, which becomes 1: the allocation `lg2` of OpenColorIO.
    Log2 {
        min: f32,
        max: f32,
    },
}

/// Nodes of a table, and the values of the channels at its first and its last one.
#[derive(Debug, Clone, PartialEq)]
struct Table {
    size: usize,
    low: Vec3,
    high: Vec3,
    /// Of three dimensions the red changes first.
    values: Vec<Vec3>,
}

/// A LUT whose result is display-encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Lut {
    input: LutInput,
    shaper: Option<Table>,
    cube: Option<Table>,
}

/// Is this the name of a LUT's file?
pub fn is_lut(name: impl AsRef<Path>) -> bool {
    name.as_ref().extension().is_some_and(|ending| ending.eq_ignore_ascii_case("cube"))
}

impl Display for LutInput {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match (self.curve, self.primaries) {
            (Curve::Linear, primaries) => write!(f, "{}", primaries.name()),
            (Curve::Acescct, _) => write!(f, "acescct"),
            (Curve::Log2 { min, max }, ColorSpace::Rec709) => write!(f, "log2:{min},{max}"),
            (Curve::Log2 { min, max }, primaries) => write!(f, "{}-log2:{min},{max}", primaries.name()),
        }
    }
}

impl FromStr for LutInput {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim().to_ascii_lowercase();
        let named = |name: &str| ColorSpace::ALL.into_iter().find(|space| space.name() == name);
        let of = |primaries, curve| Some(Self { primaries, curve });
        let log = || {
            let (primaries, range) = text.split_once("log2:")?;
            let primaries =
                if primaries.is_empty() { ColorSpace::Rec709 } else { named(primaries.strip_suffix('-')?)? };
            let (min, max) = range.split_once(',')?;
            let (min, max) = (min.trim().parse().ok()?, max.trim().parse().ok()?);
            (-126.0 <= min && min < max && max <= 127.0).then_some(Self { primaries, curve: Curve::Log2 { min, max } })
        };
        let found = match (named(&text), text.as_str()) {
            (Some(primaries), _) => of(primaries, Curve::Linear),
            (None, "acescct") => of(ColorSpace::Acescg, Curve::Acescct),
            _ => log(),
        };
        found.ok_or_else(|| {
            format!(
                "'{text}' is none of rec709, acescg, rec2020 (linear), acescct, and log2:MIN,MAX as in log2:-10,6.5, also \
                 acescg-log2:…"
            )
        })
    }
}

impl Table {
    /// Places of values between the nodes: the node below of each channel, and the fraction to the next one.
    fn place(&self, color: Vec3) -> [(usize, f32); 3] {
        let last = (self.size - 1) as f32;
        let at = ((color - self.low) / (self.high - self.low)).clamp(Vec3::ZERO, Vec3::ONE) * last;
        at.to_array().map(|at| {
            let node = at.floor().min(last - 1.0);
            (node as usize, at - node)
        })
    }

    /// Linear interpolation of each channel.
    fn curve(&self, color: Vec3) -> Vec3 {
        let at = self.place(color);
        let one = |c: usize| {
            let ((node, fraction), value) = (at[c], |node: usize| self.values[node][c]);
            value(node) + fraction * (value(node + 1) - value(node))
        };
        Vec3::new(one(0), one(1), one(2))
    }

    /// Tetrahedral interpolation (Kasson et al. 1995): from the lowest corner of a cell along its axes, that of the largest
    /// fraction first.
    fn cell(&self, color: Vec3) -> Vec3 {
        let at = self.place(color);
        let strides = [1, self.size, self.size * self.size];
        let mut axes = [0, 1, 2];
        axes.sort_by(|a, b| at[*b].1.total_cmp(&at[*a].1));
        let mut node: usize = (0..3).map(|axis| at[axis].0 * strides[axis]).sum();
        let mut result = self.values[node];
        for axis in axes {
            let next = node + strides[axis];
            result += at[axis].1 * (self.values[next] - self.values[node]);
            node = next;
        }
        result
    }
}

impl Lut {
    /// Reads a `.cube` file, with keywords in any case. Its input is `input`, or what a comment `# input space: ACEScct` says, or
    /// linear Rec. 709; `true` where neither says it.
    ///
    /// # Errors
    /// The defect, as a part of a sentence: what is no such file, tables of 1 node or too many, numbers that are not finite,
    /// and video ranges.
    pub fn parse(text: &str, input: Option<LutInput>) -> Result<(Self, bool), String> {
        let mut sizes = [None; 2];
        let mut ranges = [[Vec3::ZERO, Vec3::ONE]; 2];
        let (mut rows, mut stated, mut expected) = (Vec::new(), input, 0);
        let text = text.trim_start_matches('\u{feff}').trim_end_matches('\0').replace("\r\n", "\n");
        for (line, number) in text.split(['\n', '\r']).zip(1..) {
            let at = |why: &str| format!("line {number}: {why}");
            let (line, comment) = line.split_once('#').unwrap_or((line, ""));
            let comment = comment.trim().to_ascii_lowercase();
            // A space that is none of ours is a comment of another program.
            stated = stated.or_else(|| comment.strip_prefix("input space:")?.parse().ok());
            let mut words = line.split_whitespace();
            let Some(first) = words.next().map(str::to_ascii_uppercase).filter(|first| first != "TITLE") else {
                continue;
            };
            let numbers = |words: &mut dyn Iterator<Item = &str>| -> Result<Vec<f32>, String> {
                let parsed: Option<Vec<f32>> =
                    words.map(|word| word.parse().ok().filter(|x: &f32| x.is_finite())).collect();
                parsed.ok_or_else(|| at("not finite numbers"))
            };
            if first.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) {
                let &[r, g, b] = &numbers(&mut line.split_whitespace())?[..] else {
                    return Err(at("not three numbers"));
                };
                rows.push(Vec3::new(r, g, b));
                if rows.len() > expected {
                    return Err(at(&format!("more than the {expected} rows of its tables")));
                }
                continue;
            }
            let values = numbers(&mut words)?;
            match (&first[..], &values[..]) {
                ("LUT_1D_SIZE" | "LUT_3D_SIZE", &[size]) if rows.is_empty() => {
                    let (which, most) = if first == "LUT_1D_SIZE" { (0, MOST_1D) } else { (1, MOST_3D) };
                    if size.fract() != 0.0 || !(2.0..=most as f32).contains(&size) {
                        return Err(at(&format!("a table of {size} nodes a side: 2 to {most} are possible")));
                    }
                    sizes[which] = Some(size as usize);
                    expected = sizes[0].unwrap_or(0) + sizes[1].map_or(0, |size: usize| size.pow(3));
                }
                ("DOMAIN_MIN", &[r, g, b]) => ranges.iter_mut().for_each(|range| range[0] = Vec3::new(r, g, b)),
                ("DOMAIN_MAX", &[r, g, b]) => ranges.iter_mut().for_each(|range| range[1] = Vec3::new(r, g, b)),
                ("LUT_1D_INPUT_RANGE", &[low, high]) => ranges[0] = [low, high].map(Vec3::splat),
                ("LUT_3D_INPUT_RANGE", &[low, high]) => ranges[1] = [low, high].map(Vec3::splat),
                ("LUT_IN_VIDEO_RANGE" | "LUT_OUT_VIDEO_RANGE", _) => {
                    return Err(at("video ranges are not supported: export it for full range"));
                }
                _ => return Err(at("not understood as a line of a .cube file")),
            }
        }
        if expected == 0 || rows.len() != expected {
            return Err(format!("{} rows, where LUT_1D_SIZE and LUT_3D_SIZE ask for {expected}", rows.len()));
        }
        if ranges.iter().any(|[low, high]| !low.cmplt(*high).all() || !(*high - *low).is_finite()) {
            return Err("an input range that does not end above its start".into());
        }
        let cube = rows.split_off(sizes[0].unwrap_or(0));
        let table = |which: usize, values: Vec<Vec3>| {
            sizes[which].map(|size| Table { size, low: ranges[which][0], high: ranges[which][1], values })
        };
        let default = LutInput { primaries: ColorSpace::Rec709, curve: Curve::Linear };
        let lut = Self { input: stated.unwrap_or(default), shaper: table(0, rows), cube: table(1, cube) };
        Ok((lut, stated.is_none()))
    }

    /// Display-encoded RGB of linear Rec. 709, whose values are finite.
    pub fn apply(&self, color: [f32; 3]) -> Vec3 {
        let color = self.input.primaries.from_rec709() * Vec3::from(color);
        let color = match self.input.curve {
            Curve::Linear => color,
            Curve::Acescct => color.map(|x| match x <= 0.007_812_5 {
                true => 10.540_238 * x + 0.072_905_53,
                false => (x.log2() + 9.72) / 17.52,
            }),
            Curve::Log2 { min, max } => color.map(|x| (x.max(f32::MIN_POSITIVE).log2() - min) / (max - min)),
        };
        let color = self.shaper.as_ref().map_or(color, |shaper| shaper.curve(color));
        self.cube.as_ref().map_or(color, |cube| cube.cell(color))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: &str = "TITLE \"x\"\n# Input space: log2:-8, 8\nLUT_3D_SIZE 2\nLUT_3D_INPUT_RANGE 0 1\n\
                        0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n1 0 1\n0 1 1\n1 1 .5\n";

    #[test]
    fn shapers_ranges_and_tetrahedra_are_those_of_the_file() {
        let (lut, assumed) = Lut::parse(CUBE, None).unwrap();
        assert!(!assumed);
        // 0.75, 0.5 and 0.25 on the curve: along red, then green, then blue, whose last edge is from (1, 1, 0) to (1, 1, 0.5).
        let found = lut.apply([16.0, 1.0, 1.0 / 16.0]);
        assert!(found.abs_diff_eq(Vec3::new(0.75, 0.5, 0.125), 1e-6), "{found}");
        let (linear, _) = Lut::parse(CUBE, Some("rec709".parse().unwrap())).unwrap();
        assert!(linear.apply([0.25, 0.125, -3.0]).abs_diff_eq(Vec3::new(0.25, 0.125, 0.0), 1e-6));

        let both =
            "LUT_1D_SIZE 3\nLUT_1D_INPUT_RANGE -1 3\nLUT_3D_SIZE 2\nLUT_3D_INPUT_RANGE 0 10\n0 0 0\n5 5 5\n10 10 0\n";
        let (lut, assumed) = Lut::parse(&(both.to_owned() + &CUBE[CUBE.find("0 0 0").unwrap()..]), None).unwrap();
        assert!(assumed);
        // Between the nodes at -1, 1, 3: 2.5, 7.5, and in blue 2.5 after 5; the last edge is half as long.
        let found = lut.apply([0.0, 2.0, 2.0]);
        assert!(found.abs_diff_eq(Vec3::new(0.25, 0.75, 0.125), 1e-6), "{found}");

        let adobe = "DOMAIN_MIN 0 0 0\nDOMAIN_MAX 2 4 8\nLUT_1D_SIZE 2\n0 0 0\n1 1 1\n";
        let (lut, _) = Lut::parse(adobe, None).unwrap();
        assert!(lut.apply([1.0, 1.0, 1.0]).abs_diff_eq(Vec3::new(0.5, 0.25, 0.125), 1e-6));
        let (lut, _) = Lut::parse("LUT_1D_SIZE 2\n0 0 0\n1 1 1\n", Some("ACEScct".parse().unwrap())).unwrap();
        // S-2016-001: middle grey.
        assert!(lut.apply([0.18; 3]).abs_diff_eq(Vec3::splat(0.413_588), 1e-5), "{}", lut.apply([0.18; 3]));
    }

    #[test]
    fn keywords_line_ends_and_comments_are_as_programs_and_editors_leave_them() {
        let plain = Lut::parse(CUBE, None).unwrap();
        let lower = CUBE.replace("LUT_3D", "lut_3d").replace("TITLE", "Title");
        let remarks = CUBE.replace("SIZE 2", "SIZE 2 # nodes").replace("\n1 0 0", "\n1 0 0\t# red\n\n#\n");
        let ends = [
            CUBE.replace('\n', "\r\n"),
            CUBE.replace('\n', "\r"),
            format!("{CUBE}\0\0"),
            format!("\u{feff}{CUBE}\n \n"),
        ];
        for text in ends.into_iter().chain([lower, remarks]) {
            assert_eq!(Lut::parse(&text, None).unwrap(), plain, "{text:?}");
        }
        for space in ["Linear Rec.709", "S-Gamut3.Cine/S-Log3", "sRGB", ""] {
            let (lut, assumed) = Lut::parse(&CUBE.replace("log2:-8, 8", space), None).unwrap();
            assert!(assumed && lut.input == "rec709".parse().unwrap(), "{space}");
        }
    }

    #[test]
    fn what_is_no_lut_is_refused_with_its_line() {
        let rows = "0 0 0\n1 1 1\n";
        for (text, why) in [
            ("".into(), "0 rows"),
            (rows.to_owned(), "line 1: more than the 0 rows"),
            (format!("LUT_1D_SIZE 3\n{rows}"), "2 rows, where"),
            (format!("LUT_1D_SIZE 2\n{rows}0 0 0"), "line 4: more than"),
            ("LUT_3D_SIZE 1\n0 0 0".into(), "a table of 1 nodes"),
            ("LUT_3D_SIZE 1000000\n0 0 0".into(), "2 to 129"),
            ("LUT_3D_SIZE -2".into(), "2 to 129"),
            ("LUT_3D_SIZE 2.5".into(), "2 to 129"),
            ("LUT_1D_SIZE 2\n0 nan 0\n1 1 1".into(), "line 2: not finite"),
            ("LUT_1D_SIZE 2\n0 inf 0\n1 1 1".into(), "line 2: not finite"),
            ("LUT_1D_SIZE 2\n0 1e99 0\n1 1 1".into(), "line 2: not finite"),
            ("LUT_1D_SIZE 2\n0 0\n1 1".into(), "line 2: not three"),
            (format!("LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 1 1\n{rows}"), "range"),
            (format!("LUT_1D_SIZE 2\nDOMAIN_MIN 0 2 0\n{rows}"), "range"),
            (format!("LUT_1D_SIZE 2\nLUT_IN_VIDEO_RANGE\n{rows}"), "video"),
            (format!("LUT_1D_SIZE 2\0\n{rows}"), "line 1: not finite"),
            ("L\0U\0T\0_\x001\0D\0".into(), "line 1: not understood"),
            ("PNG".into(), "line 1: not understood"),
        ] {
            let said = Lut::parse(&text, None).unwrap_err();
            assert!(said.contains(why), "{text}: {said}");
        }
        for bad in ["", "log2:", "log2:1,1", "log2:nan,2", "log2:-10,1e9", "p3-log2:-8,8", "linear"] {
            assert!(bad.parse::<LutInput>().is_err(), "{bad}");
        }
    }
}
