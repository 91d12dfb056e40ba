//! Files: atomic writing, reading with a place in the error, and content hashes.

use crate::base::error::{Error, Result};
use sha2::{Digest, Sha256};
#[cfg(feature = "tools")]
use std::io::Read;
use std::io::Write;
use std::path::Path;

/// Writes `bytes` to `path` through a temporary file in the same folder and a rename, so that a
/// reader sees the old file or the whole new one, never a part.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    replace_atomically(path, |temporary| {
        std::fs::File::create(temporary).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
    })
}

/// Says that files are not written without the feature `tools`.
#[cfg(not(feature = "tools"))]
pub fn replace_atomically(path: &Path, _write: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<()> {
    let cause = std::io::Error::from(std::io::ErrorKind::Unsupported);
    Err(Error::io(path, "a library with the feature tools, which writes files", &cause))
}

/// Lets `write` fill a temporary file beside `path`, then renames it to `path`.
#[cfg(feature = "tools")]
pub fn replace_atomically(path: &Path, write: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let fail = |cause: &std::io::Error| Error::io(path, "a writable file", cause);
    std::fs::create_dir_all(folder).map_err(|cause| fail(&cause))?;
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    let temporary = tempfile::Builder::new()
        .prefix(TEMPORARY)
        .suffix(&extension)
        .tempfile_in(folder)
        .map_err(|cause| fail(&cause))?
        .into_temp_path();
    write(&temporary).map_err(|cause| fail(&cause))?;
    // Temporary files are private; the result gets the permissions of an ordinary new file.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(&temporary, std::fs::Permissions::from_mode(0o644)).map_err(|cause| fail(&cause))?;
    }
    temporary.persist(path).map_err(|cause| fail(&cause.error))
}

/// Beginning of the names of temporary files.
const TEMPORARY: &str = ".cloudparity-";

/// Removes what processes that were killed left while they wrote, in a folder and in those directly below it. Nobody may be writing there.
pub fn remove_temporary(folder: &Path) -> Result<()> {
    let fail = |cause: &std::io::Error| Error::io(folder, "a folder that can be read and written", cause);
    let mut folders = vec![folder.to_owned()];
    for entry in std::fs::read_dir(folder).map_err(|cause| fail(&cause))? {
        let path = entry.map_err(|cause| fail(&cause))?.path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    for folder in folders {
        for entry in std::fs::read_dir(&folder).map_err(|cause| fail(&cause))? {
            let entry = entry.map_err(|cause| fail(&cause))?;
            if entry.file_name().to_string_lossy().starts_with(TEMPORARY) && entry.path().is_file() {
                std::fs::remove_file(entry.path()).map_err(|cause| fail(&cause))?;
            }
        }
    }
    Ok(())
}

/// Reads a text file.
pub fn read_text(path: &Path, expected: &str) -> Result<String> {
    std::fs::read_to_string(path).map_err(|cause| Error::io(path, expected, &cause))
}

/// SHA-256 of `bytes` as 64 hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Refuses a `.npy` file whose header announces more values than the file has bytes for: the reader
/// would ask for the memory first, and not getting it ends the program.
#[cfg(feature = "tools")]
fn check_announced_size(path: &Path) -> Result<()> {
    let fail = |cause: &std::io::Error| Error::io(path, "a float32 .npy file", cause);
    let mut file = std::fs::File::open(path).map_err(|cause| fail(&cause))?;
    let size = file.metadata().map_err(|cause| fail(&cause))?.len();
    // Longer headers than this belong to structured types, which the reader refuses.
    let mut start = Vec::new();
    std::io::Read::take(&mut file, 4096).read_to_end(&mut start).map_err(|cause| fail(&cause))?;
    let header = String::from_utf8_lossy(&start);
    let shape = header.split_once("shape").and_then(|(_, rest)| rest.split_once('(')?.1.split_once(')'));
    let Some((shape, _)) = shape else { return Ok(()) };
    let lengths = shape.split(',').map(str::trim).filter(|length| !length.is_empty());
    let values = lengths.map(|length| length.parse::<u64>().unwrap_or(0)).fold(1_u64, u64::saturating_mul);
    if values.saturating_mul(4) > size {
        return Err(Error::new(
            path.display().to_string(),
            format!("{size} bytes for an array of shape ({shape})"),
            "as many float32 values as the header announces",
            "Write the file again; it is cut short or damaged.",
        ));
    }
    Ok(())
}

/// Reads a float32 `.npy` file of shape `[n, 3]`.
#[cfg(feature = "tools")]
pub fn read_points(path: &Path) -> Result<Vec<[f32; 3]>> {
    check_announced_size(path)?;
    let array: ndarray::Array2<f32> = ndarray_npy::read_npy(path).map_err(|cause| {
        Error::new(
            path.display().to_string(),
            cause.to_string(),
            "a float32 .npy file of shape [n, 3] in C order",
            "Write it with numpy.save(path, points.astype(numpy.float32)).",
        )
    })?;
    if array.ncols() != 3 {
        return Err(Error::new(
            path.display().to_string(),
            format!("an array of shape {:?}", array.shape()),
            "shape [n, 3]",
            "Give one row of x, y, z per point, in the frame of the volume's object.",
        ));
    }
    Ok(array.rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect())
}

/// Writes float32 values as `.npy`: shape `[n]` for one component, else `[n, components]`.
#[cfg(feature = "tools")]
pub fn write_values(path: &Path, values: &[f32], components: usize) -> Result<()> {
    let count = values.len() / components;
    let shape: Vec<usize> = if components == 1 { vec![count] } else { vec![count, components] };
    let array = ndarray::ArrayD::from_shape_vec(shape, values.to_vec())
        .expect("the length is a multiple of the components by construction");
    write_array(path, &array)
}

/// Writes a float32 array as `.npy`.
#[cfg(feature = "tools")]
pub fn write_array<D: ndarray::Dimension>(path: &Path, array: &ndarray::Array<f32, D>) -> Result<()> {
    replace_atomically(path, |temporary| ndarray_npy::write_npy(temporary, array).map_err(std::io::Error::other))
}

/// Reads any float32 `.npy` file as its flat values and shape.
#[cfg(feature = "tools")]
pub fn read_values(path: &Path) -> Result<(Vec<f32>, Vec<usize>)> {
    check_announced_size(path)?;
    let array: ndarray::ArrayD<f32> = ndarray_npy::read_npy(path).map_err(|cause| {
        Error::new(path.display().to_string(), cause.to_string(), "a float32 .npy file", "Run the step again.")
    })?;
    let shape = array.shape().to_vec();
    Ok((array.iter().copied().collect(), shape))
}

/// A file that a process has locked. The system releases it when the process ends, however that comes about.
pub struct Lock(#[expect(dead_code, reason = "held open")] std::fs::File);

impl Lock {
    /// Takes a folder for this process alone, or says that another process works in it.
    pub fn take(folder: &Path) -> Result<Self> {
        let (file, path) = Self::open(folder, "lock")?;
        Self::or_taken(file.try_lock(), folder, &path)?;
        Ok(Self(file))
    }

    /// Takes a folder together with others that share it, or says that a process has it alone.
    pub fn share(folder: &Path) -> Result<Self> {
        let (file, path) = Self::open(folder, "lock")?;
        Self::or_taken(file.try_lock_shared(), folder, &path)?;
        Ok(Self(file))
    }

    /// Takes a name in a folder, which is made where it is missing; waits while another process has it.
    pub fn wait(folder: &Path, name: &str) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|cause| Error::io(folder, "a folder for locks", &cause))?;
        let (file, path) = Self::open(folder, name)?;
        file.lock().map_err(|cause| Error::io(&path, "a file to lock", &cause))?;
        Ok(Self(file))
    }

    fn open(folder: &Path, name: &str) -> Result<(std::fs::File, std::path::PathBuf)> {
        let path = folder.join(name);
        let file = std::fs::File::create(&path).map_err(|cause| Error::io(&path, "a file to lock", &cause))?;
        Ok((file, path))
    }

    fn or_taken(locked: std::result::Result<(), std::fs::TryLockError>, folder: &Path, path: &Path) -> Result<()> {
        match locked {
            Ok(()) => Ok(()),
            Err(std::fs::TryLockError::WouldBlock) => Err(Error::new(
                folder.display().to_string(),
                "another process that works in this folder",
                "one at a time: what is measured beside something else is measured wrongly",
                "Wait for it, or take another folder.",
            )),
            Err(std::fs::TryLockError::Error(cause)) => Err(Error::io(path, "a file to lock", &cause)),
        }
    }
}

/// A setting as JSON, for provenance.
pub fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("settings serialise")
}
