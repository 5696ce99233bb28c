//! Radiance pictures (`.hdr`), read as Radiance's own library reads them (`color.c`, `resolu.c`): the signature of any program,
//! RGBE and XYZE, pixels without run lengths, with old and with new ones, and all eight orientations. `EXPOSURE` is not undone,
//! as in other renderers.

use glam::Mat3;

use crate::color;

/// Widths of scanlines that may have new run lengths.
const NEW_WIDTHS: std::ops::Range<usize> = 8..0x8000;
/// Radiance's standard primaries (`STDPRIMS` of `color.h`): x and y of red, green, blue and white.
const PRIMARIES: [f32; 8] = [0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 0.3333, 0.3333];

struct Head {
    size: [usize; 2],
    columns: bool,
    /// Do scanlines go down, and pixels from left to right?
    forward: [bool; 2],
    /// To Rec. 709, if the pixels are in another colour space.
    to_rec709: Option<Mat3>,
}

/// Width and height in pixels, by the header; `None` for a header that cannot be read.
pub fn size(bytes: &[u8]) -> Option<(u64, u64)> {
    let (Head { size: [width, height], .. }, _) = head(bytes).ok()?;
    Some((width as u64, height as u64))
}

/// Decodes a file: width, height, and linear Rec. 709 RGB by rows from the top. `fits` can refuse a width and height before
/// memory is allocated.
///
/// # Errors
/// The defect, as a part of a sentence.
pub fn decode(
    bytes: &[u8],
    fits: impl FnOnce(u64, u64) -> Result<(), String>,
) -> Result<(u32, u32, Vec<[f32; 3]>), String> {
    let (Head { size: [width, height], columns, forward: [down, right], to_rec709 }, mut rest) = head(bytes)?;
    fits(width as u64, height as u64)?;
    // Flat colours compress a thousandfold; small pictures always pass.
    if width * height > (1 << 26) + 256 * bytes.len() {
        return Err(format!("{width}x{height} pixels are more than its {} bytes can hold", bytes.len()));
    }
    let (lines, length) = if columns { (width, height) } else { (height, width) };
    let mut pixels = vec![[0.0; 3]; width * height];
    let mut line = vec![[0; 4]; length];
    for i in 0..lines {
        scanline(&mut rest, &mut line).ok_or_else(|| format!("scanline {} of {lines} is damaged or cut off", i + 1))?;
        for (j, &[r, g, b, exponent]) in line.iter().enumerate() {
            let (x, y) = if columns { (i, j) } else { (j, i) };
            let (x, y) = (if right { x } else { width - 1 - x }, if down { y } else { height - 1 - y });
            if exponent > 0 {
                let scale = f32::exp2(f32::from(exponent) - 136.0);
                pixels[y * width + x] = [r, g, b].map(|c| f32::from(c) * scale);
            }
        }
    }
    if let Some(matrix) = to_rec709 {
        pixels.iter_mut().for_each(|pixel| *pixel = (matrix * glam::Vec3::from(*pixel)).into());
    }
    Ok((width as u32, height as u32, pixels))
}

fn head(bytes: &[u8]) -> Result<(Head, &[u8]), String> {
    let mut rest = bytes;
    let mut next = || -> Result<String, String> {
        let end = rest.iter().position(|b| *b == b'\n').ok_or("its header is cut off")?;
        let line = String::from_utf8_lossy(&rest[..end]).trim_end_matches('\r').to_owned();
        rest = &rest[end + 1..];
        Ok(line)
    };
    let (mut is_xyz, mut primaries) = (false, None);
    loop {
        let line = next()?;
        if line.is_empty() {
            break;
        }
        if let Some(format) = line.strip_prefix("FORMAT=") {
            match format.trim() {
                "32-bit_rle_rgbe" => is_xyz = false,
                "32-bit_rle_xyze" => is_xyz = true,
                other => return Err(format!("its FORMAT '{other}' is not 32-bit_rle_rgbe or 32-bit_rle_xyze")),
            }
        } else if let Some(numbers) = line.strip_prefix("PRIMARIES=") {
            let numbers: Vec<f32> = numbers.split_whitespace().filter_map(|x| x.parse().ok()).collect();
            primaries = <[f32; 8]>::try_from(numbers).ok();
        }
    }
    // Pictures that name Radiance's own primaries are those that name none.
    let own = |of: &[f32; 8]| of.iter().zip(PRIMARIES).all(|(a, b)| (a - b).abs() < 1e-3);
    let to_rec709 = match primaries.filter(|of| !own(of)) {
        // Radiance's XYZ has the white of equal energy.
        _ if is_xyz => color::rec709_from_xyz([1.0 / 3.0; 2]),
        primaries => primaries.and_then(color::rec709_from_rgb),
    };
    let line = next()?;
    let unusable =
        || format!("its size '{}' is none, such as '-Y 512 +X 1024'", line.chars().take(64).collect::<String>());
    let words: Vec<&str> = line.split_whitespace().collect();
    let &[first, lines, second, length] = &words[..] else { return Err(unusable()) };
    let number = |text: &str| text.parse::<u32>().ok().filter(|n| (1..=1 << 24).contains(n)).map(|n| n as usize);
    let (lines, length) = number(lines).zip(number(length)).ok_or_else(unusable)?;
    let columns = first.ends_with('X');
    let (vertical, horizontal) = if columns { (second, first) } else { (first, second) };
    let (size, forward) = match (vertical, horizontal) {
        ("-Y" | "+Y", "-X" | "+X") => {
            (if columns { [lines, length] } else { [length, lines] }, [vertical == "-Y", horizontal == "+X"])
        }
        _ => return Err(unusable()),
    };
    Ok((Head { size, columns, forward, to_rec709 }, rest))
}

/// Decodes one scanline from `rest`; `None` if it is damaged or cut off.
fn scanline(rest: &mut &[u8], line: &mut [[u8; 4]]) -> Option<()> {
    let mut bytes = |n: usize| rest.split_off(..n);
    let first: [u8; 4] = bytes(4)?.try_into().ok()?;
    if let ([2, 2, high @ 0..0x80, low], true) = (first, NEW_WIDTHS.contains(&line.len())) {
        if usize::from(u16::from_be_bytes([high, low])) != line.len() {
            return None;
        }
        for channel in 0..4 {
            let mut at = 0;
            while at < line.len() {
                let code = usize::from(bytes(1)?[0]);
                let (n, run) = if code > 128 { (code - 128, true) } else { (code, false) };
                let values = bytes(if run { 1 } else { n })?;
                let pixels = line.get_mut(at..at + n)?;
                pixels.iter_mut().enumerate().for_each(|(i, pixel)| pixel[channel] = values[if run { 0 } else { i }]);
                at += n;
            }
        }
        return Some(());
    }
    // A pixel (1, 1, 1, n) repeats the one before n times; several are the digits of a number, the lowest first.
    let (mut at, mut shift, mut pixel) = (0_usize, 0, first);
    loop {
        if let [1, 1, 1, n] = pixel {
            let n = usize::from(n).checked_shl(shift)?;
            let before = *line.get(at.checked_sub(1)?)?;
            line.get_mut(at..at.checked_add(n)?)?.fill(before);
            (at, shift) = (at + n, shift + 8);
        } else {
            line[at] = pixel;
            (at, shift) = (at + 1, 0);
        }
        if at == line.len() {
            return Some(());
        }
        pixel = bytes(4)?.try_into().ok()?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six pixels of which each is another, in three columns and two rows: their bytes are numbers from the top left.
    fn file(head: &str, size: &str, order: [u8; 6]) -> Vec<u8> {
        let mut bytes = format!("{head}\n\n{size}\n").into_bytes();
        order.iter().for_each(|n| bytes.extend([*n, 7, 9, 136]));
        bytes
    }

    fn reds(bytes: &[u8]) -> Result<(u32, u32, Vec<f32>), String> {
        decode(bytes, |_, _| Ok(())).map(|(w, h, pixels)| (w, h, pixels.iter().map(|p| p[0]).collect()))
    }

    #[test]
    fn pictures_of_any_signature_and_orientation_are_read_upright() {
        let upright = (3, 2, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        for (size, order) in [
            ("-Y 2 +X 3", [1, 2, 3, 4, 5, 6]),
            ("-Y 2 -X 3", [3, 2, 1, 6, 5, 4]),
            ("+Y 2 +X 3", [4, 5, 6, 1, 2, 3]),
            ("+Y 2 -X 3", [6, 5, 4, 3, 2, 1]),
            ("+X 3 -Y 2", [1, 4, 2, 5, 3, 6]),
            ("+X 3 +Y 2", [4, 1, 5, 2, 6, 3]),
            ("-X 3 -Y 2", [3, 6, 2, 5, 1, 4]),
            ("-X 3 +Y 2", [6, 3, 5, 2, 4, 1]),
        ] {
            for head in ["#?RADIANCE\nFORMAT=32-bit_rle_rgbe", "#?RGBE", "#?AUTOPANO\r\n# a comment\r\nEXPOSURE=2\r"] {
                assert_eq!(reds(&file(head, size, order)).as_ref(), Ok(&upright), "{head} {size}");
            }
        }
    }

    #[test]
    fn run_lengths_of_both_forms_are_read() {
        let head = |width| format!("#?RGBE\n\n-Y 1 +X {width}\n").into_bytes();
        // New: a run and a literal in each channel.
        let mut new = head(10);
        new.extend([2, 2, 0, 10]);
        [3, 7, 9, 136].iter().for_each(|c| new.extend([128 + 6, *c, 4, *c, *c, *c, c + 1]));
        let expected = [vec![3.0; 9], vec![8.0]].concat();
        assert_eq!(reds(&new), Ok((10, 1, expected)));
        // Old: one pixel, then 2 + 256 of the same, then another.
        let mut old = head(260);
        old.extend([3, 7, 9, 136, 1, 1, 1, 2, 1, 1, 1, 1, 5, 7, 9, 136]);
        assert_eq!(reds(&old), Ok((260, 1, [vec![3.0; 259], vec![5.0]].concat())));
        // Narrower than eight pixels, bytes 2 2 are a pixel.
        let mut narrow = head(1);
        narrow.extend([2, 2, 0, 136]);
        assert_eq!(reds(&narrow), Ok((1, 1, vec![2.0])));
    }

    #[test]
    fn white_is_white_in_xyz_and_in_other_primaries() {
        for head in [
            "FORMAT=32-bit_rle_xyze",
            "PRIMARIES= 0.713 0.293 0.165 0.830 0.128 0.044 0.32168 0.33767",
            "FORMAT=32-bit_rle_rgbe",
        ] {
            let mut bytes = format!("#?RADIANCE\n{head}\n\n-Y 1 +X 1\n").into_bytes();
            bytes.extend([128, 128, 128, 129]);
            let (.., pixels) = decode(&bytes, |_, _| Ok(())).unwrap();
            assert!(pixels[0].iter().all(|c| (c - 1.0).abs() < 1e-3), "{head}: {pixels:?}");
        }
        // Radiance's own primaries are no other ones, and XYZ has none, in whichever order they are said.
        let (own, xyz) = ("PRIMARIES=0.640 0.330 0.290 0.600 0.150 0.060 0.333 0.333", "FORMAT=32-bit_rle_xyze");
        let of = |head: &str| reds(&file(&format!("#?RADIANCE\n{head}"), "-Y 2 +X 3", [1, 2, 3, 4, 5, 6]));
        assert_eq!(of(own), of("FORMAT=32-bit_rle_rgbe"));
        for head in [format!("{own}\n{xyz}"), format!("{xyz}\n{own}"), format!("{xyz}\nPRIMARIES=1")] {
            assert_eq!(of(&head), of(xyz), "{head}");
        }
    }

    #[test]
    fn damaged_pictures_are_refused() {
        let whole = file("#?RGBE", "-Y 2 +X 3", [1; 6]);
        for n in 0..whole.len() {
            assert!(reds(&whole[..n]).is_err(), "{n} bytes");
        }
        for size in ["-Y 2", "-Y 0 +X 3", "-Y 2 +Y 3", "-Y 2 +X 3 4", "-Y 99999999999 +X 3", "nonsense"] {
            assert!(reds(&file("#?RGBE", size, [1; 6])).unwrap_err().contains("its size"), "{size}");
        }
        assert!(reds(&file("#?RGBE\nFORMAT=jpeg", "-Y 2 +X 3", [1; 6])).is_err());
        // A run before the first pixel, and one beyond the last.
        for runs in [&[1, 1, 1, 3][..], &[5, 7, 9, 136, 1, 1, 1, 9]] {
            assert!(reds(&[b"#?RGBE\n\n-Y 1 +X 3\n", runs].concat()).is_err());
        }
    }
}
