//! The report of a run: one HTML page that needs nothing else, `report.md`, `figures.csv`, `tables.tex` and `certificate.json`.
//!
//! [`write_report`] reads a run directory ([`inputs`]), judges its parts ([`summary`]) and writes the
//! files beside the inputs. The page holds its pictures, styles and program; it forbids every
//! network access by its content policy, and everything that comes from a file is escaped.

pub mod certificate;
mod document;
pub mod inputs;
mod measured;
mod sections;
pub mod summary;
mod table;
mod tables;

use crate::base::error::{Error, Result};
use crate::base::files::write_atomically;
use inputs::{Inputs, Picture};
use minijinja::{AutoEscape, Environment, UndefinedBehavior, Value, value::Serde};
use serde::Serialize;
use std::path::{Path, PathBuf};

const TEMPLATE: &str = include_str!("template.html");
const STYLE: &str = include_str!("report.css");
const PROGRAM: &str = include_str!("report.js");

/// Writes `index.html`, `report.md`, `figures.csv`, `tables.tex` and `certificate.json` into a run directory and returns the path of
/// the page. Missing inputs are listed on it with what makes them; inputs that cannot be understood are an error.
pub fn write_report(directory: &Path, makers: inputs::Makers<'_>) -> Result<PathBuf> {
    let inputs = Inputs::read(directory, makers)?;
    let summary = summary::Summary::of(&inputs);
    let page = render(&inputs, &summary)?;
    write_atomically(&directory.join("figures.csv"), tables::csv(&inputs).as_bytes())?;
    let document = sections::document(&inputs, &summary);
    write_atomically(&directory.join("report.md"), document.markdown().as_bytes())?;
    write_atomically(&directory.join("tables.tex"), document.latex_tables(false).as_bytes())?;
    write_atomically(&directory.join("tables-long.tex"), document.latex_tables(true).as_bytes())?;
    write_atomically(&directory.join("figures.tex"), document.latex_figures().as_bytes())?;
    let certificate = certificate::of(directory, &inputs, &summary)?;
    let text = serde_json::to_string_pretty(&certificate).expect("JSON serialises") + "\n";
    write_atomically(&directory.join("certificate.json"), text.as_bytes())?;
    let index = directory.join("index.html");
    write_atomically(&index, page.as_bytes())?;
    Ok(index)
}

/// One picture of the viewer.
#[derive(Debug, Serialize)]
struct View<'a> {
    key: &'static str,
    label: &'static str,
    caption: &'static str,
    picture: &'a Picture,
    legend: Option<&'a Picture>,
}

/// What the template sees.
#[derive(Serialize)]
struct Page<'a> {
    style: &'static str,
    program: &'static str,
    summary: &'a summary::Summary,
    run: &'a inputs::Run,
    diff: &'a Option<crate::measure::pictures::DiffResult>,
    views: Vec<View<'a>>,
    probes: &'a [inputs::Probe],
    slices: &'a [inputs::Slice],
    pictures: &'a indexmap::IndexMap<String, Picture>,
    modes: &'a [inputs::Mode],
    bounds: Option<tables::Table>,
    bench: &'a Option<inputs::Bench>,
    software_adapter: bool,
    explain: &'a Option<String>,
    models: Option<tables::ModelsTable<'a>>,
    study: Option<tables::StudyTable<'a>>,
    tuning: Option<tables::TuningTable<'a>>,
    stability: &'a Option<crate::measure::stability::Table>,
    scene: Option<Vec<(&'static str, String)>>,
    left_out: &'a [inputs::LeftOut],
}

/// Key (file stem), label and caption of each picture of the viewer, in its order.
const VIEWS: [(&str, &str, &str); 7] = [
    ("ours", "Ours", "Our picture"),
    ("reference", "Reference", "The reference's picture"),
    ("difference", "Relative difference", "Relative difference of luminance: blue where ours is darker"),
    ("difference_absolute", "Absolute difference", "Absolute difference of the worst colour channel"),
    ("t", "t", "t of the luminance, the difference in standard errors: noise alone gives a scatter without shape"),
    ("relmse", "relMSE", "Squared relative difference of each pixel, noise included"),
    ("flip", "FLIP", "HDR-FLIP error: how visible the difference is"),
];

fn render(inputs: &Inputs, summary: &summary::Summary) -> Result<String> {
    let views: Vec<View> = VIEWS
        .iter()
        .filter_map(|(key, label, caption)| {
            let picture = inputs.pictures.get(&format!("{key}.png"))?;
            let legend = inputs.pictures.get(&format!("{key}_legend.svg"));
            Some(View { key, label, caption, picture, legend })
        })
        .collect();
    let page = Page {
        style: STYLE,
        program: PROGRAM,
        summary,
        run: &inputs.run,
        diff: &inputs.diff,
        views,
        probes: &inputs.probes,
        slices: &inputs.slices,
        pictures: &inputs.pictures,
        modes: &inputs.modes,
        bounds: inputs.bounds.as_ref().map(tables::Table::of),
        bench: &inputs.bench,
        software_adapter: inputs.bench.as_ref().is_some_and(inputs::Bench::software_adapter),
        explain: &inputs.explain,
        study: inputs.study.as_ref().map(|study| tables::StudyTable::of(study, &inputs.pictures)),
        tuning: inputs.tuning.as_ref().map(|tuning| tables::TuningTable::of(tuning, &inputs.pictures)),
        stability: &inputs.stability,
        models: inputs.models.as_ref().map(|models| tables::ModelsTable::of(models, &inputs.pictures)),
        scene: inputs.scene.as_ref().map(tables::scene_facts),
        left_out: &inputs.left_out,
    };
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    environment.add_filter("figure", |value: Option<f64>| crate::base::numbers::figure(value));
    environment.add_filter("percent", |value: Option<f64>| crate::base::numbers::percent(value));
    environment.add_filter("signed_percent", |value: Option<f64>| crate::base::numbers::signed_percent(value));
    environment.add_filter("count", |value: Option<u64>| crate::base::numbers::count(value));
    environment.add_filter("seconds", |value: Option<f64>| crate::base::numbers::seconds(value));
    environment.add_filter("rate", |value: Option<f64>| crate::base::numbers::rate(value));
    environment.add_filter("ratio", |value: Option<f64>| crate::base::numbers::ratio(value));
    environment.add_filter("plain", |value: Value| {
        serde_json::to_value(&value).map_or_else(|_| value.to_string(), |json| crate::base::numbers::plain(&json))
    });
    let failed = |cause: minijinja::Error| {
        Error::new(
            format!("report template, line {}", cause.line().unwrap_or(0)),
            format!("{cause:#}"),
            "a template that fits its data",
            "This is a defect of the program: report it with the run directory.",
        )
    };
    environment.add_template("template.html", TEMPLATE).map_err(failed)?;
    environment
        .get_template("template.html")
        .and_then(|template| template.render(Value::from(Serde(&page))))
        .map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const MAKERS: inputs::Makers<'_> =
        &[("modes.json", "cloudparity modes > RUN/modes.json"), ("bench.json", "cloudparity bench > RUN/bench.json")];

    fn directory(files: &[(&str, String)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        folder
    }

    fn read(folder: &tempfile::TempDir, name: &str) -> String {
        std::fs::read_to_string(folder.path().join(name)).unwrap()
    }

    #[test]
    fn an_empty_run_gives_a_page_that_lists_what_is_missing() {
        let folder = directory(&[]);
        let page = write_report(folder.path(), MAKERS).unwrap();
        assert_eq!(page, folder.path().join("index.html"));
        let html = read(&folder, "index.html");
        assert!(html.contains("could not tell"));
        assert!(html.contains("modes.json") && html.contains("cloudparity modes"));
        assert!(read(&folder, "report.md").contains("cloudparity bench"));
        assert_eq!(read(&folder, "figures.csv").lines().count(), 1);
        assert!(read(&folder, "tables.tex").contains("booktabs"));
    }

    #[test]
    fn text_from_files_is_escaped_and_the_page_asks_for_nothing() {
        let evil = "<script>alert(1)</script>\"'&|";
        let folder = directory(&[
            ("run.json", json!({"title": evil, "scene": evil, "versions": {evil: evil}}).to_string()),
            ("modes.json", json!([{"node": evil, "mode": {"operation": evil}, "pass": false}]).to_string()),
            ("explain.txt", evil.to_owned()),
        ]);
        write_report(folder.path(), MAKERS).unwrap();
        let html = read(&folder, "index.html");
        assert!(!html.contains("<script>alert"));
        assert!(!html.contains("src=\"http") && !html.contains("href=\"http") && !html.contains("url(http"));
        let row = read(&folder, "report.md").lines().find(|line| line.contains("Node modes")).unwrap().to_owned();
        assert!(row.contains("differs"));
    }

    #[test]
    fn a_failing_part_decides_the_headline() {
        let probe = json!({"points": 10, "domain": "wide", "evaluators": {
            "cpu": {"points": 10, "differing": 0, "max_error": 0.0},
            "gpu": {"points": 10, "differing": 3, "max_error": 0.5, "limit": 0.1}}});
        let folder = directory(&[("probe.json", probe.to_string())]);
        write_report(folder.path(), MAKERS).unwrap();
        let page = read(&folder, "index.html");
        assert!(page.contains("class=\"verdict differs\""));
        assert!(page.contains("Field (GPU, wide)"));
        let csv = read(&folder, "figures.csv");
        assert!(csv.contains("field,,gpu,max_error,0.5,,0.1,differs"), "{csv}");
        let certificate: serde_json::Value = serde_json::from_str(&read(&folder, "certificate.json")).unwrap();
        assert_eq!(certificate["format"], certificate::FORMAT);
        assert_eq!(certificate["verdict"], "differs");
        let gpu = certificate["field"].as_array().unwrap().iter().find(|one| one["evaluator"] == "gpu").unwrap();
        assert_eq!((&gpu["verdict"], &gpu["differing"]), (&json!("differs"), &json!(3)));
        let hash = crate::base::files::sha256(probe.to_string().as_bytes());
        assert_eq!(certificate["sha256"], json!({"probe.json": hash}));
    }

    #[test]
    fn a_file_that_cannot_be_understood_is_named_with_its_place() {
        let folder = directory(&[("modes.json", "[{\"node\": \"Math\", \"points\": \"many\"}]".into())]);
        let error = write_report(folder.path(), MAKERS).unwrap_err();
        assert!(error.place.ends_with("modes.json, [0].points"), "{}", error.place);
        let folder = directory(&[("diff.json", "{".into())]);
        assert!(write_report(folder.path(), MAKERS).unwrap_err().place.contains("diff.json, line 1"));
    }

    #[test]
    fn pictures_outside_the_run_directory_are_refused() {
        let folder = directory(&[("slices.json", json!([{"title": "t", "field_png": "../a.png"}]).to_string())]);
        assert_eq!(write_report(folder.path(), MAKERS).unwrap_err().place, "slices.json or models.json");
    }
}
