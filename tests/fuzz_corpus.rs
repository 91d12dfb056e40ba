//! What fuzzing found and covered, once more: every committed input of `fuzz/corpus` goes through the entry of its fuzz target
//! (docs/fuzzing.md), on this compiler. None may panic, take longer or ask for more memory than the limits say.

#[path = "../fuzz/entries.rs"]
mod entries;
mod support;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::mpsc;
use std::time::Duration;

/// Committed inputs of a target.
fn corpus(target: &str) -> Vec<PathBuf> {
    let folder = support::project("fuzz/corpus").join(target);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|cause| panic!("{}: {cause}", folder.display()));
    let mut inputs: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    inputs.sort();
    inputs
}

/// What asks for more ends this process, with the name of the input as the last line.
#[cfg(unix)]
fn limit_memory() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    // Every thread has a stack, which counts.
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let most = entries::MOST_BYTES + threads * (64 << 20);
    let maximum = getrlimit(Resource::Data).maximum;
    setrlimit(Resource::Data, Rlimit { current: Some(most), maximum }).expect("a limit of memory");
}

#[cfg(not(unix))]
fn limit_memory() {}

#[test]
fn every_committed_input_gives_a_result_or_an_error_within_the_limits() {
    limit_memory();
    let mut faults = Vec::new();
    for (target, entry) in entries::ENTRIES {
        let inputs = corpus(target);
        assert!(!inputs.is_empty(), "{target} has no inputs");
        for path in inputs {
            let name = format!("{target}/{}", path.file_name().expect("a file").to_string_lossy());
            let bytes = std::fs::read(&path).expect("a committed input");
            println!("{name}");
            let folder = tempfile::tempdir().expect("a temporary folder");
            let place = folder.path().to_owned();
            let (send, receive) = mpsc::channel();
            // A thread that hangs is left behind; the test ends without it.
            std::thread::spawn(move || {
                let result = catch_unwind(AssertUnwindSafe(|| {
                    if let Err(error) = entry(&bytes, &place) {
                        entries::check_error(&error);
                    }
                }));
                let _ = send.send(result.is_ok());
            });
            match receive.recv_timeout(Duration::from_secs(entries::MOST_SECONDS)) {
                Ok(true) => {}
                Ok(false) => faults.push(format!("{name}: a panic")),
                Err(_) => faults.push(format!("{name}: more than {} s", entries::MOST_SECONDS)),
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
