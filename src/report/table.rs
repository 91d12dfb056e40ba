//! Tables whose columns have one precision: cells as text for pages and Markdown, and as numbers aligned at the decimal marker for LaTeX.

use crate::base::numbers::{ABSENT, column, count, uncertain_with};
use serde::Serialize;

/// Powers of ten are left to a column of uncertain figures that has smaller ones than this.
const SMALLEST_PLAIN: f64 = 1e-4;

/// A cell before its column gives it a precision.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Words, or a figure with its own unit.
    Text(String),
    /// A number, or none.
    Number(Option<f64>),
    /// A number and its standard error.
    Uncertain(f64, f64),
    /// How many.
    Count(Option<u64>),
}

impl Cell {
    /// Words.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }
}

/// A column's name and the unit of its numbers, empty where there is none.
pub type Head = (&'static str, &'static str);

/// A table in the form in which it is shown.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Table {
    /// What it shows, of what.
    pub caption: String,
    /// The columns.
    pub columns: Vec<Column>,
    /// Rows of cells, as many as there are columns.
    pub rows: Vec<Vec<String>>,
}

/// The head of a column.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Its name, with the unit in brackets.
    pub name: String,
    /// Whether all its cells are numbers, so that it stands flush right.
    pub is_number: bool,
}

impl Table {
    /// A table of cells, each column at one precision.
    pub fn new(caption: impl Into<String>, heads: &[Head], rows: impl IntoIterator<Item = Vec<Cell>>) -> Self {
        let named = heads.iter().map(
            |&(name, unit)| {
                if unit.is_empty() { name.to_owned() } else { format!("{name} ({unit})") }
            },
        );
        Self::with_names(caption, named, rows)
    }

    /// The same, where names of columns come from the user.
    pub fn with_names(
        caption: impl Into<String>,
        names: impl IntoIterator<Item = String>,
        rows: impl IntoIterator<Item = Vec<Cell>>,
    ) -> Self {
        let cells: Vec<Vec<Cell>> = rows.into_iter().collect();
        let mut rows = vec![Vec::new(); cells.len()];
        let mut columns = Vec::new();
        for (index, name) in names.into_iter().enumerate() {
            let here: Vec<&Cell> = cells.iter().filter_map(|row| row.get(index)).collect();
            let is_number = !here.iter().any(|cell| matches!(cell, Cell::Text(_)));
            for (row, text) in rows.iter_mut().zip(shown(&here)) {
                row.push(text);
            }
            columns.push(Column { name, is_number });
        }
        Self { caption: caption.into(), columns, rows }
    }
}

/// The cells of a column as text.
fn shown(cells: &[&Cell]) -> Vec<String> {
    let numbers: Vec<f64> =
        cells.iter().filter_map(|cell| if let Cell::Number(number) = cell { *number } else { None }).collect();
    let mut numbers = column(&numbers).into_iter();
    let has_powers = cells
        .iter()
        .any(|cell| matches!(cell, Cell::Uncertain(_, error) if *error > 0.0 && *error < SMALLEST_PLAIN / 100.0));
    let show = |cell: &&Cell| match cell {
        Cell::Text(text) => text.clone(),
        Cell::Number(None) | Cell::Count(None) => ABSENT.to_owned(),
        Cell::Number(Some(_)) => numbers.next().unwrap_or_default(),
        Cell::Uncertain(value, error) => uncertain_with(*value, *error, has_powers),
        Cell::Count(number) => count(*number),
    };
    cells.iter().map(show).collect()
}

/// Seconds of a column in the unit that fits the largest: the factor and the unit.
pub fn time_unit(seconds: impl Iterator<Item = f64>) -> (f64, &'static str) {
    let largest = seconds.fold(0.0, f64::max);
    if largest < 10.0 { (1e3, "ms") } else { (1.0, "s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_have_one_precision_and_units_stand_in_their_heads() {
        let row =
            |name: &str, time, error: f64| vec![Cell::text(name), Cell::Number(time), Cell::Uncertain(error, 0.0004)];
        let rows = [row("a", Some(9.014), 0.0556), row("b", Some(15.3), 0.018), row("c", None, -0.00001)];
        let table = Table::new("errors", &[("Run", ""), ("Time", "ms"), ("relMSE", "")], rows);
        let names: Vec<&str> = table.columns.iter().map(|column| column.name.as_str()).collect();
        assert_eq!(names, ["Run", "Time (ms)", "relMSE"]);
        assert_eq!(table.columns.iter().map(|column| column.is_number).collect::<Vec<_>>(), [false, true, true]);
        assert_eq!(table.rows[0], ["a", "9.0", "0.0556(4)"]);
        assert_eq!(table.rows[1], ["b", "15.3", "0.0180(4)"]);
        assert_eq!(table.rows[2], ["c", ABSENT, "0.0000(4)"]);
    }

    #[test]
    fn the_unit_of_time_fits_the_longest() {
        assert_eq!(time_unit([0.01, 0.2].into_iter()), (1e3, "ms"));
        assert_eq!(time_unit([0.01, 20.0].into_iter()), (1.0, "s"));
    }
}
