//! A scene-linear picture as Blender shows it: a PNG through Blender's own colour management.

use crate::base::display_table::DisplayTable;
use crate::base::error::Result;
use crate::base::files;
use crate::base::temporary;
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
    /// Part, layer or pass of a file with several.
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

/// A view transform as a table of `side` colours an axis, without the exposure; none where it is Standard, which has a formula.
pub(super) fn table(display: &Display, side: usize) -> Result<Option<DisplayTable>> {
    let Display { view_transform, look, gamma, .. } = display;
    if (view_transform.as_str(), look.as_str(), *gamma) == ("Standard", "None", 1.0) {
        return Ok(None);
    }
    let folder = temporary::folder()?;
    let values = folder.path().join("values.npy");
    let request = json!({
        "op": "cube", "axis": DisplayTable::axis(side), "values": values, "view": view_transform, "look": look, "gamma": gamma,
    });
    let result = bridge::run_script(SCRIPT, &request, CyclesKernel::Default, |_| ())?;
    let (values, _) = files::read_values(&values)?;
    let colours = values.chunks_exact(3).map(|colour| [colour[0], colour[1], colour[2]]).collect();
    Ok(Some(DisplayTable::new(result["view_used"].as_str().unwrap_or_default().to_owned(), side, colours)))
}
