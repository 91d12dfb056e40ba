//! Warnings of the library on stderr.
//!
//! The library hands what its caller should know and did not ask for to the facade `log` and prints nothing.

use crate::base::error::plain_lines;
use indicatif::{ProgressBar, WeakProgressBar};
use log::{Level, LevelFilter, Log, Metadata, Record};
use std::sync::{Mutex, PoisonError};

struct Notices;

/// The bar that is shown, if one is.
static BAR: Mutex<Option<WeakProgressBar>> = Mutex::new(None);

/// Prints warnings from here on. Further calls do nothing.
pub(super) fn install() {
    // An error says that there is a logger already: this one, or that of a program that the commands run in.
    if log::set_logger(&Notices).is_ok() {
        log::set_max_level(LevelFilter::Warn);
    }
}

/// Further warnings do not break the line of this bar.
pub(super) fn print_above(bar: &ProgressBar) {
    *BAR.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.downgrade());
}

/// Whether a record is of this library: those of wgpu and naga are for their developers.
fn is_ours(target: &str) -> bool {
    target.split("::").next() == Some(env!("CARGO_CRATE_NAME"))
}

/// The word before a message.
fn name(level: Level) -> &'static str {
    match level {
        Level::Error => "error",
        Level::Warn => "warning",
        Level::Info | Level::Debug | Level::Trace => "note",
    }
}

impl Log for Notices {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        is_ours(metadata.target())
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let line = format!("{}: {}", name(record.level()), plain_lines(&record.args().to_string()));
        let bar = BAR.lock().unwrap_or_else(PoisonError::into_inner).as_ref().and_then(WeakProgressBar::upgrade);
        match bar {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }

    fn flush(&self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_of_other_crates_are_passed_over() {
        assert!(is_ours(module_path!()));
        assert!(!is_ours("wgpu_core::device") && !is_ours("cloudparity_viewer::a"));
    }
}
