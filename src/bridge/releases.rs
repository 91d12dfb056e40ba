//! Releases of Blender besides the one that everything is measured with: each in an environment of its own, made when it is first asked for.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge::{self, cache, interpreter};
use crate::scene::Release;
use std::path::PathBuf;
use std::process::Command;

/// Releases that people work with: the last of every line that the Python package index has for CPython 3.11.
pub const RELEASES: [&str; 5] = ["4.2.23", "4.3.0", "4.4.0", "4.5.15", "5.0.1"];

/// What scripts import besides Blender, as in `requirements.txt`.
const PACKAGES: [&str; 2] = ["numpy==1.26.4", "OpenImageIO==3.0.21.0"];

/// Written when an environment is complete.
const STAMP: &str = "complete";

/// Does something with a release's interpreter in the place of the usual one; makes its environment where there is none (some 400 MB are
/// fetched). An error where that cannot be had.
pub fn within<T>(release: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
    interpreter::within(environment(release)?, work)
}

/// The release whose Cycles has the values of graphs of a release of the field.
fn truth_of(values: Release) -> Option<&'static str> {
    match values {
        Release::Newest => None,
        Release::Before5 => Some("4.5.15"),
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

/// The interpreter of a release.
fn environment(release: &str) -> Result<PathBuf> {
    check(release)?;
    let folder = cache::cache_folder()?.join("blender").join(release);
    let python = folder.join("bin/python");
    if folder.join(STAMP).exists() {
        return Ok(python);
    }
    // Where the usual one is of that release, it has all that is needed. To ask it takes a start of Python.
    if bridge::module_version("bpy", "bpy.app.version_string").is_ok_and(|found| found == release) {
        return Ok(bridge::interpreter());
    }
    // One that was interrupted is made anew.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|cause| Error::io(&folder, "a folder that can be removed", &cause))?;
    }
    let base = bridge::interpreter();
    step(release, Command::new(&base).args(["-m", "venv"]).arg(&folder))?;
    let mut install = Command::new(&python);
    install.env("PIP_DISABLE_PIP_VERSION_CHECK", "1").args(["-m", "pip", "install", "-q"]);
    step(release, install.arg(format!("bpy=={release}")).args(PACKAGES))?;
    let stamp = folder.join(STAMP);
    files::write_atomically(&stamp, release.as_bytes())?;
    Ok(python)
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
            "a wheel of the package bpy with this number for CPython 3.11",
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
    }
}
