//! Parity suites and what is measured with them: nothing is rendered twice, and another build's work is refused.

mod support;

use cloudparity::base::identity::{Identity, Resume};
use cloudparity::integrators::path::Tracking;
use cloudparity::measure::experiment::{Outcome, Settings, Shard};
use cloudparity::measure::pictures::parity;
use cloudparity::measure::speed::time_to_error::{self, TimeSettings};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A ramp under several scatterings, in nine sub-pixel images of 8 x 4 pixels.
fn suite_file(folder: &Path) -> PathBuf {
    let scene = support::scene("linear-ramp");
    std::fs::write(folder.join("ramp.scene.json"), serde_json::to_string(&scene).expect("JSON")).expect("written");
    let entry = |name: &str, samples: u32| {
        serde_json::json!({
            "name": name, "about": "a ramp", "scene": "ramp.scene.json", "resolution": [8, 4], "volume_bounces": 3,
            "samples": samples, "replicas": {"sub_pixels": 3},
        })
    };
    let suite = serde_json::json!({"format": "cloudparity-suite/1", "entries": [entry("few", 64), entry("many", 256)]});
    let path = folder.join("ramp.suite.json");
    std::fs::write(&path, suite.to_string()).expect("written");
    path
}

/// Our pictures and the records below a folder, with their times of change.
fn kept(folder: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let mut found = BTreeMap::new();
    for part in ["ours", "records", "timed", "few", "many"] {
        for entry in std::fs::read_dir(folder.join(part)).into_iter().flatten() {
            let path = entry.expect("an entry").path();
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            if part.len() > 4 || part == "ours" || name.starts_with("ours-") || name.starts_with("timed-") {
                let changed = std::fs::metadata(&path).and_then(|metadata| metadata.modified()).expect("a time");
                found.insert(path, changed);
            }
        }
    }
    found
}

fn shard(number: u32) -> Settings {
    Settings { shard: Shard::new(number, 2).expect("a shard"), ..Settings::default() }
}

fn by_another(mix_builds: bool) -> Settings {
    Settings::of(Resume { build: Identity::of("0.1.0", "bb"), mix_builds })
}

#[test]
fn a_suite_goes_on_where_it_stopped_and_in_shards() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (suite, output) = (suite_file(folder.path()), folder.path().join("out"));
    let run = |settings: &Settings| {
        let mut told = Vec::new();
        let mut tell = |result: &parity::EntryResult| told.push(result.name.clone());
        let outcome = parity::run(&suite, &[], &output, settings, &|_, _| (), &mut tell);
        outcome.map(|outcome| (outcome, told))
    };
    let (outcome, told) = run(&shard(1)).expect("the first half");
    assert_eq!((outcome, told), (Outcome::Part { done: 1, of: 2 }, vec!["few".to_owned()]));
    let half = kept(&output);
    assert_eq!(half.len(), 3, "a picture and two records: {half:?}");
    let (outcome, told) = run(&shard(2)).expect("the second half");
    assert_eq!(told, ["few", "many"]);
    let results = outcome.all().expect("all of it");
    assert_eq!(results.iter().map(|result| result.name.as_str()).collect::<Vec<_>>(), ["few", "many"]);
    assert!(results.iter().all(|result| result.builds == [Identity::current().clone()] && !result.identity.is_empty()));
    let whole = kept(&output);
    assert!(whole.len() == 6 && half.iter().all(|(path, time)| whole.get(path) == Some(time)));
    assert_eq!(run(&Settings::default()).expect("again").0, Outcome::All(results.clone()));
    assert_eq!(kept(&output), whole, "nothing is rendered twice");
    for name in ["parity.json", "parity.md", "experiment.json", "many/diff.json"] {
        assert!(output.join(name).is_file(), "{name}");
    }

    let error = run(&by_another(false)).expect_err("another build").to_string();
    assert!(error.contains("0.1.0+bb") && error.contains(&Identity::current().to_string()), "{error}");
    assert_eq!(run(&by_another(true)).expect("knowingly").0, Outcome::All(results));
    assert_eq!(kept(&output), whole);
}

#[test]
fn races_to_an_error_are_records_of_their_own() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (suite, output) = (suite_file(folder.path()), folder.path().join("out"));
    let what = |levels: &[u32]| TimeSettings {
        levels: levels.to_vec(),
        marching_rate: None,
        trackings: vec![Tracking::Proven],
        longest: 60.0,
    };
    let run = |levels: &[u32], settings: &Settings| {
        time_to_error::run(&suite, &["many".to_owned()], &output, &what(levels), settings, &|_, _| ())
    };
    let first = run(&[4], &Settings::default()).and_then(Outcome::all).expect("a race");
    assert_eq!((first.rows.len(), first.cycles.len()), (1, 1));
    let race = &first.rows[0];
    // How the sides stand to each other is no matter of this test: 96 values say little about errors.
    assert!(race.our_samples >= 1 && race.error > 0.0 && race.our_error.is_finite() && race.ratio > 0.0, "{race:?}");
    let before = kept(&output);
    // Another level is another race, with what is known of the samples.
    let second = run(&[4, 8], &Settings::default()).and_then(Outcome::all).expect("two races");
    assert_eq!((second.rows.len(), &second.rows[0]), (2, race));
    let after = kept(&output);
    assert!(before.iter().all(|(path, time)| after.get(path) == Some(time)), "nothing is made twice");
    assert!(run(&[4], &by_another(false)).is_err());
    assert!(run(&[], &Settings::default()).is_err(), "no level, nothing to measure");
}
