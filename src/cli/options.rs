//! The options of the command line by the settings of the library.
//!
//! The library names settings where an error can be avoided by one ([`Error::settings`]) and knows no option. An option is called as its
//! setting is, with `-` for `_`; the table holds those that are not.

use crate::base::error::Error;
use clap::Command;

/// Settings with the options of other names that give them, of which a command has at most one. An option that means something else in
/// other commands has its value's name behind it.
const OTHERWISE_CALLED: &[(&str, &[&str])] = &[
    ("backend", &["backend", "without-gpu"]),
    ("light", &["shadows"]),
    ("steps", &["steps-per-side"]),
    ("points", &["points N"]),
];

/// The option of a command that gives a setting, as it is typed.
fn option_of(command: &Command, setting: &str) -> Option<String> {
    let same = setting.replace('_', "-");
    let names = OTHERWISE_CALLED.iter().find(|(name, _)| *name == setting).map(|(_, options)| *options);
    let wanted = names.unwrap_or(std::slice::from_ref(&same.as_str())).to_vec();
    wanted.iter().find_map(|text| {
        let (name, value) = text.split_once(' ').map_or((*text, None), |(name, value)| (name, Some(value)));
        let argument = command.get_arguments().find(|argument| argument.get_long() == Some(name))?;
        let has_value = |value: &str| {
            let mut names = argument.get_value_names().unwrap_or_default().iter();
            names.any(|name| name.as_str() == value)
        };
        value.is_none_or(has_value).then(|| format!("--{name}"))
    })
}

/// The error as the command prints it: with those of its options that the remedy speaks of.
pub(super) fn message(error: &Error, command: Option<&Command>) -> String {
    let options =
        command.into_iter().flat_map(|command| error.settings.iter().filter_map(|name| option_of(command, name)));
    let options: Vec<String> = options.collect();
    let text = error.to_string();
    if options.is_empty() {
        return text;
    }
    format!("{} ({}).", text.trim_end_matches('.'), options.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::vocabulary::all_commands;
    use std::collections::BTreeSet;
    use std::path::Path;

    /// Texts of all sources below a folder, without the command line's.
    fn sources(folder: &Path, found: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).expect("a folder of sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() && path.file_name().is_none_or(|name| name != "cli") {
                sources(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(std::fs::read_to_string(&path).expect("a source"));
            }
        }
    }

    #[test]
    fn every_setting_that_an_error_names_is_an_option_of_some_command() {
        let all = all_commands();
        let mut texts = Vec::new();
        sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut texts);
        let begin = ".with_setting(\"";
        let names: BTreeSet<&str> = texts
            .iter()
            .flat_map(|text| text.split(begin).skip(1))
            .map(|rest| rest.split('"').next().unwrap_or_default())
            .collect();
        assert!(names.len() > 10 && names.contains("backend") && names.contains("density_cache"), "{names:?}");
        for name in names {
            let known = all.iter().any(|(_, command)| option_of(command, name).is_some());
            assert!(known, "no command has an option for the setting {name}");
        }
    }

    #[test]
    fn an_error_shows_the_options_of_the_command_that_met_it() {
        let all = all_commands();
        let command = |name: &str| {
            all.iter().find(|(full, _)| full == &format!("cloudparity {name}")).map(|(_, command)| command)
        };
        let error = Error::new("a node", "one", "another", "Evaluate on the CPU.").with_setting("backend");
        let shown = |name: &str| message(&error, command(name));
        assert!(shown("render").ends_with("Evaluate on the CPU (--backend)."), "{}", shown("render"));
        assert!(shown("measure modes").ends_with("Evaluate on the CPU (--without-gpu)."), "{}", shown("measure modes"));
        assert!(shown("eval").ends_with("Evaluate on the CPU (--backend)."), "{}", shown("eval"));
        assert_eq!(shown("export"), error.to_string());
        // The points of eval are a file: more of them are not asked for by a number.
        let points = Error::new("points", "0", "some", "Ask for more points.").with_setting("points");
        assert!(message(&points, command("measure probe")).ends_with("(--points)."));
        assert_eq!(message(&points, command("eval")), points.to_string());
    }
}
