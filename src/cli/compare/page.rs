//! A self-contained HTML page with two pictures under a slider, their FLIP error map and their errors.

use std::io::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::difference::false_color;
use super::report::short;
use crate::film::compare::{Comparison, flip_map};
use crate::film::preview::{encoded, encoded_picture, to_byte};
use crate::film::{Exposure, Look, Picture, View, atomic};
use crate::{Result, console};

const TEMPLATE: &str = include_str!("page.html");

/// Writes the page; `curve` is the chart of a sequence, or empty.
pub fn write(path: &Path, names: [&Path; 2], pictures: [&Picture; 2], c: &Comparison, curve: &str) -> Result<()> {
    let text = page(names, pictures, c, curve)?;
    atomic::write(path, |file| Ok(Ok(file.write_all(text.as_bytes())?)))
}

/// The page, with HTML above the pictures. Both pictures have the view transform and the automatic exposure of B.
pub fn page(names: [&Path; 2], [a, b]: [&Picture; 2], c: &Comparison, above: &str) -> Result<String> {
    let view = if a.displayed && b.displayed { View::Srgb } else { View::Agx };
    let exposure = if view == View::Srgb { 0.0 } else { Exposure::Auto.of(b.colors()) };
    let look = Look { view: view.into(), exposure };
    let [width, height] = a.size().map(|n| n as u32);
    let errors = flip_map(a, b);
    let map: Vec<u8> = errors.iter().flat_map(|e| false_color(*e).map(to_byte)).collect();
    let data = |png: Vec<u8>| format!("data:image/png;base64,{}", STANDARD.encode(png));
    let numbers = [("relMSE", c.rel_mse), ("RMSE", c.rmse), ("MAE", c.mae), ("FLIP, mean", c.flip)];
    let mut rows: String = numbers
        .iter()
        .map(|(name, value)| format!("<tr><th scope=row>{name}<td colspan=3>{}\n", short(*value)))
        .collect();
    let mut triple = |name: &str, values: [f64; 3]| {
        let [r, g, b] = values.map(short);
        rows += &format!("<tr><th scope=row>{name}, R G B<td>{r}<td>{g}<td>{b}\n");
    };
    triple("mean of B", c.reference_mean);
    triple("bias A − B", c.bias);
    if let Some(s) = &c.statistics {
        triple("z of the bias", s.bias_z);
    }
    let shown = |path: &Path| escaped(&path.display().to_string());
    let fill = [
        ("{{a-name}}", shown(names[0])),
        ("{{b-name}}", shown(names[1])),
        ("{{width}}", width.to_string()),
        ("{{height}}", height.to_string()),
        ("{{look}}", format!("view {}, exposure {exposure} EV", view.name())),
        ("{{curve}}", above.to_owned()),
        ("{{rows}}", rows),
        ("{{a}}", data(encoded_picture(a, &look)?)),
        ("{{b}}", data(encoded_picture(b, &look)?)),
        ("{{map}}", data(encoded(width, height, &map)?)),
    ];
    let mut text = TEMPLATE.to_owned();
    for (word, value) in fill {
        text = text.replace(word, &value);
    }
    Ok(text)
}

/// Text in HTML or XML, or in an attribute of these, that fills no placeholder and changes no direction of the text around it. What
/// XML 1.0 does not allow besides (U+FFFE, U+FFFF) becomes spaces.
pub fn escaped(text: &str) -> String {
    let space = |c| matches!(c, '\n' | '\t' | '\u{FFFE}' | '\u{FFFF}');
    let plain = console::escaped(text).replace(space, " ");
    let plain = plain.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    plain.replace('"', "&quot;").replace('{', "&#123;")
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn a_name_fills_no_placeholder_and_is_what_xml_allows() {
        assert!(!escaped("{{{rows}}").contains("{{rows}}"));
        assert_eq!(escaped("a\u{FFFF}\n\u{1}<\"é\u{202e}"), "a  \\u&#123;1}&lt;&quot;é\\u&#123;202e}");
    }
}
