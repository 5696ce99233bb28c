//! Tables for pages.

use maud::{Markup, html};
use serde::Serialize;
use serde_json::Value;

use super::{number, with_error};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    Plain,
    /// Better than what it is compared with.
    Good,
    /// Worse than what it is compared with.
    Bad,
    Faint,
    /// Words, not a number: a column of these is set from the left.
    Words,
}

impl Tone {
    /// Good where a ratio is below 1 by more than two standard errors, bad where it is above.
    pub fn below_one(ratio: f64, error: f64) -> Self {
        match () {
            () if ratio + 2.0 * error < 1.0 => Self::Good,
            () if ratio - 2.0 * error > 1.0 => Self::Bad,
            () => Self::Plain,
        }
    }

    /// Good where a ratio is above 1 by more than two standard errors, bad where it is below.
    pub(crate) fn above_one(ratio: f64, error: f64) -> Self {
        Self::below_one(2.0 - ratio, error)
    }

    fn class(self) -> Option<&'static str> {
        match self {
            Tone::Plain => None,
            Tone::Good => Some("good"),
            Tone::Bad => Some("bad"),
            Tone::Faint => Some("faint"),
            Tone::Words => Some("words"),
        }
    }
}

/// The text of a cell and how it stands out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cell {
    pub text: String,
    pub tone: Tone,
}

impl From<(String, Tone)> for Cell {
    fn from((text, tone): (String, Tone)) -> Self {
        Self { text, tone }
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        (text, Tone::Plain).into()
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl From<f64> for Cell {
    fn from(x: f64) -> Self {
        number(x).into()
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(cell: Option<T>) -> Self {
        cell.map_or_else(|| "".into(), T::into)
    }
}

/// A table whose first column names its rows.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Column heads, each with what it means (shown when pointed at).
    columns: Vec<(String, String)>,
    rows: Vec<Vec<Cell>>,
}

/// A table under construction: one row per value of `of`, columns added one by one.
pub struct Columns<'a, R> {
    of: &'a [R],
    table: Table,
}

impl Table {
    /// A table with a row per value, without columns.
    pub fn of<R>(of: &[R]) -> Columns<'_, R> {
        Columns { of, table: Self { columns: Vec::new(), rows: vec![Vec::new(); of.len()] } }
    }

    /// The named fields of rows as files have them, each with its standard error where there is a field `NAME_se`. `NAME<1`
    /// is a ratio that is good below 1, `NAME>1` one that is good above it.
    pub(crate) fn of_fields<R: Serialize>(rows: &[R], fields: &str) -> Self {
        let fields = fields.split_whitespace().map(|field| (field, field.split(['<', '>']).next().unwrap_or(field)));
        let cell = |row: &Value, (field, name): (&str, &str)| -> Cell {
            let value = &row[name];
            let tone = |x, error| match &field[name.len()..] {
                "<1" => Tone::below_one(x, error),
                ">1" => Tone::above_one(x, error),
                _ => Tone::Plain,
            };
            match (value.as_f64(), row[format!("{name}_se")].as_f64()) {
                (Some(x), Some(error)) => (with_error(x, error), tone(x, error)).into(),
                (Some(x), None) if !value.is_u64() => x.into(),
                _ => value.as_str().map_or_else(|| value.to_string().replace("null", ""), str::to_owned).into(),
            }
        };
        let values = rows.iter().map(|row| serde_json::to_value(row).unwrap_or_default());
        Self {
            columns: fields.clone().map(|(_, name)| (name.replace('_', " "), String::new())).collect(),
            rows: values.map(|row| fields.clone().map(|field| cell(&row, field)).collect()).collect(),
        }
    }

    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        self.rows.push(row.into_iter().collect());
    }

    pub fn html(&self) -> Markup {
        let of_words = |column: usize| {
            !self.rows.is_empty() && self.rows.iter().all(|row| row.get(column).is_some_and(|c| c.tone == Tone::Words))
        };
        let meant = || self.columns.iter().filter(|(_, meaning)| !meaning.is_empty());
        html! {
            (scrolling("table", html! { table {
                thead { tr {
                    @for (i, (head, meaning)) in self.columns.iter().enumerate() {
                        th class=[of_words(i).then_some("words")] title=(meaning) { (head) }
                    }
                } }
                tbody {
                    @for row in &self.rows {
                        tr { @for Cell { text, tone } in row { td class=[tone.class()] { (text) } } }
                    }
                }
            } }))
            // For fingers and keys, which cannot point.
            @if meant().next().is_some() {
                details.columns {
                    summary { "What the columns mean" }
                    dl { @for (head, meaning) in meant() { @if !head.is_empty() { dt { (head) } } dd { (meaning) } } }
                }
            }
        }
    }

    /// Columns side by side, for a terminal.
    pub fn text(&self) -> String {
        let head = self.columns.iter().map(|(head, _)| head).collect();
        let rows = self.rows.iter().map(|row| row.iter().map(|cell| &cell.text).collect());
        let lines = std::iter::once(head).chain(rows).collect::<Vec<Vec<&String>>>();
        let widest = |i: usize| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or(0);
        let widths = (0..self.columns.len()).map(widest).collect::<Vec<_>>();
        let line = |line: &Vec<&String>| {
            let cells = line.iter().zip(&widths).skip(1).map(|(text, &width)| format!("  {text:>width$}"));
            format!("{:<width$}{}\n", line[0], cells.collect::<String>(), width = widths[0])
        };
        lines.iter().map(line).collect()
    }

    pub(crate) fn markdown(&self) -> String {
        let cell = |text: &str| text.replace('|', "\\|");
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let mut out = line(self.columns.iter().map(|c| cell(&c.0)).collect());
        out += &line(vec!["---".to_owned(); self.columns.len()]);
        for row in &self.rows {
            out += &line(row.iter().map(|c| cell(&c.text)).collect());
        }
        out
    }
}

impl<'a, R> Columns<'a, R> {
    /// Adds a column: its head, what it means, and the cell of each row.
    pub fn column<C: Into<Cell>>(mut self, head: &str, meaning: &str, cell: impl Fn(&'a R) -> C) -> Self {
        self.table.columns.push((head.to_owned(), meaning.to_owned()));
        self.table.rows.iter_mut().zip(self.of).for_each(|(row, of)| row.push(cell(of).into()));
        self
    }

    /// Adds a column of words without a meaning of its own, set from the left.
    pub fn words<T: Into<String>>(self, head: &str, text: impl Fn(&'a R) -> T) -> Self {
        self.column(head, "", |of| (text(of).into(), Tone::Words))
    }

    /// Makes the cells so far of some rows faint.
    pub(crate) fn faint(mut self, faint: impl Fn(&R) -> bool) -> Self {
        for (row, _) in self.table.rows.iter_mut().zip(self.of).filter(|(_, of)| faint(of)) {
            row.iter_mut().for_each(|cell| cell.tone = Tone::Faint);
        }
        self
    }

    pub fn end(self) -> Table {
        self.table
    }
}

/// A box that scrolls, also by keys, if its content is wider than the page.
pub(super) fn scrolling(what: &str, content: Markup) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(what) { (content) }
        p.hint aria-hidden="true" { "There is more to the right: swipe, or scroll with → and ←." }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_html_and_markdown() {
        let table = Table::of(&["2"]).column("a|b", "what \"a\" is", |_| "<1>");
        let mut table = table.column("c", "", |text| (text.to_string(), Tone::Bad)).end();
        assert_eq!(table.markdown(), "| a\\|b | c |\n| --- | --- |\n| <1> | 2 |\n");
        assert_eq!(table.text(), "a|b  c\n<1>  2\n");
        let html = table.html().0;
        assert!(html.contains("&lt;1&gt;") && html.contains(r#"<td class="bad">2"#) && html.contains("&quot;a&quot;"));
        assert!(html.contains(r#"tabindex="0""#) && html.contains("<dt>a|b</dt><dd>what &quot;a&quot; is</dd>"));
        assert!(!html.contains("<dt>c"), "nothing is said of it");
        assert!(!html.contains(r#"class="words""#));
        table.rows[0][1].tone = Tone::Words;
        let html = table.html().0;
        assert!(html.contains(r#"<th class="words" title="">c"#) && html.contains(r#"<td class="words">2"#));
    }
}
