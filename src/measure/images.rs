//! What several questions ask of pictures: HDR-FLIP between them, and how they are displayed.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use crate::base::temporary;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::scene::Display;
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::PathBuf;

/// The script that computes everything here.
pub const SCRIPT: &str = "compare_images.py";

/// How linear values become a display picture, in Blender's names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DisplaySettings {
    /// View transform: `AgX`, `Standard`, `Filmic`, `Khronos PBR Neutral`, `Raw`.
    pub view: String,
    /// Look, `None` for none.
    pub look: String,
    /// Stops: values are multiplied by `2^exposure` first.
    pub exposure: f64,
    /// The display value is raised to `1 / gamma` last.
    pub gamma: f64,
    /// Linear radiance behind a transparent film; `None` keeps the picture transparent.
    pub background: Option<[f64; 3]>,
}

impl DisplaySettings {
    /// Those of a scene, before this linear radiance.
    pub fn of(display: &Display, background: Option<[f64; 3]>) -> Self {
        Self {
            view: display.view_transform.clone(),
            look: display.look.clone(),
            exposure: f64::from(display.exposure),
            gamma: f64::from(display.gamma),
            background,
        }
    }
}

/// A picture and what it is compared with: files whose means are compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlipPair {
    /// Our picture, or replicas of it.
    pub ours: Vec<PathBuf>,
    /// Replicas of the reference.
    pub reference: Vec<PathBuf>,
}

/// Pictures of the user's, in any form that `diff` reads: plain ones here, others by the script
/// that knows what the parts, layers and windows of a file mean. `part` names one of several,
/// `option` gives it.
pub fn read(paths: &[PathBuf], part: Option<&str>, option: &str) -> Result<Vec<Image>> {
    let mut others = Vec::new();
    for path in paths {
        files::open_input(path, "a picture")?;
        kinds::want(path, FileKind::Exr)?;
        let is_plain = || Ok(FileKind::of(path) == Some(FileKind::Exr) && Image::why_not_plain(path)?.is_none());
        others.push(part.is_some() || !is_plain()?);
    }
    let folder = temporary::folder()?;
    let plain = |number: usize| folder.path().join(format!("{number}.exr"));
    let requested: Vec<Json> = (0..paths.len())
        .filter(|number| others[*number])
        .map(|number| json!({"exr": paths[number], "plain": plain(number)}))
        .collect();
    if !requested.is_empty() {
        let request = json!({"op": "plain", "images": requested, "part": part, "option": option});
        bridge::run_script(SCRIPT, &request, CyclesKernel::Default, |_| ())?;
    }
    let read = |number: usize| Image::read_exr(&if others[number] { plain(number) } else { paths[number].clone() });
    (0..paths.len()).map(read).collect()
}

/// Mean HDR-FLIP of each pair, in one run of the script.
pub fn flip(pairs: &[FlipPair]) -> Result<Vec<f64>> {
    let request = json!({"op": "flip", "pairs": pairs});
    let found = bridge::run_script(SCRIPT, &request, CyclesKernel::Default, |_| ())?;
    let means: Option<Vec<f64>> =
        found["means"].as_array().map(|means| means.iter().filter_map(|mean| mean.as_f64()).collect());
    means
        .filter(|means| means.len() == pairs.len())
        .ok_or_else(|| Error::new(SCRIPT, found.to_string(), format!("{} means", pairs.len()), "Report this defect."))
}
