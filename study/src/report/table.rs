//! Tables for pages.

use maud::{Markup, html};

use super::page::scrolling;

/// How a cell stands out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// Not at all.
    Plain,
    /// Better than what it is compared with.
    Good,
    /// Worse than what it is compared with.
    Bad,
    /// Of less weight: controls, limits.
    Faint,
    /// Words, not a number: a column of these is set from the left.
    Words,
}

impl Tone {
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

/// A table whose first column names its rows.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Column heads, each with what it means (shown when pointed at).
    pub columns: Vec<(String, String)>,
    /// Cells.
    pub rows: Vec<Vec<(String, Tone)>>,
}

impl Table {
    /// A table without rows.
    pub fn new(columns: &[(&str, &str)]) -> Self {
        let columns = columns.iter().map(|(head, meaning)| (head.to_string(), meaning.to_string())).collect();
        Self { columns, rows: Vec::new() }
    }

    /// The table.
    pub fn html(&self) -> Markup {
        let of_words = |column: usize| {
            !self.rows.is_empty() && self.rows.iter().all(|row| matches!(row.get(column), Some((_, Tone::Words))))
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
                        tr { @for (text, tone) in row { td class=[tone.class()] { (text) } } }
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

    /// The table in Markdown.
    pub fn markdown(&self) -> String {
        let cell = |text: &str| text.replace('|', "\\|");
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let mut out = line(self.columns.iter().map(|c| cell(&c.0)).collect());
        out += &line(vec!["---".to_owned(); self.columns.len()]);
        for row in &self.rows {
            out += &line(row.iter().map(|(text, _)| cell(text)).collect());
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_html_and_markdown() {
        let mut table = Table::new(&[("a|b", "what \"a\" is"), ("c", "")]);
        table.rows.push(vec![("<1>".into(), Tone::Plain), ("2".into(), Tone::Bad)]);
        assert_eq!(table.markdown(), "| a\\|b | c |\n| --- | --- |\n| <1> | 2 |\n");
        let html = table.html().0;
        assert!(html.contains("&lt;1&gt;") && html.contains(r#"<td class="bad">2"#) && html.contains("&quot;a&quot;"));
        assert!(html.contains(r#"tabindex="0""#) && html.contains("<dt>a|b</dt><dd>what &quot;a&quot; is</dd>"));
        assert!(!html.contains("<dt>c"), "nothing is said of it");
        assert!(!html.contains(r#"class="words""#));
        table.rows[0][1].1 = Tone::Words;
        let html = table.html().0;
        assert!(html.contains(r#"<th class="words" title="">c"#) && html.contains(r#"<td class="words">2"#));
    }
}
