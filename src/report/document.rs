//! Headings, tables, figures and sentences of a report, and how Markdown and LaTeX write them.

use crate::base::plain_text::{is_control, markdown as line, one_line};
use crate::report::table::Table;
use std::fmt::Write as _;

/// Rows from which on a LaTeX table runs over pages.
const LONG: usize = 40;

/// Characters of a cell from which on it is a sentence, whose lines LaTeX breaks.
const SENTENCE: usize = 34;

/// The same in a table over pages.
const LONG_SENTENCE: usize = 20;

/// Characters in a row of small letters across a page.
const PAGE: usize = 105;

/// Characters in a row of a LaTeX table that fit one column of a paper of two.
const ONE_COLUMN: usize = 52;

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
    Figure(Figure),
    Table(Table),
}

/// A picture or a drawing with its caption.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// The file for pages, relative to the run directory.
    pub file: String,
    /// The file for LaTeX, which reads no SVG.
    pub print: String,
    /// Whether it takes both columns of a paper of two.
    pub is_wide: bool,
    /// What it shows, of what.
    pub caption: String,
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

    /// A figure.
    pub fn figure(&mut self, figure: Figure) {
        self.blocks.push(Block::Figure(figure));
    }

    /// A table; one without rows is left out.
    pub fn table(&mut self, table: Table) {
        if !table.rows.is_empty() {
            self.blocks.push(Block::Table(table));
        }
    }

    /// The captions of all tables and figures.
    #[cfg(test)]
    pub fn captions(&self) -> Vec<String> {
        let caption = |block: &Block| match block {
            Block::Figure(figure) => Some(figure.caption.clone()),
            Block::Table(table) => Some(table.caption.clone()),
            Block::Heading(_) | Block::Text(_) => None,
        };
        self.blocks.iter().filter_map(caption).collect()
    }

    /// As Markdown, for terminals and repositories.
    pub fn markdown(&self) -> String {
        let [verdict, sentence] = &self.headline;
        let mut text = format!("# {}\n\n**{}** {}\n", line(&self.title), verdict, line(sentence));
        for block in &self.blocks {
            text += &match block {
                Block::Heading(heading) => format!("\n## {}\n", line(heading)),
                Block::Text(sentence) => format!("\n{}\n", paragraph(sentence)),
                Block::Figure(Figure { file, caption, .. }) => {
                    let caption = line(caption);
                    format!("\n![{caption}]({file})\n\n*{caption}*\n")
                }
                Block::Table(Table { caption, columns, rows }) => {
                    let row = |cells: &Vec<String>| {
                        let cells: Vec<String> = cells.iter().map(|cell| line(cell)).collect();
                        format!("| {} |\n", cells.join(" | "))
                    };
                    let head: Vec<String> = columns.iter().map(|column| heading_cell(&column.name)).collect();
                    let rules: String =
                        columns.iter().map(|column| if column.is_number { " ---: |" } else { " --- |" }).collect();
                    let body: String = rows.iter().map(row).collect();
                    format!("\n*{}*\n\n| {} |\n|{rules}\n{body}", line(caption), head.join(" | "))
                }
            };
        }
        text
    }

    /// Its tables as LaTeX; those of more than [`LONG`] rows run over pages (`is_long`), which `longtable` does in one column alone, so that a
    /// paper of two columns takes the others.
    pub fn latex_tables(&self, is_long: bool) -> String {
        let packages = if is_long { "booktabs, longtable, siunitx" } else { "booktabs, tabularx, siunitx" };
        let column = if is_long { "%% longtable needs a page of one column: \\onecolumn, an appendix.\n" } else { "" };
        let mut text = format!(
            "% Tables of the report: {}\n% \\usepackage{{{packages}}}\n{}",
            one_line(&self.title),
            column.replace("%%", "%")
        );
        let tables =
            self.blocks.iter().filter_map(|block| if let Block::Table(table) = block { Some(table) } else { None });
        for (index, table) in tables.enumerate().filter(|(_, table)| (table.rows.len() > LONG) == is_long) {
            text += &latex_table(table, index + 1);
        }
        text
    }

    /// Its figures as LaTeX, one environment each, for a paper that loads `graphicx`.
    pub fn latex_figures(&self) -> String {
        let mut text = format!("% Figures of the report: {}\n% \\usepackage{{graphicx}}\n", one_line(&self.title));
        let figures =
            self.blocks.iter().filter_map(|block| if let Block::Figure(figure) = block { Some(figure) } else { None });
        for (index, Figure { print, is_wide, caption, .. }) in figures.enumerate() {
            let (star, number) = (if *is_wide { "*" } else { "" }, index + 1);
            // A name with dots or spaces stays a name in braces.
            let (stem, extension) = print.rsplit_once('.').unwrap_or((print, ""));
            let _ = write!(
                text,
                "\n\\begin{{figure{star}}}\n  \\centering\n  \\includegraphics[width=\\linewidth]{{{{{stem}}}.{extension}}}\n  \
                 \\caption{{{}}}\n  \\label{{fig:cloudparity-{number}}}\n\\end{{figure{star}}}\n",
                latex(caption),
            );
        }
        text
    }
}

fn latex_table(table: &Table, number: usize) -> String {
    let Table { caption, columns, rows } = table;
    let is_long = rows.len() > LONG;
    let width =
        |index: usize| rows.iter().filter_map(|row| row.get(index)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns.len()).map(width).collect();
    // Over pages lines are broken earlier, so that all columns find room.
    let sentence = if is_long { LONG_SENTENCE } else { SENTENCE };
    let is_sentence = |index: usize| widths[index] > sentence && !columns[index].is_number;
    let sentences = (0..columns.len()).filter(|&index| is_sentence(index)).count();
    let is_wide =
        widths.iter().zip(columns).map(|(width, column)| 2 + (*width).max(column.name.chars().count())).sum::<usize>()
            > ONE_COLUMN;
    // What the other columns leave of the page, by the length of the sentences.
    let others: usize = (0..columns.len())
        .filter(|&index| !is_sentence(index))
        .map(|index| widths[index].max(columns[index].name.len()) + 2)
        .sum();
    let all: usize = (0..columns.len()).filter(|&index| is_sentence(index)).map(|index| widths[index].min(60)).sum();
    let rest = (1.0 - others as f64 / PAGE as f64).max(0.3) - 0.02 * sentences as f64;
    let share = |index: usize| rest * widths[index].min(60) as f64 / all as f64;
    let alignment: Vec<String> = (0..columns.len())
        .map(|index| match (columns[index].is_number, is_sentence(index)) {
            (true, _) => number_column(rows.iter().map(|row| row[index].as_str())),
            (false, true) if is_long => format!("p{{{:.3}\\linewidth}}", share(index)),
            (false, true) => ">{\\raggedright\\arraybackslash}X".into(),
            (false, false) => "l".into(),
        })
        .collect();
    let cell =
        |(index, cell): (usize, &String)| if columns[index].is_number { latex_number(cell) } else { latex(cell) };
    let row = |cells: &Vec<String>| {
        format!("    {} \\\\\n", cells.iter().enumerate().map(cell).collect::<Vec<_>>().join(" & "))
    };
    // In braces, names stand over columns of numbers as text.
    let head = |column: &super::table::Column| {
        let name = latex(&column.name);
        if column.is_number { format!("{{{name}}}") } else { name }
    };
    let head = format!("    {} \\\\\n", columns.iter().map(head).collect::<Vec<_>>().join(" & "));
    let body: String = rows.iter().map(row).collect();
    let (caption, label) = (latex(caption), format!("\\label{{tab:cloudparity-{number}}}"));
    let alignment = format!("@{{}}{}@{{}}", alignment.concat());
    if is_long {
        return format!(
            "\n{{\\footnotesize\\setlength{{\\LTcapwidth}}{{\\linewidth}}\n\\begin{{longtable}}{{{alignment}}}\n    \\caption{{{caption}}}{label} \\\\\n    \\toprule\n{head}    \
             \\midrule\n    \\endfirsthead\n    \\toprule\n{head}    \\midrule\n    \\endhead\n    \\bottomrule\n    \
             \\endfoot\n{body}\\end{{longtable}}}}\n"
        );
    }
    let star = if is_wide { "*" } else { "" };
    let (begin, end) = match sentences {
        0 => (format!("\\begin{{tabular}}{{{alignment}}}"), "\\end{tabular}"),
        _ => (format!("\\begin{{tabularx}}{{\\linewidth}}{{{alignment}}}"), "\\end{tabularx}"),
    };
    format!(
        "\n\\begin{{table{star}}}\n  \\centering\n  \\caption{{{caption}}}\n  {label}\n  \\footnotesize\n  {begin}\n    \\toprule\n{head}    \
         \\midrule\n{body}    \\bottomrule\n  {end}\n\\end{{table{star}}}\n"
    )
}

/// A column of siunitx, wide enough for these cells and aligned at the decimal marker.
fn number_column<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    let (mut sign, mut before, mut after, mut error, mut power) = ("", 1, 0, 0, String::new());
    for text in cells.filter_map(siunitx) {
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, ""));
        let (digits, uncertainty) = mantissa.split_once('(').unwrap_or((mantissa, ""));
        if digits.starts_with('-') {
            sign = "-";
        }
        let (whole, decimals) =
            digits.trim_start_matches('-').split_once('.').unwrap_or((digits.trim_start_matches('-'), ""));
        (before, after) = (before.max(whole.len()), after.max(decimals.len()));
        error = error.max(uncertainty.trim_end_matches(')').len());
        let places = exponent.trim_start_matches('-').len();
        if places > 0 {
            let negative = if exponent.starts_with('-') || power.starts_with("e-") { "-" } else { "" };
            power = format!("e{negative}{}", places.max(power.trim_start_matches(['e', '-']).parse().unwrap_or(0)));
        }
    }
    let error = if error > 0 { format!("({error})") } else { String::new() };
    format!("S[table-format={sign}{before}.{after}{error}{power}]")
}

/// A cell as siunitx reads it; in braces where it is no number.
fn latex_number(cell: &str) -> String {
    siunitx(cell).unwrap_or_else(|| format!("{{{}}}", latex(cell)))
}

/// A number in the letters of siunitx: `1(9)e-4`.
fn siunitx(cell: &str) -> Option<String> {
    let mut text = String::new();
    for letter in cell.chars() {
        match letter {
            '\u{2212}' => text.push('-'),
            '\u{202f}' => {}
            '\u{d7}' => text.push('e'),
            letter => text.push(RAISED.iter().find(|(above, _)| *above == letter).map_or(letter, |(_, plain)| *plain)),
        }
    }
    // A power of ten: `e10-4` is `e-4` to siunitx.
    let text = text.replacen("e10", "e", 1);
    let is_number = text.trim_start_matches('-').starts_with(|letter: char| letter.is_ascii_digit());
    let only_digits = text.chars().all(|letter| letter.is_ascii_digit() || "-.()e".contains(letter));
    (is_number && only_digits).then_some(text)
}

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
            // Names without spaces may break there, as lines of narrow columns have to.
            '=' | '/' => {
                safe.push(letter);
                safe.push_str(r"\allowbreak{}");
            }
            '~' => safe.push_str(r"\textasciitilde{}"),
            '^' => safe.push_str(r"\textasciicircum{}"),
            '\\' => safe.push_str(r"\textbackslash{}"),
            '<' => safe.push_str("$<$"),
            '>' => safe.push_str("$>$"),
            '\u{2212}' => safe.push_str("$-$"),
            '\u{d7}' => safe.push_str(r"$\times$"),
            '\u{b7}' => safe.push_str(r"$\cdot$"),
            '\u{b1}' => safe.push_str(r"$\pm$"),
            '\u{221e}' => safe.push_str(r"$\infty$"),
            '\u{2013}' => safe.push_str("--"),
            '"' => safe.push_str(r"\textquotedbl{}"),
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

    use crate::report::table::Cell;

    fn document() -> Document {
        let mut document = Document::new("A & B", "Agrees.", "Within 1 %.");
        let row = vec![Cell::text("Picture"), Cell::text("agrees")];
        document.table(Table::new("verdicts", &[("Part", ""), ("Verdict", "")], [row]));
        document.heading("Errors_1");
        let row = |name: &str, error, bias| vec![Cell::text(name), error, Cell::Number(bias)];
        let rows =
            [row("a|b", Cell::Uncertain(0.07791, 0.00089), Some(-12.0)), row("[c", Cell::Number(None), Some(2.5))];
        document.table(Table::new("errors_1 & more", &[("Name", ""), ("relMSE", ""), ("Bias", "%")], rows));
        document.table(Table::new("none", &[("Nothing", "")], std::iter::empty()));
        let rows = (0..LONG + 1).map(|row| vec![Cell::Number(Some(row as f64 * 1e-7))]);
        document.table(Table::new("long", &[("Error", "")], rows));
        let [file, print] = ["study.svg", "study.pdf"].map(str::to_owned);
        document.figure(Figure { file, print, is_wide: true, caption: "50 % of it".into() });
        document
    }

    #[test]
    fn markup_is_taken_literally() {
        let text = document().markdown();
        assert!(text.starts_with("# A \\& B\n\n**Agrees.** Within 1 %.\n"), "{text}");
        assert!(text.contains("| a\\|b | 0.0779(9) | −12.0 |"), "{text}");
        assert!(text.contains("## Errors\\_1") && !text.contains("Nothing"), "{text}");
        assert!(text.contains("![50 % of it](study.svg)") && text.contains("| --- | ---: | ---: |"), "{text}");
    }

    #[test]
    fn numbers_of_latex_tables_are_aligned_at_the_decimal_marker() {
        let text = document().latex_tables(false);
        assert_eq!(text.matches("\\begin{table}").count(), 2, "{text}");
        assert_eq!(text.matches("\\begin{table}").count(), text.matches("\\end{table}").count());
        assert!(text.contains(r"\begin{tabular}{@{}lS[table-format=1.4(1)]S[table-format=-2.1]@{}}"), "{text}");
        assert!(
            text.contains(r"\caption{errors\_1 \& more}") && text.contains(r"Name & {relMSE} & {Bias (\%)} \\"),
            "{text}"
        );
        assert!(text.contains(r"a|b & 0.0779(9) & -12.0 \\") && text.contains(r"{[}c & {--} & 2.5 \\"), "{text}");
        let long = document().latex_tables(true);
        assert!(
            long.contains(r"\begin{longtable}{@{}S[table-format=1.2e-1]@{}}") && long.contains(r"\endfirsthead"),
            "{long}"
        );
        assert!(long.contains("    1.00e-7 \\\\\n") && !text.contains("longtable"), "{long}");
        let figures = document().latex_figures();
        assert!(figures.contains(r"\begin{figure*}") && figures.contains(r"{{study}.pdf}"), "{figures}");
        assert!(figures.contains(r"\caption{50 \% of it}"), "{figures}");
        assert_eq!(latex("3\u{d7}10\u{207b}\u{2074} m\u{b2}"), r"3$\times$10$^{-4}$ m$^{2}$");
        assert_eq!(siunitx("\u{2212}2.34(5)\u{d7}10\u{207b}\u{2074}").as_deref(), Some("-2.34(5)e-4"));
        assert_eq!(latex_number("0.0779(NaN)"), "{0.0779(NaN)}");
        assert_eq!(latex_number("65\u{202f}536"), "65536");
    }
}
