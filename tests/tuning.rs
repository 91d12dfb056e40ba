//! Tuning: a known answer is found, an interrupted search goes on, a preset renders what was judged, bad input is refused.

mod support;

use assert_cmd::cargo::cargo_bin_cmd;
use cloudparity::base::identity::{Identity, Resume};
use cloudparity::measure::experiment::{Outcome, Settings};
use cloudparity::measure::tuning::preset::Preset;
use cloudparity::measure::tuning::{Scored, Tuning, TuningResults};
use cloudparity::scene::image::Image;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A ramp under single scattering, for which an engine of many steps is right at exposure 1 without powder.
fn tuning_file(folder: &Path, generations: u32) -> PathBuf {
    let mut scene = support::scene("linear-ramp");
    scene.set_volume_bounces(0);
    // Nothing hides the ambient light of an engine, so there is none.
    scene.world.color = [0.0; 3];
    std::fs::write(folder.join("ramp.scene.json"), serde_json::to_string(&scene).expect("JSON")).expect("written");
    let path = folder.join("ramp.tune.toml");
    let text = format!(
        r#"
        format = "cloudparity-tune/1"
        title = "a ramp"
        resolution = [16, 9]
        train = [{{ file = "ramp.scene.json", name = "as it is" }}]
        held_out = [{{ file = "ramp.scene.json", name = "another sun", sun = [200, 40] }}]
        [truth]
        samples = 256
        replicas = 6
        [engine]
        density = "graph"
        light = "single"
        steps = 32
        light_steps = 16
        sub_pixels = 2
        [search]
        seed = 5
        population = 6
        generations = {generations}
        objective = "relmse"
        [parameters]
        exposure = {{ range = [0.25, 4.0], logarithmic = true, initial = 2.5 }}
        powder_strength = {{ range = [0.0, 1.0], initial = 0.4 }}
        "#
    );
    std::fs::write(&path, text).expect("written");
    path
}

fn run(path: &Path, folder: &Path) -> TuningResults {
    let tuning = Tuning::load(path).expect("a tuning");
    tuning.run(folder, &Settings::default(), &|_, _| ()).and_then(Outcome::all).expect("results")
}

/// The records of candidates: name and bytes.
fn evaluations(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    std::fs::read_dir(folder.join("evaluations"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .map(|path| (PathBuf::from(path.file_name().expect("a name")), std::fs::read(&path).expect("readable")))
        .collect()
}

#[test]
fn a_search_finds_a_known_answer_goes_on_and_its_preset_renders_it() {
    if !support::require("cma") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out");
    // A search that was cut off after three generations, and went on.
    let short = run(&tuning_file(folder.path(), 3), &folder.path().join("short"));
    let whole = run(&tuning_file(folder.path(), 40), &output);
    assert_eq!(short.history[..], whole.history[..3], "a search is determined by its seed");
    let before = evaluations(&output);
    assert_eq!(before.len(), whole.evaluations);
    assert!(evaluations(&folder.path().join("short")).iter().all(|(name, _)| before.contains_key(name)));
    // The search is interrupted near its end: its own record is not there, and neither are those of some candidates.
    let lost: Vec<&PathBuf> = before.keys().step_by(100).collect();
    for name in &lost {
        std::fs::remove_file(output.join("evaluations").join(name)).expect("a candidate is lost");
    }
    for entry in std::fs::read_dir(output.join("records")).expect("a folder") {
        let path = entry.expect("an entry").path();
        if std::fs::read_to_string(&path).expect("a record").contains("\"history\"") {
            std::fs::remove_file(&path).expect("the search is not done");
        }
    }
    let again = run(&tuning_file(folder.path(), 40), &output);
    let after = evaluations(&output);
    assert_eq!(after.len(), before.len());
    for (name, bytes) in before.iter().filter(|(name, _)| !lost.contains(name)) {
        assert_eq!(&after[name], bytes, "{} is not made again", name.display());
    }
    assert_eq!(again.parameters, whole.parameters);
    assert_eq!(again.history, whole.history);

    // The engine is right within the light that its rays leave out, at most 1 %, and 240 candidates reach some per cent of each range.
    let [exposure, powder] = ["exposure", "powder_strength"].map(|name| whole.parameters[name]);
    assert!((exposure - 1.0).abs() < 0.05 && powder < 0.1, "{exposure} {powder}");
    let single = whole.published.iter().find(|scored| scored.name == "single").expect("single scattering is published");
    assert!((single.exposure - 1.0).abs() < 0.05, "{}", single.exposure);
    // At least as good as the known answer, whose parameters are among those that were searched.
    let [tuned, known] = [&whole.tuned, single].map(|scored| Scored::mean_relmse(&scored.train));
    assert!(tuned <= 1.001 * known, "{tuned} {known}");
    assert!(Scored::mean_flip(&whole.tuned.held_out) < 1.2 * Scored::mean_flip(&single.held_out) + whole.noise_flip);
    assert!(whole.published.is_sorted_by_key(|scored| (1e9 * Scored::mean_flip(&scored.held_out)) as u64));

    // The preset renders the held-out view that was judged.
    let mut scene = support::scene("linear-ramp");
    scene.set_volume_bounces(0);
    scene.world.color = [0.0; 3];
    let axis = &whole.file.held_out[0];
    axis.prepare(&mut scene, [16, 9]).expect("prepared");
    let view = folder.path().join("view.scene.json");
    std::fs::write(&view, serde_json::to_string(&scene).expect("JSON")).expect("written");
    let picture = folder.path().join("preset.exr");
    cargo_bin_cmd!("cloudparity")
        .arg("render")
        .arg(&view)
        .arg("--preset")
        .arg(output.join("tuned.preset.json"))
        .arg("-o")
        .arg(&picture)
        .assert()
        .success();
    let ours = Image::read_exr(&picture).expect("a picture");
    let judged = Image::read_exr(&output.join(&whole.tuned.held_out[0].picture)).expect("a picture");
    assert_eq!(ours.pixels, judged.pixels);
    assert_eq!(ours.provenance["preset_builds"], Identity::current().full());
    assert_eq!(ours.provenance["build"], Identity::current().full());
    // Another build neither takes the search for its own nor makes it anew.
    let other = |mix_builds| Settings::of(Resume { build: Identity::of("0.1.0", "bb"), mix_builds });
    let tuning = Tuning::load(&tuning_file(folder.path(), 40)).expect("a tuning");
    let error = tuning.run(&output, &other(false), &|_, _| ()).expect_err("refused");
    assert!(error.found.contains(&Identity::current().to_string()) && error.expected.contains("0.1.0+bb"), "{error}");
    assert_eq!(evaluations(&output), after);
    let mixed = tuning.run(&output, &other(true), &|_, _| ()).and_then(Outcome::all).expect("knowingly");
    assert_eq!(mixed.parameters, whole.parameters);
    assert!(mixed.builds.contains(Identity::current()), "{:?}", mixed.builds);
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = tuning_file(folder.path(), 2);
    let said = |arguments: &[&str]| {
        let mut command = cargo_bin_cmd!("cloudparity");
        let found = command.args(arguments).assert().code(2).get_output().clone();
        String::from_utf8(found.stderr).expect("text")
    };
    let (file, out) = (path.to_str().expect("a name"), folder.path().join("out"));
    let out = out.to_str().expect("a name");
    let text = std::fs::read_to_string(&path).expect("a file");
    let broken = folder.path().join("broken.tune.toml");
    for (from, to, place) in [
        ("light = \"single\"", "light = \"moon\"", "octaves-deep"),
        ("exposure =", "exposures =", "contribution"),
        ("name = \"another sun\"", "name = \"as it is\"", "held_out"),
        ("ramp.scene.json\", name = \"another", "none.scene.json\", name = \"another", "none.scene.json"),
    ] {
        assert!(text.contains(from), "{from}");
        std::fs::write(&broken, text.replace(from, to)).expect("written");
        let error = said(&["tune", broken.to_str().expect("a name"), "-o", out]);
        assert!(error.contains(place), "{error}");
    }
    // The folder of another tuning.
    std::fs::create_dir_all(out).expect("a folder");
    std::fs::write(Path::new(out).join("tune.json"), "{}").expect("written");
    assert!(said(&["tune", file, "-o", out]).contains("another folder"));
    // Presets of another format, with a field too many, with a parameter that is not there.
    let scene = support::project("parity/scenes/linear-ramp.scene.json");
    let preset = folder.path().join("a.preset.json");
    let good = r#"{"format": "cloudparity-preset/1", "title": "", "parameters": {},
        "engine": {"density": "graph", "light": "single", "steps": 4, "light_steps": 2}}"#;
    for (from, to, place) in [
        ("preset/1", "preset/9", "$.format"),
        ("\"title\"", "\"titel\"", "titel"),
        ("{},", "{\"shine\": 1},", "contribution"),
        ("\"single\"", "\"moon\"", "octaves-deep"),
    ] {
        std::fs::write(&preset, good.replace(from, to)).expect("written");
        let arguments =
            ["render", scene.to_str().expect("a name"), "--preset", preset.to_str().expect("a name"), "-o", "none.exr"];
        let error = said(&arguments);
        assert!(error.contains(place), "{error}");
    }
}

#[test]
fn committed_presets_make_engines_of_their_scenes() {
    let scene = support::scene("clouds-in-daylight");
    let mut count = 0;
    for entry in std::fs::read_dir(support::project("parity/presets")).expect("a folder") {
        let path = entry.expect("an entry").path();
        let mut preset = Preset::load(&path).expect("a preset");
        count += 1;
        if let Some(volume) = &mut preset.engine.light_volume {
            // Found by a build that says so. A coarse volume is made like a fine one, in less time.
            assert!(preset.builds.iter().all(|build| *build != Identity::unknown()) && preset.builds.len() == 1);
            (volume.cells, volume.shadow_cells, volume.paths) = (4, 8, 1);
            let (_, engine, _) = preset.build(&scene).expect("an engine");
            assert!(engine.light_volume.is_some() && !engine.light.terms.imitates_orders(), "{}", path.display());
            continue;
        }
        let (_, engine, _) = preset.build(&scene).expect("an engine");
        assert!(
            engine.light.terms.needs_coarse() && engine.light.terms.octaves.compression > 0.0,
            "{}",
            path.display()
        );
        // They were found before builds had an identity: settings, but no results of this build.
        assert_eq!(preset.builds, [Identity::unknown()], "{}", path.display());
    }
    assert_eq!(count, 4);
    // Using one is no error; the program says whose it is, and the picture names both builds.
    let folder = tempfile::tempdir().expect("a folder");
    let picture = folder.path().join("a.exr");
    let said = cargo_bin_cmd!("cloudparity")
        .arg("render")
        .arg(support::project("parity/scenes/clouds-in-daylight.scene.json"))
        .args(["--resolution", "16x9", "--preset"])
        .arg(support::project("parity/presets/perlin-fbm.preset.json"))
        .arg("-o")
        .arg(&picture)
        .assert()
        .success()
        .get_output()
        .clone();
    let said = String::from_utf8(said.stderr).expect("text");
    assert!(said.contains("another build (unknown)") && said.contains(&Identity::current().to_string()), "{said}");
    let picture = Image::read_exr(&picture).expect("a picture");
    assert_eq!(picture.provenance["preset_builds"], "unknown");
    assert_eq!(picture.provenance["build"], Identity::current().full());
}

#[test]
fn a_preset_of_another_scene_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = std::fs::read_to_string(support::project("parity/presets/perlin-fbm.preset.json")).expect("a preset");
    let mut preset: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let scene = support::project("parity/scenes/procedural-clouds.scene.json");
    let mut said = |scenes: serde_json::Value| {
        preset["provenance"]["scenes"] = scenes;
        let path = folder.path().join("a.preset.json");
        std::fs::write(&path, preset.to_string()).expect("written");
        let output = cargo_bin_cmd!("cloudparity")
            .arg("render")
            .arg(&scene)
            .args(["--resolution", "8x4", "--backend", "cpu", "--preset"])
            .arg(&path)
            .arg("-o")
            .arg(folder.path().join("a.exr"))
            .assert()
            .success();
        String::from_utf8_lossy(&output.get_output().stderr).into_owned()
    };
    let text = said(serde_json::json!(["elsewhere"]));
    assert!(text.contains("found in elsewhere") && text.contains("procedural-clouds"), "{text}");
    assert!(!said(serde_json::json!(["elsewhere", "procedural-clouds"])).contains("found in"));
}
