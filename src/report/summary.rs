//! The verdict on a run: one part per subject that was judged, and the figures that matter.

use crate::base::numbers::{count, figure, percent, ratio, signed_percent};
use crate::measure::densities::comparison::{Comparison, Side};
use crate::measure::pictures::Verdict;
use crate::measure::stability;
use crate::measure::stability::Table;
use crate::report::inputs::{Inputs, Mode, Probe};
use serde::Serialize;

/// What the head of a report says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Title of the page.
    pub title: String,
    /// The verdict on everything that was judged; `None` where something was measured and nothing judged.
    pub verdict: Option<Verdict>,
    /// The verdict in words.
    pub words: &'static str,
    /// One sentence with the reason.
    pub sentence: String,
    /// The verdict on each subject.
    pub parts: Vec<Part>,
    /// At most six figures.
    pub figures: Vec<KeyFigure>,
}

/// One subject of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Part {
    /// The subject.
    pub name: String,
    /// Where it stands on the page.
    pub anchor: &'static str,
    /// Its verdict; `None` where it was measured and there is nothing to judge it by.
    pub verdict: Option<Verdict>,
    /// The verdict in words.
    pub words: &'static str,
    /// What was found.
    pub sentence: String,
}

/// A figure at the head of the page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct KeyFigure {
    /// The figure with its unit.
    pub value: String,
    /// What it measures.
    pub label: String,
    /// Its limit or the quantity that it belongs to.
    pub note: String,
}

impl Part {
    fn new(name: impl Into<String>, anchor: &'static str, verdict: Option<Verdict>, sentence: String) -> Self {
        let words = verdict.map_or("measured", Verdict::words);
        Self { name: name.into(), anchor, verdict, words, sentence }
    }
}

impl Summary {
    /// Judges a run. A part that differs decides; a run without any judged part could not be told.
    pub fn of(inputs: &Inputs) -> Self {
        let mut parts = Vec::new();
        if let Some(diff) = &inputs.diff {
            parts.push(Part::new("Picture", "figures", Some(diff.verdict), diff.reasons.join(" ")));
        }
        parts.extend(inputs.probes.iter().flat_map(field_parts));
        if !inputs.modes.is_empty() {
            parts.push(modes_part(&inputs.modes));
        }
        parts.extend(inputs.models.as_ref().map(models_part));
        parts.extend(inputs.stability.as_ref().map(stability_part));
        let judged: Vec<&Part> = parts.iter().filter(|part| part.verdict.is_some()).collect();
        let verdict = Verdict::worst(judged.iter().filter_map(|part| part.verdict)).unwrap_or(Verdict::CouldNotTell);
        let deciding: Vec<&str> =
            judged.iter().filter(|part| part.verdict == Some(verdict)).map(|part| part.name.as_str()).collect();
        let has_measured = inputs.study.is_some() || inputs.tuning.is_some() || inputs.attribution.is_some();
        let is_measured = judged.is_empty() && (!parts.is_empty() || has_measured);
        let sentence = match verdict {
            _ if is_measured => "Nothing here is judged against a limit.".to_owned(),
            _ if judged.is_empty() => "Nothing in this run was judged against a limit.".to_owned(),
            Verdict::Agrees => format!("Within every limit that was set: {}.", joined(&deciding)),
            Verdict::Differs => format!("Found to differ: {}.", joined(&deciding)),
            Verdict::CouldNotTell => format!("No sound answer for: {}.", joined(&deciding)),
        };
        let run = &inputs.run;
        let of_study = || inputs.study.as_ref().map(|found| found.study.title.clone());
        let of_tuning = || inputs.tuning.as_ref().map(|found| found.file.title.clone());
        let of_attribution = || inputs.attribution.as_ref().map(|found| found.attribution.title.clone());
        let title = run.title.clone().or_else(|| run.scene.clone()).or_else(of_study).or_else(of_tuning);
        let title = title.or_else(of_attribution);
        let title = title.unwrap_or_else(|| "Comparison report".into());
        let words = if is_measured { "measured" } else { verdict.words() };
        let verdict = (!is_measured).then_some(verdict);
        Self { title, verdict, words, sentence, figures: key_figures(inputs), parts }
    }
}

fn joined(names: &[&str]) -> String {
    let mut text = String::new();
    for (index, name) in names.iter().enumerate() {
        text.push_str(match index {
            0 => "",
            i if i + 1 == names.len() => " and ",
            _ => ", ",
        });
        // Only the first name starts a clause.
        let mut letters = name.chars();
        let capital = name.chars().nth(1).is_some_and(char::is_uppercase);
        match letters.next() {
            Some(first) if !capital => text.extend(first.to_lowercase().chain(letters)),
            _ => text.push_str(name),
        }
    }
    text
}

fn field_parts(probe: &Probe) -> impl Iterator<Item = Part> + '_ {
    // A run may probe several domains.
    let place =
        probe.domain.as_ref().and_then(|domain| domain.as_str()).map_or(String::new(), |name| format!(", {name}"));
    probe.evaluators.iter().map(move |(name, found)| {
        let total = found.points.unwrap_or(probe.points);
        let mut sentence = match found.differing {
            Some(0) => format!("All {} points are equal to the reference.", count(Some(total))),
            Some(differing) => format!(
                "{} of {} points differ, at most by {}.",
                count(Some(differing)),
                count(Some(total)),
                figure(found.max_error)
            ),
            None => format!("Largest error {} over {} points.", figure(found.max_error), count(Some(total))),
        };
        if let Some(lonely) = found.one_sided_nonfinite.filter(|lonely| *lonely > 0) {
            sentence.push_str(&format!(" {} points are finite on one side only.", count(Some(lonely))));
        }
        if let Some(limit) = found.limit {
            sentence.push_str(&format!(" Limit {}.", figure(Some(limit))));
        }
        Part::new(format!("Field ({}{place})", evaluator_name(name)), "field", found.verdict(), sentence)
    })
}

/// Name of an evaluator for readers.
pub fn evaluator_name(name: &str) -> &str {
    match name {
        "cpu" => "CPU",
        "gpu" => "GPU",
        "oracle" => "f64 oracle",
        other => other,
    }
}

fn models_part(models: &Comparison) -> Part {
    let all = |text: &dyn Fn(&Side) -> String| models.sides.iter().map(text).collect::<Vec<_>>().join(", ");
    let sentence = format!(
        "{} at a mean optical depth of {}: {} of the vertical lines lose 10 % of the light, {} ns per sample on the CPU.",
        all(&|side| side.title.clone()),
        figure(models.sides.first().map(|side| side.statistics.mean_depth)),
        all(&|side| percent(Some(side.statistics.covered))),
        all(&|side| figure(Some(side.cpu_nanoseconds))),
    );
    Part::new("Density models", "models", None, sentence)
}

fn stability_part(table: &Table) -> Part {
    let [passed, limited, failed] = [stability::Verdict::Pass, stability::Verdict::Limit, stability::Verdict::Fails]
        .map(|verdict| table.count(verdict));
    let nonfinite: usize = table.rows.iter().map(|row| row.nonfinite).sum();
    let mut sentence = format!(
        "{} rows of f32 against f64: {passed} within their limit, {limited} at the limit of f32 with a derived bound, {failed} beyond it; {} \
         values NaN or infinite.",
        table.rows.len(),
        count(Some(nonfinite as u64)),
    );
    if table.adapter.is_none() {
        sentence.push_str(" Without an adapter WGSL was not measured.");
    }
    let verdict = match (failed, &table.adapter) {
        (0, Some(_)) => Verdict::Agrees,
        (0, None) => Verdict::CouldNotTell,
        _ => Verdict::Differs,
    };
    Part::new("Numerical stability", "stability", Some(verdict), sentence)
}

fn modes_part(modes: &[Mode]) -> Part {
    let judged = modes.iter().filter(|mode| mode.pass.is_some()).count();
    let failed: Vec<&Mode> = modes.iter().filter(|mode| mode.pass == Some(false)).collect();
    let verdict = match (judged, failed.len()) {
        (0, _) => None,
        (_, 0) => Some(Verdict::Agrees),
        _ => Some(Verdict::Differs),
    };
    let sentence = match failed.first() {
        None => format!("{judged} of {} node modes judged, all within their limits.", modes.len()),
        Some(first) => format!(
            "{} of {judged} node modes are over their limit, the first {} ({}).",
            failed.len(),
            first.node,
            crate::base::numbers::plain(&first.mode)
        ),
    };
    Part::new("Node modes", "modes", verdict, sentence)
}

fn key_figures(inputs: &Inputs) -> Vec<KeyFigure> {
    let mut figures = Vec::new();
    let mut add = |value: String, label: &str, note: String| {
        if figures.len() < 6 {
            figures.push(KeyFigure { value, label: label.into(), note });
        }
    };
    if let Some(diff) = &inputs.diff {
        let limit = |name: &str, show: fn(Option<f64>) -> String| {
            let check = diff.checks.iter().find(|check| check.name == name);
            check.map_or("no limit set".into(), |check| format!("limit {}", show(Some(check.limit))))
        };
        let worst = diff.channels.iter().flatten().filter_map(|row| row.relative_difference);
        if let Some(worst) = worst.max_by(|a, b| a.abs().total_cmp(&b.abs())) {
            add(signed_percent(Some(worst)), "worst channel mean", limit("channel_mean_relative", percent));
        }
        if let Some(relmse) = &diff.relmse {
            add(figure(relmse.block), "block relMSE", limit("block_relmse", figure));
        }
        if let Some(flip) = diff.flip.as_ref().filter(|flip| flip.mean.is_some()) {
            add(figure(flip.mean), "mean HDR-FLIP", "0 none, 1 all".into());
        }
    }
    if let Some(probe) = inputs.probes.first() {
        for (name, found) in probe.evaluators.iter().filter(|(name, _)| *name != "oracle") {
            let total = found.points.unwrap_or(probe.points);
            let name = evaluator_name(name);
            match found.differing {
                Some(0) => {
                    add(count(Some(total)), &format!("{name} points equal"), format!("of {}", count(Some(total))))
                }
                _ => add(
                    figure(found.max_error),
                    &format!("{name} field, max error"),
                    format!("{} points", count(Some(total))),
                ),
            }
        }
    }
    if !inputs.modes.is_empty() {
        let passed = inputs.modes.iter().filter(|mode| mode.pass == Some(true)).count();
        add(format!("{passed} / {}", inputs.modes.len()), "node modes pass", "CPU and WGSL".into());
    }
    if let Some(row) = inputs.bench.as_ref().and_then(|bench| bench.rows.first()) {
        if row.gpu_ratio.is_some() && !inputs.bench.as_ref().is_some_and(super::inputs::Bench::software_adapter) {
            add(ratio(row.gpu_ratio), "Cycles' speed, on the GPU", row.what.clone());
        } else if row.cpu_ratio.is_some() {
            add(ratio(row.cpu_ratio), "Cycles' speed, on the CPU", row.what.clone());
        }
    }
    figures
}
