//! Names and sentences of users' files as plain text of a format, whatever they hold.

use super::numbers::ABSENT;

/// Text on one line: line breaks and other controls, which a terminal would obey, are spaces.
pub fn one_line(text: &str) -> String {
    text.chars().map(|letter| if is_control(letter) { ' ' } else { letter }).collect()
}

/// Whether a character is an order to what shows it: to break the line, to turn the direction of writing, to a terminal.
pub(crate) fn is_control(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Text on one line of Markdown, with its markup taken literally; a dash for none.
pub fn markdown(text: &str) -> String {
    let mut safe = String::new();
    for letter in text.chars() {
        match letter {
            letter if is_control(letter) => safe.push(' '),
            '|' | '<' | '>' | '[' | ']' | '`' | '*' | '_' | '\\' | '&' | '#' | '~' => {
                safe.push('\\');
                safe.push(letter);
            }
            _ => safe.push(letter),
        }
    }
    if safe.is_empty() { ABSENT.into() } else { safe }
}

/// A cell of a CSV file: quoted where it holds what would end it. Text that a spreadsheet would compute, because it begins like a formula, has
/// an apostrophe before it, by which spreadsheets know text; numbers stay as they are.
pub fn csv_cell(text: &str) -> String {
    let begins_like_formula = text.starts_with(['=', '+', '-', '@', '\t', '\r', '\n']);
    let guard = if begins_like_formula && text.parse::<f64>().is_err() { "'" } else { "" };
    if text.contains([',', ';', '"', '\'']) || text.contains(is_control) {
        format!("\"{guard}{}\"", text.replace('"', "\"\""))
    } else {
        format!("{guard}{text}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_numbers_and_formulas_become_text() {
        for number in ["-1.5", "+2", "1e-9", "-inf", ""] {
            assert_eq!(csv_cell(number), number);
        }
        assert_eq!(csv_cell("=1+1"), "'=1+1");
        assert_eq!(csv_cell("+cmd|x"), "'+cmd|x");
        assert_eq!(csv_cell("-x,y"), "\"'-x,y\"");
        assert_eq!(csv_cell("@\"a\"\nb"), "\"'@\"\"a\"\"\nb\"");
        assert_eq!(csv_cell("a=b"), "a=b");
    }

    #[test]
    fn a_line_is_one_line() {
        assert_eq!(one_line("a\nb\u{1b}[31m\u{2028}c"), "a b [31m c");
        assert_eq!(markdown("a|`b`\r\n<i>"), "a\\|\\`b\\`  \\<i\\>");
        assert_eq!(markdown(""), ABSENT);
    }
}
