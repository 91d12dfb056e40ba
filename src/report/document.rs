//! Headings, tables and sentences of a report, and how Markdown and LaTeX write them.

use crate::base::numbers::ABSENT;
use crate::base::plain_text::{is_control, markdown as line, one_line};

/// A report in parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Document {
    title: String,
    /// In bold, and what follows it.
    headline: [String; 2],
    blocks: Vec<Block>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Block {
    Heading(String),
    Text(String),
    Pictures(Vec<String>),
    Table { columns: Vec<String>, rows: Vec<Vec<String>> },
}

impl Document {
    /// A document under a title, with a verdict and the reason for it.
    pub fn new(title: &str, verdict: &str, sentence: &str) -> Self {
        Self { title: title.to_owned(), headline: [verdict.to_owned(), sentence.to_owned()], blocks: Vec::new() }
    }

    /// Begins a section.
    pub fn heading(&mut self, text: &str) {
        self.blocks.push(Block::Heading(text.to_owned()));
    }

    /// A sentence.
    pub fn text(&mut self, text: &str) {
        self.blocks.push(Block::Text(text.to_owned()));
    }

    /// Pictures side by side, by file name.
    pub fn pictures<'a>(&mut self, names: impl Iterator<Item = &'a str>) {
        self.blocks.push(Block::Pictures(names.map(str::to_owned).collect()));
    }

    /// A table; one without rows is left out.
    pub fn table(&mut self, columns: &[&str], rows: impl Iterator<Item = Vec<String>>) {
        let rows: Vec<Vec<String>> = rows.collect();
        if !rows.is_empty() {
            self.blocks.push(Block::Table { columns: columns.iter().map(|&name| name.to_owned()).collect(), rows });
        }
    }

    /// As Markdown, for terminals and repositories.
    pub fn markdown(&self) -> String {
        let [verdict, sentence] = &self.headline;
        let mut text = format!("# {}\n\n**{}** {}\n", line(&self.title), verdict, line(sentence));
        for block in &self.blocks {
            text += &match block {
                Block::Heading(heading) => format!("\n## {}\n", line(heading)),
                Block::Text(sentence) => format!("\n{}\n", paragraph(sentence)),
                Block::Pictures(names) if names.is_empty() => String::new(),
                Block::Pictures(names) => {
                    let shown: Vec<String> = names.iter().map(|name| format!("![{name}]({name})")).collect();
                    format!("\n{}\n", shown.join(" "))
                }
                Block::Table { columns, rows } => {
                    let row = |cells: &Vec<String>| {
                        let cells: Vec<String> = cells.iter().map(|cell| line(cell)).collect();
                        format!("| {} |\n", cells.join(" | "))
                    };
                    let head: Vec<String> = columns.iter().map(|name| heading_cell(name)).collect();
                    let body: String = rows.iter().map(row).collect();
                    format!("\n| {} |\n|{}\n{body}", head.join(" | "), " --- |".repeat(columns.len()))
                }
            };
        }
        text
    }

    /// Its tables as LaTeX, one `table` environment each, for a paper that loads `booktabs`. The section is the caption; a table wider than the
    /// text is shrunk to it (`graphicx`).
    pub fn latex(&self) -> String {
        let mut text = format!(
            "% Tables of the report: {}\n% Needs \\usepackage{{booktabs}} and \\usepackage{{graphicx}}.\n",
            one_line(&self.title)
        );
        let mut caption = "Verdicts";
        let mut count = 0;
        for block in &self.blocks {
            match block {
                Block::Heading(heading) => caption = heading,
                Block::Table { columns, rows } => {
                    count += 1;
                    text += &latex_table(columns, rows, caption, count);
                }
                Block::Text(_) | Block::Pictures(_) => {}
            }
        }
        text
    }
}

fn latex_table(columns: &[String], rows: &[Vec<String>], caption: &str, number: usize) -> String {
    // Columns of numbers stand flush right, so that places line up.
    let alignment: String = (0..columns.len())
        .map(|column| if rows.iter().all(|row| row.get(column).is_none_or(|cell| is_number(cell))) { 'r' } else { 'l' })
        .collect();
    let row = |cells: &[String]| cells.iter().map(|cell| latex(cell)).collect::<Vec<_>>().join(" & ") + " \\\\\n";
    format!(
        "\n\\begin{{table}}\n  \\centering\n  \\caption{{{}}}\n  \\label{{tab:cloudparity-{number}}}\n  \\footnotesize\n  \
         \\resizebox{{\\ifdim\\width>\\linewidth\\linewidth\\else\\width\\fi}}{{!}}{{%\n  \\begin{{tabular}}{{{alignment}}}\n    \
         \\toprule\n    {}    \\midrule\n{}    \\bottomrule\n  \\end{{tabular}}}}\n\\end{{table}}\n",
        latex(caption),
        row(columns),
        rows.iter().map(|cells| format!("    {}", row(cells))).collect::<String>(),
    )
}

/// Whether a cell begins with a number, or holds none because there is nothing to say.
fn is_number(cell: &str) -> bool {
    let digits = cell.trim_start_matches(['+', '-', '\u{2212}']);
    let is_short = cell.chars().count() <= LONGEST_NUMBER;
    cell == ABSENT || cell.is_empty() || is_short && digits.starts_with(|letter: char| letter.is_ascii_digit())
}

/// Characters of a cell that is a number with its unit; longer ones are sentences.
const LONGEST_NUMBER: usize = 20;

/// Digits and signs that stand above the line.
const RAISED: [(char, char); 11] = [
    ('\u{2070}', '0'),
    ('\u{b9}', '1'),
    ('\u{b2}', '2'),
    ('\u{b3}', '3'),
    ('\u{2074}', '4'),
    ('\u{2075}', '5'),
    ('\u{2076}', '6'),
    ('\u{2077}', '7'),
    ('\u{2078}', '8'),
    ('\u{2079}', '9'),
    ('\u{207b}', '-'),
];

/// Text with its markup taken literally by LaTeX.
fn latex(text: &str) -> String {
    let mut safe = String::new();
    let mut is_raised = false;
    for letter in text.chars() {
        let raised = RAISED.iter().find(|(above, _)| *above == letter).map(|(_, plain)| *plain);
        match (is_raised, raised) {
            (false, Some(_)) => safe.push_str("$^{"),
            (true, None) => safe.push_str("}$"),
            _ => {}
        }
        is_raised = raised.is_some();
        match raised.unwrap_or(letter) {
            other if is_control(other) => safe.push(' '),
            // Behind the end of a row, a bracket or a star would belong to it.
            '[' => safe.push_str("{[}"),
            '*' => safe.push_str("{*}"),
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                safe.push('\\');
                safe.push(letter);
            }
            '\u{2009}' | '\u{202f}' => safe.push_str(r"\,"),
            '~' => safe.push_str(r"\textasciitilde{}"),
            '^' => safe.push_str(r"\textasciicircum{}"),
            '\\' => safe.push_str(r"\textbackslash{}"),
            '<' => safe.push_str("$<$"),
            '>' => safe.push_str("$>$"),
            '\u{2212}' => safe.push_str("$-$"),
            '\u{d7}' => safe.push_str(r"$\times$"),
            '\u{b7}' => safe.push_str(r"$\cdot$"),
            '\u{b1}' => safe.push_str(r"$\pm$"),
            other => safe.push(other),
        }
    }
    if is_raised {
        safe.push_str("}$");
    }
    safe
}

/// A sentence as a paragraph of Markdown: with markup taken literally at its beginning, too, where a sign would begin a list.
fn paragraph(sentence: &str) -> String {
    let text = line(sentence);
    if text.starts_with(['-', '+', '=']) { format!("\\{text}") } else { text }
}

/// A column's name, which may be empty.
fn heading_cell(name: &str) -> String {
    if name.is_empty() { String::new() } else { line(name) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document() -> Document {
        let mut document = Document::new("A & B", "Agrees.", "Within 1 %.");
        document.table(&["Part", "Verdict"], std::iter::once(vec!["Picture".into(), "agrees".into()]));
        document.heading("Errors_1");
        document.table(
            &["Name", "relMSE", "Bias"],
            [["a|b", "0.01", "+1 %"], ["c", ABSENT, "-2 %"]].iter().map(|row| row.map(str::to_owned).to_vec()),
        );
        document.table(&["Nothing"], std::iter::empty());
        document
    }

    #[test]
    fn markup_is_taken_literally() {
        let text = document().markdown();
        assert!(text.starts_with("# A \\& B\n\n**Agrees.** Within 1 %.\n"), "{text}");
        assert!(
            text.contains("| a\\|b | 0.01 | +1 % |") && text.contains("## Errors\\_1") && !text.contains("Nothing"),
            "{text}"
        );
    }

    #[test]
    fn tables_of_numbers_stand_flush_right_in_latex() {
        let text = document().latex();
        assert_eq!(text.matches("\\begin{table}").count(), 2);
        assert_eq!(text.matches("\\begin{table}").count(), text.matches("\\end{table}").count());
        assert!(text.contains(r"\begin{tabular}{lrr}") && text.contains(r"\caption{Errors\_1}"), "{text}");
        assert!(text.contains(r"a|b & 0.01 & +1 \% \\"), "{text}");
        assert_eq!(latex("3\u{d7}10\u{207b}\u{2074} m\u{b2}"), r"3$\times$10$^{-4}$ m$^{2}$");
        assert!(is_number("3.36\u{d7}10\u{207b}\u{2074}") && !is_number("138 rows of f32 against f64"));
    }
}
