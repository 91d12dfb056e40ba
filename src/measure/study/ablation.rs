//! What each defect of a published system costs in error and time: the differences between runs that differ in it alone.
//!
//! A defect is judged twice, since defects do not add up: put *alone* into the corrected system, and *taken out* of the system as published.
//! Errors of both runs are against the same truth, so that the standard error of their difference is of the difference itself
//! ([`errors::relmse_change`]).

use crate::base::error::{Error, Result};
use crate::base::plain_text::csv_cell;
use crate::engines::defects::{Defect, Defects};
use crate::engines::{Model, Selection};
use crate::measure::combination::Combination;
use crate::measure::errors::{self, Uncertain};
use crate::measure::study::{Measured, Results};
use crate::scene::image::Image;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::HashMap;
use std::path::Path;

/// A value of the axis of defects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DefectsAxis {
    /// A set.
    Kept(Defects),
    /// Every defect of the density model alone.
    Each,
    /// All of them but one, for every one.
    AllButEach,
}

const EACH: &str = "each";
const ALL_BUT_EACH: &str = "all-but-each";

impl DefectsAxis {
    /// The sets that it means for a model.
    pub fn sets(&self, model: &Model) -> Vec<Defects> {
        let defects = model.defects.iter();
        match self {
            Self::Kept(set) => vec![set.clone()],
            Self::Each => defects.map(Defects::only).collect(),
            Self::AllButEach => defects.map(|defect| Defects::all_but(model, defect)).collect(),
        }
    }
}

impl Serialize for DefectsAxis {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Kept(set) => set.serialize(serializer),
            Self::Each => serializer.serialize_str(EACH),
            Self::AllButEach => serializer.serialize_str(ALL_BUT_EACH),
        }
    }
}

impl<'de> Deserialize<'de> for DefectsAxis {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        match text.as_str() {
            EACH => Ok(Self::Each),
            ALL_BUT_EACH => Ok(Self::AllButEach),
            _ => text.parse().map(Self::Kept).map_err(|error: Error| {
                let expected = format!("{EACH}, {ALL_BUT_EACH}, {}", error.expected);
                serde::de::Error::custom(Error { expected, ..error })
            }),
        }
    }
}

/// What changes from one run to another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// relMSE with what is judged minus relMSE without it: above 0 it makes the picture worse.
    pub relmse: Uncertain,
    /// Bias of the image's mean with it minus without it.
    pub bias: f64,
    /// Time with it over time without it.
    pub time: f64,
}

/// A defect, or all of them together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Its name; `all` together.
    pub defect: String,
    /// In the corrected system. None where a run is missing.
    pub alone: Option<Change>,
    /// In the system as published, beside all others; of `all` none.
    pub among_all: Option<Change>,
}

/// What the defects of a system cost in a scene under settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ablation {
    /// The scene.
    pub scene: String,
    /// The density model.
    pub density: String,
    /// The settings in words.
    pub settings: String,
    /// relMSE and seconds of the corrected form.
    pub corrected: (Uncertain, f64),
    /// The same as published.
    pub published: (Uncertain, f64),
    /// Each defect in the order of the model, then all together.
    pub rows: Vec<Row>,
}

/// A combination with no defects: what runs of one ablation share.
fn without_defects(combination: &Combination) -> Combination {
    Combination { defects: Defects::NONE, ..combination.clone() }
}

/// Runs that differ in their defects alone, by their sets.
struct Runs<'a> {
    model: &'static Model,
    runs: Vec<(Defects, &'a Measured)>,
}

impl<'a> Runs<'a> {
    fn of(&self, set: &Defects) -> Option<&'a Measured> {
        let set = set.of_model(self.model).ok()?;
        self.runs.iter().find(|(defects, _)| *defects == set).map(|(_, run)| *run)
    }
}

impl Results {
    /// The ablations whose runs are there: of every system with both of its forms.
    pub(super) fn ablations(&self, folder: &Path) -> Result<Vec<Ablation>> {
        let mut groups: Vec<(Combination, Vec<&Measured>)> = Vec::new();
        for run in &self.runs {
            let shared = without_defects(&run.combination);
            match groups.iter_mut().find(|(one, _)| *one == shared) {
                Some((_, runs)) => runs.push(run),
                None => groups.push((shared, vec![run])),
            }
        }
        // In the order of the study's scenes and densities.
        let densities = self.study.densities();
        let place = |one: &Combination| {
            let scene = self.truths.iter().position(|truth| truth.scene == one.scene);
            (densities.iter().position(|density| *density == one.density), scene)
        };
        groups.sort_by_key(|(one, _)| place(one));
        let mut truths: HashMap<&str, Vec<Image>> = HashMap::new();
        let mut ablations = Vec::new();
        for (shared, runs) in &groups {
            let model = Selection::parse(&shared.density)?.model;
            let sets = runs.iter().map(|run| Ok((run.combination.defects.of_model(model)?, *run)));
            let runs = Runs { model, runs: sets.collect::<Result<_>>()? };
            let (Some(corrected), Some(published)) = (runs.of(&Defects::NONE), runs.of(&Defects::ALL)) else {
                continue;
            };
            if model.defects.is_empty() {
                continue;
            }
            if !truths.contains_key(corrected.truth.as_str()) {
                let Some(record) = self.truths.iter().find(|record| record.id == corrected.truth) else { continue };
                truths.insert(&corrected.truth, record.read(folder)?);
            }
            let truth = &truths[corrected.truth.as_str()];
            let change = |with: Option<&Measured>, without: Option<&Measured>| -> Result<Option<Change>> {
                let (Some(with), Some(without)) = (with, without) else { return Ok(None) };
                let [picture, other] = [with, without].map(|run| Image::read_exr(&folder.join(&run.picture)));
                Ok(Some(Change {
                    relmse: errors::relmse_change(&picture?, &other?, truth)?,
                    bias: with.errors.bias.value - without.errors.bias.value,
                    time: with.seconds.median / without.seconds.median,
                }))
            };
            let row = |defect: &Defect| {
                Ok(Row {
                    defect: defect.id.to_owned(),
                    alone: change(runs.of(&Defects::only(defect)), Some(corrected))?,
                    among_all: change(Some(published), runs.of(&Defects::all_but(model, defect)))?,
                })
            };
            let mut rows = model.defects.iter().map(row).collect::<Result<Vec<Row>>>()?;
            rows.push(Row {
                defect: Defects::ALL.to_string(),
                alone: change(Some(published), Some(corrected))?,
                among_all: None,
            });
            let figures = |run: &Measured| (run.errors.relmse, run.seconds.median);
            ablations.push(Ablation {
                scene: shared.scene.clone(),
                density: shared.density.clone(),
                settings: shared.describe(),
                corrected: figures(corrected),
                published: figures(published),
                rows,
            });
        }
        Ok(ablations)
    }
}

/// One line per defect, scene and settings.
pub(super) fn csv(ablations: &[Ablation]) -> String {
    let mut text = String::from(
        "scene,density,settings,defect,alone_relmse_change,alone_relmse_standard_error,alone_bias_change,alone_time_ratio,\
         among_all_relmse_change,among_all_relmse_standard_error,among_all_bias_change,among_all_time_ratio\n",
    );
    for ablation in ablations {
        for row in &ablation.rows {
            let mut fields: Vec<String> =
                [&ablation.scene, &ablation.density, &ablation.settings, &row.defect].map(|text| csv_cell(text)).into();
            for change in [row.alone, row.among_all] {
                let numbers = change.map(|change| {
                    [change.relmse.value, change.relmse.standard_error, change.bias, change.time].map(|x| x.to_string())
                });
                fields.extend(numbers.unwrap_or_default());
            }
            text += &(fields.join(",") + "\n");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::{graph, perlin_fbm};

    #[test]
    fn words_mean_sets_of_the_model() {
        let of = |text: &str| serde_json::from_str::<DefectsAxis>(&format!("\"{text}\""));
        let count = perlin_fbm::MODEL.defects.len();
        for (text, sets) in [("each", count), ("all-but-each", count), ("PF-4", 1), ("all", 1)] {
            let value = of(text).expect("a value");
            assert_eq!(serde_json::to_string(&value).expect("it serialises"), format!("\"{text}\""));
            assert_eq!(value.sets(&perlin_fbm::MODEL).len(), sets);
        }
        assert!(of("each").expect("a value").sets(&graph::MODEL).is_empty());
        let alone = of("each").expect("a value").sets(&perlin_fbm::MODEL);
        let others = of("all-but-each").expect("a value").sets(&perlin_fbm::MODEL);
        for ((defect, alone), others) in perlin_fbm::MODEL.defects.iter().zip(alone).zip(others) {
            for other in perlin_fbm::MODEL.defects {
                assert_eq!(alone.has(other), other.id == defect.id);
                assert_eq!(others.has(other), other.id != defect.id);
            }
        }
        assert!(of("every").expect_err("refused").to_string().contains("all-but-each"));
    }
}
