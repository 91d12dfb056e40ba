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
pub mod settings;
pub mod statements;
pub mod summary;
mod table;
mod tables;

use crate::base::error::{Error, Result};
use crate::base::files::write_atomically;
use crate::base::identity::{COMPILER, Identity};
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
    for (name, text) in pages(&inputs, &summary)? {
        write_atomically(&directory.join(name), text.as_bytes())?;
    }
    let certificate = certificate::of(directory, &inputs, &summary)?;
    let text = serde_json::to_string_pretty(&certificate).expect("JSON serialises") + "\n";
    write_atomically(&directory.join("certificate.json"), text.as_bytes())?;
    Ok(directory.join(INDEX))
}

/// The page that is opened.
const INDEX: &str = "index.html";

/// The files of a report but for the certificate: name and text.
fn pages(inputs: &Inputs, summary: &summary::Summary) -> Result<Vec<(&'static str, String)>> {
    let document = sections::document(inputs, summary);
    Ok(vec![
        ("figures.csv", tables::csv(inputs)),
        ("report.md", document.markdown()),
        ("tables.tex", document.latex_tables(false)),
        ("tables-long.tex", document.latex_tables(true)),
        ("figures.tex", document.latex_figures()),
        (INDEX, render(inputs, summary)?),
    ])
}

/// Computes again what a certificate says, from the files of its folder, and compares: hashes, verdicts and figures, a study's errors from its
/// pictures, and, where this build wrote the report, every page.
pub fn check_certificate(path: &Path, makers: inputs::Makers<'_>) -> Result<certificate::Findings> {
    let claimed = certificate::read(path)?;
    let directory = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let inputs = Inputs::read(directory, makers)?;
    let summary = summary::Summary::of(&inputs);
    let again = certificate::of(directory, &inputs, &summary)?;
    let mut findings = certificate::compare(&claimed, &again, directory, &inputs);
    if claimed["written_by"]["build"] == again["written_by"]["build"] {
        let pages = pages(&inputs, &summary)?;
        findings.compared.push(("pages", pages.len()));
        for (name, text) in pages {
            let written = std::fs::read(directory.join(name)).unwrap_or_default();
            if written != text.as_bytes() {
                findings.differing.push(format!("{name}: not what the files of the folder give"));
            }
        }
    }
    Ok(findings)
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
    attribution: Option<tables::AttributionTables<'a>>,
    stability: &'a Option<crate::measure::stability::Table>,
    scene: Option<Vec<(&'static str, String)>>,
    left_out: &'a [inputs::LeftOut],
    made_by: Vec<(&'static str, Vec<(String, String)>)>,
    written_by: String,
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
        attribution: inputs.attribution.as_ref().map(|found| tables::AttributionTables::of(found, &inputs.pictures)),
        stability: &inputs.stability,
        models: inputs.models.as_ref().map(|models| tables::ModelsTable::of(models, &inputs.pictures)),
        scene: inputs.scene.as_ref().map(tables::scene_facts),
        left_out: &inputs.left_out,
        made_by: [
            ("study", inputs.study.as_ref().and_then(|study| study.provenance.as_ref())),
            ("tuning", inputs.tuning.as_ref().and_then(|tuning| tuning.provenance.as_ref())),
        ]
        .into_iter()
        .filter_map(|(what, found)| Some((what, found?.facts())))
        .collect(),
        written_by: format!("cloudparity {}, {}", Identity::current(), COMPILER),
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
        let statements = certificate["statements"].as_array().unwrap();
        let subjects: Vec<&serde_json::Value> = statements.iter().map(|one| &one["subject"]).collect();
        assert_eq!(subjects, ["field (CPU, wide)", "field (GPU, wide)"]);
        let gpu = &statements[1];
        assert_eq!((&gpu["verdict"], &gpu["population"]["count"]), (&json!("differs"), &json!(10)));
        assert_eq!(gpu["claim"], "Values are within 0.1 of those of the reference, or equal");
        assert_eq!(
            (&gpu["worst"]["value"], &gpu["worst"]["place"]),
            (&json!(0.5), &json!("the file does not say where"))
        );
        assert_eq!(statements[0]["worst"], json!(null), "equal everywhere");
        assert!(certificate["not_shown"].to_string().contains("no comparison of pictures"));
        let hash = crate::base::files::sha256(probe.to_string().as_bytes());
        assert_eq!(certificate["sha256"]["probe.json"], json!(hash));
        assert_eq!(certificate["written_by"]["compiler"], crate::base::identity::COMPILER);
    }

    #[test]
    fn a_certificate_is_computed_again_and_every_altered_file_is_found() {
        let probe = |error: f64| {
            json!({"points": 10, "domain": "wide", "evaluators": {
                "gpu": {"points": 10, "differing": 3, "max_error": error, "limit": 0.1}}})
            .to_string()
        };
        let folder = directory(&[("probe.json", probe(0.05)), ("explain.txt", "density".into())]);
        write_report(folder.path(), MAKERS).unwrap();
        let certificate = folder.path().join("certificate.json");
        let check = || check_certificate(&certificate, MAKERS);
        let sound = check().unwrap();
        assert_eq!((&sound.differing, &sound.untold), (&vec![], &vec![]));
        assert!(sound.compared.iter().any(|(what, count)| *what == "statements" && *count > 10), "{sound:?}");
        // Every file that it stands on, and the certificate itself.
        let names = [
            "probe.json",
            "explain.txt",
            "index.html",
            "report.md",
            "figures.csv",
            "tables.tex",
            "figures.tex",
            "tables-long.tex",
        ];
        for name in names {
            let before = read(&folder, name);
            std::fs::write(folder.path().join(name), before.clone() + " ").unwrap();
            let found = check().unwrap();
            assert!(found.differing.iter().any(|line| line.starts_with(name)), "{name}: {found:?}");
            std::fs::write(folder.path().join(name), before).unwrap();
        }
        std::fs::write(folder.path().join("probe.json"), probe(0.5)).unwrap();
        let found = check().unwrap().differing.join("\n");
        assert!(
            found.contains("$.field[0].max_error: 0.5 now, certified 0.05") && found.contains("$.verdict"),
            "{found}"
        );
        std::fs::write(folder.path().join("probe.json"), probe(0.05)).unwrap();
        let text = read(&folder, "certificate.json");
        std::fs::write(&certificate, text.replace("\"agrees\"", "\"differs\"")).unwrap();
        assert!(check().unwrap().differing.iter().any(|line| line.starts_with("$.verdict")));
        std::fs::write(&certificate, text.replace("Values are within 0.1", "Values are within 0.01")).unwrap();
        assert!(check().unwrap().differing.iter().any(|line| line.starts_with("$.statements[0].claim")));
        std::fs::write(&certificate, &text).unwrap();
        std::fs::remove_file(folder.path().join("explain.txt")).unwrap();
        assert!(check().unwrap().untold.iter().any(|line| line.starts_with("explain.txt")));
        let before = "{\"format\": \"cloudparity-certificate/1\", \"sha256\": {}}";
        std::fs::write(&certificate, before).unwrap();
        assert!(check().unwrap_err().remedy.contains("Write the report again"));
        for broken in ["{", "{}", "{\"format\": \"cloudparity-certificate/9\", \"sha256\": {}}"] {
            std::fs::write(&certificate, broken).unwrap();
            assert!(check().unwrap_err().place.contains("certificate.json"), "{broken}");
        }
    }

    #[test]
    fn every_table_says_of_what_it_is() {
        let probe = |domain: &str| {
            json!({"scene": "cloud", "points": 10, "domain": domain, "seed": 7, "reference": {"renderer": "Cycles", "kernel": "sse42"},
                "evaluators": {"cpu": {"points": 10, "differing": 0}}})
        };
        let folder = directory(&[
            ("run.json", json!({"scene": "cloud", "adapter": {"name": "llvmpipe"}}).to_string()),
            ("probe.json", json!([probe("box"), probe("wide")]).to_string()),
        ]);
        let inputs = Inputs::read(folder.path(), MAKERS).unwrap();
        let captions = sections::document(&inputs, &summary::Summary::of(&inputs)).captions();
        let different: std::collections::HashSet<&String> = captions.iter().collect();
        assert_eq!((captions.len(), different.len()), (4, 4), "{captions:?}");
        assert_eq!(captions[0], "Verdicts. Scene cloud; adapter llvmpipe.");
        let wide =
            "Errors of the field against Cycles at 10 points of the domain wide, seed 7, scene cloud; GPU: llvmpipe.";
        assert_eq!(captions[2], wide);
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
