//! Names, ranges and units of the parameters of density models: one schema for all.

use crate::base::error::{Error, Result};
use indexmap::IndexMap;
use serde::Serialize;

/// The default of a parameter that has none of its own: where it is not given, the model takes it from other parameters, as its `about`
/// says.
pub const DERIVED: f64 = f64::NAN;

/// A named number that a model takes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parameter {
    /// Its name on the command line and in files.
    pub name: &'static str,
    /// What it does.
    pub about: &'static str,
    /// What it is measured in; empty for a plain number.
    pub unit: &'static str,
    /// What values are allowed.
    pub range: Range,
    /// Its value where none is given, or [`DERIVED`].
    pub default: f64,
    /// The range that the model's description uses, for random trials: a part of what is allowed.
    pub usual: [f64; 2],
}

/// Short to write in tables.
pub const fn parameter(
    name: &'static str,
    default: f64,
    range: Range,
    usual: [f64; 2],
    unit: &'static str,
    about: &'static str,
) -> Parameter {
    Parameter { name, about, unit, range, default, usual }
}

impl Parameter {
    /// Its value where none is given; none where that is derived from others.
    pub fn fixed_default(&self) -> Option<f64> {
        Some(self.default).filter(|value| !value.is_nan())
    }

    /// Whether a parameter of this name is there and may have the value; `place` says where the value stands.
    pub fn check(parameters: &[Self], name: &str, value: f64, place: &str) -> Result<&'static str> {
        let Some(parameter) = parameters.iter().find(|parameter| parameter.name == name) else {
            let known: Vec<&str> = parameters.iter().map(|parameter| parameter.name).collect();
            return Err(Error::new(
                place,
                format!("the parameter \"{name}\""),
                format!("one of {}", known.join(", ")),
                "Correct the name.",
            ));
        };
        if !parameter.range.holds(value) {
            return Err(Error::new(
                format!("{place}: parameter {name}"),
                value.to_string(),
                parameter.range.to_string(),
                "Correct the value.",
            ));
        }
        Ok(parameter.name)
    }
}

/// What values a parameter may have; all of them finite.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Range {
    /// Any finite number.
    Any,
    /// Above 0.
    Positive,
    /// 0 or above.
    NotNegative,
    /// From the first to the second.
    Between(f64, f64),
    /// Whole, from the first to the second.
    Whole(u32, u32),
}

impl std::fmt::Display for Range {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Any => write!(out, "any finite number"),
            Self::Positive => write!(out, "a finite number above 0"),
            Self::NotNegative => write!(out, "0 or a finite number above it"),
            Self::Between(low, high) => write!(out, "{low} to {high}"),
            Self::Whole(low, high) => write!(out, "a whole number from {low} to {high}"),
        }
    }
}

impl Range {
    /// Whether a value is allowed.
    pub fn holds(&self, value: f64) -> bool {
        value.is_finite()
            && match *self {
                Self::Any => true,
                Self::Positive => value > 0.0,
                Self::NotNegative => value >= 0.0,
                Self::Between(low, high) => (low..=high).contains(&value),
                Self::Whole(low, high) => value.fract() == 0.0 && (f64::from(low)..=f64::from(high)).contains(&value),
            }
    }
}

/// Name and value of a text `NAME=VALUE`.
pub fn assignment(text: &str) -> Result<(&str, f64)> {
    let parts = text.split_once('=').and_then(|(name, value)| Some((name.trim(), value.trim().parse().ok()?)));
    parts.ok_or_else(|| Error::new("parameter", text, "NAME=VALUE with a number", "Write for example octaves=4."))
}

/// Values of a model's parameters: of each but those that are derived from others and were not given.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Values(IndexMap<&'static str, f64>);

impl Values {
    /// The defaults.
    pub fn defaults(parameters: &[Parameter]) -> Self {
        let fixed = |parameter: &Parameter| Some((parameter.name, parameter.fixed_default()?));
        Self(parameters.iter().filter_map(fixed).collect())
    }

    /// Sets a parameter, after its name and range are checked. `place` says where the value stands.
    pub fn set(&mut self, parameters: &[Parameter], name: &str, value: f64, place: &str) -> Result<()> {
        let name = Parameter::check(parameters, name, value, place)?;
        self.0.insert(name, value);
        Ok(())
    }

    /// Sets parameters given as `NAME=VALUE`.
    pub fn set_texts(&mut self, parameters: &[Parameter], texts: &[String]) -> Result<()> {
        for text in texts {
            let (name, value) = assignment(text)?;
            self.set(parameters, name, value, text)?;
        }
        Ok(())
    }

    /// The value of a parameter that is derived from others where it is not given.
    pub fn given(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// The value of a parameter that the model has and that has a default of its own.
    pub fn get(&self, name: &str) -> f64 {
        *self.0.get(name).unwrap_or_else(|| panic!("the model has no parameter {name}"))
    }

    /// All names and values.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.0.iter().map(|(name, value)| (*name, *value))
    }
}
