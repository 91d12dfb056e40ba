//! `cloudparity nodes`: what is supported of Blender's nodes, and what is not.

use crate::base::error::Result;
use crate::measure::nodes::table;
use std::process::ExitCode;

/// List every supported node with its modes, measured errors and costs, and every refused one with what to do instead.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity nodes")]
pub(super) struct Arguments {
    /// JSON instead of text: everything that is known of each node.
    #[arg(long)]
    json: bool,
    /// Everything that is known of each node, as the text of docs/nodes.md.
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let table = table::table()?;
    let text = match (arguments.json, arguments.markdown) {
        (true, _) => serde_json::to_string_pretty(&table).expect("the table serialises") + "\n",
        (false, true) => table.markdown(),
        (false, false) => table.text(),
    };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}
