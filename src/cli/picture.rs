//! What commands that make pictures share: the scene with overrides, so that both sides of a comparison
//! take the same arguments for the same picture.

use crate::base::error::Result;
use crate::scene::{PixelFilter, Scene};
use std::path::PathBuf;

/// A scene with the changes to it, and where its picture goes.
#[derive(clap::Args)]
pub(super) struct PictureArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// The picture to write: an EXR, or a PNG with the EXR beside it.
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: PathBuf,
}

/// A scene and the changes to it.
#[derive(clap::Args)]
pub(super) struct SceneArguments {
    /// The scene file.
    scene: PathBuf,
    /// Pixels, WIDTHxHEIGHT, instead of the scene's.
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    resolution: Option<[u32; 2]>,
    /// Leave the world out of what the camera sees directly.
    #[arg(long, value_name = "true|false")]
    film_transparent: Option<bool>,
    /// Scattering events beyond the first.
    #[arg(long, value_name = "N")]
    volume_bounces: Option<u32>,
    /// Change a stored value: "Large Noise/Scale=2". May be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
}

impl PictureArguments {
    /// Loads the scene and applies the changes.
    pub(super) fn load(&self) -> Result<Scene> {
        self.scene.load()
    }
}

impl SceneArguments {
    /// Loads the scene and applies the changes.
    pub(super) fn load(&self) -> Result<Scene> {
        let mut scene = Scene::load_with(&self.scene, &self.set)?;
        if let Some(resolution) = self.resolution {
            scene.film.resolution = resolution;
            scene.film.resolution_percentage = 100;
        }
        if let Some(transparent) = self.film_transparent {
            scene.film.transparent = transparent;
        }
        if let Some(bounces) = self.volume_bounces {
            scene.set_volume_bounces(bounces);
        }
        Ok(scene)
    }
}

/// Command line name of a pixel filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Filter {
    /// Uniform over the pixel: what references use.
    Box,
    /// Gaussian of the scene's filter width.
    Gaussian,
    /// Blackman-Harris of the scene's filter width.
    BlackmanHarris,
}

impl From<Filter> for PixelFilter {
    fn from(filter: Filter) -> Self {
        match filter {
            Filter::Box => Self::Box,
            Filter::Gaussian => Self::Gaussian,
            Filter::BlackmanHarris => Self::BlackmanHarris,
        }
    }
}

/// WIDTHxHEIGHT, 1 to 16384 pixels per side.
pub(super) fn parse_resolution(text: &str) -> std::result::Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    let fits = |sides: &[u32; 2]| sides.iter().all(|side| (1..=16384).contains(side));
    sides.filter(fits).ok_or("expected WIDTHxHEIGHT with 1 to 16384 pixels per side, such as 320x180".into())
}
