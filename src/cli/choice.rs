//! Options that choose one of a library's named values.

use crate::base::choice::Choice;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Reads the name of a choice. The help lists all names with what their documentation says first.
pub(super) fn choice<T: Choice + Send + Sync>() -> impl TypedValueParser<Value = T> {
    let values = T::VARIANTS.iter().map(|value| PossibleValue::new(value.name()).help(value.about()));
    PossibleValuesParser::new(values)
        .map(|name| T::named(&name).expect("the parser passes these names on and no others"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Command;

    /// A choice is read by each of its names, which are those of files, too.
    fn check<T>()
    where
        T: Choice + Send + Sync + PartialEq + std::fmt::Debug + serde::Serialize,
    {
        for value in T::VARIANTS {
            let command = Command::new("a").arg(clap::Arg::new("b").long("b").value_parser(choice::<T>()));
            let matches = command.try_get_matches_from(["a", "--b", value.name()]).expect("a name is taken");
            assert_eq!(matches.get_one::<T>("b"), Some(value));
            assert_eq!(serde_json::to_value(value).expect("a name"), value.name());
            assert!(!value.about().is_empty() && !value.about().ends_with('.'), "{value:?}: {}", value.about());
        }
    }

    #[test]
    fn names_on_the_command_line_are_those_of_files() {
        check::<crate::engines::render::EngineJitter>();
        check::<crate::integrators::Jitter>();
        check::<crate::integrators::LightMode>();
        check::<crate::media::density_cache::CacheFilter>();
        check::<crate::media::density_cache::CacheFormat>();
        check::<crate::media::majorant::Tracking>();
        check::<crate::media::transfer::Integration>();
        check::<crate::measure::study::pareto_front::Metric>();
        check::<crate::scene::Release>();
    }

    #[test]
    fn the_help_is_the_first_paragraph_in_one_line() {
        let about = crate::media::majorant::Tracking::Adaptive.about();
        assert!(about.starts_with("From a few densities in each leaf:") && !about.contains('\n'), "{about}");
        assert!(about.ends_with("a few pixels of few samples may be negative"), "{about}");
    }

    #[test]
    fn another_name_is_refused_with_those_that_exist() {
        let command =
            Command::new("a").arg(clap::Arg::new("b").long("b").value_parser(choice::<crate::integrators::Jitter>()));
        let error = command.try_get_matches_from(["a", "--b", "pixels"]).expect_err("no such name").to_string();
        assert!(error.contains("[possible values: none, pixel]"), "{error}");
    }
}
