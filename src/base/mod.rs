//! What everything else stands on: the error type, named choices, files, the identity of builds, the ledger of records, numbers as text,
//! users' text in the formats that are written, progress, textures.

pub mod arrays;
pub mod choice;
pub mod destination;
pub mod display_table;
pub mod error;
pub mod files;
pub mod identity;
pub mod interpolation;
pub mod json;
pub mod kinds;
pub mod ktx2;
#[cfg(feature = "tools")]
pub mod ledger;
pub mod numbers;
pub mod plain_text;
pub mod progress;
pub mod recent;
#[cfg(test)]
mod source_hash;
#[cfg(feature = "tools")]
pub mod temporary;
pub mod texture;
