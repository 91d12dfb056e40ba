//! Files: atomic writing, reading with a place in the error, and content hashes.

use crate::base::error::{Error, Result};
use sha2::{Digest, Sha256};
use std::io::{Read, Write};
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

/// Lets `write` fill a temporary file, which then takes the place of `path`. Links are followed; a
/// device or a pipe is written to ([`crate::base::destination::Destination`]).
#[cfg(feature = "tools")]
pub fn replace_atomically(path: &Path, write: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<()> {
    crate::base::destination::write(path, write)
}

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
            if entry.file_name().to_string_lossy().starts_with(super::destination::TEMPORARY) && entry.path().is_file()
            {
                std::fs::remove_file(entry.path()).map_err(|cause| fail(&cause))?;
            }
        }
    }
    Ok(())
}

/// Bytes of a text file at most, in MiB. Files name each other, and a name may lead to a device that never ends; a scene with a mesh of
/// three million vertices is as long.
const LONGEST_TEXT: u64 = 256;

/// Refuses what is no ordinary file as an input: a folder; a pipe, for whose writer reading would
/// wait; a device, which has no end. A path where nothing is passes.
pub fn check_input(path: &Path, expected: &str) -> Result<()> {
    let found = std::fs::metadata(path).ok().and_then(|metadata| super::destination::special(&metadata));
    let Some(found) = found else { return Ok(()) };
    let remedy = if found == "a folder" { "Name the file in it." } else { "Write it to a file, and name that." };
    Err(Error::new(path.display().to_string(), found, expected, remedy))
}

/// Makes a folder, and those above it, where it is not there; what else is there is an error.
pub fn make_folder(path: &Path, expected: &str) -> Result<()> {
    match std::fs::metadata(path).ok().filter(|metadata| !metadata.is_dir()) {
        None => std::fs::create_dir_all(path).map_err(|cause| Error::io(path, expected, &cause)),
        Some(metadata) => {
            let found = super::destination::special(&metadata).unwrap_or("a file");
            Err(Error::new(path.display().to_string(), found, expected, "Name another folder."))
        }
    }
}

/// Opens an ordinary file to be read.
pub fn open_input(path: &Path, expected: &str) -> Result<std::fs::File> {
    check_input(path, expected)?;
    std::fs::File::open(path).map_err(|cause| Error::io(path, expected, &cause))
}

/// Reads an ordinary file.
pub fn read_bytes(path: &Path, expected: &str) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_input(path, expected)?.read_to_end(&mut bytes).map_err(|cause| Error::io(path, expected, &cause))?;
    Ok(bytes)
}

/// What some editors write before a text in UTF-8.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Reads a text file, without a byte order mark.
pub fn read_text(path: &Path, expected: &str) -> Result<String> {
    let fail = |cause: &std::io::Error| Error::io(path, expected, cause);
    let file = open_input(path, expected)?;
    let most = LONGEST_TEXT << 20;
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes).map_err(|cause| fail(&cause))?;
    if bytes.len() as u64 > most {
        return Err(Error::new(
            path.display().to_string(),
            format!("more than {LONGEST_TEXT} MiB"),
            format!("{expected}, of at most {LONGEST_TEXT} MiB"),
            "Name the right file, or split what it holds.",
        ));
    }
    let mut text = String::from_utf8(bytes).map_err(|_| {
        fail(&std::io::Error::new(std::io::ErrorKind::InvalidData, "stream did not contain valid UTF-8"))
    })?;
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len_utf8());
    }
    Ok(text)
}

/// SHA-256 of `bytes` as 64 hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Bytes of the header of a float32 `.npy` file at most; `numpy.save` writes 118.
#[cfg(feature = "tools")]
const LONGEST_HEADER: u64 = 4096;

/// Refuses a `.npy` file whose header would take the reader more than the file is worth: it asks for the memory of the header and of the
/// values that are announced before it reads them, and not getting it ends the program; it parses brackets within brackets by recursion.
/// What is refused here `numpy.save` never writes for numbers.
#[cfg(feature = "tools")]
fn check_header(path: &Path) -> Result<()> {
    let fail = |cause: &std::io::Error| Error::io(path, "a float32 .npy file", cause);
    let refused = |found: String, expected: String| {
        let remedy = "Write the file again with numpy.save; it is cut short or damaged.";
        Err(Error::new(path.display().to_string(), found, expected, remedy))
    };
    let mut file = open_input(path, "a float32 .npy file")?;
    let size = file.metadata().map_err(|cause| fail(&cause))?.len();
    let mut start = Vec::new();
    (&mut file).take(LONGEST_HEADER + 12).read_to_end(&mut start).map_err(|cause| fail(&cause))?;
    // Six bytes of a mark, two of a version, two or four of the header's length.
    let (length, begin) = match start.as_slice() {
        [_, _, _, _, _, _, 1, _, a, b, ..] => (u64::from(u16::from_le_bytes([*a, *b])), 10),
        [_, _, _, _, _, _, 2 | 3, _, a, b, c, d, ..] => (u64::from(u32::from_le_bytes([*a, *b, *c, *d])), 12),
        // The reader says what is wrong with it.
        _ => return Ok(()),
    };
    if length > LONGEST_HEADER {
        return refused(format!("a header of {length} bytes"), format!("one of at most {LONGEST_HEADER}"));
    }
    let header = String::from_utf8_lossy(&start[begin..start.len().min(begin + length as usize)]).into_owned();
    // A name that is spelled with escapes, or a second shape, would be another one than is checked here.
    let shape = match header.split_once("shape").and_then(|(_, rest)| rest.split_once('(')?.1.split_once(')')) {
        Some((shape, rest)) if !header.contains('\\') && !rest.contains("shape") => shape,
        _ => return refused("a header without one shape".into(), "what numpy.save writes".into()),
    };
    if header.matches(['(', '[', '{']).count() > 8 {
        return refused("a header with more than 8 brackets".into(), "what numpy.save writes for numbers".into());
    }
    let lengths = shape.split(',').map(str::trim).filter(|length| !length.is_empty());
    let lengths: Option<Vec<u64>> = lengths.map(|length| length.parse().ok()).collect();
    let product = |lengths: &[u64]| lengths.iter().fold(4, |product: u64, length| product.saturating_mul(*length));
    match lengths {
        // Beside a length of 0 the others may be anything, and yet no array has them.
        Some(lengths) if product(&lengths) <= size && lengths.iter().all(|length| *length <= size) => Ok(()),
        Some(_) => refused(
            format!("{size} bytes for an array of shape ({shape})"),
            "as many float32 values as the header announces".into(),
        ),
        None => refused(format!("an array of shape ({shape})"), "whole numbers in decimal digits".into()),
    }
}

/// Reads a float32 `.npy` file of shape `[n, 3]`.
#[cfg(feature = "tools")]
pub fn read_points(path: &Path) -> Result<Vec<[f32; 3]>> {
    check_header(path)?;
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
    check_header(path)?;
    let array: ndarray::ArrayD<f32> = ndarray_npy::read_npy(path).map_err(|cause| {
        Error::new(path.display().to_string(), cause.to_string(), "a float32 .npy file", "Run the step again.")
    })?;
    let shape = array.shape().to_vec();
    Ok((array.iter().copied().collect(), shape))
}

/// A file that a process has locked. The system releases it when the process ends, however that comes about.
#[derive(Debug)]
pub struct Lock(#[expect(dead_code, reason = "held open")] std::fs::File);

impl Lock {
    /// Name of the file by which a folder is taken.
    pub(super) const NAME: &str = "lock";

    /// Takes a folder for this process alone, or says that another process works in it.
    pub fn take(folder: &Path) -> Result<Self> {
        let (file, path) = Self::open(folder, Self::NAME)?;
        Self::or_taken(file.try_lock(), folder, &path)?;
        Ok(Self(file))
    }

    /// Takes a folder together with others that share it, or says that a process has it alone.
    pub fn share(folder: &Path) -> Result<Self> {
        let (file, path) = Self::open(folder, Self::NAME)?;
        Self::or_taken(file.try_lock_shared(), folder, &path)?;
        Ok(Self(file))
    }

    /// Takes a name in a folder, which is made where it is missing; waits while another process has it.
    pub fn wait(folder: &Path, name: &str) -> Result<Self> {
        make_folder(folder, "a folder for locks")?;
        let (file, path) = Self::open(folder, name)?;
        file.lock().map_err(|cause| Error::io(&path, "a file to lock", &cause))?;
        Ok(Self(file))
    }

    fn open(folder: &Path, name: &str) -> Result<(std::fs::File, std::path::PathBuf)> {
        let path = folder.join(name);
        check_input(&path, "a file to lock")?;
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
