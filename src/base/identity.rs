//! The identity of a build, and what becomes of another build's work.
//!
//! Keys, records, state files, presets and pictures name the build that made them: the version and the hash of the sources
//! (`base/source_hash.rs` computes it when the program is built). After an edit of a single constant a result is that of another
//! build, and is refused where work goes on: it is neither taken as current nor silently made anew. Who knows what was edited may
//! go on with it ([`Resume::mix_builds`]); the result then names all builds that had part in it.
//!
//! Pictures by Cycles are no results of this program: their keys hold the scripts that decide their pixels ([`crate::bridge`]).

use crate::base::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::LazyLock;

/// Digits of the hash that readers see.
const SHORT: usize = 12;

/// The compiler of this build, by its own words.
pub const COMPILER: &str = env!("CLOUDPARITY_COMPILER");

/// Attribute of a picture: the build that rendered it, or all of them.
pub const ATTRIBUTE: &str = "build";

/// What made a result: `VERSION+HASH`, with the 64 hexadecimal digits of the sources' hash.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Identity(String);

impl Identity {
    /// This build.
    pub fn current() -> &'static Self {
        static CURRENT: LazyLock<Identity> =
            LazyLock::new(|| Identity::of(env!("CARGO_PKG_VERSION"), env!("CLOUDPARITY_SOURCES_SHA256")));
        &CURRENT
    }

    /// The build of a version from sources with that hash.
    pub fn of(version: &str, sources_sha256: &str) -> Self {
        Self(format!("{version}+{sources_sha256}"))
    }

    /// A build from before builds had an identity: that of a file that names none.
    pub fn unknown() -> Self {
        Self("unknown".to_owned())
    }

    /// All of it, for records.
    pub fn full(&self) -> &str {
        &self.0
    }
}

impl Default for Identity {
    /// What a record has that names no build: [`Identity::unknown`].
    fn default() -> Self {
        Self::unknown()
    }
}

/// The short text, for readers: `VERSION+` and twelve digits.
impl fmt::Display for Identity {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = self.0.find('+').map_or(self.0.len(), |plus| (plus + 1 + SHORT).min(self.0.len()));
        formatter.write_str(self.0.get(..end).unwrap_or(&self.0))
    }
}

/// Identities in a line, for attributes and errors; where none is named, the unknown one.
pub fn listed<'a>(builds: impl IntoIterator<Item = &'a Identity>, show: impl Fn(&Identity) -> String) -> String {
    let all: Vec<String> = builds.into_iter().map(show).collect();
    if all.is_empty() { Identity::unknown().0 } else { all.join(", ") }
}

/// How work goes on that was begun before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Resume {
    /// Who goes on: this build. Tests name others.
    pub build: Identity,
    /// Whether work of another build is gone on with instead of being refused.
    pub mix_builds: bool,
}

impl Default for Resume {
    fn default() -> Self {
        Self { build: Identity::current().clone(), mix_builds: false }
    }
}

impl Resume {
    /// Going on with whatever build's work is there.
    pub fn mixing() -> Self {
        Self { mix_builds: true, ..Self::default() }
    }

    /// The builds that have part in work of `found` once this one goes on with it, or an error that names both. `place` is the file.
    pub fn join(&self, place: &str, found: &[Identity]) -> Result<Vec<Identity>> {
        let others: Vec<&Identity> = found.iter().filter(|build| **build != self.build).collect();
        if others.is_empty() {
            return Ok(vec![self.build.clone()]);
        }
        if !self.mix_builds {
            return Err(Error::new(
                place,
                format!("work of another build, {}", listed(others, ToString::to_string)),
                format!("that of this build, {}", self.build),
                "Take another place, or remove what is there, and the work is done anew; or go on with it knowingly: the results then name \
                 both builds.",
            )
            .with_setting("mix_builds"));
        }
        let mut all = found.to_vec();
        if !all.contains(&self.build) {
            all.push(self.build.clone());
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identity_is_a_version_and_a_hash_and_reads_back() {
        let current = Identity::current();
        let hash =
            current.full().strip_prefix(concat!(env!("CARGO_PKG_VERSION"), "+")).expect("the version stands first");
        assert!(hash.len() == 64 && hash.bytes().all(|byte| byte.is_ascii_hexdigit()), "{hash}");
        assert_eq!(current.to_string(), format!("{}+{}", env!("CARGO_PKG_VERSION"), &hash[..SHORT]));
        let text = serde_json::to_string(current).expect("JSON");
        assert_eq!(serde_json::from_str::<Identity>(&text).expect("an identity"), *current);
        assert_eq!(Identity::unknown().to_string(), "unknown");
        assert_eq!(Identity::of("1", "ab").to_string(), "1+ab");
    }

    #[test]
    fn work_of_another_build_is_refused_by_both_names_or_gone_on_with() {
        let [ours, other] = ["a", "b"].map(|hash| Identity::of("0.1.0", &hash.repeat(64)));
        let resume = |mix_builds| Resume { build: ours.clone(), mix_builds };
        assert_eq!(resume(false).join("x", &[]).expect("nothing there"), std::slice::from_ref(&ours));
        assert_eq!(resume(false).join("x", std::slice::from_ref(&ours)).expect("our own"), std::slice::from_ref(&ours));
        for found in [vec![other.clone()], vec![ours.clone(), other.clone()], vec![Identity::unknown()]] {
            let error = resume(false).join("the/place", &found).expect_err("it is refused").to_string();
            let others = found.iter().filter(|build| **build != ours);
            for part in
                others.map(ToString::to_string).chain([ours.to_string(), "the/place".into(), "knowingly".into()])
            {
                assert!(error.contains(&part), "{part} in {error}");
            }
        }
        assert_eq!(
            resume(true).join("x", std::slice::from_ref(&other)).expect("knowingly"),
            [other.clone(), ours.clone()]
        );
        let both = [other, ours.clone()];
        assert_eq!(resume(true).join("x", &both).expect("knowingly"), both);
    }
}
