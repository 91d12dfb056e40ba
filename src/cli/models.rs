//! `cloudparity models`: the density models and their parameters.

use crate::base::error::Result;
use crate::engines;
use crate::engines::Model;
use crate::engines::parameters::Parameter;
use std::fmt::Write as _;
use std::process::ExitCode;

/// List the density models of published engines, with parameters, units, ranges and defaults.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity models perlin-fbm")]
pub(super) struct Arguments {
    /// Only this model.
    model: Option<String>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let models = match &arguments.model {
        Some(id) => vec![engines::find(id)?],
        None => engines::models().to_vec(),
    };
    let text = if arguments.json {
        let all: Vec<serde_json::Value> = models.iter().map(|model| document(model)).collect();
        serde_json::to_string_pretty(&all).expect("models serialise") + "\n"
    } else {
        models.iter().map(|model| describe(model)).collect::<Vec<_>>().join("\n")
    };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Parameters as JSON.
pub(super) fn parameter_documents(parameters: &[Parameter]) -> Vec<serde_json::Value> {
    parameters
        .iter()
        .map(|parameter| {
            serde_json::json!({
                "name": parameter.name,
                "about": parameter.about,
                "unit": parameter.unit,
                "range": parameter.range.to_string(),
                "default": parameter.fixed_default(),
                "usual": parameter.usual,
            })
        })
        .collect()
}

/// Parameters as lines of text.
pub(super) fn parameter_lines(parameters: &[Parameter]) -> String {
    let mut text = String::new();
    let width = parameters.iter().map(|parameter| parameter.name.len()).max().unwrap_or(0) + 2;
    let mut line = |parts: std::fmt::Arguments<'_>| writeln!(text, "{parts}").expect("writing to a string cannot fail");
    line(format_args!("{:<width$}{:>8}  {:<34}{}", "parameter", "default", "allowed", "what it is"));
    for parameter in parameters {
        let unit = if parameter.unit.is_empty() { String::new() } else { format!(" [{}]", parameter.unit) };
        line(format_args!(
            "{:<width$}{:>8}  {:<34}{}{unit}",
            parameter.name,
            parameter.fixed_default().map_or("derived".to_owned(), |value| value.to_string()),
            parameter.range.to_string(),
            parameter.about
        ));
    }
    text
}

fn document(model: &Model) -> serde_json::Value {
    let qualities: serde_json::Map<String, serde_json::Value> = model
        .qualities
        .iter()
        .map(|(name, settings)| {
            let settings: serde_json::Map<String, serde_json::Value> =
                settings.iter().map(|&(name, value)| (name.to_owned(), value.into())).collect();
            ((*name).to_owned(), settings.into())
        })
        .collect();
    serde_json::json!({
        "id": model.id,
        "title": model.title,
        "about": model.about,
        "parameters": parameter_documents(model.parameters),
        "domains": model.domains,
        "qualities": qualities,
        "defects": model.defects,
        "sky": model.sky.map(|sky| serde_json::json!({
            "about": sky.about,
            "parameters": parameter_documents(sky.parameters),
        })),
    })
}

fn describe(model: &Model) -> String {
    let domains: Vec<String> = model.domains.iter().map(ToString::to_string).collect();
    let mut text = format!("{}: {}\n{}\ndomains: {}\n\n", model.id, model.title, model.about, domains.join(", "));
    text += &parameter_lines(model.parameters);
    for (name, settings) in model.qualities {
        text += &format!("quality {name}: {}\n", assignments(settings));
    }
    if let Some(sky) = model.sky {
        text += &format!("sky: {} (cloudparity export SCENE --sky {})\n", sky.about, model.id);
        text += &parameter_lines(sky.parameters);
    }
    for defect in model.defects {
        text += &format!("defect {}: {}; corrected: {}\n", defect.id, defect.about, defect.corrected);
    }
    text
}

/// Settings as text: "steps 20, octaves 3".
pub(super) fn assignments(settings: &[(&str, f64)]) -> String {
    settings.iter().map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join(", ")
}
