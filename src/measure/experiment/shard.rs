//! Shards: parts of a plan that separate processes work on.

use crate::base::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// One of several parts of a plan: `NUMBER/COUNT`, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    number: u32,
    count: u32,
}

/// All of a plan.
impl Default for Shard {
    fn default() -> Self {
        Self { number: 1, count: 1 }
    }
}

impl Shard {
    /// The part `number` of `count`, from 1 on.
    pub fn new(number: u32, count: u32) -> Result<Self> {
        if (1..=count).contains(&number) {
            return Ok(Self { number, count });
        }
        Err(wrong(&format!("{number}/{count}")))
    }

    /// Whether it is all of the plan.
    pub fn is_all(self) -> bool {
        self.count == 1
    }

    /// How many parts there are.
    pub fn count(self) -> u32 {
        self.count
    }

    /// Whether the job at a position of the plan is its. Jobs are dealt in turn: plans are sorted by cost, so that each shard gets a like
    /// amount of work.
    pub fn has(self, position: usize) -> bool {
        position as u64 % u64::from(self.count) == u64::from(self.number - 1)
    }
}

fn wrong(found: &str) -> Error {
    Error::new(
        "the shard",
        format!("\"{found}\""),
        "NUMBER/COUNT with a number from 1 to the count, such as 2/4",
        "Correct it: the shards of a plan in four parts are 1/4, 2/4, 3/4 and 4/4.",
    )
}

/// As it is written: `2/4`.
impl fmt::Display for Shard {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}/{}", self.number, self.count)
    }
}

impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let parts = text.split_once('/').and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        let (number, count) = parts.ok_or_else(|| wrong(text))?;
        Self::new(number, count).map_err(|_| wrong(text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_job_has_one_shard_and_what_is_none_is_refused() {
        let shards: Vec<Shard> = ["1/3", "2/3", "3/3"].map(|text| text.parse().expect("a shard")).to_vec();
        for position in 0..20 {
            assert_eq!(shards.iter().filter(|shard| shard.has(position)).count(), 1);
            assert!(Shard::default().has(position));
        }
        assert!(Shard::default().is_all() && !shards[0].is_all());
        for text in ["0/2", "3/2", "0/0", "1/0", "2", "a/b", "1/2/3", "", "-1/2", "1/ 2", "99999999999/99999999999"] {
            let error = text.parse::<Shard>().expect_err(text);
            assert!(error.found.contains(text) && error.expected.contains("1 to the count"), "{error}");
        }
    }
}
