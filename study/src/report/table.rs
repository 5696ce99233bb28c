//! Tables for pages.

use std::fmt::Write;

use super::escape;

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
    pub fn html(&self) -> String {
        let mut out = "<div class=scroll><table><thead><tr>".to_owned();
        let of_words = |column: usize| {
            !self.rows.is_empty() && self.rows.iter().all(|row| matches!(row.get(column), Some((_, Tone::Words))))
        };
        for (i, (head, meaning)) in self.columns.iter().enumerate() {
            let class = if of_words(i) { " class=words" } else { "" };
            let _ = write!(out, r#"<th{class} title="{}">{}</th>"#, escape(meaning), escape(head));
        }
        out += "</tr></thead><tbody>";
        for row in &self.rows {
            out += "<tr>";
            for (text, tone) in row {
                let class = match tone {
                    Tone::Plain => "",
                    Tone::Good => " class=good",
                    Tone::Bad => " class=bad",
                    Tone::Faint => " class=faint",
                    Tone::Words => " class=words",
                };
                let _ = write!(out, "<td{class}>{}</td>", escape(text));
            }
            out += "</tr>";
        }
        out + "</tbody></table></div>"
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
        let html = table.html();
        assert!(html.contains("&lt;1&gt;") && html.contains("<td class=bad>2") && html.contains("&quot;a&quot;"));
        assert!(!html.contains("class=words"));
        table.rows[0][1].1 = Tone::Words;
        assert!(table.html().contains("<th class=words title=\"\">c") && table.html().contains("<td class=words>2"));
    }
}
