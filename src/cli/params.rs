//! `cloudparity params`: what `--set` knows of a scene.

use crate::base::error::Result;
use crate::scene::Scene;
use crate::scene::overrides::Settable;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// List everything of a scene that `--set` changes: names, values, limits, units.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity params CLOUD.scene.json")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let found = Scene::load(&arguments.scene)?.settable();
    let text = if arguments.json {
        serde_json::to_string_pretty(&found).expect("values serialise") + "\n"
    } else {
        describe(&found)
    };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

fn describe(found: &[Settable]) -> String {
    if found.is_empty() {
        return "nothing: every input of the graph is linked\n".to_owned();
    }
    let values: Vec<String> = found.iter().map(|one| one.value.to_string()).collect();
    let limits: Vec<String> = found.iter().map(limits).collect();
    let width = |texts: &mut dyn Iterator<Item = &String>| texts.map(|text| text.chars().count()).max().unwrap_or(0);
    let names = width(&mut found.iter().map(|one| &one.name)).max(4);
    let numbers = width(&mut values.iter()).max(5);
    let ranges = width(&mut limits.iter()).max(6);
    let mut text = format!("{:<names$}  {:>numbers$}  {:<ranges$}  unit, meaning\n", "name", "value", "limits");
    for ((one, value), limits) in found.iter().zip(&values).zip(&limits) {
        let words: Vec<&str> = [&one.unit, &one.about].into_iter().flatten().map(String::as_str).collect();
        let line = format!("{:<names$}  {value:>numbers$}  {limits:<ranges$}  {}", one.name, words.join(", "));
        writeln!(text, "{}", line.trim_end()).expect("writing to a string cannot fail");
    }
    text
}

/// "0 to 1"; "any" where f32 is the only limit.
fn limits(one: &Settable) -> String {
    // What Blender writes for no limit.
    let [low, high] = one.limits.map(|limit| limit.filter(|limit| limit.abs() < f32::MAX));
    match (low, high) {
        (None, None) => "any".to_owned(),
        (Some(low), None) => format!("{low} or more"),
        (None, Some(high)) => format!("{high} or less"),
        (Some(low), Some(high)) => format!("{low} to {high}"),
    }
}
