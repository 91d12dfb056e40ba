//! Studies: what is measured, resumed, refused and verified.

mod support;

use assert_cmd::cargo::cargo_bin_cmd;
use cloudparity::base::identity::{Identity, Resume};
use cloudparity::engines::defects::Defects;
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use cloudparity::gpu::{Backend, Gpu};
use cloudparity::measure::attribution::file::AttributionFile;
use cloudparity::measure::combination::Combination;
use cloudparity::measure::errors::{Errors, Uncertain};
use cloudparity::measure::experiment::{Outcome, Settings, Shard};
use cloudparity::measure::sequence::file::SequenceFile;
use cloudparity::measure::study::file::StudyFile;
use cloudparity::measure::study::{Results, Study};
use cloudparity::measure::timing::Clock;
use cloudparity::measure::truth::PixelRays;
use cloudparity::measure::tuning::Tuning;
use cloudparity::measure::tuning::preset::Preset;
use cloudparity::report::settings::{self, Recorded};
use rand::{Rng as _, SeedableRng as _};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

/// A ramp in the sun, single scattering, whose truth single scattering with many steps is.
fn study_file(folder: &Path, steps: &str) -> PathBuf {
    let mut scene = support::scene("linear-ramp");
    scene.set_volume_bounces(0);
    scene.world.color = [0.0; 3];
    std::fs::write(folder.join("ramp.scene.json"), serde_json::to_string(&scene).expect("JSON")).expect("written");
    let path = folder.join("ramp.study.toml");
    let text = format!(
        r#"
        format = "cloudparity-study/1"
        title = "a ramp"
        resolution = [16, 9]
        [truth]
        samples = 512
        replicas = 8
        voxels = 16
        [timing]
        repeats = 1
        [axes]
        scenes = [{{ file = "ramp.scene.json" }}]
        densities = ["graph"]
        lights = ["single", "octaves"]
        steps = {steps}
        light_steps = [1, 32]
        sub_pixels = [4]
        "#
    );
    std::fs::write(&path, text).expect("written");
    path
}

fn run_as(path: &Path, folder: &Path, settings: &Settings) -> cloudparity::Result<Outcome<Results>> {
    Study::load(path).expect("a study").run(folder, settings, &|_, _| ())
}

fn run(path: &Path, folder: &Path) -> Results {
    run_as(path, folder, &Settings::default()).and_then(Outcome::all).expect("results")
}

/// Names and times of change of the records of runs and truths.
fn records(folder: &Path) -> Vec<(PathBuf, SystemTime)> {
    let mut found: Vec<(PathBuf, SystemTime)> = ["runs", "truth"]
        .iter()
        .flat_map(|name| std::fs::read_dir(folder.join(name)).expect("a folder"))
        .map(|entry| {
            let entry = entry.expect("an entry");
            (entry.path(), entry.metadata().expect("metadata").modified().expect("a time"))
        })
        .collect();
    found.sort();
    found
}

#[test]
fn truths_look_through_pixels_as_the_runs_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[64]");
    let text = std::fs::read_to_string(&path).expect("a study");
    let text = text.replace("[1, 32]", "[32]").replace("\"single\", \"octaves\"", "\"single\"");
    let study = |sub_pixels: &str| {
        std::fs::write(&path, text.replace("[4]", sub_pixels)).expect("written");
        run(&path, &folder.path().join(sub_pixels.trim_matches(['[', ']'])))
    };
    let (alone, beside) = (study("[1]"), study("[1, 4]"));
    assert_eq!((alone.truths[0].rays, beside.truths[0].rays), (PixelRays::Centres, PixelRays::Filtered));
    assert_ne!(alone.truths[0].id, beside.truths[0].id);
    let relmse = |results: &Results, rays: u32| {
        let found = results.runs.iter().find(|run| run.combination.sub_pixels == rays).expect("a run");
        found.errors.relmse
    };
    // The same picture: against a filtered truth the edges of the box are an error, which is not the light model's.
    let (alike, unlike, filtered) = (relmse(&alone, 1), relmse(&beside, 1), relmse(&beside, 4));
    let difference = unlike.value - alike.value;
    assert!(difference > 5.0 * unlike.standard_error.hypot(alike.standard_error), "{alike:?} {unlike:?} {filtered:?}");
    assert!(alike.value < 0.5 * unlike.value && filtered.value < unlike.value, "{alike:?} {unlike:?} {filtered:?}");
}

#[test]
fn errors_are_those_of_the_settings_and_nothing_is_measured_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2, 64]");
    let output = folder.path().join("out");
    let first = run(&path, &output);
    assert_eq!((first.runs.len(), first.skipped.len(), first.truths.len()), (8, 0, 1));
    let find = |light: &str, steps: u32, light_steps: u32| {
        let wanted = |run: &&cloudparity::measure::study::Measured| {
            let combination = &run.combination;
            (combination.light.as_str(), combination.steps, combination.light_steps) == (light, steps, light_steps)
        };
        first.runs.iter().find(wanted).expect("a run")
    };
    let fine = find("single", 64, 32);
    // The early end of rays leaves up to 1 % of their light, steps far less.
    assert!(fine.errors.bias.value.abs() < 0.01 + 4.0 * fine.errors.bias.standard_error, "{:?}", fine.errors);
    for (light, steps, light_steps) in [("single", 2, 1), ("octaves", 64, 32)] {
        let coarse = find(light, steps, light_steps);
        let apart = coarse.errors.relmse.value - fine.errors.relmse.value;
        assert!(apart > 10.0 * coarse.errors.relmse.standard_error, "{light} {steps}: {:?}", coarse.errors);
    }
    assert!(first.runs.iter().all(|run| run.seconds.median > 0.0 && output.join(&run.picture).is_file()));
    let before = records(&output);
    // HDR-FLIP, where the packages are there, is kept with the runs; a second time nothing is written.
    let second = run(&path, &output);
    assert_eq!(second, first);
    assert_eq!(records(&output), before);
    // What is new is measured, what was there is kept.
    let third = run(&study_file(folder.path(), "[2, 8, 64]"), &output);
    assert_eq!(third.runs.len(), 12);
    let after = records(&output);
    assert!(before.iter().all(|record| after.contains(record)));
    let csv = std::fs::read_to_string(output.join("results.csv")).expect("a table");
    assert_eq!(csv.lines().count(), 13);
    let commas = csv.lines().next().map_or(0, |head| head.matches(',').count());
    assert!(commas > 20 && csv.lines().all(|line| line.matches(',').count() == commas), "{csv}");
}

/// Records and pictures below a folder, by name: time of change and bytes.
fn kept(folder: &Path) -> BTreeMap<PathBuf, (SystemTime, Vec<u8>)> {
    let mut found = BTreeMap::new();
    for part in ["truth", "runs", "curves"] {
        for entry in std::fs::read_dir(folder.join(part)).into_iter().flatten() {
            let path = entry.expect("an entry").path();
            // What a process was writing when it was killed is no record.
            if path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')) {
                continue;
            }
            let changed = std::fs::metadata(&path).and_then(|metadata| metadata.modified()).expect("a time");
            let name = path.strip_prefix(folder).expect("below it").to_owned();
            found.insert(name, (changed, std::fs::read(&path).expect("readable")));
        }
    }
    found
}

#[test]
fn a_study_that_is_killed_at_ten_random_moments_loses_nothing_and_makes_nothing_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2, 3, 4, 5, 6, 64]");
    let text = std::fs::read_to_string(&path).expect("a study").replace("[axes]", "[curves]\npath = [2, 4]\n[axes]");
    std::fs::write(&path, text).expect("written");
    let begin = SystemTime::now();
    let whole = run(&path, &folder.path().join("whole"));
    let names = |kept: &BTreeMap<PathBuf, _>| kept.keys().cloned().collect::<Vec<_>>();
    let wanted = kept(&folder.path().join("whole"));
    // Until the last record was there: HDR-FLIP, in another process and at the end, is not what is to be interrupted.
    let last = wanted.values().map(|(changed, _)| *changed).max().expect("there are records");
    let needed = last.duration_since(begin).expect("time goes on");

    let output = folder.path().join("out");
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let mut before: BTreeMap<PathBuf, (SystemTime, Vec<u8>)> = BTreeMap::new();
    let mut grown = 0;
    for _ in 0..10 {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_cloudparity"));
        let mut child = command.arg("study").arg(&path).arg("-o").arg(&output).spawn().expect("it starts");
        // An eighth of the time that all records take, on average: it is killed at the beginning, in the middle, and when all are there.
        std::thread::sleep(needed.mul_f64(random.random_range(0.0..0.25)));
        child.kill().expect("it is killed");
        child.wait().expect("it ends");
        let now = kept(&output);
        for (name, record) in &before {
            assert_eq!(now.get(name), Some(record), "{} is lost or made again", name.display());
        }
        grown += usize::from(now.len() > before.len());
        before = now;
    }
    assert!(grown >= 2, "it was killed in the middle of its work: {grown} times something was kept");
    let results = run(&path, &output);
    let after = kept(&output);
    for (name, record) in &before {
        assert_eq!(after.get(name), Some(record), "{} is lost or made again", name.display());
    }
    assert_eq!(names(&after), names(&wanted), "the records of an uninterrupted study");
    assert_eq!((results.runs.len(), results.curves.len()), (24, 2));
    // What does not depend on time is the same.
    let errors = |results: &Results| results.runs.iter().map(|run| (run.id.clone(), run.errors)).collect::<Vec<_>>();
    assert_eq!(errors(&results), errors(&whole));
}

#[test]
fn shards_of_a_study_meet_in_one_folder_or_are_copied_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2, 8]");
    let whole = run(&path, &folder.path().join("whole"));
    let wanted: Vec<PathBuf> = kept(&folder.path().join("whole")).into_keys().collect();

    // Two processes at the same time in one folder.
    let output = folder.path().join("one");
    let start = |shard: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_cloudparity"));
        command.arg("study").arg(&path).arg("-o").arg(&output).args(["--shard", shard]).spawn().expect("it starts")
    };
    for mut child in [start("1/2"), start("2/2")] {
        assert!(child.wait().expect("it ends").success());
    }
    assert_eq!(kept(&output).into_keys().collect::<Vec<_>>(), wanted);
    let found = Results::load(&output).expect("one of them summed up");
    let ids = |results: &Results| results.runs.iter().map(|run| run.id.clone()).collect::<Vec<_>>();
    assert_eq!(ids(&found), ids(&whole));

    // Two folders, copied together.
    let half = |number: u32, folder: &Path| {
        let settings = Settings { shard: Shard::new(number, 2).expect("a shard"), ..Settings::default() };
        run_as(&path, folder, &settings).expect("a half")
    };
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    assert!(matches!(half(1, &a), Outcome::Part { .. }) && matches!(half(2, &b), Outcome::Part { .. }));
    for part in ["truth", "runs", "pictures"] {
        std::fs::create_dir_all(a.join(part)).expect("a folder");
        for entry in std::fs::read_dir(b.join(part)).into_iter().flatten() {
            let from = entry.expect("an entry").path();
            std::fs::copy(&from, a.join(part).join(from.file_name().expect("a name"))).expect("copied");
        }
    }
    let before = kept(&a);
    assert_eq!(ids(&run(&path, &a)), ids(&whole));
    assert_eq!(kept(&a), before, "nothing was left to be made");

    // Two folders, merged by the program: the same records; a shard that is not there, or not whole, is named.
    let merge = |folders: &[&PathBuf], into: &str| {
        let mut command = cargo_bin_cmd!("cloudparity");
        command.arg("study").arg(&path).arg("-o").arg(folder.path().join(into)).args(["--only-merge", "--merge"]);
        command.args(folders).assert()
    };
    let [c, d] = ["c", "d"].map(|name| folder.path().join(name));
    assert!(matches!(half(1, &c), Outcome::Part { .. }) && matches!(half(2, &d), Outcome::Part { .. }));
    let said = String::from_utf8(merge(&[&c], "merged").code(2).get_output().stderr.clone()).expect("text");
    assert!(said.contains("shard 2/2 is in none of the folders"), "{said}");
    merge(&[&c, &d], "merged").success();
    let merged = folder.path().join("merged");
    assert_eq!(kept(&merged).into_keys().collect::<Vec<_>>(), wanted);
    assert_eq!(ids(&Results::load(&merged).expect("it summed up")), ids(&whole));
    let (run, _) = kept(&d).into_iter().find(|(path, _)| path.starts_with("runs")).expect("a run");
    std::fs::remove_file(d.join(&run)).expect("removed");
    let said = String::from_utf8(merge(&[&c, &d], "lost").code(2).get_output().stderr.clone()).expect("text");
    assert!(said.contains("shard 2/2 in") && said.contains("lacks 1 of"), "{said}");

    // By these words the workflow of sweeps counts the jobs of a plan (parity/workflows/chunks.py).
    let mut command = cargo_bin_cmd!("cloudparity");
    command.arg("study").arg(&path).arg("-o").arg(folder.path().join("count")).args(["--shard", "1/4294967295"]);
    let said = String::from_utf8(command.assert().success().get_output().stderr.clone()).expect("text");
    let counted = format!("1 of {} records are there", whole.runs.len() + whole.truths.len());
    assert!(said.lines().any(|line| line.starts_with(&counted)), "{said}");

    // What is no shard.
    for shard in ["3/2", "0/2", "1/0", "half", "1/2/3", ""] {
        let mut command = cargo_bin_cmd!("cloudparity");
        let found = command.arg("study").arg(&path).arg("-o").arg(&output).args([&format!("--shard={shard}")]);
        let said = String::from_utf8(found.assert().code(2).get_output().stderr.clone()).expect("text");
        assert!(said.contains(shard) && said.contains("--shard") && said.contains("1 to the count"), "{said}");
    }
}

/// Files below a folder, by name, with their bytes.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for name in ["runs", "truth", "pictures"] {
        for entry in std::fs::read_dir(folder.join(name)).expect("a folder") {
            let path = entry.expect("an entry").path();
            let bytes = std::fs::read(&path).expect("readable");
            found.push((Path::new(name).join(path.file_name().expect("a name")), bytes));
        }
    }
    found
}

#[test]
fn what_was_done_before_the_disk_was_full_is_kept() {
    if !support::require("unshare") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]");
    let (disk, kept) = (folder.path().join("disk"), folder.path().join("kept"));
    std::fs::create_dir(&disk).expect("a folder");
    // A disk of 200 KiB, which a namespace of its own makes without privileges, and a copy of what it holds in the end.
    let script = r#"mount -t tmpfs -o size=200k tmpfs "$1" && "$2" study "$3" -o "$1/out"; code=$?; cp -r "$1/out" "$4"; exit $code"#;
    let found = std::process::Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", script, "sh"])
        .args([disk.as_os_str(), env!("CARGO_BIN_EXE_cloudparity").as_ref(), path.as_os_str(), kept.as_os_str()])
        .output()
        .expect("it starts");
    let said = String::from_utf8_lossy(&found.stderr).into_owned();
    assert_eq!(found.status.code(), Some(2), "{said}");
    assert!(said.contains("No space left") && said.contains("free space"), "{said}");
    let before = contents(&kept);
    let records = before.iter().filter(|(name, _)| name.starts_with("runs")).count();
    assert!((1..60).contains(&records), "{records} runs before the disk was full");
    // On a disk with room it goes on: what was there stays as it is, and no half file is among it.
    let results = run(&path, &kept);
    assert_eq!(results.runs.len(), 60);
    let after = contents(&kept);
    for (name, bytes) in before.iter().filter(|(name, _)| !name.starts_with("runs")) {
        assert!(after.contains(&(name.clone(), bytes.clone())), "{}", name.display());
    }
}

#[test]
fn runs_on_the_adapter_have_its_name_and_a_clock_that_fits() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("an adapter");
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[8]");
    let change = |from: &str, to: &str| {
        let text = std::fs::read_to_string(&path).expect("a study").replace(from, to);
        std::fs::write(&path, text).expect("written");
    };
    change("samples = 512", "samples = 16");
    change("densities = [\"graph\"]", "densities = [\"graph\", \"perlin-fbm\"]");
    let cpu = run(&path, &folder.path().join("out"));
    change("repeats = 1", "repeats = 1\nbackend = \"gpu\"");
    let adapter = run(&path, &folder.path().join("out"));
    assert!(adapter.machine.contains(&gpu.adapter().name), "{}", adapter.machine);
    let is_software = gpu.adapter().is_software();
    assert_eq!(adapter.clock, if is_software { Clock::Processor } else { Clock::Timestamps });
    assert_eq!((adapter.runs.len(), &adapter.skipped), (8, &cpu.skipped));
    for (ours, theirs) in cpu.runs.iter().zip(&adapter.runs) {
        assert_eq!(ours.combination, theirs.combination);
        assert_ne!(ours.id, theirs.id, "measured anew");
        assert!(theirs.seconds.median > 0.0);
        // 8 steps and at most 32 towards the sun, each of a few roundings of f32, in errors of some percent.
        let (a, b) = (ours.errors.rms.value, theirs.errors.rms.value);
        assert!((a - b).abs() <= 1e-4 * a.max(b), "{a} {b}");
    }
}

#[test]
fn timestamps_count_the_work_of_the_adapter() {
    if !support::require("vulkan") {
        return;
    }
    let Some(gpu) = Gpu::open().ok().filter(Gpu::has_timestamps) else { return };
    let scene = support::scene("linear-ramp");
    let model = cloudparity::engines::find("perlin-fbm").expect("a model");
    let values = model.values(None, &[]).expect("values");
    let engine = model.engine(&scene, &values, &Defects::NONE, 0.0).expect("an engine");
    let renderer = EngineRenderer::new(&scene, &engine, Some(&gpu)).expect("a kernel");
    let settings = EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };
    let begin = Instant::now();
    let (_, times) = gpu.timed(|| renderer.picture(&settings, &|_, _| ())).expect("a picture");
    let times = times.expect("timestamps");
    let seconds = times.seconds();
    // Dispatches follow each other, so that their sum is no more than what passed.
    assert!(seconds > 0.0 && seconds <= begin.elapsed().as_secs_f64(), "{seconds}");
    let (_, nothing) = gpu.timed(|| Ok(())).expect("nothing");
    assert_eq!(nothing.map(|times| (times.seconds(), times.0.len())), Some((0.0, 0)));
}

#[test]
fn a_folder_belongs_to_one_process_at_a_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2]");
    let output = folder.path().join("out");
    run(&path, &output);
    let lock = cloudparity::base::files::Lock::take(&output).expect("nobody has it");
    let error = Study::load(&path)
        .expect("a study")
        .run(&output, &Settings::default(), &|_, _| ())
        .expect_err("taken")
        .to_string();
    assert!(error.contains("another process"), "{error}");
    drop(lock);
    run(&path, &output);
}

#[test]
fn truths_are_made_beforehand_and_an_interrupted_one_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2]");
    let text = std::fs::read_to_string(&path).expect("a study").replace("[axes]", "[curves]\npath = [4, 64]\n[axes]");
    std::fs::write(&path, text).expect("written");
    let output = folder.path().join("out");
    let study = Study::load(&path).expect("a study");
    let made = study.prepare(&output, &Settings::default(), &|_, _| ()).and_then(Outcome::all).expect("truths").truths;
    assert!(made.len() == 1 && made[0].seconds > 0.0 && made[0].replicas.len() == 8, "{made:?}");
    // As if it had been interrupted between two replicas.
    let lost = output.join(&made[0].replicas[5]);
    let bytes = std::fs::read(&lost).expect("a replica");
    std::fs::remove_file(&lost).expect("removed");
    std::fs::remove_file(output.join(format!("truth/{}.json", made[0].id))).expect("removed");
    let stays = output.join(&made[0].replicas[0]);
    let before = std::fs::metadata(&stays).expect("a file").modified().expect("a time");
    let results = run(&path, &output);
    assert_eq!(std::fs::metadata(&stays).expect("a file").modified().expect("a time"), before);
    let [old, new] = [bytes, std::fs::read(&lost).expect("made again")].map(|bytes| {
        let file = folder.path().join("replica.exr");
        std::fs::write(&file, bytes).expect("written");
        cloudparity::scene::image::Image::read_exr(&file).expect("a picture").pixels
    });
    assert_eq!(old, new);
    // Path tracing's curve: more samples, less error; both are pictures of one converging series.
    let [few, many] = [&results.curves[0], &results.curves[1]];
    assert_eq!((few.samples, many.samples, results.curves.len()), (4, 64, 2));
    assert!(many.errors.relmse.value < few.errors.relmse.value, "{:?} {:?}", few.errors, many.errors);
    // 16 times the samples: the rms error falls to a fourth if they are independent, to a sixteenth at most where they are stratified. That of 144 pixels
    // scatters by 6 % at least, by twice as much with tails: the ratio by 17 %, of which twice. (relMSE hangs on one pixel here: it goes from 0.004 to 0.05
    // over seeds.)
    let ratio = few.errors.rms.value / many.errors.rms.value;
    assert!((4.0 * 0.66..16.0).contains(&ratio), "{ratio}: {:?} {:?}", few.errors, many.errors);
    assert!(few.seconds > Some(0.0) && few.seconds < many.seconds);
    // A second time nothing is rendered.
    assert_eq!(run(&path, &output), results);
}

#[test]
fn a_front_is_verified_and_a_wrong_one_is_found_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2, 16]");
    let output = folder.path().join("out");
    let mut results = run(&path, &output);
    let study = Study::load(&path).expect("a study");
    let found = study
        .verify(&results, &output, &Settings::default(), &|_, _| ())
        .and_then(Outcome::all)
        .expect("a verification");
    assert!(!found.is_empty() && found.iter().all(|one| one.agrees), "{found:?}");
    for run in &mut results.runs {
        run.errors.relmse.value *= 1.5;
    }
    let found = study
        .verify(&results, &output, &Settings::default(), &|_, _| ())
        .and_then(Outcome::all)
        .expect("a verification");
    assert!(found.iter().any(|one| !one.agrees), "{found:?}");
}

#[test]
fn folders_and_truths_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2]");
    let output = folder.path().join("out");
    let results = run(&path, &output);
    let refused = || {
        Study::load(&path)
            .expect("a study")
            .run(&output, &Settings::default(), &|_, _| ())
            .expect_err("refused")
            .to_string()
    };
    let truth = output.join("truth").join(format!("{}.json", results.truths[0].id));
    let text = std::fs::read_to_string(&truth).expect("a record");
    let edited = text.replace(&results.truths[0].scene_sha256, "another");
    std::fs::write(&truth, &edited).expect("written");
    let error = refused();
    assert!(error.contains(&results.truths[0].id) && error.contains("changed"), "{error}");
    // Records of builds from before there were seals have none: their content is looked at.
    let old: String =
        edited.lines().filter(|line| !line.contains("\"seal\"")).map(|line| format!("{line}\n")).collect();
    std::fs::write(&truth, old.replace(Identity::current().full(), "unknown")).expect("written");
    let error = refused();
    assert!(error.contains("another") && error.contains("truth"), "{error}");
    std::fs::write(&truth, text).expect("written");
    std::fs::write(output.join("study.json"), r#"{"format": "cloudparity-study-results/0", "version": "0"}"#)
        .expect("written");
    let error = refused();
    assert!(error.contains("another folder"), "{error}");
    std::fs::remove_file(output.join("study.json")).expect("removed");
    let error = Results::load(folder.path()).expect_err("no results").to_string();
    assert!(error.contains("cloudparity study"), "{error}");
}

#[test]
fn work_of_another_build_is_refused_by_both_names_and_gone_on_with_knowingly() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2]");
    let output = folder.path().join("out");
    let study = Study::load(&path).expect("a study");
    let [ours, other] = ["aa", "bb"].map(|hash| Identity::of("0.1.0", hash));
    let by = |build: &Identity, mix_builds| Settings::of(Resume { build: build.clone(), mix_builds });
    let go_on = |path: &Path, settings: &Settings| run_as(path, &output, settings).and_then(Outcome::all);
    let first = go_on(&path, &by(&other, false)).expect("a new folder");
    assert_eq!(first.builds, std::slice::from_ref(&other));
    let before = records(&output);
    let refusals = [
        study.run(&output, &by(&ours, false), &|_, _| ()).err(),
        study.prepare(&output, &by(&ours, false), &|_, _| ()).err(),
        study.verify(&first, &output, &by(&ours, false), &|_, _| ()).err(),
    ];
    for error in refusals {
        let error = error.expect("refused");
        assert!(error.place.ends_with("study.json") && error.settings == ["mix_builds"], "{error}");
        assert!(error.found.contains("0.1.0+bb") && error.expected.contains("0.1.0+aa"), "{error}");
    }
    assert_eq!(records(&output), before, "nothing is made anew");
    // Knowingly: what is there stays, what is new is made, and both are named.
    let longer = study_file(folder.path(), "[2, 3]");
    let mixed = go_on(&longer, &by(&ours, true)).expect("it goes on");
    assert_eq!(mixed.builds, [ours.clone(), other.clone()]);
    assert_eq!((mixed.runs.len(), first.runs.len()), (8, 4));
    assert!(before.iter().all(|record| records(&output).contains(record)));
    // Neither has the folder to itself any more.
    assert!(go_on(&longer, &by(&other, false)).is_err() && go_on(&longer, &by(&ours, false)).is_err());
    // In a folder of its own, every key of the build is another.
    let own =
        run_as(&path, &folder.path().join("own"), &by(&ours, false)).and_then(Outcome::all).expect("a new folder");
    assert!(own.runs.iter().all(|run| first.runs.iter().all(|theirs| theirs.id != run.id)));
    assert_ne!(own.truths[0].id, first.truths[0].id);

    // The program: a forged mark is refused, and the option goes on.
    let command = |option: &[&str]| {
        let mut command = cargo_bin_cmd!("cloudparity");
        let found = command.arg("study").arg(&longer).arg("-o").arg(&output).args(option).output().expect("it runs");
        (found.status.code(), String::from_utf8(found.stderr).expect("text"))
    };
    let (code, said) = command(&[]);
    assert!(code == Some(2) && said.contains("0.1.0+bb"), "{said}");
    assert!(said.contains(&Identity::current().to_string()), "{said}");
    command(&["--mix-builds"]);
    let results = Results::load(&output).expect("results");
    assert!(results.builds.contains(&other), "{:?}", results.builds);
}

#[test]
fn a_density_without_an_engine_is_left_out_with_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2]");
    let text = std::fs::read_to_string(&path).expect("a study").replace("ramp.scene.json", "coloured.scene.json");
    std::fs::write(&path, text).expect("written");
    let scene = serde_json::to_string(&support::scene("noise-coloured")).expect("JSON");
    std::fs::write(folder.path().join("coloured.scene.json"), scene).expect("written");
    let results = run(&path, &folder.path().join("out"));
    assert_eq!((results.runs.len(), results.skipped.len()), (0, 4));
    assert!(results.skipped.iter().all(|skipped| skipped.reason.contains("emi")), "{:?}", results.skipped);
}

#[test]
fn the_commands_list_recommend_and_refuse() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = study_file(folder.path(), "[2, 32]");
    let output = folder.path().join("out");
    let said = |arguments: &[&str], code: i32| {
        let mut command = cargo_bin_cmd!("cloudparity");
        let found = command.args(arguments).assert().code(code).get_output().clone();
        String::from_utf8([found.stdout, found.stderr].concat()).expect("text")
    };
    let (file, out) = (path.to_str().expect("a name"), output.to_str().expect("a name"));
    assert!(said(&["study", file, "-o", out, "--list"], 0).contains("8 runs, 0 left out"));
    assert!(!output.exists(), "a list runs nothing");
    run(&path, &output);
    let found = said(&["recommend", out, "--max-ms", "1e9"], 0);
    assert!(found.contains("graph in linear-ramp") && found.contains("relMSE"), "{found}");
    assert!(said(&["recommend", out, "--max-ms", "1e-9"], 2).contains("the fastest run"));
    assert!(said(&["recommend", out, "--max-relmse=1e-30"], 2).contains("the closest run"));
    assert!(said(&["recommend", out], 2).contains("--max-ms"));
    assert!(said(&["recommend", out, "--max-ms", "1", "--scene", "moon"], 2).contains("graph in linear-ramp"));
    assert!(said(&["study", "none.study.toml", "-o", out], 2).contains("none.study.toml"));
    // The folder of a study is one that a report is made of.
    let page = said(&["report", out], 0);
    let page = std::fs::read_to_string(page.trim()).expect("a page");
    assert!(page.contains("<h1>a ramp</h1>") && page.contains("id=\"study\""), "{page}");
    assert!(!page.contains("id=\"left-out\""), "a study lacks nothing that it was to hold");
}

/// Pairs of the window are settings as a study's runs are: of one view they are compared, of another they are another subject.
#[test]
fn recorded_pairs_are_recommended() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = support::scene("linear-ramp");
    let study = study_file(folder.path(), "[1]");
    let wanted = Study::load(&study).expect("a study").wanted;
    let exact = |value| Uncertain { value, standard_error: 0.01 * value };
    let write = |number: u32, subject: &str, steps: u32, relmse: f64, milliseconds: f64| {
        let pair = folder.path().join(format!("pair-00{number}"));
        std::fs::create_dir_all(&pair).expect("a folder");
        let combination = Combination { density: format!("graph march_steps={steps}"), steps, ..wanted[0].clone() };
        let preset = Preset::of_combination(&combination, "seen".into(), Vec::new(), serde_json::Value::Null);
        let record = Recorded {
            format: settings::FORMAT.into(),
            build: Identity::current().clone(),
            scene: "linear-ramp".into(),
            subject: Recorded::subject_of(&scene, subject),
            resolution: [32, 18],
            preset: preset.expect("a preset"),
            errors: Errors { relmse: exact(relmse), rms: exact(relmse), bias: exact(relmse) },
            flip: None,
            milliseconds,
            backend: Backend::Gpu,
            worker: "an adapter".into(),
        };
        record.write(&pair).expect("written");
    };
    write(1, "here", 16, 0.1, 10.0);
    write(2, "here", 64, 0.01, 40.0);
    write(3, "here", 32, 0.2, 20.0);
    write(4, "there", 16, 0.3, 10.0);
    let said = |arguments: &[&str], code: i32| {
        let mut command = cargo_bin_cmd!("cloudparity");
        let found =
            command.arg("recommend").arg(folder.path()).args(arguments).assert().code(code).get_output().clone();
        String::from_utf8([found.stdout, found.stderr].concat()).expect("text")
    };
    let found = said(&["--max-ms", "25"], 0);
    assert!(found.contains("graph in linear-ramp: ") && found.contains("pair-001"), "{found}");
    assert!(found.contains("graph in linear-ramp, view 2: ") && found.contains("pair-004"), "{found}");
    assert!(found.contains("time on the wall, on an adapter") && found.contains("--backend gpu"), "{found}");
    let path = folder.path().join("best.preset.json");
    let file = path.to_str().expect("a name");
    let found = said(&["--max-relmse=0.05", "--scene", "linear-ramp", "-o", file], 0);
    assert!(found.contains("pair-002") && found.contains("64 steps"), "{found}");
    assert_eq!(Preset::load(&path).expect("a preset").engine.steps, 64);
    let wrong = folder.path().join("pair-001/record.json");
    let text = std::fs::read_to_string(&wrong).expect("a record").replace(settings::FORMAT, "cloudparity-record/9");
    std::fs::write(&wrong, text).expect("written");
    let found = said(&["--max-ms", "25"], 2);
    assert!(found.contains("record.json") && found.contains("cloudparity-record/9"), "{found}");
}

#[test]
fn committed_studies_are_read() {
    let folder = support::project("parity/studies");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.to_string_lossy().ends_with(".tune.toml") {
            Tuning::load(&path).expect("a tuning and its scenes");
            continue;
        }
        if path.to_string_lossy().ends_with(".sequence.toml") {
            let sequence = SequenceFile::load(&path).expect("a sequence");
            sequence.scene(path.parent().expect("a folder")).expect("its scene");
            continue;
        }
        if path.to_string_lossy().ends_with(".attribution.toml") {
            let attribution = AttributionFile::load(&path).expect("an attribution");
            attribution.load_scenes(path.parent().expect("a folder"), "test").expect("its scenes");
            continue;
        }
        StudyFile::load(&path).expect("a study");
        let study = Study::load(&path).expect("its scenes");
        assert!(!study.wanted.is_empty());
        count += 1;
    }
    assert!(count > 0);
}
