//! A scene-linear picture as Blender shows it: a PNG through Blender's own colour management.

use crate::base::error::Result;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::measure::pictures::SCRIPT;
use crate::scene::Display;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};

/// How a picture is shown.
#[derive(clap::Args)]
#[command(next_help_heading = "Of a picture")]
pub(super) struct DisplayArguments {
    /// View transform: AgX, Standard, Filmic, Khronos PBR Neutral or Raw.
    #[arg(long, default_value = "AgX", value_name = "NAME")]
    view: String,
    /// Look: "AgX - Punchy"; those of Filmic have no prefix.
    #[arg(long, default_value = "None", value_name = "NAME")]
    look: String,
    /// Stops: values are multiplied by 2^exposure first.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_name = "STOPS")]
    exposure: f64,
    /// The display value is raised to 1 / gamma last.
    #[arg(long, default_value_t = 1.0)]
    gamma: f64,
    /// Linear radiance behind a transparent film.
    #[arg(long, value_name = "R,G,B", value_parser = super::diff::colour)]
    background: Option<[f64; 3]>,
    /// Leave alpha out: the premultiplied colours, as in Blender's RGB files.
    #[arg(long)]
    rgb: bool,
    /// Part (render pass) of a file with several.
    #[arg(long, value_name = "PART")]
    part: Option<String>,
}

/// Makes a PNG of a picture under a scene's display settings; returns the view that was used.
pub(super) fn show(exr: &Path, png: &Path, display: &Display) -> Result<String> {
    let Display { view_transform, look, exposure, gamma } = display;
    let picture = json!({
        "exr": [exr], "png": png, "part": null, "view": view_transform, "look": look, "exposure": exposure, "gamma": gamma,
        "background": null, "channels": "rgba",
    });
    make(&picture)
}

/// Makes the picture that a request describes; returns the view that was used.
fn make(picture: &Json) -> Result<String> {
    let request = json!({"op": "display", "images": [picture]});
    let result = bridge::run_script(SCRIPT, &request, CyclesKernel::Default, |_| ())?;
    Ok(result["images"][0]["view_used"].as_str().unwrap_or_default().to_owned())
}

/// Makes a PNG of one picture or of the mean of several.
pub(super) fn convert(pictures: &[PathBuf], png: &Path, arguments: &DisplayArguments) -> Result<String> {
    let DisplayArguments { view, look, exposure, gamma, background, rgb, part } = arguments;
    let picture = json!({
        "exr": pictures, "png": png, "part": part, "view": view, "look": look, "exposure": exposure, "gamma": gamma,
        "background": background, "channels": if *rgb { "rgb" } else { "rgba" },
    });
    make(&picture)
}
