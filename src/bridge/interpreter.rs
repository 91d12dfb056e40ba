//! Which Python runs, and why that one.
//!
//! An interpreter is a program: one that merely lies in a folder above the current one may be anybody's. So only these are run: the one
//! that the user names, that of the project that this program is of, and the one that the system finds.

use std::cell::RefCell;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Environment variable that names the interpreter.
pub const INTERPRETER_VARIABLE: &str = "CLOUDPARITY_PYTHON";

/// Where a project keeps its interpreter.
const PLACE: &str = ".venv/bin/python";

/// An interpreter and why it was chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// The program to run.
    pub path: PathBuf,
    /// Why it was chosen; an interpreter that was passed over is named.
    pub reason: String,
}

thread_local! {
    /// An interpreter for what this thread does meanwhile.
    static INSTEAD: RefCell<Option<PathBuf>> = const { RefCell::new(None) };
}

/// Does something with another interpreter in the place of the chosen one, on this thread.
pub(super) fn within<T>(path: PathBuf, work: impl FnOnce() -> T) -> T {
    /// What was there before comes back, however the work ends.
    struct Back(Option<PathBuf>);
    impl Drop for Back {
        fn drop(&mut self) {
            INSTEAD.set(self.0.take());
        }
    }
    let _back = Back(INSTEAD.replace(Some(path)));
    work()
}

/// Whether this thread has another interpreter in the place of the chosen one.
pub(super) fn is_replaced() -> bool {
    INSTEAD.with_borrow(Option::is_some)
}

/// A version of CPython, as 3.13.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Version(pub u32, pub u32);

impl fmt::Display for Version {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}.{}", self.0, self.1)
    }
}

impl Version {
    /// The environment variable that names an interpreter of this version to make environments with.
    pub fn variable(self) -> String {
        format!("{INTERPRETER_VARIABLE}_{}_{}", self.0, self.1)
    }
}

/// A program that is a CPython of a version and makes environments: what its variable names, the chosen interpreter, what the system
/// finds under the usual names, and what uv and pyenv have. Where there is none, what was looked at.
pub fn find(version: Version) -> std::result::Result<PathBuf, String> {
    let variable = version.variable();
    if let Some(named) = std::env::var_os(&variable) {
        let named = PathBuf::from(named);
        return if fits(&named, version) {
            Ok(named)
        } else {
            Err(format!("{}, which {variable} names", named.display()))
        };
    }
    let of_the_system = [format!("python{version}"), "python3".to_owned()].map(PathBuf::from);
    let own = choose_usual().path;
    let mut candidates = std::iter::once(own).chain(of_the_system).chain(of_uv(version)).chain(of_pyenv(version));
    let found = candidates.find(|python| fits(python, version));
    found.ok_or_else(|| {
        format!("{variable}, the interpreter here, python{version} and python3 of the system, uv, pyenv")
    })
}

/// Whether a program is a CPython of a version that makes environments.
fn fits(python: &Path, version: Version) -> bool {
    let code = "import sys, ensurepip, venv; print(sys.implementation.name, *sys.version_info[:2])";
    let answer = Command::new(python).args(["-I", "-B", "-c", code]).stderr(Stdio::null()).output();
    let wanted = format!("cpython {} {}", version.0, version.1);
    answer.is_ok_and(|answer| answer.status.success() && String::from_utf8_lossy(&answer.stdout).trim() == wanted)
}

/// What uv has of a version.
fn of_uv(version: Version) -> Option<PathBuf> {
    let mut command = Command::new("uv");
    // Nothing is fetched on the way.
    command.env("UV_PYTHON_DOWNLOADS", "never");
    command.args(["python", "find", &version.to_string()]).stderr(Stdio::null());
    let answer = command.output().ok().filter(|answer| answer.status.success())?;
    let path = String::from_utf8_lossy(&answer.stdout).trim().to_owned();
    (!path.is_empty()).then(|| PathBuf::from(path))
}

/// What pyenv has of a version, newest first.
fn of_pyenv(version: Version) -> Vec<PathBuf> {
    let root = std::env::var_os("PYENV_ROOT").map(PathBuf::from);
    let Some(root) = root.or_else(|| std::env::home_dir().map(|home| home.join(".pyenv"))) else { return Vec::new() };
    let patch_of = |folder: &PathBuf| -> Option<u32> {
        folder.file_name()?.to_str()?.strip_prefix(&format!("{version}."))?.parse().ok()
    };
    let folders = std::fs::read_dir(root.join("versions")).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> = folders.filter(|folder| patch_of(folder).is_some()).collect();
    found.sort_by_key(|folder| std::cmp::Reverse(patch_of(folder)));
    found.into_iter().map(|folder| folder.join("bin").join(format!("python{version}"))).collect()
}

/// The version of a package that is installed in the environment of an interpreter, told by its folders and without a start of Python;
/// none where it has no environment of its own.
pub fn installed_beside(python: &Path, package: &str) -> Option<String> {
    let library = python.parent()?.parent()?.join("lib");
    let folders = |at: &Path| std::fs::read_dir(at).into_iter().flatten().flatten().map(|entry| entry.path());
    let name_of = |path: &Path| Some(path.file_name()?.to_str()?.to_owned());
    folders(&library)
        .filter(|folder| name_of(folder).is_some_and(|name| name.starts_with("python")))
        .flat_map(|folder| folders(&folder.join("site-packages")))
        .find_map(|path| {
            Some(name_of(&path)?.strip_prefix(&format!("{package}-"))?.strip_suffix(".dist-info")?.to_owned())
        })
}

/// The interpreter: what `CLOUDPARITY_PYTHON` names, else the `.venv` of the project, else `python3`.
///
/// The project is the folder that this program was built from, or the folder of cloudparity's sources that the running program lies in. Its
/// `.venv` is used where it belongs to the user (or to the system's administrator) and not everybody may write to either.
pub fn choose() -> Choice {
    if let Some(path) = INSTEAD.with_borrow(Clone::clone) {
        return Choice { path, reason: "it is that of another release".into() };
    }
    choose_usual()
}

/// [`choose`], whatever this thread has in its place meanwhile.
pub(super) fn choose_usual() -> Choice {
    if let Some(path) = std::env::var_os(INTERPRETER_VARIABLE) {
        return Choice { path: PathBuf::from(path), reason: format!("{INTERPRETER_VARIABLE} names it") };
    }
    let program = std::env::current_exe().ok();
    choose_among(Path::new(env!("CARGO_MANIFEST_DIR")), program.as_deref())
}

fn choose_among(source: &Path, program: Option<&Path>) -> Choice {
    let around =
        program.into_iter().flat_map(|program| program.ancestors().skip(1)).filter(|folder| is_project(folder));
    let candidates = std::iter::once((source, "the program was built from"))
        .chain(around.map(|folder| (folder, "the program lies in")))
        .filter(|(folder, _)| folder.join(PLACE).exists());
    let mut passed_over = String::new();
    for (folder, whose) in candidates {
        match doubt(folder) {
            None => {
                let reason = format!("it belongs to the project that {whose}, {}{passed_over}", folder.display());
                return Choice { path: folder.join(PLACE), reason };
            }
            Some(doubt) => passed_over += &format!("; {} is passed over: {doubt}", folder.join(".venv").display()),
        }
    }
    Choice {
        path: "python3".into(),
        reason: format!("{INTERPRETER_VARIABLE} names none and the project has no .venv to use{passed_over}"),
    }
}

/// Whether a folder holds the sources of this program.
fn is_project(folder: &Path) -> bool {
    std::fs::read_to_string(folder.join("Cargo.toml"))
        .ok()
        .and_then(|text| toml::from_str::<toml::Table>(&text).ok())
        .is_some_and(|manifest| {
            manifest.get("package").and_then(|package| package.get("name")?.as_str()) == Some(env!("CARGO_PKG_NAME"))
        })
}

/// Why the `.venv` of a project is not to be run; nothing where it may be.
#[cfg(unix)]
fn doubt(project: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt;
    const OTHERS_WRITE: u32 = 0o002;
    let user = rustix::process::geteuid().as_raw();
    // Each as what it leads to: a link to another folder is as good as that folder. The interpreter itself is often the system's. Sources may be
    // another user's, as where a container works on a folder of its host: who ran what they build trusts their owner.
    ["", ".venv", ".venv/bin", PLACE].iter().find_map(|name| {
        let path = project.join(name);
        match std::fs::metadata(&path) {
            Err(cause) => Some(format!("{}: {cause}", path.display())),
            Ok(found) if !name.is_empty() && found.uid() != user && found.uid() != 0 => {
                Some(format!("{} belongs to another user", path.display()))
            }
            Ok(found) if found.mode() & OTHERS_WRITE != 0 => {
                Some(format!("every user may write to {}", path.display()))
            }
            Ok(_) => None,
        }
    })
}

/// Other systems keep the folders of users apart by themselves.
#[cfg(not(unix))]
fn doubt(_project: &Path) -> Option<String> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn interpreter_in(folder: &Path) {
        std::fs::create_dir_all(folder.join(".venv/bin")).expect("a temporary folder");
        std::fs::write(folder.join(PLACE), "").expect("a temporary file");
    }

    fn manifest(folder: &Path, name: &str) {
        std::fs::write(folder.join("Cargo.toml"), format!("[package]\nname = \"{name}\"\n")).expect("a temporary file");
    }

    #[test]
    fn only_the_projects_own_interpreter_is_chosen() {
        let temporary = tempfile::tempdir().expect("a folder");
        let [source, other] = ["source", "other"].map(|name| temporary.path().join(name));
        let program = other.join("target/release/cloudparity");
        std::fs::create_dir_all(&source).expect("a folder");
        interpreter_in(&other);
        // A .venv above the program that is no project's, then one of another project's.
        assert_eq!(choose_among(&source, Some(&program)).path, Path::new("python3"));
        manifest(&other, "another");
        assert_eq!(choose_among(&source, Some(&program)).path, Path::new("python3"));
        manifest(&other, "cloudparity");
        let found = choose_among(&source, Some(&program));
        assert_eq!(found.path, other.join(PLACE));
        assert!(found.reason.contains("the program lies in"), "{}", found.reason);
        interpreter_in(&source);
        assert_eq!(choose_among(&source, Some(&program)).path, source.join(PLACE));
        assert_eq!(choose_among(&source, None).path, source.join(PLACE));
    }

    #[test]
    fn packages_are_told_by_their_folders() {
        let temporary = tempfile::tempdir().expect("a folder");
        let python = temporary.path().join("bin/python");
        assert_eq!(installed_beside(&python, "bpy"), None);
        let packages = temporary.path().join("lib/python3.13/site-packages");
        std::fs::create_dir_all(packages.join("bpy-5.3.0.dist-info")).expect("a folder");
        std::fs::create_dir_all(packages.join("bpy")).expect("a folder");
        assert_eq!(installed_beside(&python, "bpy").as_deref(), Some("5.3.0"));
        assert_eq!(installed_beside(&python, "numpy"), None);
    }

    #[test]
    fn an_interpreter_that_is_named_is_the_only_one() {
        assert_eq!(Version(3, 13).variable(), "CLOUDPARITY_PYTHON_3_13");
        assert!(!fits(Path::new("/dev/null"), Version(3, 13)));
        assert!(!fits(Path::new("true"), Version(3, 13)));
    }

    #[test]
    fn an_interpreter_that_others_may_change_is_passed_over() {
        let temporary = tempfile::tempdir().expect("a folder");
        let source = temporary.path().join("source");
        interpreter_in(&source);
        let allow = |mode| std::fs::set_permissions(source.join(".venv/bin"), std::fs::Permissions::from_mode(mode));
        allow(0o777).expect("a mode");
        let found = choose_among(&source, None);
        assert_eq!(found.path, Path::new("python3"));
        assert!(found.reason.contains("every user may write"), "{}", found.reason);
        allow(0o755).expect("a mode");
        assert_eq!(choose_among(&source, None).path, source.join(PLACE));
        // Only root can give files away: sources of another user are as good, an interpreter of theirs is not.
        let give = |path: &Path| std::os::unix::fs::chown(path, Some(12345), None);
        if give(&source).is_ok() {
            assert_eq!(choose_among(&source, None).path, source.join(PLACE));
            give(&source.join(".venv")).expect("root may");
            let found = choose_among(&source, None);
            assert_eq!(found.path, Path::new("python3"));
            assert!(found.reason.contains("belongs to another user"), "{}", found.reason);
        }
    }
}
