//! What stands where an output is to go, and writing there: an ordinary file is replaced as a
//! whole, a device or a pipe is written to.
//!
//! The same rule for Python is `scene_io.replaced_file`.

use crate::base::error::{Error, Result};
use std::fs::Metadata;
use std::io::Error as IoError;
use std::path::{Path, PathBuf};

/// Links that are followed at most, as Linux has it.
const MOST_LINKS: usize = 40;

/// Where an output goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Destination {
    /// A file, new or to be replaced; links on the way to it are followed.
    File(PathBuf),
    /// A device, a pipe, or what the program has open already (`/dev/stdout`): it stays, and the
    /// bytes go into it.
    Stream(PathBuf),
}

/// What is no ordinary file, in words; none for one.
pub(super) fn special(metadata: &Metadata) -> Option<&'static str> {
    let kind = metadata.file_type();
    if kind.is_file() || kind.is_symlink() {
        return None;
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let named = [
            (kind.is_fifo(), "a pipe"),
            (kind.is_socket(), "a socket"),
            (kind.is_char_device(), "a device"),
            (kind.is_block_device(), "a disk"),
        ];
        if let Some((_, name)) = named.into_iter().find(|(is_it, _)| *is_it) {
            return Some(name);
        }
    }
    Some(if kind.is_dir() { "a folder" } else { "no file" })
}

impl Destination {
    /// Follows links from `path`. A folder, a socket, a disk and a loop of links are errors.
    pub fn find(path: &Path) -> Result<Self> {
        let fail = |cause: &IoError| Error::io(path, "a writable file", cause);
        let mut place = path.to_owned();
        for _ in 0..MOST_LINKS {
            let metadata = match std::fs::symlink_metadata(&place) {
                Ok(metadata) => metadata,
                Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => return Ok(Self::File(place)),
                Err(cause) => return Err(fail(&cause)),
            };
            if !metadata.is_symlink() {
                return Self::of(path, place, &metadata);
            }
            if is_open_file(&place) {
                // Its text is no path: `pipe:[4026]`, or the name of a file that has gone.
                let metadata = std::fs::metadata(&place).map_err(|cause| fail(&cause))?;
                return match metadata.is_file() {
                    true => Ok(Self::Stream(place)),
                    false => Self::of(path, place, &metadata),
                };
            }
            let target = std::fs::read_link(&place).map_err(|cause| fail(&cause))?;
            place = place.parent().unwrap_or(Path::new("")).join(target);
        }
        Err(wrong(path, "links that lead in a circle"))
    }

    fn of(path: &Path, place: PathBuf, metadata: &Metadata) -> Result<Self> {
        match special(metadata) {
            None => Ok(Self::File(place)),
            Some("a pipe" | "a device") => Ok(Self::Stream(place)),
            Some(other) => Err(wrong(path, other)),
        }
    }
}

fn wrong(path: &Path, found: &str) -> Error {
    Error::new(
        path.display().to_string(),
        found,
        "a writable file, a pipe that is read, or a device such as /dev/null",
        "Name a file to write.",
    )
}

/// Whether a link stands for a file that a process has open, as `/proc/self/fd/1`.
fn is_open_file(link: &Path) -> bool {
    let folder = link.parent().and_then(|folder| std::fs::canonicalize(folder).ok());
    folder.is_some_and(|folder| folder.starts_with("/proc") && folder.ends_with("fd"))
}

/// Lets `write` fill a temporary file, whose content then goes to `path`. On failure what is at
/// `path` stays as it is, and nothing else is left.
#[cfg(feature = "tools")]
pub(super) fn write(path: &Path, write: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<()> {
    let fail = |cause: &IoError| Error::io(path, "a writable file", cause);
    match Destination::find(path)? {
        Destination::File(target) => replace(&target, write).map_err(|cause| fail(&cause)),
        Destination::Stream(stream) => {
            let folder = tempfile::tempdir()
                .map_err(|cause| Error::io(&std::env::temp_dir(), "a folder for temporary files", &cause))?;
            let whole = folder.path().join(path.file_name().unwrap_or("stream".as_ref()));
            write(&whole).map_err(|cause| fail(&cause))?;
            copy(&whole, &stream).map_err(|cause| match cause.raw_os_error() == NO_READER {
                true => wrong(path, "a pipe that nobody reads"),
                false => fail(&cause),
            })
        }
    }
}

/// Beginning of the names of temporary files.
pub(super) const TEMPORARY: &str = ".cloudparity-";

/// A rename in the folder of the target, so that a reader sees the old file or the whole new one.
#[cfg(feature = "tools")]
fn replace(target: &Path, write: impl FnOnce(&Path) -> std::io::Result<()>) -> std::io::Result<()> {
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder)?;
    let extension = target.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    let temporary = tempfile::Builder::new().prefix(TEMPORARY).suffix(&extension).tempfile_in(folder)?.into_temp_path();
    write(&temporary)?;
    // Writers of formats may leave their last bytes to a buffer whose end nobody watches: a full
    // disk shows here.
    std::fs::OpenOptions::new().write(true).open(&temporary)?.sync_all()?;
    // Temporary files are private; the result has the permissions of the file that it replaces, or
    // of an ordinary new one.
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, PermissionsExt};
        let mode = std::fs::metadata(target).map_or(0o644, |metadata| metadata.mode() & 0o777);
        std::fs::set_permissions(&temporary, std::fs::Permissions::from_mode(mode))?;
    }
    temporary.persist(target).map_err(|cause| cause.error)
}

/// What opening a pipe without a reader answers.
#[cfg(all(unix, feature = "tools"))]
const NO_READER: Option<i32> = Some(rustix::io::Errno::NXIO.raw_os_error());
/// No other system has such pipes.
#[cfg(all(not(unix), feature = "tools"))]
const NO_READER: Option<i32> = Some(i32::MIN);

#[cfg(feature = "tools")]
fn copy(whole: &Path, stream: &Path) -> std::io::Result<()> {
    use std::io::Write;
    let mut options = std::fs::OpenOptions::new();
    options.append(true);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        // Opening a pipe would otherwise wait for its reader.
        options.custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32);
    }
    let mut stream = options.open(stream)?;
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        // Writing waits for the reader.
        let flags = rustix::fs::fcntl_getfl(&stream)?;
        rustix::fs::fcntl_setfl(&stream, flags - OFlags::NONBLOCK)?;
    }
    std::io::copy(&mut std::fs::File::open(whole)?, &mut stream)?;
    stream.flush()
}
