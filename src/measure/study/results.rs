//! What a study found: runs, the Pareto fronts, curves; its files and figures.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Ledger, read_record, to_json};
use crate::base::numbers::uncertain;
use crate::base::plain_text::csv_cell;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::measure::combination::Combination;
use crate::measure::errors;
use crate::measure::errors::Errors;
use crate::measure::images;
use crate::measure::images::FlipPair;
use crate::measure::provenance::Provenance;
use crate::measure::study::ablation::{self, Ablation};
use crate::measure::study::curve_points::{CurvePoint, MissingCurve};
use crate::measure::study::file::{Skipped, StudyFile};
use crate::measure::study::pareto_front::{self, Metric};
use crate::measure::timing::{Clock, Seconds};
use crate::measure::truth::TruthRecord;
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The figures of a study: name and file without its extension.
pub const FIGURES: [(&str, &str); 3] =
    [("time", "study"), ("convergence", "study_convergence"), ("pictures", "study_pictures")];

/// Part of a ledger that holds HDR-FLIP, by the picture and its truth: it needs packages that a study can do without, and comes after it.
const FLIPS: &str = "flips";

/// What a combination came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Hash of all that it depends on.
    pub id: String,
    /// The settings.
    pub combination: Combination,
    /// Errors against the truth.
    pub errors: Errors,
    /// HDR-FLIP against the mean of the truth, where it could be computed.
    pub flip: Option<f64>,
    /// Time of a render.
    pub seconds: Seconds,
    /// Wall time of the median render.
    pub wall_seconds: f64,
    /// Processor time of what is done once: textures, caches.
    pub prepare_seconds: f64,
    /// relMSE times seconds: cost per unit of error; less is better.
    pub cost: f64,
    /// The picture, relative to the folder.
    pub picture: String,
    /// The truth, by its hash.
    pub truth: String,
}

impl Measured {
    /// Time, errors and settings in a line.
    pub fn describe(&self) -> String {
        format!("{}: {}", self.figures(), self.combination.describe())
    }

    /// Time and errors.
    pub fn figures(&self) -> String {
        format!(
            "{:8.2} ms, relMSE {}, bias {:+.2} %{}",
            1e3 * self.seconds.median,
            uncertain(self.errors.relmse.value, self.errors.relmse.standard_error),
            100.0 * self.errors.bias.value,
            self.flip.map_or(String::new(), |flip| format!(", FLIP {flip:.4}")),
        )
    }
}

/// Everything that a study found: `results.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// [`crate::measure::study::FORMAT`].
    pub format: String,
    /// The program's version.
    pub version: String,
    /// The builds that measured it; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// The study.
    pub study: StudyFile,
    /// What did the work.
    pub machine: String,
    /// What took part; none in a file from before it was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
    /// What the runs' seconds are.
    #[serde(default)]
    pub clock: Clock,
    /// Truths.
    pub truths: Vec<TruthRecord>,
    /// Runs, cheapest first.
    pub runs: Vec<Measured>,
    /// Runs that no other of their scene and density beats in time and relMSE, by id.
    #[serde(default)]
    pub front: Vec<String>,
    /// Unbiased renderers' error against time, by samples.
    #[serde(default)]
    pub curves: Vec<CurvePoint>,
    /// Curves that could not be made, with the reason.
    #[serde(default)]
    pub missing_curves: Vec<MissingCurve>,
    /// Combinations that were left out, with the reason.
    pub skipped: Vec<Skipped>,
    /// What each defect of a system costs, where both forms of it were run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ablations: Vec<Ablation>,
    /// What else could not be made, with the reason: HDR-FLIP where its packages are missing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

/// Runs of one scene and density.
pub type Group<'a> = (&'a str, &'a str, Vec<&'a Measured>);

impl Results {
    /// Reads what a study left in a folder.
    pub fn load(folder: &Path) -> Result<Self> {
        let path = folder.join("results.json");
        read_record(&path)?.ok_or_else(|| {
            Error::new(
                path.display().to_string(),
                "no results",
                "the folder of a study that has run",
                "Run cloudparity study FILE -o FOLDER first.",
            )
        })
    }

    /// Runs by scene and density, in the order in which these come.
    pub fn groups(&self) -> Vec<Group<'_>> {
        let mut groups: Vec<Group<'_>> = Vec::new();
        for run in &self.runs {
            let key = (run.combination.scene.as_str(), run.combination.density.as_str());
            match groups.iter_mut().find(|group| (group.0, group.1) == key) {
                Some(group) => group.2.push(run),
                None => groups.push((key.0, key.1, vec![run])),
            }
        }
        groups
    }

    /// `results.json` and `results.csv`.
    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        files::write_atomically(&folder.join("results.json"), to_json(self).as_bytes())?;
        if !self.ablations.is_empty() {
            files::write_atomically(&folder.join("ablation.csv"), ablation::csv(&self.ablations).as_bytes())?;
        }
        files::write_atomically(&folder.join("results.csv"), self.csv().as_bytes())
    }

    /// One line per run, with every setting and figure.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "scene,density,light,steps,light_steps,cache_cells,cache_format,light_volume_cells,light_volume_paths,\
             light_volume_bands,light_volume_shadow_cells,light_volume_seed,sub_pixels,jitter,defects,god_rays,seconds,\
             seconds_smallest,seconds_largest,wall_seconds,prepare_seconds,relmse,relmse_standard_error,rms,rms_standard_error,bias,\
             bias_standard_error,flip,cost,on_front\n",
        );
        for run in &self.runs {
            let Combination {
                scene,
                density,
                light,
                steps,
                light_steps,
                cache,
                light_volume,
                sub_pixels,
                jitter,
                defects,
                god_rays,
            } = &run.combination;
            let found_beforehand = light_volume
                .map_or([0; 5], |volume| [volume.cells, volume.paths, volume.bands, volume.shadow_cells, volume.seed]);
            let fields = [
                csv_cell(scene),
                csv_cell(density),
                csv_cell(light),
                steps.to_string(),
                light_steps.to_string(),
                cache.cells.to_string(),
                cache.format.to_string(),
                found_beforehand.map(|number| number.to_string()).join(","),
                sub_pixels.to_string(),
                jitter.to_string(),
                csv_cell(&defects.to_string()),
                god_rays.to_string(),
                run.seconds.median.to_string(),
                run.seconds.smallest.to_string(),
                run.seconds.largest.to_string(),
                run.wall_seconds.to_string(),
                run.prepare_seconds.to_string(),
                run.errors.relmse.value.to_string(),
                run.errors.relmse.standard_error.to_string(),
                run.errors.rms.value.to_string(),
                run.errors.rms.standard_error.to_string(),
                run.errors.bias.value.to_string(),
                run.errors.bias.standard_error.to_string(),
                run.flip.map(|flip| flip.to_string()).unwrap_or_default(),
                run.cost.to_string(),
                self.front.contains(&run.id).to_string(),
            ];
            text += &(fields.join(",") + "\n");
        }
        text
    }

    /// The runs that nothing beats in time and relMSE, by scene and density.
    pub fn pareto_fronts(&self) -> Vec<Group<'_>> {
        let groups = self.groups().into_iter();
        groups
            .map(|(scene, density, runs)| (scene, density, pareto_front::pareto_front(runs, Metric::Relmse)))
            .collect()
    }

    /// Measures the errors of all runs again, from their pictures and the replicas of their truths in the folder: what differs from what was
    /// written, a sentence each, and what could not be measured.
    pub fn errors_again(&self, folder: &Path) -> (Vec<String>, Vec<String>) {
        // The same sums in the same order; what another build does to the order is far below this, and any digit that is shown above.
        const ROUNDING: f64 = 1e-9;
        let (mut differing, mut missing) = (Vec::new(), Vec::new());
        let mut replicas: HashMap<&str, Result<Vec<Image>>> = HashMap::new();
        for run in &self.runs {
            let Some(record) = self.truths.iter().find(|record| record.id == run.truth) else {
                missing.push(format!("{}: its truth is not listed", run.picture));
                continue;
            };
            let found = replicas.entry(&run.truth).or_insert_with(|| record.read(folder));
            let again = match (Image::read_exr(&folder.join(&run.picture)), found) {
                (Ok(picture), Ok(truth)) => errors::measure(&picture, truth),
                (Err(error), _) => Err(error),
                (_, Err(error)) => Err(error.clone()),
            };
            match again {
                Err(error) => missing.push(format!("{}: {error}", run.picture)),
                Ok(again) => {
                    let pairs = [
                        ("relMSE", run.errors.relmse, again.relmse),
                        ("RMS error", run.errors.rms, again.rms),
                        ("bias", run.errors.bias, again.bias),
                    ];
                    for (name, before, now) in pairs {
                        let size = before.value.abs().max(now.value.abs()).max(now.standard_error);
                        let difference =
                            (before.value - now.value).abs().max((before.standard_error - now.standard_error).abs());
                        // Also where one is no number.
                        let is_same = difference <= ROUNDING * size;
                        if !is_same {
                            differing.push(format!(
                                "{}: {name} {} as written, {} from the picture",
                                run.combination.describe(),
                                uncertain(before.value, before.standard_error),
                                uncertain(now.value, now.standard_error)
                            ));
                        }
                    }
                }
            }
        }
        (differing, missing)
    }

    /// Draws [`FIGURES`] as `.svg`, `.png` and `.pdf`. Needs matplotlib, and HDR-FLIP for the pictures.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        let truth = |id: &str| self.truths.iter().find(|record| record.id == id).map(|record| &record.replicas);
        let groups: Vec<serde_json::Value> = self
            .groups()
            .into_iter()
            .map(|(scene, density, runs)| {
                let front: Vec<&str> =
                    pareto_front::pareto_front(runs.iter().copied(), Metric::Relmse).iter().map(|run| run.id.as_str()).collect();
                let is_here = |point: &&CurvePoint| point.scene == scene && point.density == density;
                let curves: Vec<&CurvePoint> = self.curves.iter().filter(is_here).collect();
                let truth = truth(&runs[0].truth);
                json!({"scene": scene, "density": density, "runs": runs, "front": front, "curves": curves, "truth": truth})
            })
            .collect();
        let figures: serde_json::Map<String, serde_json::Value> = FIGURES
            .iter()
            .map(|(name, stem)| {
                let file = |extension: &str| folder.join(format!("{stem}.{extension}"));
                ((*name).to_owned(), json!({"svg": file("svg"), "png": file("png"), "pdf": file("pdf")}))
            })
            .collect();
        let request = json!({
            "title": self.study.title, "clock": self.clock.label(), "groups": groups, "folder": folder,
            "figures": figures, "made_by": self.provenance.as_ref().map(Provenance::line),
        });
        bridge::run_script("study_plot.py", &request, CyclesKernel::Default, |_| ()).map(drop)
    }

    /// Fills in HDR-FLIP: from the ledger, or computed now for all that lack it, in one run of the script.
    pub(super) fn add_flip(&mut self, ledger: &Ledger, folder: &Path) -> Result<()> {
        let truths: HashMap<&str, &TruthRecord> =
            self.truths.iter().map(|record| (record.id.as_str(), record)).collect();
        let runs = self.runs.iter_mut().map(|run| (&run.picture, &run.truth, &mut run.flip));
        let points = self.curves.iter_mut().map(|point| (&point.picture, &point.truth, &mut point.flip));
        let mut missing = Vec::new();
        let mut pairs = Vec::new();
        for (picture, truth, flip) in runs.chain(points) {
            let key = ledger.key(&json!({"picture": picture, "truth": truth}));
            *flip = ledger.read(FLIPS, &key)?;
            if let (None, Some(record)) = (&*flip, truths.get(truth.as_str())) {
                let reference: Vec<PathBuf> = record.replicas.iter().map(|name| folder.join(name)).collect();
                pairs.push(FlipPair { ours: vec![folder.join(picture)], reference });
                missing.push((key, flip));
            }
        }
        if missing.is_empty() {
            return Ok(());
        }
        for ((key, flip), mean) in missing.into_iter().zip(images::flip(&pairs)?) {
            ledger.write(FLIPS, &key, mean)?;
            *flip = Some(mean);
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::engines::defects::Defects;
    use crate::engines::render::EngineJitter;
    use crate::measure::combination::CacheAxis;
    use crate::measure::errors::Uncertain;
    use crate::media::density_cache::CacheFormat;

    /// A run of so many seconds and such a relMSE.
    pub fn run_of(seconds: f64, relmse: f64) -> Measured {
        let exact = |value| Uncertain { value, standard_error: 0.0 };
        Measured {
            id: format!("{seconds}-{relmse}"),
            combination: Combination {
                scene: "scene".into(),
                density: "graph".into(),
                light: "single".into(),
                steps: 1,
                light_steps: 1,
                cache: CacheAxis { cells: 0, format: CacheFormat::F16 },
                light_volume: None,
                sub_pixels: 1,
                jitter: EngineJitter::None,
                defects: Defects::NONE,
                god_rays: false,
            },
            errors: Errors { relmse: exact(relmse), rms: exact(0.0), bias: exact(0.0) },
            flip: None,
            seconds: Seconds { median: seconds, smallest: seconds, largest: seconds },
            wall_seconds: seconds,
            prepare_seconds: 0.0,
            cost: seconds * relmse,
            picture: String::new(),
            truth: String::new(),
        }
    }
}
