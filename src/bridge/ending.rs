//! Why a script ended without an answer, as an error that names the right reason.
//!
//! A process that dies says little: a signal, an exit status, its last words on stderr. Each of these has one of few causes, and a file
//! that is whole must never be blamed for a process that somebody else killed.

use super::limits::Limits;
use crate::base::error::Error;
use std::process::ExitStatus;

/// Signals by their POSIX numbers; the names are for readers.
const SIGNALS: [(i32, &str); 12] = [
    (1, "SIGHUP"),
    (2, "SIGINT"),
    (3, "SIGQUIT"),
    (4, "SIGILL"),
    (6, "SIGABRT"),
    (7, "SIGBUS"),
    (8, "SIGFPE"),
    (9, "SIGKILL"),
    (11, "SIGSEGV"),
    (13, "SIGPIPE"),
    (15, "SIGTERM"),
    (24, "SIGXCPU"),
];

/// Signals that a library raises in its own process: a failed check, or a wrong address.
const OF_ITS_OWN: [i32; 5] = [4, 6, 7, 8, 11];
const SIGKILL: i32 = 9;
const SIGXCPU: i32 = 24;

/// What libraries write before they give up for want of memory: C++, Blender's allocator, Python, the loader.
const OUT_OF_MEMORY: [&str; 6] =
    ["bad_alloc", "alloc returns null", "MemoryError", "out of memory", "Cannot allocate memory", "allocation failed"];

/// Why a process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cause {
    /// It ran out of the memory that it may take.
    Memory(String),
    /// It used up the processor time that it may take.
    ProcessorTime,
    /// A library broke off in it.
    BrokeOff(String),
    /// Somebody outside ended it.
    Killed(String),
    /// It left without an answer.
    Left(String),
    /// It closed its output and went on.
    ClosedOutput,
    /// The system does not say.
    Unknown(String),
}

/// The cause behind a status and the last words of a process.
pub fn of(status: ExitStatus, log: &str) -> Cause {
    let signal = signal(status);
    let how = match signal {
        Some(number) => name(number),
        None => status.to_string(),
    };
    let is_out_of_memory = OUT_OF_MEMORY.iter().any(|words| log.contains(words));
    match signal {
        Some(SIGXCPU) => Cause::ProcessorTime,
        Some(SIGKILL) => Cause::Killed(how),
        _ if is_out_of_memory => Cause::Memory(how),
        Some(number) if OF_ITS_OWN.contains(&number) => Cause::BrokeOff(how),
        Some(_) => Cause::Killed(how),
        None => Cause::Left(how),
    }
}

/// The signal that ended a process. A shell or another program that stands before the interpreter hands it on as the status 128 and more.
#[cfg(unix)]
fn signal(status: ExitStatus) -> Option<i32> {
    let handed_on =
        || status.code().map(|code| code - 128).filter(|number| SIGNALS.iter().any(|(known, _)| known == number));
    std::os::unix::process::ExitStatusExt::signal(&status).or_else(handed_on)
}

/// Other systems have no signals: their status says it all.
#[cfg(not(unix))]
fn signal(_status: ExitStatus) -> Option<i32> {
    None
}

fn name(signal: i32) -> String {
    let known = SIGNALS.iter().find(|(number, _)| *number == signal);
    known.map_or_else(|| format!("signal {signal}"), |(number, name)| format!("signal {number}, {name}"))
}

impl Cause {
    /// The error of a script that ended so. `activity` is what it worked at, `log` its last words.
    pub fn error(&self, script: &str, activity: Option<&str>, log: &str, limits: Option<&Limits>) -> Error {
        let place = limits.map_or_else(|| format!("script {script}"), Limits::place);
        let doing = activity.map(|activity| format!(" while {activity}")).unwrap_or_default();
        let words = if log.is_empty() { String::new() } else { format!("; its last words: {log}") };
        let memory = limits.map(|limits| format!(" ({})", limits.memory_rule())).unwrap_or_default();
        let (found, expected, remedy) = match self {
            Self::Memory(how) => (
                format!("a process that ran out of memory{doing} ({how}){words}"),
                "enough memory to read it".to_owned(),
                format!("Close other programs, or allow more{memory}."),
            ),
            Self::ProcessorTime => {
                return limits.map_or_else(
                    || Error::new(place, format!("processor time used up{doing}"), "a shorter run", "Run it again."),
                    Limits::overrun,
                );
            }
            Self::BrokeOff(how) => (
                format!("a library that broke off{doing} ({how}){words}"),
                "contents that the Python modules on this machine can handle".to_owned(),
                format!(
                    "Open the file in Blender, take out what is named above, and save it again; a damaged file \
                     has to be made anew. Where memory is short, allow more{memory}."
                ),
            ),
            Self::Killed(how) => (
                format!("a process that was ended from outside{doing} ({how}){words}"),
                "a process that may work to its end".to_owned(),
                format!("Run it again; where the system ended it for want of memory, close other programs{memory}."),
            ),
            Self::Left(how) => (
                format!("a process that left without an answer{doing} ({how}){words}"),
                "a result".to_owned(),
                format!("Run cloudparity doctor; it checks the interpreter and its packages{memory}."),
            ),
            Self::ClosedOutput => (
                format!("a process that closed its output without an answer{doing}{words}"),
                "a result".to_owned(),
                "Run it again; where that stays, run cloudparity doctor.".to_owned(),
            ),
            Self::Unknown(cause) => (
                format!("a process without an answer{doing}, of whose end the system says: {cause}{words}"),
                "a result".to_owned(),
                "Run it again.".to_owned(),
            ),
        };
        Error::new(place, found, expected, remedy)
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;

    #[test]
    fn every_ending_has_its_own_cause() {
        let raw = ExitStatus::from_raw;
        for (status, log, found) in [
            (9, "", "ended from outside while opening a.blend (signal 9, SIGKILL)"),
            (15, "", "ended from outside while opening a.blend (signal 15, SIGTERM)"),
            (6, "can't clean grid cache", "a library that broke off while opening a.blend (signal 6, SIGABRT)"),
            (11, "", "a library that broke off while opening a.blend (signal 11, SIGSEGV)"),
            (6, "what():  std::bad_alloc", "ran out of memory while opening a.blend (signal 6, SIGABRT)"),
            (1 << 8, "MemoryError", "ran out of memory while opening a.blend (exit status: 1)"),
            (137 << 8, "", "ended from outside while opening a.blend (signal 9, SIGKILL)"),
            (3 << 8, "", "left without an answer while opening a.blend (exit status: 3)"),
        ] {
            let error = of(raw(status), log).error("export_scene.py", Some("opening a.blend"), log, None);
            assert!(error.found.contains(found), "{error}");
            assert_eq!(error.found.contains("last words"), !log.is_empty());
        }
    }
}
