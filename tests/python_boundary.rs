//! The Python boundary against others on the machine, damaged files, and the end of the program; and names of users in what is written.
#![cfg(unix)]

mod support;

use cloudparity::scene::Scene;
use rand::{Rng as _, SeedableRng as _};
use rayon::prelude::*;
use serde_json::{Value as Json, json};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn write(path: &Path, text: impl AsRef<[u8]>) {
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a temporary folder");
    std::fs::write(path, text).expect("a temporary file");
}

fn write_program(path: &Path, text: &str) {
    write(path, text);
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).expect("a mode");
}

/// The program in a folder.
fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cloudparity"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null());
    command
}

fn output(command: &mut Command) -> Output {
    command.output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

// --- what Python finds -------------------------------------------------------------------------

/// Python code that leaves a mark.
fn marking(mark: &Path) -> String {
    format!("open({:?}, 'w').close()\n", mark.display().to_string())
}

#[test]
fn no_module_comes_from_the_surroundings() {
    let folder = folder();
    let mark = folder.path().join("mark");
    let planted = folder.path().join("planted");
    // Names that the scripts or Python itself import, some at once, some late.
    for name in ["protocol", "json", "numpy", "bpy", "platform", "sitecustomize", "usercustomize", "OpenImageIO"] {
        write(&planted.join(format!("{name}.py")), marking(&mark));
    }
    write(&planted.join("start-up.py"), marking(&mark));
    let temporary = folder.path().join("temporary");
    std::fs::create_dir(&temporary).expect("a folder");
    let surrounded = |arguments: &[&str]| {
        let mut command = program(&planted, arguments);
        command.env("PYTHONPATH", &planted).env("PYTHONSTARTUP", planted.join("start-up.py"));
        command.env("PYTHONUSERBASE", &planted).env("BLENDER_USER_SCRIPTS", &planted).env("TMPDIR", &temporary);
        output(&mut command)
    };
    let doctor = surrounded(&["doctor", "--json"]);
    assert!(!mark.exists(), "doctor ran what lies around");
    let document: Json = serde_json::from_slice(&doctor.stdout).expect("JSON");
    let check = |what: &str| document["checks"].as_array().unwrap().iter().find(|check| check["what"] == what).cloned();
    assert!(check("Python").is_some_and(|check| check["found"].is_string()), "{document:#}");
    write(&planted.join("x.blend"), "no Blender file");
    let export = surrounded(&["export", "x.blend", "-o", "x.scene.json"]);
    assert_eq!(export.status.code(), Some(2));
    assert!(!mark.exists(), "a script ran what lies around: {}", text(&export.stderr));
    // Nothing is unpacked, where another user could be first.
    let left: Vec<String> = std::fs::read_dir(&temporary)
        .expect("the folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with("cloudparity"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
    // A home of Python that is none would keep it from starting.
    let mut command = program(folder.path(), &["doctor", "--json"]);
    let doctor = output(command.env("PYTHONHOME", &planted));
    let document: Json = serde_json::from_slice(&doctor.stdout).expect("JSON");
    assert_eq!(document["checks"][1]["what"], "Python");
    assert!(document["checks"][1]["found"].is_string(), "{:#}", document["checks"][1]);
}

#[test]
fn an_interpreter_that_lies_above_the_current_folder_is_not_run() {
    let folder = folder();
    let mark = folder.path().join("mark");
    write_program(
        &folder.path().join(".venv/bin/python"),
        &format!("#!/bin/sh\ntouch '{}'\nexec python3 \"$@\"\n", mark.display()),
    );
    let current = folder.path().join("a/b");
    std::fs::create_dir_all(&current).expect("a folder");
    let run = output(program(&current, &["doctor"]).env_remove("CLOUDPARITY_PYTHON"));
    assert!(!mark.exists(), "{}", text(&run.stdout));
    // Which one is run, and why, stands in its line.
    let stdout = text(&run.stdout);
    let line = stdout.lines().find(|line| line.starts_with("Python ")).expect("a line for Python");
    let project = support::project(".venv/bin/python");
    if project.exists() {
        assert!(line.contains(&project.display().to_string()), "{line}");
        assert!(line.contains("the program was built from"), "{line}");
    } else {
        assert!(stdout.contains("has no .venv"), "{stdout}");
    }
    let named = output(program(&current, &["doctor"]).env("CLOUDPARITY_PYTHON", "/nonexistent/python"));
    assert!(text(&named.stdout).contains("CLOUDPARITY_PYTHON names it"), "{}", text(&named.stdout));
}

// --- the end of the program --------------------------------------------------------------------

/// Processes below one, by number.
#[cfg(target_os = "linux")]
fn descendants(process: u32) -> Vec<u32> {
    let mut parents = Vec::new();
    for entry in std::fs::read_dir("/proc").expect("Linux has /proc").flatten() {
        let Some(number) = entry.file_name().to_str().and_then(|name| name.parse::<u32>().ok()) else { continue };
        let Ok(status) = std::fs::read_to_string(entry.path().join("stat")) else { continue };
        // The name in parentheses may hold anything.
        let Some((_, rest)) = status.rsplit_once(") ") else { continue };
        let parent = rest.split(' ').nth(1).and_then(|parent| parent.parse::<u32>().ok());
        parents.extend(parent.map(|parent| (number, parent)));
    }
    let mut found = vec![process];
    let mut next = 0;
    while next < found.len() {
        let children = parents.iter().filter(|(_, parent)| *parent == found[next]).map(|(child, _)| *child);
        found.extend(children.collect::<Vec<_>>());
        next += 1;
    }
    found.split_off(1)
}

/// Whether a process runs. One that ended and whose parent has not asked does not.
#[cfg(target_os = "linux")]
fn runs(process: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{process}/stat"))
        .is_ok_and(|status| status.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with(['Z', 'X'])))
}

/// Waits until something holds, and says whether it did in time.
fn comes(limit: Duration, mut holds: impl FnMut() -> bool) -> bool {
    let begin = Instant::now();
    while !holds() {
        if begin.elapsed() > limit {
            return false;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    true
}

/// Cycles at work for long, as a child of the program.
#[cfg(target_os = "linux")]
fn rendering(folder: &Path, interpreter: Option<&Path>) -> (Child, Vec<u32>) {
    let scene = support::project("parity/scenes/procedural-clouds.scene.json").display().to_string();
    let arguments = ["render", &scene, "-o", "x.exr", "--integrator", "cycles", "--samples", "4096"];
    let mut command = program(folder, &arguments);
    command.env("CLOUDPARITY_CACHE", folder.join("cache")).stdout(Stdio::null()).stderr(Stdio::null());
    interpreter.map(|path| command.env("CLOUDPARITY_PYTHON", path));
    let program = command.spawn().expect("the program starts");
    let mut children = Vec::new();
    // The version of Blender is asked first; what then lives for seconds is the render.
    let mut since = Instant::now();
    assert!(
        comes(Duration::from_secs(120), || {
            let found = descendants(program.id());
            if found.is_empty() || found != children {
                (children, since) = (found, Instant::now());
            }
            since.elapsed() > Duration::from_secs(6)
        }),
        "nothing renders"
    );
    (program, children)
}

#[test]
#[cfg(target_os = "linux")]
fn a_program_that_is_stopped_takes_its_interpreter_along() {
    if !support::require("bpy") {
        return;
    }
    let folder = folder();
    // An interpreter of its own behind a script: the process that the program started is the shell.
    let wrapped = folder.path().join("wrapped");
    let python = cloudparity::bridge::interpreter();
    write_program(&wrapped, &format!("#!/bin/sh\n'{}' \"$@\"\nexit $?\n", python.display()));
    for (signal, interpreter) in [("KILL", None), ("INT", None), ("TERM", None), ("KILL", Some(wrapped.as_path()))] {
        let (mut program, children) = rendering(folder.path(), interpreter);
        assert!(children.iter().all(|child| runs(*child)), "{signal}: {children:?}");
        let sent = Command::new("kill").args([&format!("-{signal}"), &program.id().to_string()]).status();
        assert!(sent.is_ok_and(|status| status.success()), "{signal}");
        program.wait().expect("it ends");
        let is_over = comes(Duration::from_secs(5), || !children.iter().any(|child| runs(*child)));
        for child in children.iter().filter(|child| runs(**child)) {
            let _ = Command::new("kill").args(["-KILL", &child.to_string()]).status();
        }
        assert!(is_over, "{signal}, {interpreter:?}: an interpreter goes on");
    }
}

// --- damaged files -----------------------------------------------------------------------------

/// Asserts that a run ended with an error of place, found, expected and remedy, and no account of Python's.
#[track_caller]
fn is_refused(what: &str, run: &Output, place: &str) {
    let (stdout, stderr) = (text(&run.stdout), text(&run.stderr));
    assert_eq!(run.status.code(), Some(2), "{what}: {stdout}{stderr}");
    assert!(!stderr.contains("Traceback") && !stderr.contains("panicked"), "{what}: {stderr}");
    let message = stderr.find("error: ").map_or("", |start| stderr[start..].trim_end());
    let parts = message
        .split_once(": found ")
        .and_then(|(place, rest)| Some((place, rest.split_once("; expected ")?)))
        .and_then(|(place, (found, rest))| Some((place, found, rest.split_once(". ")?)));
    let Some((found_place, found, (expected, remedy))) = parts else { panic!("{what}: {stderr}") };
    assert!(found_place.contains(place), "{what}: {place} is not the place of {message}");
    assert!(![found, expected, remedy].iter().any(|part| part.trim().is_empty()), "{what}: {message}");
}

/// A damaged copy: cut, with bits flipped, or with a range of zeros or of other bytes.
fn damaged(whole: &[u8], number: u64) -> (String, Vec<u8>) {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(number);
    let mut bytes = whole.to_vec();
    // Half of the damage is in the head, where the sizes of everything stand.
    let reach = if number % 8 < 4 { 2_000.min(bytes.len()) } else { bytes.len() };
    let place = random.random_range(0..reach);
    let what = match number % 4 {
        0 => {
            bytes.truncate(place);
            format!("cut at {place}")
        }
        1 => {
            let count = random.random_range(1..40);
            (0..count).for_each(|_| bytes[random.random_range(0..reach)] ^= 1 << random.random_range(0..8));
            format!("{count} bits flipped below {reach}")
        }
        kind => {
            let end = (place + random.random_range(1..400)).min(bytes.len());
            bytes[place..end].iter_mut().for_each(|byte| *byte = if kind == 2 { 0 } else { random.random() });
            format!("bytes {place} to {end} {}", if kind == 2 { "zero" } else { "random" })
        }
    };
    (format!("{number}: {what}"), bytes)
}

#[test]
fn damaged_grids_end_in_time_with_an_error() {
    if !support::require("bpy") {
        return;
    }
    const FILES: u64 = 60;
    // A whole grid is read in 2; what is cut off later is refused all the same.
    const SECONDS: u64 = 8;
    let folder = folder();
    let whole = std::fs::read(support::project("parity/scenes/perlin-fbm.vdb")).expect("the committed grid");
    let found: Vec<(bool, String, Duration)> = (0..FILES)
        .into_par_iter()
        .map(|number| {
            let (what, bytes) = damaged(&whole, number);
            let name = format!("{number}.vdb");
            write(&folder.path().join(&name), bytes);
            let begin = Instant::now();
            let mut command = program(folder.path(), &["grid", &name, "-o", &format!("{number}.npy")]);
            let run = output(command.env("CLOUDPARITY_READ_SECONDS", SECONDS.to_string()));
            let time = begin.elapsed();
            assert!(time < Duration::from_secs(SECONDS + 30), "{what}: {time:?}");
            // Some damage makes other numbers of a voxel, which are as good as the first.
            let is_read = run.status.success();
            if !is_read {
                is_refused(&what, &run, &name);
            }
            (is_read, format!("{what}: {:.1} s: {}", time.as_secs_f64(), text(&run.stderr).trim()), time)
        })
        .collect();
    let read = found.iter().filter(|(is_read, ..)| *is_read).count();
    let late = found.iter().filter(|(_, line, _)| line.contains("is not read after")).count();
    found.iter().for_each(|(_, line, _)| println!("{line}"));
    println!("{FILES} files: {read} read, {late} over the time");
    assert!(read < FILES as usize / 2, "{read} are read");
}

#[test]
fn files_of_another_kind_are_refused() {
    if !support::require("bpy") {
        return;
    }
    let folder = folder();
    let scene = support::project("parity/scenes/linear-ramp.scene.json").display().to_string();
    let built = output(&mut program(folder.path(), &["export", &scene, "-o", "whole.blend"]));
    assert!(built.status.success(), "{}", text(&built.stderr));
    let blend = std::fs::read(folder.path().join("whole.blend")).expect("a file");
    let exr = std::fs::read(support::project("parity/scenes/environment-image.exr")).expect("the committed picture");
    let vdb = std::fs::read(support::project("parity/scenes/perlin-fbm.vdb")).expect("the committed grid");
    for (ending, whole) in [("blend", &blend), ("exr", &exr), ("vdb", &vdb)] {
        write(&folder.path().join(format!("cut.{ending}")), &whole[..whole.len() / 2]);
        write(&folder.path().join(format!("text.{ending}")), "this is text\n");
        write(&folder.path().join(format!("empty.{ending}")), "");
        std::fs::create_dir(folder.path().join(format!("folder.{ending}"))).expect("a folder");
    }
    for stem in ["cut", "text", "empty", "folder", "missing"] {
        let [blend, exr, vdb] = ["blend", "exr", "vdb"].map(|ending| format!("{stem}.{ending}"));
        let run = |arguments: &[&str]| {
            let begin = Instant::now();
            let run = output(program(folder.path(), arguments).env("CLOUDPARITY_READ_SECONDS", "40"));
            assert!(begin.elapsed() < Duration::from_secs(70), "{arguments:?}");
            run
        };
        is_refused(&blend, &run(&["export", &blend, "-o", "x.scene.json"]), &blend);
        is_refused(&vdb, &run(&["grid", &vdb, "-o", "x.npy"]), &vdb);
        is_refused(&exr, &run(&["export", &exr, "-o", "x.png"]), &exr);
        // A comparison that cannot be made is a verdict, with the reason on stdout.
        let diff = run(&["diff", "--ours", &exr, "--reference", &exr]);
        assert_eq!(diff.status.code(), Some(2), "{exr}");
        let said = text(&diff.stdout) + &text(&diff.stderr);
        assert!(said.contains(&exr) && !said.contains("Traceback"), "{said}");
    }
    for name in ["x.scene.json", "x.npy", "x.png"] {
        assert!(!folder.path().join(name).exists(), "{name}");
    }
}

#[test]
fn limits_are_the_users_to_change() {
    if !support::require("bpy") {
        return;
    }
    let folder = folder();
    let grid = support::project("parity/scenes/perlin-fbm.vdb").display().to_string();
    let read =
        |name: &str, value: &str| output(program(folder.path(), &["grid", &grid, "-o", "x.npy"]).env(name, value));
    let late = read("CLOUDPARITY_READ_SECONDS", "0.01");
    is_refused("time", &late, "perlin-fbm.vdb");
    assert!(text(&late.stderr).contains("CLOUDPARITY_READ_SECONDS"), "{}", text(&late.stderr));
    let large = read("CLOUDPARITY_READ_GIB", "0.05");
    assert_eq!(large.status.code(), Some(2), "{}", text(&large.stderr));
    assert!(!text(&large.stderr).contains("Traceback"), "{}", text(&large.stderr));
    // A library that breaks down takes the interpreter along: the signal is named.
    let breaking = folder.path().join("breaking");
    write_program(&breaking, "#!/bin/sh\nkill -SEGV $$\n");
    let crash = read("CLOUDPARITY_PYTHON", &breaking.display().to_string());
    is_refused("crash", &crash, "perlin-fbm.vdb");
    assert!(text(&crash.stderr).contains("signal 11, SIGSEGV"), "{}", text(&crash.stderr));
    for wrong in ["-1", "many", "nan", ""] {
        is_refused(wrong, &read("CLOUDPARITY_READ_SECONDS", wrong), "CLOUDPARITY_READ_SECONDS");
    }
    assert!(!folder.path().join("x.npy").exists());
    let whole = read("CLOUDPARITY_READ_SECONDS", "100");
    assert!(whole.status.success(), "{}", text(&whole.stderr));
}

// --- names -------------------------------------------------------------------------------------

/// Names that are more than text to HTML, to spreadsheets, to LaTeX, to Markdown, to shaders.
const EVIL: [&str; 5] = [
    "=1+1<script>alert('x')</script>",
    "+cmd|' /C calc'!A0 \"&amp;\" `code`",
    "@x\nfn broken() { let y = ; }\r\n// \u{2028}*/ #import x::y",
    "[1cm] \\input{x} $\\frac$ %_^~# {a} & b",
    "-a, b\u{1b}[31m | c **d** </pre><img src=x onerror=alert(1)> [e](javascript:f)",
];

/// The cells of a CSV file by row.
fn cells(text: &str) -> Vec<Vec<String>> {
    let (mut rows, mut row, mut cell, mut is_quoted) = (Vec::new(), Vec::new(), String::new(), false);
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => cell.extend(letters.next()),
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => row.push(std::mem::take(&mut cell)),
            '\n' if !is_quoted => {
                row.push(std::mem::take(&mut cell));
                rows.push(std::mem::take(&mut row));
            }
            other => cell.push(other),
        }
    }
    assert!(!is_quoted && cell.is_empty() && row.is_empty(), "the file is cut: {text}");
    rows
}

/// A table: rows of as many cells as columns, and no cell that a spreadsheet would compute.
fn is_table(name: &str, text: &str) -> Vec<Vec<String>> {
    let rows = cells(text);
    for row in &rows {
        assert_eq!(row.len(), rows[0].len(), "{name}: {row:?}");
        for cell in row {
            let is_formula = cell.starts_with(['=', '+', '-', '@', '\t', '\r']) && cell.parse::<f64>().is_err();
            assert!(!is_formula, "{name}: {cell}");
        }
    }
    rows
}

/// How often a character stands in a line without a backslash before it.
fn bare(line: &str, wanted: char) -> usize {
    let mut is_escaped = false;
    let mut count = 0;
    for letter in line.chars() {
        count += usize::from(letter == wanted && !is_escaped);
        is_escaped = letter == '\\' && !is_escaped;
    }
    count
}

/// A scene whose every name is one of [`EVIL`].
fn evil_scene() -> Json {
    let [scene, sun, object, first, second] = EVIL;
    let link = |node: &str, socket: &str| json!({"node": node, "socket": socket});
    let mut document = serde_json::to_value(support::scene("linear-ramp")).expect("JSON");
    document["name"] = scene.into();
    document["lights"][0]["name"] = sun.into();
    document["volume"]["object"] = object.into();
    document["volume"]["material"] = first.into();
    document["integrator"]["volume_bounces"] = 0.into();
    document["graph"] = json!({"material": first, "groups": [], "nodes": [
        {"name": "Material Output", "type": "ShaderNodeOutputMaterial",
         "inputs": {"Volume": link("Principled Volume", "Volume")}},
        {"name": "Principled Volume", "type": "ShaderNodeVolumePrincipled", "inputs": {"Density": link(object, "Value")}},
        {"name": object, "type": "ShaderNodeMath", "properties": {"operation": "ADD"},
         "inputs": {"Value": link(second, "Fac"), "Value_001": link(first, "Value")}},
        {"name": first, "type": "ShaderNodeMath", "properties": {"operation": "SINE"},
         "inputs": {"Value": link(second, "Fac")}},
        {"name": second, "type": "ShaderNodeTexNoise"},
        {"name": scene, "type": "ShaderNodeMath", "properties": {"operation": "ADD"}},
    ]});
    document
}

#[test]
fn names_stay_text_in_every_output() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let read = |name: &str| std::fs::read_to_string(path(name)).unwrap_or_else(|cause| panic!("{name}: {cause}"));
    let run = |arguments: &[&str]| {
        let run = output(&mut program(folder.path(), arguments));
        assert!(run.status.success(), "{arguments:?}: {}", text(&run.stderr));
        text(&run.stdout)
    };
    let scene = evil_scene();
    write(&path("x.scene.json"), scene.to_string());
    Scene::load(&path("x.scene.json")).expect("a scene");

    // Shaders: only what the graph makes is code.
    run(&["shader", "x.scene.json", "-o", "x.wgsl"]);
    let module = naga::front::wgsl::parse_str(&read("x.wgsl")).expect("WGSL");
    naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
        .validate(&module)
        .expect("valid WGSL");
    assert!(!read("x.wgsl").contains("broken") && !read("x.wgsl").contains("alert"));

    // Explained: a line per node.
    let explained = run(&["explain", "x.scene.json"]);
    let [evaluated, left_out] = ["Evaluated, in order (", "Left out ("].map(|head| {
        let (_, rest) = explained.split_once(head).unwrap_or_else(|| panic!("{explained}"));
        rest.split(|letter: char| !letter.is_ascii_digit())
            .next()
            .and_then(|count| count.parse::<usize>().ok())
            .expect("a count")
    });
    // Two heads, and a line for the output.
    assert_eq!(explained.lines().count(), 2 + evaluated + left_out + 1, "{explained}");
    assert!(!explained.contains(|letter: char| letter.is_control() && letter != '\n'), "{explained:?}");

    // A study, whose title and scenes have such names.
    let title = EVIL[3];
    write(
        &path("x.study.toml"),
        format!(
            "format = \"cloudparity-study/1\"\ntitle = {}\nresolution = [8, 5]\n\
             [truth]\nsamples = 16\nreplicas = 6\nvoxels = 8\n[timing]\nrepeats = 1\n\
             [axes]\nscenes = [{{ file = \"x.scene.json\" }}, {{ file = \"x.scene.json\", name = {} }}]\n\
             densities = [\"graph\"]\nlights = [\"single\"]\nsteps = [2]\nlight_steps = [1]\nsub_pixels = [1]\n",
            json!(title),
            json!(EVIL[4]).to_string().replace("\\u001b", "\\u001B"),
        ),
    );
    std::fs::create_dir(path("run")).expect("a folder");
    run(&["study", "x.study.toml", "-o", "run/study"]);
    let rows = is_table("results.csv", &read("run/study/results.csv"));
    let scenes: Vec<&str> = rows[1..].iter().map(|row| row[0].as_str()).collect();
    let mut expected = [EVIL[0], EVIL[4]].map(|name| format!("'{name}"));
    expected.sort();
    let mut scenes: Vec<String> = scenes.into_iter().map(str::to_owned).collect();
    scenes.sort();
    assert_eq!(scenes, expected);
    let seconds = rows[0].iter().position(|name| name == "seconds").expect("a column");
    assert!(rows[1..].iter().all(|row| row[seconds].parse::<f64>().is_ok()));

    // A report of it all.
    write(&path("run/run.json"), json!({"title": EVIL[0], "scene": EVIL[1], "command": EVIL[2], "versions": {EVIL[3]: EVIL[4]}, "adapter": {"name": EVIL[4]}, "left_out": [{"what": EVIL[2], "why": EVIL[3], "remedy": EVIL[4]}], "timings": [{"what": EVIL[4], "seconds": 1.0}]}).to_string());
    write(&path("run/scene.json"), scene.to_string());
    write(&path("run/explain.txt"), &explained);
    let probe = |name: &str| json!({"scene": name, "points": 10, "domain": "box", "evaluators": {"cpu": {"points": 10, "differing": 3, "max_error": -0.5}}});
    write(&path("run/probe.json"), Json::from(EVIL.map(probe).to_vec()).to_string());
    let modes = EVIL.map(|name| json!({"node": name, "mode": {"operation": name}, "output": name, "points": 10, "cpu_max_error": 0.5, "limit": 0.1, "pass": false}));
    write(&path("run/modes.json"), Json::from(modes.to_vec()).to_string());
    run(&["report", "run"]);

    let rows = is_table("figures.csv", &read("run/figures.csv"));
    assert!(rows.iter().flatten().any(|cell| cell.starts_with("'=1+1")), "{rows:?}");
    assert!(rows.iter().any(|row| row[4] == "-0.5"), "numbers stay numbers: {rows:?}");

    let page = read("run/index.html");
    assert_eq!(page.matches("<script").count(), 1, "the page's own");
    for markup in ["<img src=x", "</pre><img", "alert('x')</script>", "onerror=alert(1)>", "href=\"javascript"] {
        assert!(!page.contains(markup), "{markup}");
    }

    let markdown = read("run/report.md");
    assert!(!markdown.contains(|letter: char| letter.is_control() && letter != '\n'));
    let mut columns = None;
    for line in markdown.lines() {
        if line.starts_with("| ") {
            let count = bare(line, '|');
            assert_eq!(*columns.get_or_insert(count), count, "{line}");
        } else if !line.starts_with("|-") && !line.starts_with("| ---") {
            columns = None;
        }
        assert!(bare(line, '<') == 0 && bare(line, '`') == 0, "{line}");
        let is_own = line.is_empty() || line.starts_with(['#', '|', '*', '!']) || line.contains("relMSE = ");
        assert!(is_own || !line.contains("broken"), "{line}");
    }
    assert!(markdown.starts_with("# =1+1\\<script\\>"), "{markdown}");

    let tables = read("run/tables.tex");
    assert!(!tables.contains("\\input") && !tables.contains(|letter: char| letter.is_control() && letter != '\n'));
    let mut columns = None;
    for line in tables.lines() {
        match line.trim_end().strip_suffix(r"\\") {
            Some(row) => {
                let count = bare(row, '&');
                assert_eq!(*columns.get_or_insert(count), count, "{line}");
                // Behind the end of the row before, a bracket would be the height of a gap.
                assert!(!row.trim_start().starts_with(['[', '*']), "{line}");
            }
            None if line.contains("tabular") => columns = None,
            // The title is a comment.
            None => assert!(line.starts_with('%') || !line.contains("<script") && bare(line, '&') == 0, "{line}"),
        }
    }
}

// --- readers that die --------------------------------------------------------------------------

/// An interpreter that says what a reader says, and then does something.
fn playing(folder: &Path, name: &str, act: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    let events = r#"printf '{"event": "hello"}\n{"event": "activity", "what": "opening a.blend"}\n'"#;
    // A reader has read its order and its request before it works.
    write_program(&path, &format!("#!/bin/sh\ncat > /dev/null\n{events}\n{act}\n"));
    path
}

#[test]
fn a_reader_that_dies_is_never_taken_for_another_reason() {
    let folder = folder();
    write(&folder.path().join("a.blend"), "BLENDER");
    let aborting = "echo \"can't clean grid cache\" >&2; kill -ABRT $$";
    for (name, act, found, expected) in [
        ("kill", "kill -KILL $$", "ended from outside while opening a.blend (signal 9, SIGKILL)", "work to its end"),
        ("term", "kill -TERM $$", "ended from outside while opening a.blend (signal 15, SIGTERM)", "work to its end"),
        ("abort", aborting, "a library that broke off while opening a.blend (signal 6, SIGABRT)", "can handle"),
        ("segv", "kill -SEGV $$", "a library that broke off while opening a.blend (signal 11, SIGSEGV)", "can handle"),
        ("bus", "kill -BUS $$", "a library that broke off while opening a.blend (signal 7, SIGBUS)", "can handle"),
        ("handed", "exit 134", "a library that broke off while opening a.blend (signal 6, SIGABRT)", "can handle"),
        ("memory", "echo 'std::bad_alloc' >&2; kill -ABRT $$", "ran out of memory while opening a.blend", "memory"),
        ("python", "echo 'MemoryError' >&2; exit 1", "ran out of memory while opening a.blend", "memory"),
        ("cpu", "kill -XCPU $$", "a file that is not read after", "read in that time"),
        ("left", "exit 3", "left without an answer while opening a.blend (exit status: 3)", "a result"),
        ("closed", "exec >&-; sleep 60", "closed its output without an answer while opening a.blend", "a result"),
        (
            "half",
            r#"printf '{"event": "done", "result": {"sce'; kill -KILL $$"#,
            "ended from outside",
            "work to its end",
        ),
    ] {
        let interpreter = playing(folder.path(), name, act);
        let mut export = program(folder.path(), &["export", "a.blend", "-o", "a.scene.json"]);
        let run = output(export.env("CLOUDPARITY_PYTHON", &interpreter));
        let errors = text(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{name}: {errors}");
        assert!(errors.contains(found) && errors.contains(expected), "{name}: {errors}");
        assert!(!errors.contains("expected a file that is whole"), "{name}: {errors}");
        assert!(errors.contains("a.blend: found"), "{name}: {errors}");
        assert!(!folder.path().join("a.scene.json").exists(), "{name}");
    }
}

#[test]
fn a_reader_that_is_killed_at_any_moment_is_reported_or_has_answered() {
    if !support::require("bpy") {
        return;
    }
    let folder = folder();
    let scene = support::project("parity/scenes/homogeneous-cube.scene.json").display().to_string();
    let made = output(&mut program(folder.path(), &["export", &scene, "-o", "cube.blend"]));
    assert!(made.status.success(), "{}", text(&made.stderr));
    let python = cloudparity::bridge::interpreter();
    for tenth in 0..10 {
        // The last moments come after the answer, where Blender's module takes its time.
        let killer = folder.path().join("killer");
        let seconds = f64::from(tenth) * 0.2 + 0.05;
        write_program(&killer, &format!("#!/bin/sh\nexec timeout -s KILL {seconds} {} \"$@\"\n", python.display()));
        let mut export = program(folder.path(), &["export", "cube.blend", "-o", "x.scene.json"]);
        let run = output(export.env("CLOUDPARITY_PYTHON", &killer));
        let errors = text(&run.stderr);
        if run.status.success() {
            assert!(Scene::load(&folder.path().join("x.scene.json")).is_ok());
        } else {
            assert_eq!(run.status.code(), Some(2), "{errors}");
            assert!(errors.contains("ended from outside") && errors.contains("SIGKILL"), "{seconds} s: {errors}");
        }
        let _ = std::fs::remove_file(folder.path().join("x.scene.json"));
    }
}

#[test]
fn an_answer_counts_whatever_the_reader_does_after_it() {
    if !support::require("bpy") {
        return;
    }
    let folder = folder();
    let scene = support::project("parity/scenes/homogeneous-cube.scene.json").display().to_string();
    assert!(output(&mut program(folder.path(), &["export", &scene, "-o", "cube.blend"])).status.success());
    let python = cloudparity::bridge::interpreter();
    for end in ["kill -ABRT $$", "exit 7"] {
        let interpreter = folder.path().join("python");
        write_program(&interpreter, &format!("#!/bin/sh\n{} \"$@\"\n{end}\n", python.display()));
        let mut export = program(folder.path(), &["export", "cube.blend", "-o", "x.scene.json"]);
        let run = output(export.env("CLOUDPARITY_PYTHON", &interpreter));
        assert!(run.status.success(), "{}", text(&run.stderr));
    }
}
