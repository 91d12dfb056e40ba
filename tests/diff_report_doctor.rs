//! The commands around the pictures, as a caller sees them: exit status, stdout, files.

mod support;

use assert_cmd::Command;
use predicates::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use support::require;

fn program() -> Command {
    assert_cmd::cargo::cargo_bin_cmd!("cloudparity")
}

/// A lit disc of `size` x `size` pixels whose red is multiplied by `red`.
fn save_picture(folder: &Path, name: &str, size: usize, red: f32) -> PathBuf {
    let path = folder.join(name);
    let centre = size as f32 / 2.0;
    exr::prelude::write_rgba_file(&path, size, size, |x, y| {
        let value = (1.0 - (x as f32 - centre).hypot(y as f32 - centre) / centre).max(0.0);
        (value * red, value * 0.75, value * 0.5, value)
    })
    .expect("a writable folder");
    path
}

#[test]
fn diff_tells_agreement_difference_and_doubt_by_its_exit_status() {
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let reference = save_picture(folder.path(), "reference.exr", 32, 1.0);
    let same = save_picture(folder.path(), "same.exr", 32, 1.0);
    // 3 % more red than a tolerance of 1 % allows.
    let planted = save_picture(folder.path(), "planted.exr", 32, 1.03);
    let other_size = save_picture(folder.path(), "other.exr", 24, 1.0);
    let diff = |ours: &Path| {
        let mut command = program();
        command.arg("diff").arg("--ours").arg(ours).arg("--reference").arg(&reference);
        command
    };
    diff(&same).args(["--channel-mean", "0.01"]).assert().code(0).stdout(predicate::str::starts_with("agrees\n"));
    diff(&planted)
        .args(["--channel-mean", "0.01"])
        .assert()
        .code(1)
        .stdout(predicate::str::starts_with("differs\n").and(predicate::str::contains("Channel R")));
    diff(&planted).args(["--channel-mean", "0.05"]).assert().code(0);
    diff(&other_size).args(["--channel-mean", "0.01"]).assert().code(2);
    diff(&same).assert().code(2).stdout(predicate::str::contains("No tolerance was given"));
}

#[test]
fn diff_writes_a_directory_that_report_makes_a_page_of() {
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let ours = save_picture(folder.path(), "ours.exr", 32, 1.03);
    let reference = save_picture(folder.path(), "reference.exr", 32, 1.0);
    let run = folder.path().join("run");
    let assert = program()
        .args(["diff", "--json", "--channel-mean", "0.01", "--view", "AgX", "--ours"])
        .arg(&ours)
        .arg("--reference")
        .arg(&reference)
        .arg("--output")
        .arg(&run)
        .assert()
        .code(1);
    let printed: Value = serde_json::from_slice(&assert.get_output().stdout).expect("stdout holds JSON alone");
    let written = std::fs::read_to_string(run.join("diff.json")).expect("diff.json is written");
    assert_eq!(printed["verdict"], "differs");
    assert_eq!(printed, serde_json::from_str::<Value>(&written).expect("diff.json is JSON"));
    for name in ["ours.png", "reference.png", "difference.png", "flip.png"] {
        assert!(run.join(name).is_file(), "{name}");
    }
    program().arg("report").arg(&run).assert().code(0).stdout(predicate::str::ends_with("index.html\n"));
    let page = std::fs::read_to_string(run.join("index.html")).expect("the page is written");
    assert!(page.contains("verdict differs"));
}

#[test]
fn replicas_are_judged_by_statistics_and_the_report_shows_bias_and_noise() {
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    // Replicas whose red scatters by 0.5 % as a whole, in steps that cancel over the eight.
    let side = |name: &str, red: f32| -> Vec<PathBuf> {
        let step = |k: u8| red * (1.0 + 0.005 * (f32::from(k) - 3.5) / 3.5);
        (0..8).map(|k| save_picture(folder.path(), &format!("{name}{k}.exr"), 16, step(k))).collect()
    };
    let (ours, planted, reference) = (side("o", 1.0001), side("p", 1.03), side("r", 1.0));
    let run = folder.path().join("run");
    let diff = |ours: &[PathBuf], more: &[&str]| {
        let mut command = program();
        command.arg("diff").arg("--ours").args(ours).arg("--reference").args(&reference).args(more);
        command.assert()
    };
    // Files without provenance say neither renderer nor samples, so the allowance must be chosen.
    diff(&ours, &[]).code(2).stdout(predicate::str::contains("--systematic-allowance 0"));
    diff(&ours, &["--systematic-allowance", "0"]).code(0).stdout(predicate::str::contains("means: R +0.01"));
    diff(&ours, &["--systematic-allowance", "0", "--verbose"])
        .code(0)
        .stdout(predicate::str::contains("bias of R: +0.01").and(predicate::str::contains("kurtosis of")));
    diff(&planted, &["--systematic-allowance", "0.05"]).code(0);
    let out = run.to_str().expect("a UTF-8 path");
    diff(&planted, &["--systematic-allowance", "0", "--verbose", "--output", out])
        .code(1)
        .stdout(predicate::str::starts_with("differs\n").and(predicate::str::contains("image_mean")));
    diff(&ours[..1], &["--statistics", "on"]).code(2).stdout(predicate::str::contains("is one file"));
    program().arg("report").arg(&run).assert().code(0);
    let page = std::fs::read_to_string(run.join("index.html")).expect("the page is written");
    assert!(page.contains("Bias and noise") && page.contains("alt=\"t of the luminance"));
    assert!(std::fs::read_to_string(run.join("report.md")).expect("written").contains("## Bias and noise"));
}

#[test]
fn report_of_no_directory_could_not_do_its_work() {
    let folder = tempfile::tempdir().expect("a folder");
    program()
        .arg("report")
        .arg(folder.path().join("none"))
        .assert()
        .code(2)
        .stderr(predicate::str::contains("no directory"));
}

#[test]
fn doctor_says_what_is_missing_and_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let assert = program()
        .args(["doctor", "--json"])
        .env("CLOUDPARITY_PYTHON", folder.path().join("no-python"))
        .env("WGPU_ADAPTER_NAME", "no adapter has this name")
        .env("CLOUDPARITY_CACHE", "/dev/null/cache")
        .assert()
        .code(1);
    let document: Value = serde_json::from_slice(&assert.get_output().stdout).expect("stdout holds JSON alone");
    assert_eq!(document["all_there"], false);
    let checks = document["checks"].as_array().expect("a list of checks");
    for what in
        ["graphics adapter", "Python", "bpy", "OpenImageIO", "numpy", "flip-evaluator", "opencolorio", "scipy", "cache"]
    {
        let check = checks.iter().find(|check| check["what"] == what).expect(what);
        assert!(check["found"].is_null() && check["problem"]["remedy"].as_str().is_some_and(|text| text.len() > 10));
    }
}

#[test]
fn doctor_finds_what_is_there() {
    if !require("bpy") || !require("vulkan") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    program()
        .arg("doctor")
        .env("CLOUDPARITY_CACHE", folder.path())
        .assert()
        .code(0)
        .stdout(predicate::str::contains("missing").not());
}

/// A run with figures of every size, names that LaTeX would obey, and a table that runs over pages.
fn write_run(folder: &Path) {
    let write = |name: &str, value: Value| {
        std::fs::write(folder.join(name), value.to_string()).expect("a writable folder");
    };
    let evaluator = |error: f64| serde_json::json!({"points": 65536, "differing": 932, "max_error": error, "p999_error": error / 9.0, "rms_error": 0.0, "seconds": 0.047});
    write(
        "probe.json",
        serde_json::json!([{"scene": "cloud", "points": 65536, "domain": "box", "seed": 1, "evaluators": {"cpu": evaluator(5.06e-7), "gpu": evaluator(0.612)}}]),
    );
    let row = |number: usize| serde_json::json!({"id": format!("transmittance-at-the-edge-{number}/wgsl"), "varied": "optical depth 0 and 1e-6 to 1e6 of a step, 16 octaves", "values": 70000, "nonfinite": 0, "max_error": 1e-7 * number as f64, "limit": 1.19e-6, "share_of_bound": 0.25, "verdict": "pass"});
    let left_out: Vec<Value> = (0..60).map(|number| serde_json::json!({"what": format!("what {number}"), "why": row(number)["varied"], "remedy": "cloudparity bench SCENE --json > RUN/bench.json"})).collect();
    write(
        "run.json",
        serde_json::json!({"title": "50 % of $x_1$ & more", "scene": "cloud_{1}#~^\\", "adapter": {"name": "llvmpipe"}, "left_out": left_out}),
    );
}

#[test]
fn tables_of_a_report_compile_in_a_paper_of_two_columns_without_running_over() {
    if !require("pdflatex") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    write_run(folder.path());
    cloudparity::report::write_report(folder.path(), &[]).expect("a report");
    let paper = "\\documentclass[twocolumn]{article}\n\\usepackage[T1]{fontenc}\n\\usepackage[utf8]{inputenc}\n\\usepackage{lmodern}\n\
                 \\usepackage[letterpaper,textwidth=7in,textheight=9in,columnsep=0.33in]{geometry}\n\
                 \\usepackage{booktabs,tabularx,longtable,siunitx,graphicx}\n\\begin{document}\nText.\n\\input{tables}\n\\input{figures}\n\
                 \\clearpage\\onecolumn\n\\input{tables-long}\n\\end{document}\n";
    std::fs::write(folder.path().join("paper.tex"), paper).expect("a writable folder");
    let run = || {
        std::process::Command::new("pdflatex")
            .args(["-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "paper.tex"])
            .current_dir(folder.path())
            .output()
            .expect("pdflatex runs")
    };
    // The widths of columns are right in the second run.
    let [first, second] = [run(), run()];
    let log = String::from_utf8_lossy(&second.stdout).into_owned();
    assert!(first.status.success() && second.status.success(), "{log}");
    assert!(!log.contains("Overfull \\hbox"), "{log}");
    let tables = std::fs::read_to_string(folder.path().join("tables.tex")).expect("tables");
    assert!(tables.contains("\\begin{tabular}") && tables.contains("\\begin{tabularx}"), "{tables}");
    assert!(std::fs::read_to_string(folder.path().join("tables-long.tex")).expect("tables").contains("\\endfirsthead"));
    let fonts =
        std::process::Command::new("pdffonts").arg(folder.path().join("paper.pdf")).output().expect("pdffonts runs");
    let fonts = String::from_utf8_lossy(&fonts.stdout).into_owned();
    assert!(fonts.contains("Type 1") && !fonts.contains("Type 3"), "{fonts}");
}

#[test]
fn report_checks_a_certificate_and_says_so_by_its_exit_status() {
    let folder = tempfile::tempdir().expect("a folder");
    write_run(folder.path());
    program().arg("report").arg(folder.path()).assert().code(0);
    let certificate = folder.path().join("certificate.json");
    let check = || {
        let mut command = program();
        command.arg("report").arg("--check").arg(&certificate);
        command.assert()
    };
    check().code(0).stdout(predicate::str::starts_with("the same: compared "));
    let page = folder.path().join("index.html");
    let text = std::fs::read(&page).expect("a page");
    std::fs::write(&page, [&text[..], b"<!-- -->"].concat()).expect("a writable folder");
    check().code(1).stdout(predicate::str::contains("differs: index.html: SHA-256"));
    std::fs::write(&page, &text).expect("a writable folder");
    check().code(0);
    std::fs::remove_file(&page).expect("a page");
    check().code(1);
    std::fs::write(&page, &text).expect("a writable folder");
    std::fs::write(&certificate, "{}").expect("a writable folder");
    check().code(2).stderr(predicate::str::contains("certificate.json"));
}

/// The disc of `save_picture` as Blender's layer, cropped to `columns` of it.
fn save_layer(folder: &Path, name: &str, size: usize, columns: std::ops::Range<usize>) -> PathBuf {
    use exr::prelude::{
        Encoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes, SpecificChannels, Vec2,
    };
    use exr::prelude::{WritableImage, f16};
    let path = folder.join(name);
    let (centre, left) = (size as f32 / 2.0, columns.start);
    let channels = SpecificChannels::build()
        .with_channel::<f32>("ViewLayer.Combined.R")
        .with_channel::<f32>("ViewLayer.Combined.G")
        .with_channel::<f32>("ViewLayer.Combined.B")
        .with_channel::<f32>("ViewLayer.Combined.A")
        .with_channel::<f16>("ViewLayer.Depth.Z")
        .with_pixel_fn(move |at: Vec2<usize>| {
            let (x, y) = ((at.x() + left) as f32, at.y() as f32);
            let value = (1.0 - (x - centre).hypot(y - centre) / centre).max(0.0);
            (value, value * 0.75, value * 0.5, value, f16::from_f32(1.0))
        });
    let window = IntegerBounds::new(Vec2(0, 0), Vec2(size, size));
    let attributes =
        LayerAttributes { layer_position: Vec2(i32::try_from(left).expect("small"), 0), ..LayerAttributes::default() };
    let layer = Layer::new((columns.len(), size), attributes, Encoding::FAST_LOSSLESS, channels);
    let image = Image { attributes: ImageAttributes::new(window), layer_data: layer };
    image.write().to_file(&path).expect("a writable folder");
    path
}

#[test]
fn a_truth_is_read_in_the_forms_that_diff_reads() {
    use cloudparity::measure::images;
    use cloudparity::scene::image::Image;
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let plain = save_picture(folder.path(), "plain.exr", 32, 1.0);
    let layer = save_layer(folder.path(), "layer.exr", 32, 0..32);
    let cropped = save_layer(folder.path(), "cropped.exr", 32, 4..32);
    let expected = Image::read_exr(&plain).expect("a plain file");
    let read = |paths: &[&PathBuf], part| {
        let paths: Vec<PathBuf> = paths.iter().map(|path| (*path).clone()).collect();
        images::read(&paths, part, "--truth-part")
    };
    let found = read(&[&plain, &layer, &cropped], None).expect("they are read");
    assert_eq!(found[0], expected);
    assert_eq!(found[1].pixels, expected.pixels);
    for (index, pixel) in found[2].pixels.iter().enumerate() {
        let wanted = if index % 32 < 4 { [0.0; 4] } else { expected.pixels[index] };
        assert_eq!(*pixel, wanted, "{index}");
    }
    assert_eq!(read(&[&layer], Some("Combined")).expect("by name")[0].pixels, expected.pixels);
    let error = read(&[&layer], Some("Mist")).expect_err("no such layer").to_string();
    assert!(error.contains("--truth-part") && error.contains("ViewLayer.Depth"), "{error}");
    assert!(read(&[&layer], Some("Depth")).expect_err("no colours").to_string().contains("no colours"));
    // What reads plain files alone does not take a part of the picture for the whole.
    let error = Image::read_exr(&cropped).expect_err("a crop").to_string();
    assert!(error.contains("28 x 32 at 4, 0 of the 32 x 32"), "{error}");
}

#[test]
fn diff_takes_a_part_for_each_side_and_asks_what_integers_mean() {
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let plain = save_picture(folder.path(), "plain.exr", 32, 1.0);
    let layer = save_layer(folder.path(), "layer.exr", 32, 0..32);
    let diff = |ours: &Path, reference: &Path, more: &[&str]| {
        let mut command = program();
        command.arg("diff").arg("--ours").arg(ours).arg("--reference").arg(reference).args(["--max-error", "0"]);
        command.args(more).assert()
    };
    let read = "'ViewLayer.Combined' is read, 1 of 2 in the file";
    diff(&plain, &layer, &[]).code(0).stdout(predicate::str::contains(read));
    diff(&layer, &plain, &["--ours-part", "Combined"]).code(0);
    diff(&plain, &layer, &["--reference-part", "ViewLayer.Depth"])
        .code(2)
        .stdout(predicate::str::contains("channels Z"));
    diff(&plain, &layer, &["--part", "Mist"]).code(2).stdout(predicate::str::contains("--ours-part NAME"));
    let png = folder.path().join("plain.png");
    program().arg("export").arg(&plain).args(["--view", "Standard", "-o"]).arg(&png).assert().code(0);
    diff(&png, &plain, &[]).code(2).stdout(predicate::str::contains("--integers srgb"));
    // Half a step of 8 bits by the curve's slope, and as much of alpha.
    program()
        .args(["diff", "--integers", "srgb", "--max-error", "0.0065", "--ours"])
        .arg(&png)
        .arg("--reference")
        .arg(&plain)
        .assert()
        .code(0)
        .stdout(predicate::str::contains("decoded by the sRGB curve"));
    diff(&png, &png, &["--integers", "display"]).code(0).stdout(predicate::str::contains("no figure is of radiance"));
}
