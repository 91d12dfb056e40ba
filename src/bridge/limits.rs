//! How long and with how much memory a script may read a file of the user's.
//!
//! Libraries that read a damaged file may never end, or ask for all memory. The limits are far above what a whole file of that size needs,
//! and the user's variables replace them. A script that renders or measures has none.

use crate::base::error::{Error, Result};
use serde_json::Value as Json;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Environment variable: seconds that reading may take.
pub const SECONDS_VARIABLE: &str = "CLOUDPARITY_READ_SECONDS";

/// Environment variable: GiB of address space that reading may take.
pub const MEMORY_VARIABLE: &str = "CLOUDPARITY_READ_GIB";

/// Scripts that read files of the user's, with the seconds that they may take for any file and for each megabyte.
const READERS: [(&str, f64, f64); 3] = [
    // A grid has at most 2^28 voxels.
    ("volume_grid.py", 120.0, 1.0),
    // Figures and pictures of what was read are made, too: HDR-FLIP takes about a second per megapixel.
    ("compare_images.py", 300.0, 10.0),
    // Blender reads, and every mesh is evaluated.
    ("export_scene.py", 900.0, 5.0),
];

/// Address space of any reader, bytes: Blender with its libraries has 1.3 GiB before it reads.
const MEMORY: u64 = 8 << 30;

/// More for each core: every thread reserves some.
const MEMORY_PER_CORE: u64 = 256 << 20;

/// More for each byte of the files: what is packed is unpacked.
const MEMORY_PER_BYTE: u64 = 64;

/// What a script may take to read its files.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// The files.
    pub files: Vec<PathBuf>,
    /// Wall-clock time.
    pub time: Duration,
    /// Address space, bytes.
    pub memory: u64,
}

impl Limits {
    /// Those of a request to a script; none where it reads no file of the user's.
    pub fn of(script: &str, request: &Json) -> Result<Option<Self>> {
        let Some((_, seconds, seconds_per_megabyte)) = READERS.iter().find(|(name, ..)| *name == script) else {
            return Ok(None);
        };
        let files = files(request);
        if files.is_empty() {
            return Ok(None);
        }
        let bytes: u64 = files.iter().filter_map(|path| std::fs::metadata(path).ok()).map(|found| found.len()).sum();
        let seconds = match variable(SECONDS_VARIABLE)? {
            Some(seconds) => seconds,
            None => seconds + seconds_per_megabyte * bytes as f64 / 1e6,
        };
        let cores = std::thread::available_parallelism().map_or(1, usize::from) as u64;
        let memory = match variable(MEMORY_VARIABLE)? {
            Some(gibibytes) => (gibibytes * f64::from(1_u32 << 30)) as u64,
            None => MEMORY + cores * MEMORY_PER_CORE + bytes.saturating_mul(MEMORY_PER_BYTE),
        };
        Ok(Some(Self { files, time: Duration::from_secs_f64(seconds), memory }))
    }

    /// Processor time, seconds: what all cores can give in that time, and some for what the clock does not see.
    pub fn processor_seconds(&self) -> f64 {
        let cores = std::thread::available_parallelism().map_or(1, usize::from) as f64;
        60.0 + cores * self.time.as_secs_f64()
    }

    /// The files, as the place of an error.
    pub fn place(&self) -> String {
        const MOST: usize = 3;
        let names: Vec<String> = self.files.iter().take(MOST).map(|path| path.display().to_string()).collect();
        let more = self.files.len().saturating_sub(MOST);
        names.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
    }

    /// The error where the time is over.
    pub fn overrun(&self) -> Error {
        Error::new(
            self.place(),
            format!("a file that is not read after {:?}", self.time),
            "a file that is read in that time",
            format!(
                "A damaged one may never be: write it again. For one that is whole, set {SECONDS_VARIABLE} to more seconds."
            ),
        )
    }

    /// The memory that reading may take, and the variable that changes it.
    pub fn memory_rule(&self) -> String {
        format!("reading may take {:.2} GiB of memory; {MEMORY_VARIABLE} sets another limit", gibibytes(self.memory))
    }
}

fn gibibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1_u32 << 30)
}

/// The files that a request names to be read.
fn files(request: &Json) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for key in ["read", "blend", "ours", "reference", "exr", "images", "pairs", "slices"] {
        collect(&request[key], &mut found);
    }
    found.dedup();
    found
}

fn collect(value: &Json, found: &mut Vec<PathBuf>) {
    match value {
        Json::String(path) => found.push(Path::new(path).to_owned()),
        Json::Array(entries) => entries.iter().for_each(|entry| collect(entry, found)),
        Json::Object(_) => found.extend(files(value)),
        _ => {}
    }
}

/// A positive number of the environment.
fn variable(name: &str) -> Result<Option<f64>> {
    /// Seconds of a year; as GiB it is as far from anything that is.
    const MOST: f64 = 3e7;
    let Some(text) = std::env::var_os(name) else { return Ok(None) };
    let text = text.to_string_lossy();
    match text.trim().parse::<f64>() {
        Ok(value) if value > 0.0 && value <= MOST => Ok(Some(value)),
        _ => Err(Error::new(
            format!("environment variable {name}"),
            format!("\"{text}\""),
            format!("a number over 0 and up to {MOST}"),
            "Correct it, or leave it unset.",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn limits_follow_the_files_that_are_read() {
        let request = json!({"op": "diff", "ours": ["a.exr", "b.exr"], "reference": ["c.exr"], "out": "d"});
        let limits = Limits::of("compare_images.py", &request).expect("no variable is set").expect("a reader");
        assert_eq!(limits.files, ["a.exr", "b.exr", "c.exr"].map(PathBuf::from));
        assert_eq!(limits.time, Duration::from_secs(300));
        let request = json!({"op": "display", "images": [{"exr": ["a.exr"], "png": "b.png"}]});
        assert_eq!(files(&request), [PathBuf::from("a.exr")]);
        assert_eq!(Limits::of("reference.py", &json!({"exr": "a.exr"})), Ok(None));
        assert_eq!(Limits::of("volume_grid.py", &json!({"write": "a.vdb"})), Ok(None));
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.vdb");
        std::fs::write(&path, vec![0; 3_000_000]).expect("a file");
        let large =
            Limits::of("volume_grid.py", &json!({"read": path})).expect("no variable is set").expect("a reader");
        assert_eq!(large.time, Duration::from_secs(123));
        assert!(large.memory >= MEMORY + 3_000_000 * MEMORY_PER_BYTE);
    }
}
