//! `cloudparity lights`: the light models and their parameters.

use crate::base::error::Result;
use crate::cli::models::{assignments, parameter_documents, parameter_lines};
use crate::engines::light::models::{LIGHTS, PARAMETERS};
use std::process::ExitCode;

/// List the light models that stand in for light transport in engines, with their parameters, ranges and defaults.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity lights")]
pub(super) struct Arguments {
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let text = if arguments.json {
        let lights: Vec<serde_json::Value> = LIGHTS
            .iter()
            .map(|light| {
                let settings: serde_json::Map<String, serde_json::Value> =
                    light.settings.iter().map(|&(name, value)| (name.to_owned(), value.into())).collect();
                serde_json::json!({"id": light.id, "about": light.about, "settings": settings})
            })
            .collect();
        let document = serde_json::json!({"lights": lights, "parameters": parameter_documents(PARAMETERS)});
        serde_json::to_string_pretty(&document).expect("light models serialise") + "\n"
    } else {
        let width = LIGHTS.iter().map(|light| light.id.len()).max().unwrap_or(0) + 2;
        let mut text = String::new();
        for light in LIGHTS {
            text += &format!("{:<width$}{}\n", light.id, light.about);
            if !light.settings.is_empty() {
                text += &format!("{:<width$}{}\n", "", assignments(light.settings));
            }
        }
        text + "\n" + &parameter_lines(PARAMETERS)
    };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}
