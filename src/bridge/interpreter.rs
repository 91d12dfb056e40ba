//! Which Python runs, and why that one.
//!
//! An interpreter is a program: one that merely lies in a folder above the current one may be anybody's. So only these are run: the one
//! that the user names, that of the project that this program is of, and the one that the system finds.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

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

/// The interpreter: what `CLOUDPARITY_PYTHON` names, else the `.venv` of the project, else `python3`.
///
/// The project is the folder that this program was built from, or the folder of cloudparity's sources that the running program lies in. Its
/// `.venv` is used where it belongs to the user (or to the system's administrator) and not everybody may write to either.
pub fn choose() -> Choice {
    if let Some(path) = INSTEAD.with_borrow(Clone::clone) {
        return Choice { path, reason: "it is that of another release".into() };
    }
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
