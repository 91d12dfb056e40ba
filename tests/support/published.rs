//! Published values of closed forms, where they are there, and random parameters of published systems.

use cloudparity::engines::Model;
use cloudparity::engines::parameters::{Range, Values};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// The values of a file; `None` where they are missing.
pub fn published(name: &str) -> Option<Value> {
    let path = super::project(&format!("../shared/golden/encyclopedia/{name}.json"));
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("skipped: {} is missing", path.display());
        return None;
    };
    Some(serde_json::from_str(&text).expect("JSON"))
}

/// A list of numbers.
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|item| item.as_f64().expect("a number")).collect()
}

/// A number of trials that an environment variable may raise.
pub fn count(variable: &str, usual: usize) -> usize {
    std::env::var(variable).map_or(usual, |text| text.parse().expect("a number"))
}

/// Values anew between the ends of their usual ranges, of those that are no whole numbers and no ends: what a kernel leaves out stays the same but
/// where a model leaves out what two of them make together.
pub fn values_between(model: &Model, values: &Values, random: &mut ChaCha8Rng) -> Values {
    let mut values = values.clone();
    for parameter in model.parameters {
        let [low, high] = parameter.usual;
        let old = values.get(parameter.name);
        if !matches!(parameter.range, Range::Whole(..)) && low < old && old < high {
            let drawn = random.random_range(low..high).max(low.next_up());
            values.set(model.parameters, parameter.name, drawn, "a random trial").expect("usual values are allowed");
        }
    }
    values
}

/// Random values within the usual ranges; one in four is an end of its range, where things break.
pub fn random_values(model: &Model, random: &mut ChaCha8Rng) -> Values {
    let mut values = Values::defaults(model.parameters);
    for parameter in model.parameters {
        let [low, high] = parameter.usual;
        let drawn = match random.random_range(0..8) {
            0 => low,
            1 => high,
            _ => random.random_range(low..=high),
        };
        let value = match parameter.range {
            Range::Whole(..) => drawn.round().clamp(low, high.min(low.max(12.0))),
            _ => drawn,
        };
        values.set(model.parameters, parameter.name, value, "a random trial").expect("usual values are allowed");
    }
    values
}
