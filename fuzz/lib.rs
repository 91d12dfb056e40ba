//! What the fuzz targets share: the limits, the entries of the library, mutations of documents.

#[allow(dead_code, reason = "the fuzzer itself watches the time")]
mod entries;
pub mod mutations;

use mutations::Text;
use std::cell::LazyCell;
use tempfile::TempDir;

thread_local! {
    /// The folder that inputs are written to; `TMPDIR` says where.
    static FOLDER: LazyCell<TempDir> = LazyCell::new(|| {
        let limit = rustix::process::Rlimit { current: Some(entries::MOST_BYTES), maximum: None };
        // Whatever asks for more ends the process, which the fuzzer reports as a crash.
        rustix::process::setrlimit(rustix::process::Resource::Data, limit).expect("a limit of memory");
        tempfile::tempdir().expect("a temporary folder")
    });
}

/// Runs an input through the entry of a target.
pub fn run(target: &str, bytes: &[u8]) {
    FOLDER.with(|folder| {
        let entry = entries::ENTRIES.iter().find(|(known, _)| *known == target).expect("a target of the list").1;
        if let Err(error) = entry(bytes, folder.path()) {
            entries::check_error(&error);
        }
    });
}

/// A mutation of the document in `bytes[..size]`, or of its bytes where it is none; the new size.
pub fn mutate(text: Text, bytes: &mut [u8], size: usize, most: usize, seed: u32) -> usize {
    let mut random = fastrand::Rng::with_seed(u64::from(seed));
    // CLOUDPARITY_FUZZ_BYTES=1 leaves out what knows the structure, to measure what that is worth.
    static BYTES_ALONE: std::sync::LazyLock<bool> =
        std::sync::LazyLock::new(|| std::env::var_os("CLOUDPARITY_FUZZ_BYTES").is_some());
    if !*BYTES_ALONE
        && random.u8(..) >= 16
        && let Some(new) = mutations::mutated(text, &bytes[..size], &mut random)
        && new.len() <= most
    {
        bytes[..new.len()].copy_from_slice(&new);
        return new.len();
    }
    libfuzzer_sys::fuzzer_mutate(bytes, size, most)
}

/// A document with a part of another; the size of `bytes` that it takes.
pub fn cross(text: Text, one: &[u8], other: &[u8], bytes: &mut [u8], seed: u32) -> usize {
    let mut random = fastrand::Rng::with_seed(u64::from(seed));
    let crossed = mutations::crossed(text, one, other, &mut random).filter(|new| new.len() <= bytes.len());
    let new = crossed.unwrap_or_else(|| one[..one.len().min(bytes.len())].to_vec());
    bytes[..new.len()].copy_from_slice(&new);
    new.len()
}

/// A fuzz target: its name, and how its documents are written if they are JSON or TOML.
#[macro_export]
macro_rules! target {
    ($name:literal) => {
        libfuzzer_sys::fuzz_target!(|bytes: &[u8]| $crate::run($name, bytes));
    };
    ($name:literal, $text:ident) => {
        $crate::target!($name);
        libfuzzer_sys::fuzz_mutator!(|bytes: &mut [u8], size: usize, most: usize, seed: u32| {
            $crate::mutate($crate::mutations::Text::$text, bytes, size, most, seed)
        });
        libfuzzer_sys::fuzz_crossover!(|one: &[u8], other: &[u8], bytes: &mut [u8], seed: u32| {
            $crate::cross($crate::mutations::Text::$text, one, other, bytes, seed)
        });
    };
}
