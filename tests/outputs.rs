//! Everything that writes, against what is no ordinary file: a device, a pipe, a link, a folder, a
//! full disk, a disk that is read-only.
//!
//! Nodes are made here, in temporary folders; those of the machine are never named.

#![cfg(unix)]

mod support;

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use support::{project, require};

/// What the program does with a path of the command line.
enum Use {
    /// It is read.
    Reads,
    /// A file is written; the rest of a short command line, and what it needs besides the program.
    WritesFile(&'static str, &'static str),
    /// A folder is made; the same.
    WritesFolder(&'static str, &'static str),
    /// It is written, and why this is not tried: the sources are
    /// (`files_are_written_in_one_place`).
    Untried(&'static str),
}

use Use::{Reads, Untried, WritesFile, WritesFolder};

const SCENE: &str = "homogeneous-cube.scene.json";

/// Every path of the command line. `SCENE` stands for a scene file, `POINTS` for points, `@FILE`
/// for a file of the project.
const USES: &[(&str, &str, Use)] = &[
    // Pictures and scenes that are made.
    ("init", "<FILE>", Reads),
    ("init", "--output", WritesFolder("SCENE", "")),
    ("export", "<INPUTS>", Reads),
    ("export", "--output", WritesFile("SCENE", "bpy")),
    ("show explain", "<SCENE>", Reads),
    ("show params", "<SCENE>", Reads),
    ("show man", "--output", WritesFolder("", "")),
    ("view", "<SCENE>", Reads),
    ("view", "--preset", Reads),
    ("view", "--truth", Reads),
    ("view", "--study", Reads),
    ("view", "--output", Untried("it opens a window")),
    ("view", "--photograph", Untried("it opens a window")),
    ("render", "<SCENE>", Reads),
    ("render", "--preset", Reads),
    ("render", "--output", WritesFile("SCENE --integrator path --samples 1 --resolution 4x4", "")),
    ("diff", "--ours", Reads),
    ("diff", "--reference", Reads),
    ("diff", "--output", WritesFolder("--ours x.scene.json --reference x.scene.json", "bpy")),
    ("report", "<DIRECTORY>", Reads),
    ("report", "--check", Reads),
    ("eval", "<SCENE>", Reads),
    ("eval", "--points", Reads),
    ("eval", "--output", WritesFile("SCENE --points POINTS", "")),
    ("publish", "<SCENE>", Reads),
    ("publish", "--preset", Reads),
    ("publish", "--truth", Reads),
    ("publish", "--output", WritesFolder("SCENE --resolution 4x4 --to texture --voxels 4", "")),
    ("shader", "<SCENE>", Reads),
    ("shader", "--output", WritesFile("SCENE", "")),
    ("grid", "<INPUT>", Reads),
    ("grid", "--output", WritesFile("SCENE --voxels 8", "bpy")),
    // Measurements.
    ("measure study", "<FILE>", Reads),
    ("measure study", "--output", WritesFolder("@parity/studies/small.study.toml", "")),
    ("measure study", "--merge", Reads),
    ("measure attribution", "<FILE>", Reads),
    ("measure attribution", "--output", WritesFolder("@parity/studies/planted.attribution.toml", "")),
    ("measure attribution", "--merge", Reads),
    ("measure recommend", "<DIRECTORY>", Reads),
    ("measure recommend", "--output", Untried("it needs a study that was run")),
    ("measure sequence", "<FILE>", Reads),
    ("measure sequence", "--output", WritesFolder("@parity/studies/cloud-layer.sequence.toml", "")),
    ("measure sequence", "--merge", Reads),
    ("measure tune", "<FILE>", Reads),
    ("measure tune", "--output", WritesFolder("@parity/studies/clouds.tune.toml", "")),
    ("measure tune", "--merge", Reads),
    ("measure compare-models", "<SCENE>", Reads),
    ("measure compare-models", "--output", WritesFolder("SCENE --resolution 4x4", "bpy")),
    ("measure probe", "<SCENE>", Reads),
    ("measure probe", "--output", WritesFile("SCENE --points 64", "bpy")),
    ("measure parity", "<SUITE>", Reads),
    ("measure parity", "--output", WritesFolder("@parity/parity.suite.json --only noise-coloured", "bpy")),
    ("measure parity", "--merge", Reads),
    ("measure modes", "--output", WritesFile("--node Gamma --points 64 --without-gpu", "bpy")),
    ("measure modes", "--summary", WritesFile("--node Gamma --points 64 --without-gpu", "bpy")),
    ("measure drift", "--scenes", Reads),
    ("measure drift", "--summary", Untried("it fetches other releases")),
    ("measure drift", "--output", WritesFolder("--node Gamma --points 64", "bpy")),
    ("measure drift", "--merge", Reads),
    ("measure findings", "--scenes", Reads),
    ("measure findings", "--output", WritesFolder("--only order", "bpy")),
    ("measure findings", "--merge", Reads),
    ("measure bounds", "<SCENE>", Reads),
    ("measure stability", "<SCENE>", Reads),
    ("measure stability", "--pictures-of", Reads),
    ("measure stability", "--output", WritesFolder("SCENE --resolution 4x4", "vulkan")),
    ("measure stability", "--merge", Reads),
    ("measure convergence", "<SCENE>", Reads),
    ("measure convergence", "--output", WritesFolder("SCENE --resolution 4x4", "")),
    ("measure convergence", "--merge", Reads),
    ("measure time-to-error", "<SUITE>", Reads),
    ("measure time-to-error", "--output", WritesFolder("@parity/times.suite.json", "bpy")),
    ("measure time-to-error", "--merge", Reads),
    ("measure bench", "<SCENE>", Reads),
    (
        "measure bench",
        "--output",
        Untried("on a busy machine a difference of its times may have the wrong sign, which it rejects"),
    ),
    ("measure bench-compile", "<SCENES>", Reads),
    ("measure bench-compile", "--output", WritesFile("SCENE --repeats 1 --without-gpu", "")),
    (
        "measure bench-nodes",
        "--output",
        WritesFile("--node Gamma --points 1024 --repeats 1 --without-gpu --without-cycles", ""),
    ),
    ("measure bench-quick", "<SCENE>", Reads),
    ("measure bench-quick", "--baseline", Reads),
    ("measure bench-quick", "--write-baseline", Untried("it takes minutes")),
    ("measure bench-voxels", "<SCENE>", Reads),
    ("measure growth", "<SCENE>", Reads),
    ("measure growth", "--output", WritesFolder("SCENE --ladder width=2,4", "")),
    ("measure growth", "--merge", Reads),
    ("measure variance", "<SCENE>", Reads),
    ("measure variance", "--output", WritesFile("SCENE --resolution 4x4 --samples 1 --replicas 2", "")),
    ("measure demo", "--output", WritesFolder("", "bpy")),
];

/// A command that takes longer hangs.
const LONGEST: Duration = Duration::from_secs(240);

/// A folder with what commands read.
fn desk() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::copy(project("parity/scenes").join(SCENE), folder.path().join("x.scene.json")).expect("the committed scene");
    let points = ndarray_points();
    fs::write(folder.path().join("p.npy"), points).expect("written");
    folder
}

/// Two points as numpy.save writes them.
fn ndarray_points() -> Vec<u8> {
    let mut header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }".to_owned();
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).expect("a short header").to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend([0.1_f32, 0.2, 0.3, -0.1, 0.0, 0.4].iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Runs a command with an output; its exit status and stderr.
fn run(folder: &Path, command: &str, rest: &str, option: &str, output: &Path) -> (Option<i32>, String) {
    let words = command.split(' ').chain(rest.split(' ').filter(|word| !word.is_empty()));
    let words = words.map(|word| match (word, word.strip_prefix('@')) {
        ("SCENE", _) => PathBuf::from("x.scene.json"),
        ("POINTS", _) => PathBuf::from("p.npy"),
        (_, Some(file)) => project(file),
        _ => PathBuf::from(word),
    });
    let stderr = folder.join("stderr");
    let mut program = Command::new(env!("CARGO_BIN_EXE_cloudparity"));
    program.current_dir(folder).args(words).arg(option).arg(output).stdin(Stdio::null()).stdout(Stdio::null());
    program.env("TMPDIR", folder);
    let mut child = program.stderr(fs::File::create(&stderr).expect("a file")).spawn().expect("the program starts");
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child") {
            break status;
        }
        if begin.elapsed() > LONGEST {
            child.kill().expect("it ends");
            child.wait().expect("it has ended");
            panic!("{command} {option} {} hangs", output.display());
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let text = fs::read_to_string(&stderr).expect("text");
    assert!(!text.contains("panicked"), "{command}: {text}");
    (status.code(), text)
}

/// Makes a device node, or says that it is not allowed here.
fn node(path: &Path, minor: &str) -> bool {
    let made = Command::new("mknod").arg(path).args(["c", "1", minor]).stderr(Stdio::null()).status();
    // On some disks nodes can be made and not opened.
    made.is_ok_and(|status| status.success()) && fs::OpenOptions::new().write(true).open(path).is_ok()
}

/// A small disk that is gone with its value.
struct Disk(PathBuf);

impl Disk {
    fn new(path: &Path, kib: u32) -> Option<Self> {
        fs::create_dir(path).expect("a folder");
        let size = format!("size={kib}k");
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(path).stderr(Stdio::null());
        mount.status().is_ok_and(|status| status.success()).then(|| Self(path.to_owned()))
    }

    fn make_read_only(&self) {
        let status = Command::new("mount").args(["-o", "remount,ro"]).arg(&self.0).status();
        assert!(status.is_ok_and(|status| status.success()));
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).expect("a folder");
    entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
}

/// Those of the table whose needs are met.
fn tried(is_file: bool) -> Vec<(&'static str, &'static str, &'static str)> {
    let of = |(command, option, what): &'static (&str, &str, Use)| match what {
        WritesFile(rest, need) if is_file && (need.is_empty() || require(need)) => Some((*command, *option, *rest)),
        WritesFolder(rest, need) if !is_file && (need.is_empty() || require(need)) => Some((*command, *option, *rest)),
        _ => None,
    };
    USES.iter().filter_map(of).collect()
}

/// An ending that a command may decide by.
fn ending(command: &str) -> &'static str {
    match command {
        "eval" => "npy",
        "export" => "blend",
        "grid" => "vdb",
        "render" => "exr",
        "shader" => "wgsl",
        _ => "json",
    }
}

#[test]
fn every_path_of_the_command_line_is_listed() {
    let found: BTreeSet<(String, String)> = cloudparity::cli::path_options().into_iter().collect();
    let listed: BTreeSet<(String, String)> =
        USES.iter().map(|(command, option, _)| ((*command).to_owned(), (*option).to_owned())).collect();
    let new: Vec<_> = found.difference(&listed).collect();
    let gone: Vec<_> = listed.difference(&found).collect();
    assert!(new.is_empty() && gone.is_empty(), "say in USES what is done with {new:?}; gone: {gone:?}");
    for (command, option, what) in USES {
        if let Untried(why) = what {
            assert!(!why.is_empty(), "{command} {option}");
        }
    }
}

#[test]
fn devices_pipes_links_and_folders_stay_what_they_are() {
    for (command, option, rest) in tried(true) {
        let desk = desk();
        let at = |name: &str| desk.path().join(format!("{name}.{}", ending(command)));
        let (null, full, pipe, link, folder) = (at("null"), at("full"), at("pipe"), at("link"), at("folder"));
        if node(&null, "3") && node(&full, "7") {
            // What a command adds to a file that is there, it cannot read from a device.
            let (status, text) = run(desk.path(), command, rest, option, &null);
            let is_read = text.contains("found a device");
            assert!(is_read || matches!(status, Some(0 | 1)), "{command} {option} null: {status:?} {text}");
            let (status, text) = run(desk.path(), command, rest, option, &full);
            let why = if is_read { "found a device" } else { "No space" };
            assert!(status == Some(2) && text.contains(why), "{command} {option} full: {status:?} {text}");
            for (path, minor) in [(&null, 3), (&full, 7)] {
                let found = fs::symlink_metadata(path).expect("a node");
                assert!(found.file_type().is_char_device(), "{command} replaced a device");
                assert_eq!(found.rdev(), (1 << 8) | minor);
            }
        } else {
            eprintln!("left out: no device nodes here");
        }
        assert!(Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()));
        fs::create_dir(&folder).expect("a folder");
        for (path, what) in [(&pipe, "a pipe"), (&folder, "a folder")] {
            let (status, text) = run(desk.path(), command, rest, option, path);
            assert!(status == Some(2) && text.contains(what), "{command} {option} {what}: {status:?} {text}");
        }
        assert!(fs::symlink_metadata(&pipe).expect("it is there").file_type().is_fifo());
        assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 0);
        let target = desk.path().join(format!("elsewhere.{}", ending(command)));
        symlink(target.file_name().expect("a name"), &link).expect("a link");
        let (status, text) = run(desk.path(), command, rest, option, &link);
        assert!(matches!(status, Some(0 | 1)), "{command} {option} link: {status:?} {text}");
        assert!(fs::symlink_metadata(&link).expect("it is there").is_symlink(), "{command} replaced a link");
        assert!(fs::metadata(&target).expect("the file behind the link").len() > 0);
        let left: Vec<String> =
            names(desk.path()).into_iter().filter(|name| name.starts_with('.') || name.contains("-run-")).collect();
        assert!(left.is_empty(), "{command} leaves {left:?}");
    }
}

#[test]
fn a_full_disk_and_one_that_is_read_only_keep_what_was_there() {
    for (command, option, rest) in tried(true) {
        for is_full in [true, false] {
            let desk = desk();
            let Some(disk) = Disk::new(&desk.path().join("disk"), 4) else {
                eprintln!("left out: no mount here");
                return;
            };
            let target = disk.0.join(format!("x.{}", ending(command)));
            // One page: no other file has a place.
            fs::write(&target, if option == "--summary" { "{" } else { "before" }).expect("written");
            let before = fs::read(&target).expect("read");
            if !is_full {
                disk.make_read_only();
            }
            let (status, text) = run(desk.path(), command, rest, option, &target);
            let name = target.file_name().expect("a name").to_string_lossy().into_owned();
            assert!(status == Some(2) && text.contains(&name), "{command} {option}: {status:?} {text}");
            assert_eq!(fs::read(&target).expect("read"), before, "{command} {option}");
            assert_eq!(names(&disk.0), BTreeSet::from([name]), "{command} {option}");
        }
    }
}

#[test]
fn folders_of_results_are_not_made_of_nodes() {
    for (command, option, rest) in tried(false) {
        let desk = desk();
        let (null, pipe) = (desk.path().join("null"), desk.path().join("pipe"));
        assert!(Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()));
        let has_null = node(&null, "3");
        for path in [&pipe, &null].into_iter().take(if has_null { 2 } else { 1 }) {
            let before = fs::symlink_metadata(path).expect("a node").file_type();
            let (status, text) = run(desk.path(), command, rest, option, path);
            let name = path.file_name().expect("a name").to_string_lossy();
            assert!(status == Some(2) && text.contains(&*name), "{command} {option}: {status:?} {text}");
            assert_eq!(fs::symlink_metadata(path).expect("a node").file_type(), before);
        }
    }
}

#[test]
fn a_file_that_is_replaced_keeps_its_permissions() {
    let desk = desk();
    let target = desk.path().join("x.wgsl");
    fs::write(&target, "before").expect("written");
    fs::set_permissions(&target, fs::Permissions::from_mode(0o600)).expect("set");
    let (status, text) = run(desk.path(), "shader", "SCENE", "--output", &target);
    assert_eq!(status, Some(0), "{text}");
    let found = fs::metadata(&target).expect("a file");
    assert!(found.len() > 100 && found.mode() & 0o777 == 0o600);
}

/// What writes by itself instead of through `base::files` and `scene_io.replaced_file`.
#[test]
fn files_are_written_in_one_place() {
    let mut found = Vec::new();
    let rust = ["fs::write(", "File::create(", "OpenOptions::new", "fs::rename(", ".persist(", "fs::copy("];
    let python =
        ["os.replace(", "os.rename(", ".write_bytes(", ".write_text(", "np.save(", ".savefig(", "\"w\")", "\"wb\")"];
    for (folder, ending, calls) in [("src", "rs", rust.as_slice()), ("blend", "py", python.as_slice())] {
        let mut folders = vec![project(folder)];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).expect("a folder") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|found| found == ending)
                    && !path.ends_with("tests.rs")
                    && !path.ends_with("cli/vocabulary.rs")
                {
                    let text = fs::read_to_string(&path).expect("a source");
                    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
                    let code = code.split("#[cfg(all(test").next().unwrap_or_default();
                    let name = path.strip_prefix(project("")).expect("below it").display().to_string();
                    let calls = calls.iter().filter(|call| code.contains(**call));
                    found.extend(calls.map(|call| format!("{name} {call}")));
                }
            }
        }
    }
    found.sort();
    // What the rule itself does, and what writes into the temporary file that it gives, or into a
    // temporary folder.
    let known = [
        "blend/compare_images.py .write_text(",
        "blend/compare_images.py np.save(",
        "blend/display_picture.py .write_text(",
        "blend/plots.py .savefig(",
        "blend/point_probe.py \"wb\")",
        "blend/point_probe.py np.save(",
        "blend/scene_io.py os.replace(",
        "blend/volume_grid.py np.save(",
        "blend/world_reader.py .write_bytes(",
        "src/base/destination.rs .persist(",
        "src/base/destination.rs OpenOptions::new",
        "src/base/files.rs File::create(",
        "src/measure/experiment/merge.rs fs::copy(",
    ];
    assert_eq!(found, known, "write through base::files or scene_io.replaced_file");
}
