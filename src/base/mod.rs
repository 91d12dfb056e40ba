//! What everything else stands on: the error type, files, the identity of builds, the ledger of records, numbers as text, progress.

pub mod error;
pub mod files;
pub mod identity;
pub mod ledger;
pub mod numbers;
pub mod progress;
#[cfg(test)]
mod source_hash;
