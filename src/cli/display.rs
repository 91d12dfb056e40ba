//! `cloudparity display`: a scene-linear picture as Blender shows it.

use crate::base::error::Result;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::measure::pictures::SCRIPT;
use crate::scene::Display;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Make a PNG of an EXR through Blender's own colour management, equal to the PNG that Blender saves without dither.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Scene-linear EXR; several are averaged.
    #[arg(required = true, num_args = 1..)]
    pictures: Vec<PathBuf>,
    /// The PNG to write.
    #[arg(short, long)]
    output: PathBuf,
    /// View transform: AgX, Standard, Filmic, Khronos PBR Neutral or Raw.
    #[arg(long, default_value = "AgX")]
    view: String,
    /// Look: "AgX - Punchy"; those of Filmic have no prefix.
    #[arg(long, default_value = "None")]
    look: String,
    /// Stops: values are multiplied by 2^exposure first.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
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
    #[arg(long)]
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

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let picture = json!({
        "exr": arguments.pictures,
        "png": arguments.output,
        "part": arguments.part,
        "view": arguments.view,
        "look": arguments.look,
        "exposure": arguments.exposure,
        "gamma": arguments.gamma,
        "background": arguments.background,
        "channels": if arguments.rgb { "rgb" } else { "rgba" },
    });
    let view = make(&picture)?;
    super::print(&format!("{} ({view})\n", arguments.output.display()))?;
    Ok(ExitCode::SUCCESS)
}
