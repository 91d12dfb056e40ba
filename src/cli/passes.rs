//! `cloudparity passes`: passes over finished pictures, and the parameters of systems that are theirs.

use crate::base::error::Result;
use crate::cli::models::{parameter_documents, parameter_lines};
use crate::engines;
use crate::engines::parameters::Parameter;
use crate::engines::passes::{NamedPass, PASSES};
use std::process::ExitCode;

/// List the passes over finished pictures of engines, with their parameters, ranges and defaults.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity passes")]
pub(super) struct Arguments {
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

/// Systems with parameters of a pass.
fn systems(pass: &NamedPass) -> Vec<(&'static str, Vec<Parameter>)> {
    let Some(prefix) = pass.prefix else { return Vec::new() };
    let of = |model: &'static engines::Model| {
        let own: Vec<Parameter> =
            model.parameters.iter().filter(|parameter| parameter.name.starts_with(prefix)).copied().collect();
        (model.id, own)
    };
    engines::models().into_iter().map(of).filter(|(_, parameters)| !parameters.is_empty()).collect()
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let text = if arguments.json {
        let passes: Vec<serde_json::Value> = PASSES
            .iter()
            .map(|pass| {
                let systems: serde_json::Map<String, serde_json::Value> = systems(pass)
                    .into_iter()
                    .map(|(model, parameters)| (model.to_owned(), parameter_documents(&parameters).into()))
                    .collect();
                serde_json::json!({"id": pass.id, "about": pass.about, "how": pass.how, "parameters": systems})
            })
            .collect();
        serde_json::to_string_pretty(&passes).expect("passes serialise") + "\n"
    } else {
        let mut text = String::new();
        for pass in PASSES {
            text += &format!("{}: {}\nby: {}\n", pass.id, pass.about, pass.how);
            for (model, parameters) in systems(pass) {
                text += &format!("of {model}:\n{}", parameter_lines(&parameters));
            }
            text += "\n";
        }
        text
    };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}
