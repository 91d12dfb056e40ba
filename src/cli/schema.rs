//! `cloudparity schema`: the JSON Schema of scene files.

use crate::base::error::Result;
use std::process::ExitCode;

/// Print the JSON Schema of scene files.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity schema > scene.schema.json")]
pub(super) struct Arguments {}

pub(super) fn run(_: &Arguments) -> Result<ExitCode> {
    let text = serde_json::to_string_pretty(&crate::scene::schema()).expect("the schema serialises");
    super::print(&(text + "\n"))?;
    Ok(ExitCode::SUCCESS)
}
