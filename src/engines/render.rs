//! An engine in a scene: its density in its domain, its march and light, the scene's camera, suns and world.
//!
//! A sun delivers its `strength`, and the world's mean radiance over all directions is the ambient one; behind the cloud stands the world
//! itself. So the engine's picture and a path-traced one are of one scene.

use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::base::progress::Progress;
use crate::engines::Engine;
use crate::engines::domain::Container;
use crate::engines::light::LightModel;
use crate::engines::light::Sun;
use crate::engines::march::RealTimeRay;
use crate::engines::march::adapter::MarchKernel;
use crate::engines::passes::god_rays::Layer;
use crate::gpu::Gpu;
use crate::gpu::{Backend, worker};
use crate::media::transfer::smooth;
use crate::scene::Scene;
use crate::scene::image::Image;
use crate::view::camera::Camera;
use crate::view::environment::Environment;
use crate::view::lights::{Source, delta_lights, world_radiance};
use crate::view::{blue_noise, film, memory};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Pixels that are marched between two reports.
const PIXELS: usize = 1 << 14;

/// Memory that a picture takes at most while it is made, per pixel: rays, their results, the pixel and its channels for the file.
const BYTES_PER_PIXEL: u64 = 256;

/// Where within its steps a ray takes its samples.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumMessage,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum EngineJitter {
    /// In the middle.
    None,
    /// At a place from a tile of blue noise, moved by the golden ratio from frame to frame.
    BlueNoise,
}

/// How a picture is made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EngineSettings {
    /// Where samples lie.
    pub jitter: EngineJitter,
    /// The frame of the jitter.
    pub frame: u32,
    /// Rays per pixel and axis.
    pub sub_pixels: u32,
    /// Whether god rays are added.
    pub god_rays: bool,
}

/// Distance of the point that stands for the sun on the screen, in sides of the box: 9000 units where the box has 120.
const SUN_DISTANCE: f64 = 75.0;

/// Angular radius of the sun's glow in the occlusion picture, in radians: at half resolution a true disc would fall between pixels.
const SUN_GLOW: f64 = 0.05;

/// Cosine to the view axis below which god rays fade, to nothing where the sun stands in the image plane.
const FADE: f64 = 0.2;

/// Renders a scene with an engine in place of its graph. The picture's provenance says what was used.
pub fn render(
    scene: &Scene,
    engine: &Engine,
    settings: &EngineSettings,
    backend: Backend,
    progress: Progress<'_>,
) -> Result<Image> {
    check_memory(scene, settings)?;
    let gpu = backend.open()?;
    EngineRenderer::new(scene, engine, gpu.as_ref())?.picture(settings, progress)
}

fn check_memory(scene: &Scene, settings: &EngineSettings) -> Result<()> {
    memory::check(scene.image_size(), BYTES_PER_PIXEL * u64::from(settings.sub_pixels).pow(2))
}

/// An engine that is ready to make pictures of a scene: lit, and compiled where it runs on an adapter.
pub struct EngineRenderer<'a> {
    scene: &'a Scene,
    engine: &'a Engine,
    light: LightModel,
    background: Background,
    adapter: Option<(&'a Gpu, MarchKernel<'a>)>,
}

/// What stands behind the cloud.
enum Background {
    Constant([f64; 3]),
    Picture(Environment),
}

impl Background {
    fn of(scene: &Scene) -> Result<Self> {
        Ok(Environment::load(scene)?.map_or_else(|| Self::Constant(world_radiance(scene)), Self::Picture))
    }

    /// Radiance from a unit direction.
    fn radiance(&self, direction: DVec3) -> [f64; 3] {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Picture(picture) => picture.radiance(direction),
        }
    }

    /// Mean over all directions.
    fn mean(&self) -> [f64; 3] {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Picture(picture) => picture.mean_radiance(),
        }
    }
}

impl<'a> EngineRenderer<'a> {
    /// On the adapter where one is given, else on all cores.
    pub fn new(scene: &'a Scene, engine: &'a Engine, gpu: Option<&'a Gpu>) -> Result<Self> {
        let background = Background::of(scene)?;
        let light = lit_by(scene, &background, engine.light.clone())?;
        let marched = engine.marched(&light)?;
        let adapter = match gpu {
            Some(gpu) => Some((gpu, MarchKernel::new(gpu, &marched, &engine.march)?)),
            None => None,
        };
        Ok(Self { scene, engine, light, background, adapter })
    }

    /// A picture; its provenance says what was used.
    pub fn picture(&self, settings: &EngineSettings, progress: Progress<'_>) -> Result<Image> {
        check_memory(self.scene, settings)?;
        let begin = std::time::Instant::now();
        let Self { scene, engine, light, background, .. } = self;
        let marched = engine.marched(light)?;
        let size = scene.image_size();
        let strata = settings.sub_pixels as usize;
        let camera = Camera::new(scene, size)?;
        let [width, height] = size.map(|side| side as usize);
        let offsets = film::offsets(scene.film.pixel_filter, f64::from(scene.film.filter_width), strata);
        let mut image = Image::new(width, height);
        let mut through: Vec<f32> = Vec::with_capacity(if settings.god_rays { width * height } else { 0 });
        for first in (0..image.pixels.len()).step_by(PIXELS) {
            let pixels = first..image.pixels.len().min(first + PIXELS);
            let rays: Vec<RealTimeRay> = pixels
                .clone()
                .flat_map(|pixel| (0..strata * strata).map(move |part| (pixel, part)))
                .map(|(pixel, part)| {
                    let (column, line) = (pixel % width, height - 1 - pixel / width);
                    let raster = DVec2::new(
                        column as f64 + 0.5 + offsets[part % strata],
                        line as f64 + 0.5 + offsets[part / strata],
                    );
                    let jitter = match settings.jitter {
                        EngineJitter::None => 0.5,
                        EngineJitter::BlueNoise => blue_noise::value(column, line, settings.frame),
                    };
                    let ray = camera.ray(raster);
                    let start = ray.origin + ray.direction * ray.near;
                    engine.container.ray(start, ray.direction, ray.far - ray.near, jitter)
                })
                .collect();
            let found = match &self.adapter {
                Some((_, kernel)) => kernel.march(&rays)?,
                None => marched.march(&engine.march, &rays)?,
            };
            let per_pixel = strata * strata;
            for ((pixel, parts), rays) in pixels.zip(found.chunks_exact(per_pixel)).zip(rays.chunks_exact(per_pixel)) {
                let mut mean = [0.0; 4];
                for (part, ray) in parts.iter().zip(rays) {
                    let behind = (!scene.film.transparent).then(|| background.radiance(ray.direction));
                    let shown = engine.compositing.composite(part, behind);
                    for channel in 0..4 {
                        mean[channel] += shown[channel] / parts.len() as f64;
                    }
                }
                let exposure = f64::from(scene.film.exposure);
                image.pixels[pixel] =
                    [mean[0] * exposure, mean[1] * exposure, mean[2] * exposure, mean[3]].map(|value| value as f32);
                if settings.god_rays {
                    let alpha: f64 = parts.iter().map(|part| engine.compositing.alpha(part)).sum();
                    through.push((1.0 - alpha / parts.len() as f64) as f32);
                }
            }
            progress((first + PIXELS).min(image.pixels.len()) as f64 / image.pixels.len() as f64, "view rays");
        }
        if settings.god_rays {
            add_god_rays(&mut image, scene, engine, &camera, light, &through)?;
        }
        for (name, value) in [
            ("renderer", format!("cloudparity {} engine {}", env!("CARGO_PKG_VERSION"), engine.model)),
            ("domain", engine.container.domain.to_string()),
            ("defects", engine.defects.to_string()),
            ("parameters", json(&engine.values)),
            ("light", json(light)),
            ("march", json(&engine.march)),
            ("settings", json(settings)),
            ("scene", scene.name.clone()),
            ("scene_sha256", scene.content_hash()),
            ("film", json(&scene.film)),
            ("backend", worker(self.adapter.as_ref().map(|(gpu, _)| *gpu))),
            ("render_seconds", format!("{:.3}", begin.elapsed().as_secs_f64())),
        ] {
            image.provenance.insert(name.to_owned(), value);
        }
        Ok(image)
    }
}

/// A light model under a scene's suns and world.
fn lit_by(scene: &Scene, background: &Background, mut light: LightModel) -> Result<LightModel> {
    let exposure = light.terms.exposure;
    let exposed = |light: [f64; 3]| light.map(|channel| channel * exposure);
    light.ambient = exposed(background.mean());
    light.suns.clear();
    for (number, found) in delta_lights(scene)?.iter().enumerate() {
        let Source::Direction(towards) = found.source else {
            return Err(Error::new(
                format!("light {}", scene.lights[number].name),
                "a light that is no sun",
                "suns: engines know light from directions alone",
                "Take the light away, or give another integrator.",
            ));
        };
        light.suns.push(Sun { direction: towards.to_array(), irradiance: exposed(found.power) });
    }
    Ok(light)
}

/// Adds the engine's god rays: the sun's glow times what the cloud lets through, at half the resolution, blurred towards the sun.
/// The original never renders that picture (defect PF-11).
fn add_god_rays(
    image: &mut Image,
    scene: &Scene,
    engine: &Engine,
    camera: &Camera,
    light: &LightModel,
    through: &[f32],
) -> Result<()> {
    let Some(star) = light.suns.iter().max_by(|a, b| a.brightest().total_cmp(&b.brightest())) else { return Ok(()) };
    let brightest = star.brightest();
    if brightest == 0.0 {
        return Ok(());
    }
    let to_sun = star.towards();
    let Container { to_local, unit, outline, .. } = &engine.container;
    let region = outline.region();
    let middle = to_local.inverse().transform_point3((region.low + region.high) / 2.0);
    let place = middle + to_sun * (SUN_DISTANCE * unit);
    let Some((sun, cosine)) = camera.device_coordinates(place) else {
        return Err(Error::new(
            "$.camera.projection",
            "a panorama",
            "a picture on a plane: god rays are straight there only",
            "Leave the god rays out, or take another camera.",
        )
        .with_setting("god_rays"));
    };
    let fade = if engine.god_rays.from_behind { 1.0 } else { smooth(0.0, FADE, cosine) };
    let [width, height] = [image.width.div_ceil(2), image.height.div_ceil(2)];
    let mut occlusion = Layer { width, height, pixels: vec![[0.0; 3]; width * height] };
    for (index, pixel) in occlusion.pixels.iter_mut().enumerate() {
        let (column, row) = (index % width, index / width);
        let raster = DVec2::new(2.0 * column as f64 + 1.0, image.height as f64 - 2.0 * row as f64 - 1.0);
        let angle = camera.ray(raster).direction.dot(to_sun).clamp(-1.0, 1.0).acos();
        // The four pixels that it covers, or those that there are.
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 2 * row..(2 * row + 2).min(image.height) {
            for x in 2 * column..(2 * column + 2).min(image.width) {
                sum += f64::from(through[y * image.width + x]);
                count += 1.0;
            }
        }
        *pixel = [sum / count * smooth(SUN_GLOW, 0.0, angle); 3];
    }
    let strength = fade * f64::from(scene.film.exposure);
    let colour = star.irradiance.map(|channel| channel / brightest * strength);
    let rays = engine.god_rays.render(&occlusion, sun.to_array(), colour);
    for (index, pixel) in image.pixels.iter_mut().enumerate() {
        let u = ((index % image.width) as f64 + 0.5) / (2 * width) as f64;
        let v = 1.0 - ((index / image.width) as f64 + 0.5) / (2 * height) as f64;
        let found = rays.sample([u, v]);
        for channel in 0..3 {
            pixel[channel] += found[channel] as f32;
        }
    }
    Ok(())
}
