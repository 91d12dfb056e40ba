//! The table as text and as CSV.

use crate::base::plain_text::csv_cell;
use crate::measure::stability::{Judgement, Table, Verdict};
use std::fmt::Write as _;

impl Table {
    /// For a terminal: a line per row, the reasons of the rows that are no pass, and the guards.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let mut line = |words: std::fmt::Arguments<'_>| {
            writeln!(text, "{words}").expect("writing to a string cannot fail");
        };
        line(format_args!(
            "{}, pictures of {}: {} rows, {} pass, {} at the limit of f32, {} fail; {:.1} s; WGSL on {}",
            self.scene,
            self.pictures_of,
            self.rows.len(),
            self.count(Verdict::Pass),
            self.count(Verdict::Limit),
            self.count(Verdict::Fails),
            self.seconds,
            self.adapter.as_deref().unwrap_or("no adapter: rows of WGSL are missing"),
        ));
        for what in &self.left_out {
            line(format_args!("left out: {what}"));
        }
        let width = self.rows.iter().map(|row| row.id.len()).max().unwrap_or(0);
        line(format_args!(
            "{:5}  {:width$}  {:>8} {:>7} {:>9} {:>9} {:>9}",
            "", "row", "values", "NaN/Inf", "error", "limit", "of bound"
        ));
        for row in &self.rows {
            line(format_args!(
                "{:5}  {:width$}  {:>8} {:>7} {:>9.1e} {:>9.1e} {:>9}",
                row.verdict.word(),
                row.id,
                row.values,
                row.nonfinite,
                row.max_error,
                row.limit,
                row.share_of_bound.map_or_else(|| "-".to_owned(), |share| format!("{share:.2}")),
            ));
        }
        for row in self.rows.iter().filter(|row| row.verdict != Verdict::Pass) {
            line(format_args!("\n{} {}: {}\n  {}", row.verdict.word(), row.id, row.varied, row.reason));
        }
        line(format_args!("\nGuards:"));
        for guard in &self.guards {
            line(format_args!(
                "  {}{}: {} ({}; {})",
                guard.name,
                if guard.holds { "" } else { " FAILS" },
                guard.keeps,
                guard.files.join(", "),
                guard.shown_by
            ));
        }
        text
    }

    /// A line per row.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "id,subject,varied,evaluator,values,nonfinite,max_error,share_of_bound,limit,reason,guards,cycles,verdict\n",
        );
        for row in &self.rows {
            text += &line(row);
        }
        text
    }
}

fn line(row: &Judgement) -> String {
    let subject = serde_json::to_value(row.subject).expect("a name");
    let words = [
        csv_cell(&row.id),
        csv_cell(subject.as_str().unwrap_or_default()),
        csv_cell(&row.varied),
        csv_cell(&row.evaluator),
        row.values.to_string(),
        row.nonfinite.to_string(),
        row.max_error.to_string(),
        row.share_of_bound.map(|share| share.to_string()).unwrap_or_default(),
        row.limit.to_string(),
        csv_cell(&row.reason),
        csv_cell(&row.guards.join("; ")),
        csv_cell(&row.cycles),
        row.verdict.word().to_lowercase(),
    ];
    words.join(",") + "\n"
}
