//! The Pareto front of an earlier run, measured again from scratch: new truths, new renders.

use crate::base::error::Result;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::engines::render::EngineRenderer;
use crate::gpu::Gpu;
use crate::measure::combination::Combination;
use crate::measure::errors;
use crate::measure::errors::{Errors, Uncertain};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::study::{Measured, PURPOSE, Results, Study};
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::collections::HashMap;
use std::path::Path;

/// What the truths of a verification are for.
const TRUTHS: &str = "verification";

/// Difference of two measurements of an error, in standard errors, up to which they agree. With the eight replicas of a truth by default
/// chance alone exceeds it once in 5,000 (14 degrees of freedom) to once in 600 tests (7).
const LARGEST_T: f64 = 5.0;

/// An error that was measured twice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verified {
    /// The run.
    pub id: String,
    /// Its settings.
    pub combination: Combination,
    /// relMSE as the study says.
    pub first: Uncertain,
    /// relMSE against a new truth.
    pub second: Uncertain,
    /// Difference over its standard error.
    pub t: f64,
    /// Whether they agree.
    pub agrees: bool,
}

impl Verified {
    fn new(run: &Measured, again: Errors) -> Self {
        let (first, second) = (run.errors.relmse, again.relmse);
        let error = first.standard_error.hypot(second.standard_error);
        let difference = second.value - first.value;
        let t = if difference == 0.0 { 0.0 } else { difference / error };
        let agrees = t.abs() <= LARGEST_T;
        Self { id: run.id.clone(), combination: run.combination.clone(), first, second, t, agrees }
    }
}

/// The runs of the Pareto fronts, measured again.
struct Verification<'a> {
    study: &'a Study,
    runs: Vec<&'a Measured>,
    gpu: Option<Gpu>,
    truths: HashMap<String, Vec<Image>>,
}

impl Study {
    /// Measures the Pareto fronts of an earlier run again. Each pair of errors has to agree within the uncertainty that both state.
    pub fn verify(
        &self,
        results: &Results,
        folder: &Path,
        settings: &Settings,
        progress: Progress<'_>,
    ) -> Result<Outcome<Vec<Verified>>> {
        let runs = results.pareto_fronts().into_iter().flat_map(|(_, _, runs)| runs).collect();
        let mut verification = Verification { study: self, runs, gpu: self.adapter()?, truths: HashMap::new() };
        experiment::run(&mut verification, Some(folder), settings, progress)
    }
}

impl Experiment for Verification<'_> {
    /// The position of a run.
    type Job = usize;
    type Record = Errors;
    type Summary = Vec<Verified>;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<usize>> {
        Ok((0..self.runs.len()).collect())
    }

    fn part(&self, _job: &usize) -> &'static str {
        "verified"
    }

    fn inputs(&self, job: &usize) -> Result<Json> {
        let combination = &self.runs[*job].combination;
        let scene = self.study.scene(&combination.scene);
        let truth = self.study.file.truth.inputs(scene, &combination.density, TRUTHS, self.study.rays());
        Ok(json!({"combination": combination, "truth": truth, "adapter": self.gpu.as_ref().map(Gpu::adapter)}))
    }

    fn label(&self, _job: &usize) -> String {
        "Pareto front".into()
    }

    fn run(&mut self, job: &usize, desk: &Desk<'_>) -> Result<Found<Errors>> {
        let combination = &self.runs[*job].combination;
        let scene = self.study.scene(&combination.scene);
        let report = |done: f64, what: &str| desk.report(done, what);
        let (truth, rays) = (&self.study.file.truth, self.study.rays());
        let truth = truth.obtain(scene, &combination.density, TRUTHS, rays, desk.ledger, &report)?;
        if !self.truths.contains_key(&truth.id) {
            self.truths.insert(truth.id.clone(), truth.read(desk.folder()?)?);
        }
        let (engine, _) = self.study.engine(scene, combination)?;
        let renderer = EngineRenderer::new(scene, &engine, self.gpu.as_ref())?;
        let image = renderer.picture(&combination.picture_settings(), &|_, _| ())?;
        errors::measure(&image, &self.truths[&truth.id]).map(Found::Record)
    }

    fn summary(&mut self, found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<Vec<Verified>> {
        let again = |done: Done<Self>| match done.found {
            Found::Record(errors) => Some(Verified::new(self.runs[done.job], errors)),
            Found::LeftOut(_) => None,
        };
        Ok(found.into_iter().filter_map(again).collect())
    }
}
