//! The figures as CSV, what the page shows of studies, tunings and density models, and tables from JSON of no fixed layout.

use crate::base::numbers::{figure, percent, plain};
use crate::base::plain_text::csv_cell;
use crate::measure::attribution;
use crate::measure::densities::comparison::{Comparison, FIGURE};
use crate::measure::study::curve_points::CurvePoint;
use crate::measure::study::{FIGURES, Results};
use crate::measure::tuning::{Scored, TuningResults};
use crate::report::inputs::{ATTRIBUTION_FIGURE, Inputs, Picture, TUNING_FIGURE, study_figure};
use crate::report::measured;
use crate::report::measured::TuningRow;
use crate::report::table::Table as Columns;
use indexmap::IndexMap;
use serde::Serialize;
use serde_json::Value;

/// A table of text.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Table {
    /// Single facts, name and value.
    pub facts: Vec<(String, String)>,
    /// Column names.
    pub columns: Vec<String>,
    /// Rows of cells, as many as there are columns.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A list of objects becomes rows, with the union of the keys as columns; of an object, its first
    /// such list becomes rows and everything else a fact.
    pub fn of(value: &Value) -> Self {
        let mut table = Self::default();
        match value {
            Value::Array(items) => table.fill(items),
            Value::Object(fields) => {
                for (key, item) in fields {
                    match item {
                        Value::Array(items) if table.rows.is_empty() && items.iter().any(Value::is_object) => {
                            table.fill(items);
                        }
                        _ => table.facts.push((words(key), plain(item))),
                    }
                }
            }
            other => table.facts.push(("value".into(), plain(other))),
        }
        table
    }

    fn fill(&mut self, items: &[Value]) {
        let mut keys: Vec<&String> = Vec::new();
        for key in items.iter().filter_map(Value::as_object).flat_map(|object| object.keys()) {
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        self.columns = keys.iter().map(|key| words(key)).collect();
        self.rows = items.iter().map(|item| keys.iter().map(|key| plain(&item[key.as_str()])).collect()).collect();
    }
}

/// A study, as the page shows it.
#[derive(Debug, Serialize)]
pub struct StudyTable<'a> {
    /// Its headline.
    pub title: &'a str,
    /// Runs, and combinations that were left out.
    pub counts: [usize; 2],
    /// What did the work.
    pub machine: &'a str,
    /// What the runs' seconds are.
    pub clock: &'static str,
    /// Error against time, convergence by steps, and pictures of the front.
    pub figures: [Option<&'a Picture>; 3],
    /// Their captions.
    pub captions: [String; 3],
    /// What nothing beats, by scene and density.
    pub fronts: Vec<Columns>,
    /// What each defect of a system costs.
    pub ablations: Vec<Columns>,
    /// Processor time of each truth.
    pub truths: Vec<(String, f64)>,
    /// Points of unbiased renderers.
    pub curves: Columns,
    /// Curves that are missing: which, and why.
    pub missing: Vec<(String, String)>,
}

/// A point of an unbiased renderer: where, renderer and samples, seconds of preparation and samples, relMSE, its standard error, bias,
/// HDR-FLIP.
pub type CurveRow = (String, String, (f64, Option<f64>), f64, f64, f64, Option<f64>);

fn curve_row(point: &CurvePoint) -> CurveRow {
    let relmse = point.errors.relmse;
    (
        format!("{} in {}", point.density, point.scene),
        format!("{}, {} samples", point.renderer.label(), point.samples),
        (point.prepare_seconds, point.seconds),
        relmse.value,
        relmse.standard_error,
        point.errors.bias.value,
        point.flip,
    )
}

/// A tuning, as the page shows it.
#[derive(Debug, Serialize)]
pub struct TuningTable<'a> {
    /// All figures.
    pub found: &'a TuningResults,
    /// Before and after.
    pub figure: Option<&'a Picture>,
    /// Light models, exposure matched, then the tuned one: name, exposure, HDR-FLIP in training and held out, relMSE held out, milliseconds.
    pub rows: Vec<TuningRow>,
    /// The light models, as they are shown.
    pub models: Columns,
    /// The parameters that were found.
    pub parameters: Columns,
    /// By what share held-out HDR-FLIP fell.
    pub improvement: f64,
}

impl<'a> TuningTable<'a> {
    /// Arranges a tuning.
    pub fn of(found: &'a TuningResults, pictures: &'a IndexMap<String, Picture>) -> Self {
        let row = |scored: &Scored| {
            (
                scored.name.clone(),
                scored.exposure,
                Scored::mean_flip(&scored.train),
                Scored::mean_flip(&scored.held_out),
                Scored::mean_relmse(&scored.held_out),
                scored.seconds,
            )
        };
        let rows = found.published.iter().chain([&found.tuned, &found.finer]).map(row).collect();
        let mut table = Self {
            found,
            figure: pictures.get(TUNING_FIGURE),
            rows,
            models: Columns::new("", &[], []),
            parameters: measured::tuned_parameters(found),
            improvement: found.improvement(),
        };
        table.models = measured::tuning_models(found, &table.rows);
        table
    }
}

/// An attribution, as the page shows it.
#[derive(Debug, Serialize)]
pub struct AttributionTables<'a> {
    /// Headline.
    pub title: &'a str,
    /// What did the work.
    pub machine: &'a str,
    /// Waterfalls and maps.
    pub figure: Option<&'a Picture>,
    /// A table for each scene and engine.
    pub cases: Vec<Columns>,
}

impl<'a> AttributionTables<'a> {
    /// Arranges an attribution.
    pub fn of(found: &'a attribution::Results, pictures: &'a IndexMap<String, Picture>) -> Self {
        Self {
            title: &found.attribution.title,
            machine: &found.machine,
            figure: pictures.get(ATTRIBUTION_FIGURE),
            cases: measured::attributions(found),
        }
    }
}

impl<'a> StudyTable<'a> {
    /// Arranges a study.
    pub fn of(found: &'a Results, pictures: &'a IndexMap<String, Picture>) -> Self {
        Self {
            title: &found.study.title,
            counts: [found.runs.len(), found.skipped.len()],
            machine: &found.machine,
            clock: found.clock.label(),
            figures: FIGURES.map(|(_, stem)| pictures.get(&study_figure(stem))),
            captions: measured::study_captions(found),
            fronts: measured::fronts(found),
            ablations: measured::ablations(found),
            truths: found
                .truths
                .iter()
                .map(|truth| {
                    (format!("{} in {}, rays {}", truth.density, truth.scene, truth.rays.label()), truth.seconds)
                })
                .collect(),
            curves: measured::curves(found),
            missing: found
                .missing_curves
                .iter()
                .map(|curve| {
                    let which = format!("{}, {} in {}", curve.renderer.label(), curve.density, curve.scene);
                    (which, curve.reason.clone())
                })
                .collect(),
        }
    }
}

/// Two density models, as the page shows them.
#[derive(Debug, Serialize)]
pub struct ModelsTable<'a> {
    /// All figures.
    pub found: &'a Comparison,
    /// Figures as rows: what, and one text per density.
    pub rows: Vec<(&'static str, Vec<String>)>,
    /// Histogram and spectrum.
    pub figure: Option<&'a Picture>,
    /// Pictures by light model, one per density.
    pub lights: Vec<LightRow<'a>>,
}

/// The pictures of a light model.
#[derive(Debug, Serialize)]
pub struct LightRow<'a> {
    /// The light model in words.
    pub title: &'a str,
    /// Density in words, picture, seconds, mean radiance, and how far that is from path tracing's.
    pub pictures: Vec<(&'a str, &'a Picture, f64, f64, Option<String>)>,
}

impl<'a> ModelsTable<'a> {
    /// Arranges a comparison.
    pub fn of(found: &'a Comparison, pictures: &'a IndexMap<String, Picture>) -> Self {
        let mut lights: Vec<LightRow<'a>> = Vec::new();
        for picture in &found.pictures {
            let title = picture.light_title.as_str();
            let Some(shown) = picture.png.as_ref().and_then(|name| pictures.get(name)) else { continue };
            let density = found.sides.iter().find(|side| side.id == picture.density).map_or("", |side| &side.title);
            let bias = picture.bias.map(|bias| format!("{:+.1} %", 100.0 * bias));
            let entry = (density, shown, picture.seconds, picture.mean_radiance, bias);
            match lights.last_mut().filter(|row| row.title == title) {
                Some(row) => row.pictures.push(entry),
                None => lights.push(LightRow { title, pictures: vec![entry] }),
            }
        }
        Self { found, rows: model_rows(found), figure: pictures.get(FIGURE), lights }
    }
}

/// Figures of density models: what, and one text per density.
pub(super) fn model_rows(found: &Comparison) -> Vec<(&'static str, Vec<String>)> {
    let each = |text: &dyn Fn(&crate::measure::densities::comparison::Side) -> String| {
        found.sides.iter().map(text).collect::<Vec<_>>()
    };
    vec![
        ("factor on the density", each(&|side| figure(Some(side.factor)))),
        ("mean optical depth, top to bottom", each(&|side| figure(Some(side.statistics.mean_depth)))),
        ("share of places that hold something", each(&|side| percent(Some(side.statistics.filled)))),
        (
            "covered share: vertical lines that lose 10 % of the light",
            each(&|side| percent(Some(side.statistics.covered))),
        ),
        (
            "standard deviation over mean density",
            each(&|side| figure(Some(side.statistics.standard_deviation / side.statistics.mean))),
        ),
        ("largest over mean density", each(&|side| figure(Some(side.statistics.largest / side.statistics.mean)))),
        ("evaluator on the CPU", each(&|side| side.evaluator.clone())),
        ("CPU, all cores, ns per sample", each(&|side| figure(Some(side.cpu_nanoseconds)))),
        ("adapter, ns per sample", each(&|side| figure(side.gpu_nanoseconds))),
    ]
}

fn words(key: &str) -> String {
    key.replace('_', " ")
}

/// The facts of a scene file that a reader of the report wants: camera, film, light, medium, graph.
pub fn scene_facts(scene: &Value) -> Vec<(&'static str, String)> {
    let at = |pointer: &str| scene.pointer(pointer).filter(|value| !value.is_null());
    let text = |pointer: &str| at(pointer).map(plain);
    let mut facts = Vec::new();
    let mut add = |name, value: Option<String>| facts.extend(value.map(|value| (name, value)));
    let joined = |pointers: &[(&str, &str)]| {
        let known: Vec<String> =
            pointers.iter().filter_map(|(label, pointer)| Some(format!("{label}{}", text(pointer)?))).collect();
        (!known.is_empty()).then(|| known.join(", "))
    };
    add("Name", text("/name"));
    add(
        "Camera",
        joined(&[("", "/camera/projection"), ("focal length ", "/camera/focal_length"), ("clip ", "/camera/clip_end")]),
    );
    let size = at("/film/resolution")
        .and_then(Value::as_array)
        .map(|size| size.iter().map(Value::to_string).collect::<Vec<_>>().join(" × "));
    add(
        "Resolution",
        size.zip(text("/film/resolution_percentage")).map(|(size, percent)| format!("{size} at {percent} %")),
    );
    add("Pixel filter", joined(&[("", "/film/pixel_filter"), ("width ", "/film/filter_width")]));
    add("Transparent film", text("/film/transparent"));
    add("Volume bounces", text("/integrator/volume_bounces"));
    add(
        "View",
        joined(&[("", "/display/view_transform"), ("look ", "/display/look"), ("exposure ", "/display/exposure")]),
    );
    let lights = at("/lights").and_then(Value::as_array).map(|lights| {
        let each: Vec<String> = lights
            .iter()
            .map(|light| {
                format!("{} ({}, strength {})", plain(&light["name"]), plain(&light["type"]), plain(&light["strength"]))
            })
            .collect();
        if each.is_empty() { "none".into() } else { each.join("; ") }
    });
    add("Lights", lights);
    add("World", joined(&[("colour ", "/world/color"), ("strength ", "/world/strength")]));
    add(
        "Volume",
        joined(&[("", "/volume/object"), ("shape ", "/volume/shape/type"), ("material ", "/volume/material")]),
    );
    let nodes = at("/graph/nodes").and_then(Value::as_array).map(|nodes| {
        let groups = at("/graph/groups").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let inside: usize = groups.iter().filter_map(|group| group["nodes"].as_array()).map(Vec::len).sum();
        format!("{} nodes in {} trees", nodes.len() + inside, 1 + groups.len())
    });
    add("Graph", nodes.or_else(|| text("/graph/file")));
    facts
}

/// Columns of `figures.csv`. Values are written in full, without units.
const COLUMNS: [&str; 8] = ["section", "subject", "item", "quantity", "value", "unit", "limit", "outcome"];

/// `figures.csv`: every number of the run, one per line, `\n` between lines, quoted where needed.
pub fn csv(inputs: &Inputs) -> String {
    let mut rows: Vec<[String; 8]> = Vec::new();
    let mut add = |section: &str, subject: &str, item: &str, quantity: &str, value: Option<f64>, unit: &str| {
        if let Some(value) = value {
            let fields = [section, subject, item, quantity, &value.to_string(), unit, "", ""];
            rows.push(fields.map(str::to_owned));
        }
    };
    if let Some(diff) = &inputs.diff {
        for (item, found) in [("colour", &diff.colour), ("alpha", &diff.alpha)] {
            let Some(found) = found else { continue };
            add("picture", "", item, "mean_error", Some(found.mean_error), "radiance");
            add("picture", "", item, "rms_error", Some(found.rms_error), "radiance");
            add("picture", "", item, "psnr", found.psnr, "dB");
            add("picture", "", item, "max_error", Some(found.max_error), "radiance");
            add("picture", "", item, "failing_share", Some(found.failing_share), "share");
        }
        for row in diff.channels.iter().flatten() {
            add("picture", "channel mean", &row.channel, "ours", Some(row.ours), "radiance");
            add("picture", "channel mean", &row.channel, "reference", Some(row.reference), "radiance");
            add("picture", "channel mean", &row.channel, "relative_difference", row.relative_difference, "share");
            add(
                "picture",
                "channel mean",
                &row.channel,
                "standard_error_relative",
                row.standard_error_relative,
                "share",
            );
        }
        if let Some(relmse) = &diff.relmse {
            add("picture", "relMSE", "", "epsilon", Some(relmse.epsilon), "radiance");
            add("picture", "relMSE", "pixel", "value", relmse.pixel, "");
            add("picture", "relMSE", "pixel", "noise", relmse.noise_pixel, "");
            add("picture", "relMSE", "block", "value", relmse.block, "");
            add("picture", "relMSE", "block", "noise", relmse.noise_block, "");
            add("picture", "relMSE", "block", "debiased", relmse.debiased_block, "");
        }
        for row in diff.statistics.iter().flat_map(|found| &found.means) {
            let subject = "bias of the image mean";
            add("statistics", subject, &row.channel, "relative_bias", row.relative_bias, "share");
            add("statistics", subject, &row.channel, "relative_low", row.relative_low, "share");
            add("statistics", subject, &row.channel, "relative_high", row.relative_high, "share");
            add("statistics", subject, &row.channel, "t", Some(row.t), "");
            add("statistics", subject, &row.channel, "p", Some(row.p), "");
            add("statistics", "noise of a pixel", &row.channel, "ours", Some(row.noise_variance_ours), "radiance^2");
            let reference = Some(row.noise_variance_reference);
            add("statistics", "noise of a pixel", &row.channel, "reference", reference, "radiance^2");
        }
        if let Some(relmse) = diff.statistics.as_ref().map(|found| &found.relmse) {
            add("statistics", "relMSE", "pixel", "plain", relmse.plain, "");
            add("statistics", "relMSE", "pixel", "noise", relmse.noise, "");
            add("statistics", "relMSE", "pixel", "debiased", relmse.debiased, "");
            add("statistics", "relMSE", "pixel", "standard_error", relmse.standard_error, "");
        }
        add("picture", "HDR-FLIP", "", "mean", diff.flip.as_ref().and_then(|flip| flip.mean), "");
    }
    for slice in &inputs.slices {
        add("slice", &slice.title, "", "equal_share", slice.equal_share, "share");
        add("slice", &slice.title, "", "max_error", slice.max_error, "");
    }
    for row in inputs.bench.iter().flat_map(|bench| &bench.rows) {
        add("bench", &row.what, "cycles", "rate", row.cycles_rate, "points/s");
        add("bench", &row.what, "cpu", "rate", row.cpu_rate, "points/s");
        add("bench", &row.what, "gpu", "rate", row.gpu_rate, "points/s");
        add("bench", &row.what, "gpu", "kernel_rate", row.kernel_rate, "points/s");
        add("bench", &row.what, "cpu", "ratio", row.cpu_ratio, "");
        add("bench", &row.what, "gpu", "ratio", row.gpu_ratio, "");
    }
    for run in inputs.study.iter().flat_map(|study| &study.runs) {
        let subject = format!("{} in {}", run.combination.density, run.combination.scene);
        let words = run.combination.describe();
        let mut study = |quantity, value, unit| add("study", &subject, &words, quantity, value, unit);
        study("seconds", Some(run.seconds.median), "s");
        study("relmse", Some(run.errors.relmse.value), "");
        study("relmse_standard_error", Some(run.errors.relmse.standard_error), "");
        study("rms", Some(run.errors.rms.value), "radiance");
        study("bias", Some(run.errors.bias.value), "share");
        study("flip", run.flip, "");
    }
    for point in inputs.study.iter().flat_map(|study| &study.curves) {
        let (subject, words, (before, after), relmse, deviation, bias, flip) = curve_row(point);
        let mut curve = |quantity, value, unit| add("curve", &subject, &words, quantity, value, unit);
        curve("prepare_seconds", Some(before), "s");
        curve("seconds", after, "s");
        curve("relmse", Some(relmse), "");
        curve("relmse_standard_error", Some(deviation), "");
        curve("bias", Some(bias), "share");
        curve("flip", flip, "");
    }
    if let Some(tuning) = &inputs.tuning {
        for (name, exposure, train, held_out, relmse, time) in TuningTable::of(tuning, &inputs.pictures).rows {
            let mut tuned = |quantity, value, unit| add("tuning", &name, "", quantity, Some(value), unit);
            tuned("exposure", exposure, "");
            tuned("train_flip", train, "");
            tuned("held_out_flip", held_out, "");
            tuned("held_out_relmse", relmse, "");
            tuned("seconds", time, "s");
        }
        for (name, value) in &tuning.parameters {
            add("tuning", "tuned", name, "parameter", Some(*value), "");
        }
    }
    for one in inputs.attribution.iter().flat_map(|found| &found.attributed) {
        let subject = format!("{} in {}", one.engine, one.scene);
        add("attribution", &subject, "whole", "relmse", Some(one.relmse.value), "");
        add("attribution", &subject, "remainder", "relmse", Some(one.remainder.value), "");
        for share in &one.shares {
            let stage = share.stage.to_string();
            let mut stage = |quantity, value, unit| add("attribution", &subject, &stage, quantity, Some(value), unit);
            stage("relmse", share.relmse.value, "");
            stage("relmse_standard_error", share.relmse.standard_error, "");
            stage("brightness", share.brightness.value, "share");
        }
    }
    for side in inputs.models.iter().flat_map(|models| &models.sides) {
        let found = &side.statistics;
        let mut model = |quantity, value, unit| add("models", &side.title, "", quantity, value, unit);
        model("factor", Some(side.factor), "");
        model("mean_depth", Some(found.mean_depth), "");
        model("filled", Some(found.filled), "share");
        model("covered", Some(found.covered), "share");
        model("mean_density", Some(found.mean), "");
        model("standard_deviation", Some(found.standard_deviation), "");
        model("largest_density", Some(found.largest), "");
        model("cpu_time", Some(side.cpu_nanoseconds), "ns/sample");
        model("gpu_time", side.gpu_nanoseconds, "ns/sample");
    }
    for picture in inputs.models.iter().flat_map(|models| &models.pictures) {
        add("models", &picture.density, &picture.light, "mean_radiance", Some(picture.mean_radiance), "radiance");
        add("models", &picture.density, &picture.light, "wall", Some(picture.seconds), "s");
    }
    for row in inputs.stability.iter().flat_map(|table| &table.rows) {
        let mut stable = |quantity, value| add("stability", &row.id, "", quantity, Some(value), "");
        stable("nonfinite", row.nonfinite as f64);
        stable("max_error", row.max_error);
        if let Some(share) = row.share_of_bound {
            stable("share_of_bound", share);
        }
        stable("limit", row.limit);
    }
    for timing in &inputs.run.timings {
        add("timing", &timing.what, "", "wall", Some(timing.seconds), "s");
    }
    let number = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
    for check in inputs.diff.iter().flat_map(|diff| &diff.checks) {
        let outcome = check.outcome.words();
        rows.push(
            ["check", "", "", &check.name, &number(check.value), "", &number(Some(check.limit)), outcome]
                .map(str::to_owned),
        );
    }
    for probe in &inputs.probes {
        let scene = probe.scene.as_deref().unwrap_or_default();
        for (name, found) in &probe.evaluators {
            let outcome = found.verdict().map_or("", |verdict| verdict.words());
            let counts = [
                ("points", found.points.or(Some(probe.points)).map(|n| n as f64)),
                ("differing", found.differing.map(|n| n as f64)),
                ("one_sided_nonfinite", found.one_sided_nonfinite.map(|n| n as f64)),
                ("p999_error", found.p999_error),
                ("rms_error", found.rms_error),
                ("mean_error", found.mean_error),
                ("nonzero_share", found.nonzero_share),
                ("seconds", found.seconds),
            ];
            for (quantity, value) in counts.into_iter().filter(|(_, value)| value.is_some()) {
                rows.push(["field", scene, name, quantity, &number(value), "", "", ""].map(str::to_owned));
            }
            let limit = number(found.limit);
            rows.push(
                ["field", scene, name, "max_error", &number(found.max_error), "", &limit, outcome].map(str::to_owned),
            );
        }
    }
    for mode in &inputs.modes {
        let outcome = mode.pass.map_or("", |pass| if pass { "agrees" } else { "differs" });
        let subject = format!("{} {}", mode.node, plain(&mode.mode));
        let output = plain(&mode.output);
        for (quantity, value) in [("cpu_max_error", mode.cpu_max_error), ("wgsl_max_error", mode.wgsl_max_error)] {
            let (value, limit) = (number(value), number(mode.limit));
            rows.push(["mode", &subject, &output, quantity, &value, "", &limit, outcome].map(str::to_owned));
        }
    }
    let lines = std::iter::once(COLUMNS.map(str::to_owned)).chain(rows);
    lines.map(|row| row.map(|cell| csv_cell(&cell)).join(",") + "\n").collect()
}
