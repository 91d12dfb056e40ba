//! Temporary folders, which a later run removes where this one is killed.

use crate::base::error::{Error, Result};
use crate::base::files::Lock;
use std::path::Path;
use std::sync::Once;

/// Beginning of their names; the process's number follows.
const PREFIX: &str = "cloudparity-run-";

/// A folder that is gone with its value, or with the next run of the program if this process is
/// killed.
#[derive(Debug)]
pub struct TemporaryFolder {
    // Before the folder: released before it is removed.
    _lock: Lock,
    folder: tempfile::TempDir,
}

impl TemporaryFolder {
    /// Its path.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Makes a temporary folder; the first time, it also removes what killed processes left.
pub fn folder() -> Result<TemporaryFolder> {
    static SWEPT: Once = Once::new();
    let place = std::env::temp_dir();
    SWEPT.call_once(|| sweep(&place));
    make(&place, std::process::id())
}

fn make(place: &Path, process: u32) -> Result<TemporaryFolder> {
    let folder =
        tempfile::Builder::new().prefix(&format!("{PREFIX}{process}-")).tempdir_in(place).map_err(|cause| {
            Error::new(
                place.display().to_string(),
                cause.to_string(),
                "a folder for temporary files",
                "Make room, or set TMPDIR to another folder.",
            )
        })?;
    Ok(TemporaryFolder { _lock: Lock::take(folder.path())?, folder })
}

/// Removes the folders of this module whose process has ended. What cannot be told or removed
/// stays.
fn sweep(place: &Path) {
    let Ok(entries) = std::fs::read_dir(place) else { return };
    for path in entries.flatten().map(|entry| entry.path()).filter(|path| is_left(path)) {
        let _ = std::fs::remove_dir_all(path);
    }
}

/// Whether a path is a folder of a process of this user that has ended. A number may belong to a
/// process of a container that shares the folder: what is alive holds the lock, whatever its
/// number.
fn is_left(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let number = name.strip_prefix(PREFIX).and_then(|rest| rest.split_once('-')).map(|(number, _)| number.parse());
    let (Some(Ok(process)), Ok(metadata)) = (number, std::fs::symlink_metadata(path)) else { return false };
    metadata.is_dir() && is_own(&metadata) && has_ended(process) && path.join(Lock::NAME).is_file() && {
        Lock::take(path).is_ok()
    }
}

#[cfg(unix)]
fn is_own(metadata: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    metadata.uid() == rustix::process::getuid().as_raw()
}

#[cfg(unix)]
fn has_ended(process: i32) -> bool {
    let found = rustix::process::Pid::from_raw(process).map(rustix::process::test_kill_process);
    found == Some(Err(rustix::io::Errno::SRCH))
}

/// Nothing is known of the owners of files there.
#[cfg(not(unix))]
fn is_own(_: &std::fs::Metadata) -> bool {
    false
}

#[cfg(not(unix))]
fn has_ended(_: i32) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// The number of a process that has ended.
    fn ended() -> u32 {
        let mut child = std::process::Command::new("true").spawn().expect("a process");
        child.wait().expect("it ends");
        child.id()
    }

    #[test]
    fn what_a_dead_process_left_is_removed_and_nothing_else() {
        let place = tempfile::tempdir().expect("a folder");
        let path = |name: String| place.path().join(name);
        let dead = ended();
        let left = make(place.path(), dead).expect("a folder");
        let left_path = left.path().to_owned();
        std::fs::write(left_path.join("points.npy"), "points").expect("written");
        // Of a process that ended, and yet locked: a container's.
        let held = make(place.path(), dead).expect("a folder");
        let mine = make(place.path(), std::process::id()).expect("a folder");
        let foreign = ["cloudparity-run-x-1", "cloudparity-run-", "cloudparity-other", "cloudparity-run-5"];
        for name in foreign {
            std::fs::create_dir(path(name.into())).expect("a folder");
        }
        // One that was being made when its process ended has no lock yet, and nothing in it.
        std::fs::create_dir(path(format!("{PREFIX}{dead}-unlocked"))).expect("a folder");
        std::fs::write(path(format!("{PREFIX}{dead}-file")), "a file").expect("written");
        let elsewhere = tempfile::tempdir().expect("a folder");
        std::fs::write(elsewhere.path().join(Lock::NAME), "").expect("written");
        std::os::unix::fs::symlink(elsewhere.path(), path(format!("{PREFIX}{dead}-link"))).expect("a link");
        // As a killed process leaves it: the lock is released, the folder stays.
        let TemporaryFolder { _lock, folder } = left;
        drop(_lock);
        let _ = folder.keep();
        sweep(place.path());
        assert!(!left_path.exists());
        assert!(held.path().exists() && mine.path().exists() && elsewhere.path().join(Lock::NAME).exists());
        assert_eq!(std::fs::read_dir(place.path()).expect("read").count(), 2 + foreign.len() + 3);
    }
}
