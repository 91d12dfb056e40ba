//! Releases of Blender besides the one that everything is measured with: each in an environment of its own, made when it is first asked for.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge::interpreter::{self, Version};
use crate::bridge::saved_by::{Line, saved_by};
use crate::bridge::{self, cache};
use crate::scene::Release;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Releases that people work with, oldest first: the last of every line that the Python package index has.
pub const RELEASES: [&str; 8] = ["4.2.23", "4.3.0", "4.4.0", "4.5.15", USUAL, "5.1.2", "5.2.3", "5.3.0"];

/// The release that `.venv` has, and that everything is measured with where no other is named.
pub const USUAL: &str = "5.0.1";

/// What scripts import besides Blender, by version of Python.
const REQUIREMENTS: &str = include_str!("../../requirements-releases.txt");

/// Written when an environment is complete.
const STAMP: &str = "complete";

/// Does something with a release's interpreter in the place of the usual one; makes its environment where there is none (some 400 MB are
/// fetched). An error where that cannot be had.
pub fn within<T>(release: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
    interpreter::within(environment(release)?, work)
}

/// The release whose Cycles has the values of graphs of a release of the field; none: the usual one.
pub fn truth_of(values: Release) -> Option<&'static str> {
    match values {
        Release::V4_5 => Some("4.5.15"),
        Release::V5_0 => None,
        Release::V5_1 => Some("5.1.2"),
        Release::V5_2 => Some("5.2.3"),
        Release::V5_3 => Some("5.3.0"),
    }
}

/// Does something with an interpreter whose Blender has the values that a graph has: the usual one, or that of another release.
/// Where the caller has chosen a release, that one stays.
pub fn with_values_of<T>(values: Release, work: impl FnOnce() -> Result<T>) -> Result<T> {
    match truth_of(values) {
        Some(release) if !interpreter::is_replaced() => within(release, work),
        _ => work(),
    }
}

/// How a .blend is read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reading {
    /// The line of releases that saved it, where its header says so.
    pub saved_by: Option<Line>,
    /// The release that reads it; none: the usual one.
    release: Option<String>,
    /// The release whose values its nodes get.
    pub values: Release,
}

impl Reading {
    /// How a .blend is read: by a release not older than the one that saved it nor than `asked`, whose values its nodes then get.
    /// Without it a file of Blender 5.0 or older gets the values of 5.0, and any other those of the release that saved it.
    pub fn of(blend: &Path, asked: Option<Release>) -> Result<Self> {
        let saved_by = saved_by(blend);
        let own = saved_by.map(|line| values_of(line, blend)).transpose()?.unwrap_or_default();
        let values = asked.unwrap_or(own);
        let asked = (values > Release::V5_0).then(|| Line::of(values.into())).flatten();
        let Some(least) = saved_by.max(asked) else { return Ok(Self { saved_by, release: None, values }) };
        if usual_line().is_none_or(|line| line >= least) {
            return Ok(Self { saved_by, release: None, values });
        }
        let mut able = RELEASES.into_iter().filter(|release| Line::of(release) >= Some(least)).peekable();
        let first = able.peek().copied();
        // One that is there is as good as the first that would do, and needs no network.
        let release = able.find(|release| is_complete(release)).or(first).map(str::to_owned);
        Ok(Self { saved_by, release, values })
    }

    /// Reads.
    pub fn run<T>(&self, blend: &Path, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let Some(release) = &self.release else { return work() };
        let python = environment(release).map_err(|error| {
            let by = self.saved_by.map_or_else(String::new, |line| format!(", which Blender {line} saved"));
            Error {
                place: format!("{}{by}: {}", blend.display(), error.place),
                remedy: format!(
                    "{} Or save the file with Blender 5.0, which leaves out what later releases added.",
                    error.remedy
                ),
                ..error
            }
        })?;
        interpreter::within(python, work)
    }
}

/// The values of nodes in a file of a line of releases.
fn values_of(line: Line, blend: &Path) -> Result<Release> {
    use strum::VariantArray;
    if line <= Line::new(5, 0) {
        return Ok(Release::V5_0);
    }
    let found = Release::VARIANTS.iter().find(|release| Line::of((**release).into()) == Some(line));
    found.copied().ok_or_else(|| {
        let newest = RELEASES[RELEASES.len() - 1];
        Error::new(
            blend.display().to_string(),
            format!("a file that Blender {line} saved"),
            format!("a file of Blender {newest} or older: what later releases make of nodes is not known"),
            format!("Save it again with Blender {newest}."),
        )
    })
}

/// The line of releases of the usual interpreter: what is installed beside it, without starting it, else what Python answers. None where
/// it has no Blender.
fn usual_line() -> Option<Line> {
    let python = bridge::interpreter();
    let beside = interpreter::installed_beside(&python, "bpy");
    beside.or_else(|| bridge::module_version("bpy", "bpy.app.version_string").ok()).and_then(|found| Line::of(&found))
}

/// The folder of a release's environment, whether it is there or not.
fn folder_of(release: &str) -> Result<PathBuf> {
    Ok(cache::cache_folder()?.join("blender").join(release))
}

/// Whether a release's environment is there.
pub fn is_complete(release: &str) -> bool {
    folder_of(release).is_ok_and(|folder| folder.join(STAMP).exists())
}

/// The version of CPython that the wheels of a release are for.
pub fn python_of(release: &str) -> Version {
    let since_5_1 = Line::of(release).is_some_and(|line| line >= Line::new(5, 1));
    if since_5_1 { Version(3, 13) } else { Version(3, 11) }
}

/// The interpreter of a release.
fn environment(release: &str) -> Result<PathBuf> {
    check(release)?;
    let folder = folder_of(release)?;
    let python = folder.join("bin/python");
    if is_complete(release) {
        return Ok(python);
    }
    // Where the usual one is of that release, it has all that is needed.
    let usual = interpreter::choose_usual().path;
    if interpreter::installed_beside(&usual, "bpy").is_some_and(|found| found == release) {
        return Ok(usual);
    }
    let version = python_of(release);
    let base = interpreter::find(version).map_err(|looked_at| no_interpreter(release, version, &looked_at))?;
    // One that was interrupted is made anew.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|cause| Error::io(&folder, "a folder that can be removed", &cause))?;
    }
    step(release, Command::new(&base).args(["-m", "venv"]).arg(&folder))?;
    let mut install = Command::new(&python);
    install.env("PIP_DISABLE_PIP_VERSION_CHECK", "1").args(["-m", "pip", "install", "-q"]);
    step(release, install.arg(format!("bpy=={release}")).args(requirements()))?;
    let stamp = folder.join(STAMP);
    files::write_atomically(&stamp, release.as_bytes())?;
    Ok(python)
}

/// The lines of [`REQUIREMENTS`], whose markers pip reads itself.
fn requirements() -> impl Iterator<Item = &'static str> {
    REQUIREMENTS.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
}

/// The error where no interpreter of a version is there.
fn no_interpreter(release: &str, version: Version, looked_at: &str) -> Error {
    Error::new(
        format!("Blender {release} as a Python module"),
        format!("no CPython {version} that makes environments (looked at {looked_at})"),
        format!("CPython {version}, which the wheels of Blender {release} are for"),
        format!("{} Or name it: {}=/path/to/python{version}.", how_to_get(version), version.variable()),
    )
}

/// The commands that bring an interpreter.
pub fn how_to_get(version: Version) -> String {
    format!("Get it with uv python install {version}, or with pyenv install {version}.")
}

/// Refuses what is no number of a release: it becomes the name of a folder and an argument.
pub fn check(release: &str) -> Result<()> {
    let parts: Vec<&str> = release.split('.').collect();
    let is_number = |part: &&str| !part.is_empty() && part.len() <= 3 && part.bytes().all(|byte| byte.is_ascii_digit());
    if parts.len() == 3 && parts.iter().all(is_number) {
        return Ok(());
    }
    Err(Error::new(
        "the release of Blender",
        format!("\"{release}\""),
        "three numbers, as 4.5.15",
        format!("Take one of {}.", RELEASES.join(", ")),
    ))
}

/// One step of making an environment.
fn step(release: &str, command: &mut Command) -> Result<()> {
    let wrong = |found: String| {
        Error::new(
            format!("Blender {release} as a Python module"),
            found,
            format!("a wheel of the package bpy with this number for CPython {}", python_of(release)),
            format!("Take one of {}, and check the network.", RELEASES.join(", ")),
        )
    };
    let output = command.output().map_err(|cause| wrong(format!("{}: {cause}", command.get_program().display())))?;
    if output.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let last = text.lines().rfind(|line| line.starts_with("ERROR")).or_else(|| text.lines().last());
    Err(wrong(last.unwrap_or("no answer of pip").to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_release_is_refused_before_anything_is_made() {
        for wrong in ["", "4.5", "4.5.x", "../../4.5.1", "4.5.15 -i x", "4.5.15.1", "4..1"] {
            let error = within(wrong, || Ok(())).expect_err("refused");
            assert!(error.expected.contains("4.5.15"), "{error}");
        }
        RELEASES.iter().try_for_each(|release| check(release)).expect("all are releases");
        assert!(RELEASES.windows(2).all(|pair| Line::of(pair[0]) < Line::of(pair[1])));
    }

    #[test]
    fn every_release_of_the_field_has_a_truth_in_the_list() {
        use strum::VariantArray;
        for values in Release::VARIANTS {
            let truth = truth_of(*values).unwrap_or(USUAL);
            assert!(RELEASES.contains(&truth) && Line::of(truth) == Line::of((*values).into()), "{values}: {truth}");
        }
        assert_eq!(["4.5.15", "5.0.1", "5.1.2", "5.3.0"].map(|release| python_of(release).1), [11, 11, 13, 13]);
    }

    #[test]
    fn files_have_the_values_of_the_release_that_saved_them() {
        let folder = tempfile::tempdir().expect("a folder");
        let reading = |header: &str, asked: Option<Release>| {
            let path = folder.path().join("f.blend");
            std::fs::write(&path, header).expect("a file");
            Reading::of(&path, asked)
        };
        for (header, values) in [
            ("BLENDER-v276", Release::V5_0),
            ("BLENDER17-01v0500", Release::V5_0),
            ("BLENDER17-01v0501", Release::V5_1),
            ("BLENDER17-01v0503", Release::V5_3),
            ("no header", Release::V5_0),
        ] {
            assert_eq!(reading(header, None).expect("a reading").values, values, "{header}");
        }
        let asked = reading("BLENDER-v405", Some(Release::V5_3)).expect("a reading");
        assert_eq!((asked.saved_by, asked.values), (Some(Line::new(4, 5)), Release::V5_3));
        assert_eq!(reading("BLENDER17-01v0503", Some(Release::V4_5)).expect("a reading").values, Release::V4_5);
        let error = reading("BLENDER17-01v0504", None).expect_err("a release that is not known").to_string();
        assert!(error.contains("Blender 5.4 saved") && error.contains("Save it again with Blender 5.3.0"), "{error}");
    }

    #[test]
    fn a_missing_interpreter_is_named_with_the_ways_to_get_it() {
        let error = no_interpreter("5.3.0", Version(3, 13), "python3.13").to_string();
        for part in ["CPython 3.13", "uv python install 3.13", "pyenv install 3.13", "CLOUDPARITY_PYTHON_3_13", "5.3.0"]
        {
            assert!(error.contains(part), "\"{part}\" is not in: {error}");
        }
    }

    #[test]
    fn requirements_name_numpy_for_both_interpreters_as_setup_reads_them() {
        let lines: Vec<&str> = requirements().collect();
        assert_eq!(lines.iter().filter(|line| line.starts_with("numpy==")).count(), 2, "{lines:?}");
        // Setup makes the environment of the newest release.
        let setup = include_str!("../../tools/setup.sh");
        assert!(setup.contains(&format!("NEWEST={}\n", RELEASES[RELEASES.len() - 1])), "tools/setup.sh");
    }
}
