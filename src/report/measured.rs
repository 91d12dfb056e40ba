//! Tables and captions of studies and tunings: what was measured, against which truth, on what machine.

use crate::base::numbers::{ABSENT, capitalised, figure, uncertain};
use crate::measure::attribution;
use crate::measure::errors::Uncertain;
use crate::measure::study::ablation::{Ablation, Change};
use crate::measure::study::{Group, Results};
use crate::measure::tuning::TuningResults;
use crate::report::table::{Cell, Table, time_unit};

/// Name, exposure, HDR-FLIP in training and held out, relMSE held out, seconds.
pub type TuningRow = (String, f64, f64, f64, f64, f64);

/// A share as a number in percent.
pub(super) fn percent(share: f64) -> f64 {
    100.0 * share
}

/// What the errors of a study's scene and density are measured against, at what size.
fn truth_of(found: &Results, group: &Group<'_>) -> String {
    let [width, height] = found.study.resolution;
    let truth = &found.study.truth;
    let id = group.2.first().map_or("", |run| &run.truth);
    let rays = found.truths.iter().find(|record| record.id == id).map(|record| record.rays).unwrap_or_default();
    format!(
        "{width} × {height} pixels; truth: path tracing, {} replicas of {} samples per pixel, {}",
        truth.replicas,
        truth.samples,
        rays.label()
    )
}

/// What the times of a study are.
fn time_of(found: &Results) -> String {
    format!("Time is {} ({}).", found.clock.label(), found.machine)
}

/// Captions of the figures of a study, in the order of [`crate::measure::study::FIGURES`].
pub fn study_captions(found: &Results) -> [String; 3] {
    let groups = found.groups();
    let names: Vec<String> = groups.iter().map(|(scene, density, _)| format!("{density} in {scene}")).collect();
    let names = names.join(", ");
    let truth = groups.first().map_or(String::new(), |group| truth_of(found, group));
    let mut time = format!(
        "Error against time: {names}. Each point is one of {} runs ({truth}). The line holds the runs that no other beats in time and error; \
         labels say light model, steps/light steps, c and the cells of a density cache. Bars are standard errors.",
        found.runs.len()
    );
    if !found.curves.is_empty() {
        time += " Curves: unbiased renderers by samples, their preparation counted; dotted without it.";
    }
    [
        format!("{time} {}", time_of(found)),
        format!(
            "Convergence by steps of the view ray: {names} ({truth}). Where a line is level, more steps do not help, and what is left is the \
             light model's error. Solid: the most light steps; dotted: the fewest."
        ),
        format!(
            "Pictures of {names}: the truth, and of each Pareto front the fastest run, that of the least time × relMSE, and the closest, with \
             their HDR-FLIP maps; below, the framed window, where the closest run errs most ({truth})."
        ),
    ]
}

/// The runs that nothing beats, a table for each scene and density.
pub fn fronts(found: &Results) -> Vec<Table> {
    let front = |group: Group<'_>| {
        let (factor, unit) = time_unit(group.2.iter().map(|run| run.seconds.median));
        let all = found
            .runs
            .iter()
            .filter(|run| (run.combination.scene.as_str(), run.combination.density.as_str()) == (group.0, group.1));
        let caption = format!(
            "Runs of {} in {} that no other beats in time and relMSE, of {} ({}). {} In brackets: standard error of the last digits.",
            group.1,
            group.0,
            all.count(),
            truth_of(found, &group),
            time_of(found)
        );
        let heads =
            [("Settings", ""), ("Time", unit), ("relMSE", ""), ("RMS error", ""), ("Bias", "%"), ("HDR-FLIP", "")];
        let rows = group.2.into_iter().map(|run| {
            let (relmse, rms, bias) = (run.errors.relmse, run.errors.rms, run.errors.bias);
            vec![
                Cell::text(run.combination.describe()),
                Cell::Number(Some(factor * run.seconds.median)),
                Cell::Uncertain(relmse.value, relmse.standard_error),
                Cell::Uncertain(rms.value, rms.standard_error),
                Cell::Uncertain(percent(bias.value), percent(bias.standard_error)),
                Cell::Number(run.flip),
            ]
        });
        Table::new(caption, &heads, rows)
    };
    found.pareto_fronts().into_iter().map(front).collect()
}

/// What each defect of a system costs, a table for each scene, system and setting.
pub fn ablations(found: &Results) -> Vec<Table> {
    let of_form = |(relmse, seconds): (Uncertain, f64)| {
        let (factor, unit) = time_unit(std::iter::once(seconds));
        format!("{} in {} {unit}", uncertain(relmse.value, relmse.standard_error), figure(Some(factor * seconds)))
    };
    let table = |ablation: &Ablation| {
        let caption = format!(
            "What each defect of {} changes in {} ({}): relMSE and bias with it minus those without it, time with it over time without it; alone \
             in the corrected system (relMSE {}), and as the last of all in the system as published ({}). Above 0 it makes the picture worse. \
             In brackets: standard error of the last digits. {ABSENT}: not run, or no such case.",
            ablation.density,
            ablation.scene,
            ablation.settings,
            of_form(ablation.corrected),
            of_form(ablation.published),
        );
        let heads = [
            ("Defect", ""),
            ("alone: relMSE", ""),
            ("bias", "%"),
            ("time", "×"),
            ("among all: relMSE", ""),
            ("bias", "%"),
            ("time", "×"),
        ];
        let rows = ablation.rows.iter().map(|row| {
            let mut cells = vec![Cell::text(row.defect.clone())];
            for change in [row.alone, row.among_all] {
                cells.push(match change {
                    Some(Change { relmse, .. }) => Cell::Uncertain(relmse.value, relmse.standard_error),
                    None => Cell::Number(None),
                });
                cells.push(Cell::Number(change.map(|change| percent(change.bias))));
                cells.push(Cell::Number(change.map(|change| change.time)));
            }
            cells
        });
        Table::new(caption, &heads, rows)
    };
    found.ablations.iter().map(table).collect()
}

/// Unbiased renderers by samples.
pub fn curves(found: &Results) -> Table {
    let times = found.curves.iter().flat_map(|point| [Some(point.prepare_seconds), point.seconds]).flatten();
    let (factor, unit) = time_unit(times);
    let [width, height] = found.study.resolution;
    let caption = format!(
        "Unbiased renderers by samples per pixel ({width} × {height} pixels, the truths of the runs). {} {ABSENT}: not told apart from the \
         preparation. In brackets: standard error of the last digits.",
        time_of(found)
    );
    let heads = [
        ("Renderer", ""),
        ("Density and scene", ""),
        ("Samples", ""),
        ("Preparation", unit),
        ("Sampling", unit),
        ("relMSE", ""),
        ("Bias", "%"),
        ("HDR-FLIP", ""),
    ];
    let rows = found.curves.iter().map(|point| {
        let (relmse, bias) = (point.errors.relmse, point.errors.bias);
        vec![
            Cell::text(point.renderer.label()),
            Cell::text(format!("{} in {}", point.density, point.scene)),
            Cell::Count(Some(u64::from(point.samples))),
            Cell::Number(Some(factor * point.prepare_seconds)),
            Cell::Number(point.seconds.map(|seconds| factor * seconds)),
            Cell::Uncertain(relmse.value, relmse.standard_error),
            Cell::Uncertain(percent(bias.value), percent(bias.standard_error)),
            Cell::Number(point.flip),
        ]
    });
    Table::new(caption, &heads, rows)
}

/// Light models of a tuning, and the tuned one.
pub fn tuning_models(found: &TuningResults, shown: &[TuningRow]) -> Table {
    let (factor, unit) = time_unit(shown.iter().map(|row| row.5));
    let caption = format!(
        "Light models, exposure matched on {} training views, and the tuned one, judged on {} others of {} ({} replicas of {} samples per \
         pixel); finer: three times the steps, light steps and rays per axis, whose error is what the light model cannot express. {}.",
        found.tuned.train.len(),
        found.tuned.held_out.len(),
        found.file.title,
        found.file.truth.replicas,
        found.file.truth.samples,
        capitalised(&found.machine),
    );
    let heads = [
        ("Light model", ""),
        ("Exposure", ""),
        ("HDR-FLIP, training", ""),
        ("HDR-FLIP, held out", ""),
        ("relMSE, held out", ""),
        ("Time", unit),
    ];
    let rows = shown.iter().map(|(name, exposure, train, held_out, relmse, time)| {
        let figures = [*exposure, *train, *held_out, *relmse, factor * time].map(|value| Cell::Number(Some(value)));
        std::iter::once(Cell::text(name.clone())).chain(figures).collect()
    });
    Table::new(caption, &heads, rows)
}

/// What each stage has of an engine's error, a table for each scene and engine.
pub fn attributions(found: &attribution::Results) -> Vec<Table> {
    let [width, height] = found.attribution.resolution;
    let truth = &found.attribution.truth;
    let table = |one: &attribution::Attributed| {
        let caption = format!(
            "Stages of {} in {}: shares of its relMSE, {} (Shapley values{}; their sum is the whole but for what is left where all are exact),              of its brightness, and relMSE that is left where a stage alone is exact. {width} × {height} pixels, {} replicas of {} samples. In              brackets: standard error of the last digits.",
            one.engine,
            one.scene,
            uncertain(one.relmse.value, one.relmse.standard_error),
            one.drawn_orders.map_or_else(String::new, |orders| format!(" of {orders} drawn orders of replacement")),
            truth.replicas,
            truth.samples,
        );
        let heads = [("Stage", ""), ("relMSE", ""), ("Part", "%"), ("Brightness", "%"), ("Left alone", "")];
        let of = |figure: Uncertain| Cell::Uncertain(figure.value, figure.standard_error);
        let in_percent = |figure: Uncertain| Cell::Uncertain(percent(figure.value), percent(figure.standard_error));
        let rows = one.shares.iter().map(|share| {
            vec![
                Cell::text(share.stage.title()),
                of(share.relmse),
                Cell::Number(Some(percent(one.part(share)))),
                in_percent(share.brightness),
                of(share.alone),
            ]
        });
        let rest = vec![
            Cell::text("left where all are exact"),
            of(one.remainder),
            Cell::Number(None),
            in_percent(one.brightness_remainder),
            Cell::Number(None),
        ];
        Table::new(caption, &heads, rows.chain(std::iter::once(rest)))
    };
    found.attributed.iter().map(table).collect()
}

/// Parameters that a tuning found, each with its own precision.
pub fn tuned_parameters(found: &TuningResults) -> Table {
    let rows = found.parameters.iter().map(|(name, value)| {
        let range = found.file.parameters.get(name).map_or("fixed".into(), |one| {
            let [low, high] = one.range.map(|end| figure(Some(end)));
            format!("{low} to {high}")
        });
        vec![Cell::text(name.clone()), Cell::text(figure(Some(*value))), Cell::text(range)]
    });
    let heads = [("Tuned parameter", ""), ("Value", ""), ("Range", "")];
    Table::new(format!("Parameters of {} after {} evaluations.", found.file.title, found.evaluations), &heads, rows)
}
