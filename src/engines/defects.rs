//! Defects of published systems: each is declared beside its model, and each is kept or corrected by itself.
//!
//! A system *as published* has all of its defects, its *corrected* form has none, and every set between them is an engine, too. So what one
//! defect costs is the difference of two pictures.

use crate::base::error::{Error, Result};
use crate::engines::{Model, models};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// Something that a published system does wrong, and that this program can do as it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Defect {
    /// Its name, such as `PF-4`: the system and a number. No two defects of any systems share one.
    pub id: &'static str,
    /// What the system does.
    pub about: &'static str,
    /// What the corrected form does.
    pub corrected: &'static str,
}

/// The defects that an engine keeps; others are corrected. Its text is `all`, `none`, or ids such as `PF-4,PF-6`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Defects(Set);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Set {
    /// All of whichever system is meant.
    All,
    /// Ids in the order in which the systems declare them, each once.
    Listed(Vec<&'static str>),
}

impl Default for Defects {
    /// None: the corrected form.
    fn default() -> Self {
        Self::NONE
    }
}

impl Defects {
    /// Every defect: the system as published.
    pub const ALL: Self = Self(Set::All);
    /// No defect: the corrected form.
    pub const NONE: Self = Self(Set::Listed(Vec::new()));

    /// A single defect.
    pub fn only(defect: &Defect) -> Self {
        Self(Set::Listed(vec![defect.id]))
    }

    /// All defects of a model but one.
    pub fn all_but(model: &Model, defect: &Defect) -> Self {
        let others = model.defects.iter().map(|other| other.id).filter(|id| *id != defect.id);
        Self(Set::Listed(others.collect()))
    }

    /// Whether no defect is kept.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Whether a defect is kept.
    pub fn has(&self, defect: &Defect) -> bool {
        match &self.0 {
            Set::All => true,
            Set::Listed(ids) => ids.contains(&defect.id),
        }
    }

    /// The same set as a list of a model's defects: what `all` means for it. An error where a defect is another system's.
    pub fn of_model(&self, model: &Model) -> Result<Self> {
        let Set::Listed(ids) = &self.0 else {
            return Ok(Self(Set::Listed(model.defects.iter().map(|defect| defect.id).collect())));
        };
        match ids.iter().find(|id| model.defects.iter().all(|defect| defect.id != **id)) {
            None => Ok(self.clone()),
            Some(strange) => Err(Error::new(
                format!("defects of density model {}", model.id),
                format!("\"{strange}\""),
                known(model.defects.iter()),
                "Leave it out, or take the model that has it: cloudparity models lists them.",
            )),
        }
    }
}

/// What may stand for a set, in words.
fn known<'a>(defects: impl Iterator<Item = &'a Defect>) -> String {
    let ids: Vec<&str> = defects.map(|defect| defect.id).collect();
    match ids.as_slice() {
        [] => "all or none: it has no defects".into(),
        ids => format!("all, none, or some of {}", ids.join(", ")),
    }
}

/// Every defect of every system, in the order of the models.
fn declared() -> impl Iterator<Item = &'static Defect> {
    models().into_iter().flat_map(|model| model.defects)
}

impl fmt::Display for Defects {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Set::All => formatter.write_str("all"),
            Set::Listed(ids) if ids.is_empty() => formatter.write_str("none"),
            Set::Listed(ids) => formatter.write_str(&ids.join(",")),
        }
    }
}

impl FromStr for Defects {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim() {
            "all" => return Ok(Self::ALL),
            "none" => return Ok(Self::NONE),
            _ => {}
        }
        let asked: Vec<&str> = text.split(',').map(str::trim).collect();
        if let Some(strange) = asked.iter().find(|id| declared().all(|defect| defect.id != **id)) {
            return Err(Error::new(
                format!("defects \"{text}\""),
                format!("\"{strange}\""),
                known(declared()),
                "Correct it; cloudparity models says what each is.",
            ));
        }
        Ok(Self(Set::Listed(declared().map(|defect| defect.id).filter(|id| asked.contains(id)).collect())))
    }
}

impl Serialize for Defects {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Defects {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::{graph, perlin_fbm};

    #[test]
    fn texts_and_sets_are_one() {
        for (text, written) in [
            ("all", "all"),
            (" none ", "none"),
            ("PF-4", "PF-4"),
            ("PF-6, PF-4", "PF-4,PF-6"),
            ("PF-13,PF-2,PF-2", "PF-2,PF-13"),
        ] {
            let found: Defects = text.parse().expect("known");
            assert_eq!(found.to_string(), written);
            assert_eq!(written.parse::<Defects>().expect("known"), found);
            let file = serde_json::to_string(&found).expect("it serialises");
            assert_eq!(file, format!("\"{written}\""));
            assert_eq!(serde_json::from_str::<Defects>(&file).expect("known"), found);
        }
        for text in ["", "PF-4,", "PF-99", "pf-4", "all,PF-4", "none,none"] {
            let error = text.parse::<Defects>().expect_err("refused");
            assert!(error.expected.contains("PF-4, PF-5"), "{text}: {error}");
        }
    }

    #[test]
    fn all_is_what_the_model_has() {
        let all = Defects::ALL.of_model(&perlin_fbm::MODEL).expect("defects");
        assert!(perlin_fbm::MODEL.defects.iter().all(|defect| all.has(defect) && Defects::ALL.has(defect)));
        assert_eq!(all.to_string().parse::<Defects>().expect("known"), all);
        assert_eq!(Defects::ALL.of_model(&graph::MODEL).expect("none"), Defects::NONE);
        let error = Defects::only(&perlin_fbm::MODEL.defects[0]).of_model(&graph::MODEL).expect_err("refused");
        assert!(error.place.contains("graph") && error.expected.contains("no defects"), "{error}");
        for defect in perlin_fbm::MODEL.defects {
            assert!(!Defects::NONE.has(defect) && Defects::only(defect).has(defect));
        }
    }

    #[test]
    fn no_two_defects_share_a_name() {
        let mut ids: Vec<&str> = declared().map(|defect| defect.id).collect();
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert!(ids.len() == count && count > 0);
        // A comma would part an id, and these words mean sets.
        assert!(ids.iter().all(|id| !id.contains([',', ' ']) && !["all", "none", ""].contains(id)));
    }
}
