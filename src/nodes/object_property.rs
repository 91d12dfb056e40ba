//! Reading properties that are JSON objects: every key is required, none is ignored, every number is finite.

use crate::base::error::{Error, Result};
use serde_json::{Map, Value as Json};

/// A value of the file with its place in words, for errors.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    value: &'a Json,
    place: &'a str,
}

impl<'a> Part<'a> {
    /// The value at `place`.
    pub fn new(value: &'a Json, place: &'a str) -> Self {
        Self { value, place }
    }

    /// The error for a value that is none of what is expected.
    pub fn wrong(&self, expected: impl Into<String>) -> Error {
        let mut found = self.value.to_string();
        const LONGEST: usize = 200;
        if let Some((end, _)) = found.char_indices().nth(LONGEST) {
            found.truncate(end);
            found += "...";
        }
        Error::new(self.place, found, expected, "Correct the value, or export the scene again.")
    }

    /// The members of an object that has these keys and no others, each given to `read` with its place.
    pub fn members<const N: usize>(&self, keys: [&str; N]) -> Result<[Member<'a>; N]> {
        let expected = || format!("an object with {}", keys.join(", "));
        let object: &Map<String, Json> = self.value.as_object().ok_or_else(|| self.wrong(expected()))?;
        if object.len() != N || keys.iter().any(|key| !object.contains_key(*key)) {
            return Err(self.wrong(expected()));
        }
        Ok(keys.map(|key| Member { value: &object[key], place: format!("{}.{key}", self.place) }))
    }

    /// The items of a list of `least` to `most` items.
    pub fn items(&self, [least, most]: [usize; 2], what: &str) -> Result<Vec<Member<'a>>> {
        let list = self.value.as_array().filter(|list| (least..=most).contains(&list.len())).ok_or_else(|| {
            self.wrong(match (least, most) {
                (_, usize::MAX) => format!("a list of {least} or more {what}"),
                _ if least == most => format!("a list of {least} {what}"),
                _ => format!("a list of {least} to {most} {what}"),
            })
        })?;
        let place = |index: usize| format!("{}[{index}]", self.place);
        Ok(list.iter().enumerate().map(|(index, value)| Member { value, place: place(index) }).collect())
    }

    /// A number from `low` to `high`, as f32.
    pub fn number(&self, [low, high]: [f32; 2]) -> Result<f32> {
        let number = self.value.as_f64().map(|number| number as f32);
        number.filter(|number| number.is_finite() && (low..=high).contains(number)).ok_or_else(|| {
            self.wrong(match (low, high) {
                (f32::MIN, f32::MAX) => "a finite number".to_owned(),
                (_, f32::MAX) => format!("a finite number from {low} on"),
                _ => format!("a number from {low} to {high}"),
            })
        })
    }

    /// `N` numbers, each from `low` to `high`.
    pub fn numbers<const N: usize>(&self, limits: [f32; 2]) -> Result<[f32; N]> {
        let mut numbers = [0.0; N];
        for (number, item) in numbers.iter_mut().zip(self.items([N, N], "numbers")?) {
            *number = item.part().number(limits)?;
        }
        Ok(numbers)
    }

    /// One of these names.
    pub fn name(&self, names: &'static [&'static str]) -> Result<&'static str> {
        let given = self.value.as_str();
        let known = names.iter().find(|name| given == Some(**name)).copied();
        known.ok_or_else(|| self.wrong(format!("one of {}", names.join(", "))))
    }

    /// True or false.
    pub fn flag(&self) -> Result<bool> {
        self.value.as_bool().ok_or_else(|| self.wrong("true or false"))
    }
}

/// A value inside of another one.
pub struct Member<'a> {
    value: &'a Json,
    place: String,
}

impl Member<'_> {
    /// The value, to be read.
    pub fn part(&self) -> Part<'_> {
        Part { value: self.value, place: &self.place }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let value = json!({"a": [1, 2], "b": "x"});
        let part = Part::new(&value, "node");
        let [a, b] = part.members(["a", "b"]).expect("these are the keys");
        assert_eq!(a.part().numbers::<2>([0.0, 2.0]).expect("two numbers"), [1.0, 2.0]);
        assert_eq!(a.part().numbers::<2>([0.0, 1.5]).expect_err("2 is too large").place, "node.a[1]");
        assert!(a.part().numbers::<3>([0.0, 2.0]).is_err());
        assert_eq!(b.part().name(&["y"]).expect_err("x is not y").place, "node.b");
        assert!(part.members(["a"]).is_err());
        assert!(part.members(["a", "c"]).is_err());
    }
}
