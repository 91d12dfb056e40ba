//! Skies of published systems, as a picture around a scene and a colour of its sun: the same sky for engines, path tracing and Cycles.
//!
//! A published sky has the units of its own display, in which 1 is white. Here white is what a matte surface that reflects everything sends under
//! the scene's sun: where that delivers E, radiances are multiplied by E / pi.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::engines::parameters::{Parameter, Values};
use crate::scene::image::Image;
use crate::scene::{self, LightKind, Scene, WorldImage};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

/// Rows of the picture; it has twice as many columns.
pub const ROWS: usize = 256;

/// A system's sky.
pub struct Sky {
    /// What it is, in a sentence.
    pub about: &'static str,
    /// Its parameters.
    pub parameters: &'static [Parameter],
    /// What it looks like with a sun at a height.
    pub look: fn(&Values, sun: DVec3) -> Look,
}

/// Radiance of a direction: a unit vector that points away from the scene, z up.
pub type Radiance = Box<dyn Fn(DVec3) -> [f64; 3] + Send + Sync>;

/// A sky with the sun where it stands.
pub struct Look {
    /// Colour of the sun's light, in linear Rec. 709; the scene's sun takes it.
    pub sun: [f64; 3],
    /// Radiance without the sun's disc, in the system's units.
    pub radiance: Radiance,
}

impl Sky {
    /// The sky as an equirectangular picture of [`ROWS`] rows, in the system's units times `scale`.
    pub fn picture(&self, look: &Look, scale: f64) -> Image {
        let [width, height] = [2 * ROWS, ROWS];
        let mut image = Image::new(width, height);
        image.pixels.par_iter_mut().enumerate().for_each(|(index, pixel)| {
            let u = (index % width) as f64 + 0.5;
            let v = (height - 1 - index / width) as f64 + 0.5;
            let turn = (0.5 - u / width as f64) * TAU;
            let latitude = v / height as f64 * PI - FRAC_PI_2;
            let flat = latitude.cos();
            let found = (look.radiance)(DVec3::new(flat * turn.cos(), flat * turn.sin(), latitude.sin()));
            *pixel = [scale * found[0], scale * found[1], scale * found[2], 1.0].map(|value| value as f32);
        });
        image
    }

    /// The scene under this sky, and the sky's picture, whose file is to lie beside the scene's under the name `file`. The scene's first sun
    /// takes the sky's colour; `elevation` in degrees moves it up or down first. The others are put out.
    pub fn over(&self, scene: &Scene, values: &Values, elevation: Option<f64>, file: &Path) -> Result<(Scene, Image)> {
        let mut scene = scene.clone();
        let is_sun = |light: &scene::Light| matches!(light.kind, LightKind::Sun { .. });
        let Some(number) = scene.lights.iter().position(is_sun) else {
            return Err(Error::new(
                "the lights of the scene",
                "no sun",
                "a sun, by which a sky is lit",
                "Give the scene a light of type sun.",
            ));
        };
        let mut index = 0;
        scene.lights.retain(|light| {
            index += 1;
            index - 1 == number || !is_sun(light)
        });
        let light = &mut scene.lights[number];
        let matrix = scene::matrix_to_glam(&light.matrix_world);
        let mut towards = matrix.z_axis.truncate().normalize();
        if let Some(degrees) = elevation {
            let axes = scene::axes_from([towards.y.atan2(towards.x).to_degrees(), degrees]);
            scene::put_axes(&mut light.matrix_world, axes, None);
            towards = axes.z_axis;
        }
        let look = (self.look)(values, towards);
        light.color = look.sun.map(|channel| channel as f32);
        let image = self.picture(&look, white(&scene));
        let picture = WorldImage { file: file.to_string_lossy().into_owned(), sha256: String::new() };
        scene.world = scene::World { color: [1.0; 3], strength: 1.0, image: Some(picture), graph: None };
        Ok((scene, image))
    }

    /// [`Self::over`], written: the picture first, so that a scene file never names one that is not there.
    pub fn write(&self, scene: &Scene, values: &Values, elevation: Option<f64>, output: &Path) -> Result<Scene> {
        let name = output.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let stem = name.strip_suffix(".json").unwrap_or(&name);
        let stem = stem.strip_suffix(".scene").unwrap_or(stem);
        let file = format!("{stem}.sky.exr");
        let (mut scene, image) = self.over(scene, values, elevation, Path::new(&file))?;
        let path = output.with_file_name(&file);
        image.write_exr(&path, false)?;
        let bytes = std::fs::read(&path).map_err(|cause| Error::io(&path, "the picture of the sky", &cause))?;
        let picture = scene.world.image.as_mut().expect("a sky is a picture");
        picture.sha256 = files::sha256(&bytes);
        files::write_atomically(output, files::json(&scene).as_bytes())?;
        Ok(scene)
    }
}

/// Radiance that stands for 1 of a published display: of a white matte surface under the scene's first sun, before its colour; 1 / pi without one.
pub fn white(scene: &Scene) -> f64 {
    let sun = scene.lights.iter().find(|light| matches!(light.kind, LightKind::Sun { .. }));
    sun.map_or(1.0, scene::Light::exposed_strength) / PI
}

/// Between two colours, for a part from 0 to 1.
pub fn mix(from: [f64; 3], to: [f64; 3], part: f64) -> [f64; 3] {
    std::array::from_fn(|channel| from[channel] + (to[channel] - from[channel]) * part)
}

/// A colour of the web (0x6699cc) as linear Rec. 709 (IEC 61966-2-1).
pub fn of_web(colour: u32) -> [f64; 3] {
    [16, 8, 0].map(|shift| {
        let value = f64::from((colour >> shift) & 255) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    })
}
