//! `cloudparity doctor`: what is there of what the program can use, and what to do about the rest.

use crate::base::error::{Error, Result};
use crate::base::identity::Identity;
use crate::bridge;
use crate::bridge::releases::{RELEASES, USUAL, how_to_get, is_complete, python_of};
use crate::gpu::Gpu;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Check the adapter, the Python interpreter and its packages: exit status 0 all there, 1 something is missing.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity doctor")]
pub(super) struct Arguments {
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

/// The versions that this program was tested with.
const REQUIREMENTS: &str = include_str!("../../requirements.txt");

/// Distribution name, module to import, what needs it.
const PACKAGES: [(&str, &str, &str); 8] = [
    ("bpy", "bpy", "export, build, live probes and live references"),
    ("OpenImageIO", "OpenImageIO", "diff and the pictures of reports"),
    ("numpy", "numpy", "every script"),
    ("flip-evaluator", "flip_evaluator", "the perceptual figure of diff"),
    ("opencolorio", "PyOpenColorIO", "the pictures of reports"),
    ("scipy", "scipy", "the statistical verdict of diff"),
    ("matplotlib", "matplotlib", "all figures"),
    ("cma", "cma", "the search of tune"),
];

/// One thing that the program can use.
#[derive(Debug, Serialize)]
struct Check {
    what: String,
    /// Name or version; absent where it is missing.
    found: Option<String>,
    /// Absent where all is well.
    problem: Option<Problem>,
}

#[derive(Debug, Serialize)]
struct Problem {
    cause: String,
    needed_for: String,
    remedy: String,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let mut checks = vec![check_adapter(), check_interpreter()];
    checks.extend(PACKAGES.map(|(distribution, module, purpose)| check_package(distribution, module, purpose)));
    let temporary = Ok(std::env::temp_dir());
    checks.push(check_folder("temporary files", "probes, pictures and grids", "TMPDIR", temporary));
    let references = bridge::reference::cache_folder();
    checks.push(check_folder("cache", "references by Cycles", bridge::reference::CACHE_VARIABLE, references));
    checks.push(check_releases());
    let all_there = checks.iter().all(|check| check.problem.is_none());
    let text = if arguments.json {
        let document = serde_json::json!({
            "version": env!("CARGO_PKG_VERSION"), "build": Identity::current(), "all_there": all_there, "checks": checks,
        });
        serde_json::to_string_pretty(&document).expect("JSON serialises") + "\n"
    } else {
        describe(&checks)
    };
    super::print(&text)?;
    Ok(ExitCode::from(u8::from(!all_there)))
}

fn check_adapter() -> Check {
    let what = "graphics adapter".to_owned();
    match Gpu::open() {
        Ok(gpu) => {
            let adapter = gpu.adapter();
            let mut found = format!("{} ({}, driver {})", adapter.name, adapter.backend, adapter.driver);
            if adapter.kind == "Cpu" {
                found += "; a program on the CPU: right values, but its times say nothing about a GPU";
            }
            Check { what, found: Some(found), problem: None }
        }
        Err(error) => {
            let needed_for = "--evaluator gpu and what else runs WGSL".into();
            Check { what, found: None, problem: Some(Problem { cause: error.found, needed_for, remedy: error.remedy }) }
        }
    }
}

fn check_interpreter() -> Check {
    let bridge::interpreter::Choice { path, reason } = bridge::interpreter::choose();
    let version =
        bridge::module_version("platform", "platform.python_implementation() + ' ' + platform.python_version()");
    let what = "Python".to_owned();
    let release = bridge::interpreter::installed_beside(&path, "bpy").unwrap_or_else(|| USUAL.to_owned());
    let wanted = python_of(&release);
    let problem = |cause: String| Problem {
        cause,
        needed_for: "everything that asks Blender or compares pictures".into(),
        remedy: format!("Run make setup, or set {} to a CPython {wanted}.", bridge::INTERPRETER_VARIABLE),
    };
    match version {
        Ok(version) => {
            let fits = version.starts_with(&format!("CPython {wanted}."));
            let cause = format!("{version}, where bpy {release} needs CPython {wanted}");
            Check {
                what,
                found: Some(format!("{version} ({}; {reason})", path.display())),
                problem: (!fits).then(|| problem(cause)),
            }
        }
        Err(cause) => {
            Check { what, found: None, problem: Some(problem(format!("{}: {cause} ({reason})", path.display()))) }
        }
    }
}

/// Releases of Blender: those whose environment is there, those that can be made, and which interpreter the others lack. None is needed
/// where no file and no option asks for it, so that no release is a problem.
fn check_releases() -> Check {
    let others = RELEASES.into_iter().filter(|release| *release != USUAL);
    let mut lacking: Vec<(bridge::interpreter::Version, bool, String)> = Vec::new();
    let (there, absent): (Vec<&str>, Vec<&str>) = others.partition(|release| is_complete(release));
    let mut parts = vec![if there.is_empty() { "none besides".to_owned() } else { there.join(", ") }];
    for release in absent {
        let version = python_of(release);
        match lacking.iter_mut().find(|(known, ..)| *known == version) {
            Some((.., releases)) => *releases += &format!(", {release}"),
            None => lacking.push((version, bridge::interpreter::find(version).is_ok(), release.to_owned())),
        }
    }
    parts.extend(lacking.into_iter().map(|(version, can_be_made, releases)| match can_be_made {
        true => format!("{releases} when first asked for"),
        false => format!("{releases} with CPython {version}, which is missing. {}", how_to_get(version)),
    }));
    Check { what: format!("Blender besides {USUAL}"), found: Some(parts.join("; ")), problem: None }
}

fn check_package(distribution: &str, module: &str, purpose: &str) -> Check {
    let expected = REQUIREMENTS
        .lines()
        .find_map(|line| line.strip_prefix(distribution)?.strip_prefix("=="))
        .expect("requirements.txt pins every package that is checked");
    let version = format!("__import__('importlib.metadata').metadata.version('{distribution}')");
    let (found, cause) = match bridge::module_version(module, &version) {
        Ok(version) if version == expected => (Some(version), None),
        Ok(version) => {
            let cause = format!("version {version}, where {expected} is what the figures were checked with");
            (Some(version), Some(cause))
        }
        Err(cause) => (None, Some(cause)),
    };
    let problem = cause.map(|cause| Problem {
        cause,
        needed_for: purpose.to_owned(),
        remedy: format!(
            "Run make setup, or {} -m pip install {distribution}=={expected}.",
            bridge::interpreter().display()
        ),
    });
    Check { what: distribution.to_owned(), found, problem }
}

/// A folder that the program writes to, made where it is missing.
fn check_folder(what: &str, needed_for: &str, variable: &str, folder: Result<PathBuf>) -> Check {
    let usable = folder.and_then(|folder| {
        let fail = |cause: std::io::Error| Error::io(&folder, "a writable folder", &cause);
        std::fs::create_dir_all(&folder).map_err(fail)?;
        tempfile::tempfile_in(&folder).map_err(fail)?;
        Ok(folder)
    });
    let what = what.to_owned();
    match usable {
        Ok(folder) => Check { what, found: Some(folder.display().to_string()), problem: None },
        Err(error) => {
            let cause = format!("{}: {}", error.place, error.found);
            let remedy = format!("{} {variable} chooses another folder.", error.remedy);
            let problem = Problem { cause, needed_for: needed_for.to_owned(), remedy };
            Check { what, found: None, problem: Some(problem) }
        }
    }
}

fn describe(checks: &[Check]) -> String {
    let mut text = String::new();
    let width = checks.iter().map(|check| check.what.len()).max().unwrap_or_default();
    for Check { what, found, problem } in checks {
        let found = found.as_deref().unwrap_or("missing");
        writeln!(text, "{what:width$}  {found}").expect("writing to a string cannot fail");
        if let Some(Problem { cause, needed_for, remedy }) = problem {
            for (label, content) in [("cause", cause), ("needed for", needed_for), ("to do", remedy)] {
                writeln!(text, "{:width$}    {label}: {content}", "").expect("writing to a string cannot fail");
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_checked_package_is_pinned_and_every_pin_is_checked() {
        let pins: Vec<&str> = REQUIREMENTS.lines().filter_map(|line| Some(line.split_once("==")?.0)).collect();
        assert_eq!(pins.len(), PACKAGES.len());
        assert!(PACKAGES.iter().all(|(distribution, ..)| pins.contains(distribution)));
    }

    #[test]
    fn a_missing_package_says_what_to_do() {
        let check = Check {
            what: "bpy".into(),
            found: None,
            problem: Some(Problem { cause: "c".into(), needed_for: "n".into(), remedy: "make setup".into() }),
        };
        let text = describe(&[check]);
        assert!(text.starts_with("bpy  missing\n") && text.contains("to do: make setup"), "{text}");
    }
}
