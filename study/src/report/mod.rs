//! Self-contained HTML pages of tables, SVG charts and false-colour pictures. Knows nothing of what is reported.

pub mod axis;
pub mod chart;
pub mod dots;
pub mod page;
pub mod picture;
pub mod table;

pub use axis::{Axis, Scale};
pub use chart::{COLORS, Chart, Series};
pub use dots::{Dot, dot_plot};
pub use page::{Figure, Page};
pub use picture::ColorScale;
pub use table::{Cell, Columns, Table, Tone};

/// "s" unless there is one.
pub(crate) fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

/// A share in per cent, with two decimals.
pub fn percent(share: f64) -> String {
    if share.is_nan() { "–".to_owned() } else { format!("{:.2} %", share * 100.0) }
}

/// A number as people read it: three significant digits, plain from 0.001 to 100 000, a minus that is one.
pub fn number(x: f64) -> String {
    let text = match x.abs() {
        _ if !x.is_finite() => return "–".to_owned(),
        0.0 => "0".to_owned(),
        a if !(1e-3..1e5).contains(&a) => format!("{x:.2e}"),
        a => {
            let decimals = (2 - a.log10().floor() as i32).clamp(0, 5) as usize;
            format!("{x:.decimals$}")
        }
    };
    text.replacen('-', "−", 1).replace("e-", "e−")
}

/// A number with its standard error, both to the error's second digit; three decimals at most, five below 0.1,
/// each as [`number`] below 0.001.
pub(crate) fn with_error(x: f64, error: f64) -> String {
    let size = x.abs().max(error);
    if !x.is_finite() || !error.is_finite() || error >= 1e4 || (size > 0.0 && size < 1e-3) {
        return format!("{} ± {}", number(x), number(error));
    }
    let most = if size < 0.1 { 5 } else { 3 };
    let decimals = if error > 0.0 { (1 - error.log10().floor() as i32).clamp(0, most) as usize } else { 3 };
    format!("{x:.decimals$} ± {error:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        let cases = [(0.0, "0"), (1.0, "1.00"), (0.7134, "0.713"), (12.34, "12.3"), (4096.0, "4096"), (-0.5, "−0.500")];
        for (x, text) in cases {
            assert_eq!(number(x), text);
        }
        assert_eq!(number(1.234e-5), "1.23e−5");
        assert_eq!(number(f64::NAN), "–");
    }

    #[test]
    fn errors_say_how_many_digits_there_are() {
        assert_eq!(with_error(0.7134, 0.0123), "0.713 ± 0.012");
        assert_eq!(with_error(12.3, 1.3), "12.3 ± 1.3");
        assert_eq!(with_error(1.0, 0.0), "1.000 ± 0.000");
        assert_eq!(with_error(123.4, 45.0), "123 ± 45");
        assert_eq!(with_error(1.0, 3e9), "1.00 ± 3.00e9");
        assert_eq!(with_error(0.0021, 0.0001), "0.00210 ± 0.00010");
        assert_eq!(with_error(8.3e-6, 1e-7), "8.30e−6 ± 1.00e−7");
        assert_eq!(with_error(1e-5, 0.5), "0.00 ± 0.50");
    }
}
