//! Studies: error against time over scenes, density models, light models and quality settings.
//!
//! A study file names values on axes ([`mod@file`]). Every combination is rendered as an engine renders it, timed, and compared with path
//! tracing of the same medium ([`crate::measure::errors`]). `running` is the experiment: its jobs are truths, runs and curves, and each has
//! a record that is named by what it depends on, so an interrupted study goes on where it stopped and a changed one measures what is new.
//! Nothing is measured beside anything else.
//!
//! Errors and times lead to the Pareto front: the settings that nothing beats ([`pareto_front`]).

pub mod ablation;
pub mod curve_points;
pub mod curves;
pub mod file;
pub mod pareto_front;
mod results;
mod running;
mod verification;

pub use results::{FIGURES, Group, Measured, Results};
pub use running::Prepared;
pub use verification::Verified;

use crate::base::error::Result;
use crate::base::identity::Identity;
use crate::base::ledger::Purpose;
use crate::engines::Engine;
use crate::gpu::Gpu;
use crate::measure::combination::Combination;
use crate::measure::timing::machine;
use crate::measure::truth::PixelRays;
use crate::scene::Scene;
use cpu_time::ProcessTime;
use file::{Skipped, StudyFile};
use std::path::Path;

/// Format of a study's results.
pub const FORMAT: &str = "cloudparity-study-results/1";

/// What the folder of a study is for.
const PURPOSE: Purpose = Purpose { mark: "study.json", format: FORMAT, of: serde_json::Value::Null };

/// Whether the study in a folder is not, or not only, of this build.
pub fn is_of_another_build(folder: &Path) -> Result<bool> {
    Ok(PURPOSE.builds(folder)?.is_none_or(|builds| builds != [Identity::current().clone()]))
}

/// A study that is about to be run.
pub struct Study {
    file: StudyFile,
    scenes: Vec<Scene>,
    /// What is run, cheapest first.
    pub wanted: Vec<Combination>,
    /// What is left out.
    pub skipped: Vec<Skipped>,
}

impl Study {
    /// Reads a study file and its scenes, and expands its axes.
    pub fn load(path: &Path) -> Result<Self> {
        let file = StudyFile::load(path)?;
        let scenes = file.scenes(path.parent().unwrap_or(Path::new(".")))?;
        Ok(Self::new(file, scenes))
    }

    /// A study over scenes that are there.
    pub fn new(file: StudyFile, scenes: Vec<Scene>) -> Self {
        let (wanted, skipped) = file.expand(&scenes);
        Self { file, scenes, wanted, skipped }
    }

    fn scene(&self, name: &str) -> &Scene {
        self.scenes.iter().find(|scene| scene.name == name).expect("combinations are of the study's scenes")
    }

    /// A combination of each scene and density, in the order of the axes. Its density is not cached, and its light not found beforehand: what a truth is of.
    fn subjects(&self) -> Vec<Combination> {
        let mut subjects: Vec<Combination> = Vec::new();
        for scene in &self.scenes {
            for density in self.file.densities() {
                let is_here = |one: &&Combination| one.scene == scene.name && one.density == density;
                let found = self.wanted.iter().find(is_here);
                subjects.extend(found.map(|one| Combination {
                    cache: crate::measure::combination::no_cache()[0],
                    light_volume: None,
                    ..one.clone()
                }));
            }
        }
        subjects
    }

    /// Where in a pixel the rays of its truths pass: as those of its runs, so that the filter of a pixel is no error of a light model. Where
    /// runs of one ray per pixel stand beside runs of several, what the filter does is what they are compared in.
    fn rays(&self) -> PixelRays {
        PixelRays::of(self.wanted.iter().map(|combination| combination.sub_pixels).max().unwrap_or(1))
    }

    /// The engine of a combination, and the processor time that it took to make it.
    fn engine(&self, scene: &Scene, combination: &Combination) -> Result<(Engine, f64)> {
        let begin = ProcessTime::now();
        let engine = combination.engine(scene, &[])?;
        Ok((engine, begin.elapsed().as_secs_f64()))
    }

    /// The adapter, where the runs are rendered on it.
    fn adapter(&self) -> Result<Option<Gpu>> {
        self.file.timing.backend.open()
    }

    /// What does the work.
    fn machine(gpu: Option<&Gpu>) -> String {
        match gpu {
            Some(gpu) => format!("{}; adapter {} ({})", machine(), gpu.adapter().name, gpu.adapter().driver),
            None => machine(),
        }
    }
}
