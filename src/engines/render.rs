//! A published cloud engine in a scene: its density in the scene's box, its march and light, the scene's camera, sun and world.
//!
//! The box of the scene's volume is the engine's container, and must be a cube; the engine's y axis is the box's z axis, and its z
//! axis the box's -y axis. The sun delivers `strength` and the world's radiance is the ambient one, so that the engine's picture and a
//! path-traced one are of one scene.

use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::base::identity;
use crate::base::identity::Identity;
use crate::base::progress::Progress;
use crate::engines::Engine;
use crate::engines::light::LightModel;
use crate::engines::march;
use crate::engines::march::RealTimeRay;
use crate::engines::march::adapter::RealTimeKernel;
use crate::engines::passes::god_rays::Layer;
use crate::gpu::Gpu;
use crate::gpu::{Backend, worker};
use crate::media::averages::WithCoarse;
use crate::media::density::DensityModel;
use crate::media::transfer::smooth;
use crate::scene::image::Image;
use crate::scene::{self, Bounds, Scene};
use crate::view::camera::Camera;
use crate::view::lights::{Source, delta_lights, world_radiance};
use crate::view::{blue_noise, film, memory};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Pixels that are marched between two reports.
const PIXELS: usize = 1 << 14;

/// How far a box's sides may differ, as a share: what matrices in single precision leave.
const CUBE: f64 = 1e-5;

/// Memory that a picture takes at most while it is made, per pixel: rays, their results, the pixel and its channels for the file.
const BYTES_PER_PIXEL: u64 = 256;

/// Where within its steps a ray takes its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
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
    frame: Frame,
    light: LightModel,
    /// The density with its averages, where the light reads them.
    averaged: Option<WithCoarse<'a>>,
    adapter: Option<(&'a Gpu, RealTimeKernel<'a>)>,
}

impl<'a> EngineRenderer<'a> {
    /// On the adapter where one is given, else on all cores.
    pub fn new(scene: &'a Scene, engine: &'a Engine, gpu: Option<&'a Gpu>) -> Result<Self> {
        let frame = Frame::of(scene)?;
        let mut light = engine.light.clone();
        frame.light(scene, &mut light)?;
        let averaged = light
            .terms
            .needs_coarse()
            .then(|| WithCoarse { density: engine.density.as_ref(), coarse: engine.coarse() });
        let mut renderer = Self { scene, engine, frame, light, averaged, adapter: None };
        if let Some(gpu) = gpu {
            let kernel = RealTimeKernel::new(gpu, renderer.density(), &renderer.light, &engine.march)?;
            renderer.adapter = Some((gpu, kernel));
        }
        Ok(renderer)
    }

    fn density(&self) -> &dyn DensityModel {
        match &self.averaged {
            Some(averaged) => averaged,
            None => self.engine.density.as_ref(),
        }
    }

    /// A picture; its provenance says what was used.
    pub fn picture(&self, settings: &EngineSettings, progress: Progress<'_>) -> Result<Image> {
        check_memory(self.scene, settings)?;
        let begin = std::time::Instant::now();
        let Self { scene, engine, frame, light, .. } = self;
        let size = scene.image_size();
        let strata = settings.sub_pixels as usize;
        let camera = Camera::new(scene, size)?;
        let [width, height] = size.map(|side| side as usize);
        let offsets = film::offsets(scene.film.pixel_filter, f64::from(scene.film.filter_width), strata);
        let background = world_radiance(scene);
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
                    RealTimeRay {
                        origin: frame.to_box.transform_point3(ray.origin + ray.direction * ray.near),
                        direction: frame.to_box.transform_vector3(ray.direction * frame.side),
                        farthest: (ray.far - ray.near) / frame.side,
                        jitter,
                    }
                })
                .collect();
            let found = match &self.adapter {
                Some((_, kernel)) => kernel.march(&rays)?,
                None => march::march(self.density(), light, &engine.march, &rays)?,
            };
            for (pixel, parts) in pixels.zip(found.chunks_exact(strata * strata)) {
                let mut mean = [0.0; 4];
                for part in parts {
                    let shown = engine.compositing.composite(part, (!scene.film.transparent).then_some(background));
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
            add_god_rays(&mut image, scene, engine, &camera, frame, light, &through)?;
        }
        for (name, value) in [
            ("renderer", format!("cloudparity {} engine {}", env!("CARGO_PKG_VERSION"), engine.model)),
            (identity::ATTRIBUTE, Identity::current().full().to_owned()),
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

/// The local box of a density model in an object's bounds: object frame to local box.
pub fn box_of(bounds: &Bounds) -> DAffine3 {
    let [low, high] = [bounds.min, bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
    let extent = high - low;
    // Columns: the model's x, y and z axis, of which y points up, as edges of the box.
    let edges = DMat3::from_cols(DVec3::X * extent.x, DVec3::Z * extent.z, DVec3::NEG_Y * extent.y);
    DAffine3 { matrix3: edges, translation: (low + high) / 2.0 }.inverse()
}

/// Metres of a side of the scene's box, which must be a cube: the engine's unit of length.
pub fn container_side(scene: &Scene) -> Result<f64> {
    Ok(Frame::of(scene)?.side)
}

/// The engine's container in the scene.
struct Frame {
    /// World to local box.
    to_box: DAffine3,
    /// Metres of a side.
    side: f64,
}

impl Frame {
    fn of(scene: &Scene) -> Result<Self> {
        let volume = &scene.volume;
        let to_world = scene::matrix_to_glam(&volume.matrix_world);
        let extent = DVec3::from(volume.bounds.max.map(f64::from)) - DVec3::from(volume.bounds.min.map(f64::from));
        let axes = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|axis| axis.truncate());
        let edges: [DVec3; 3] = std::array::from_fn(|axis| axes[axis] * extent[axis]);
        let side = edges[0].length();
        let is_cube = (0..3).all(|axis| {
            let next = (axis + 1) % 3;
            (edges[axis].length() - side).abs() <= CUBE * side
                && edges[axis].dot(edges[next]).abs() <= CUBE * side * side
        });
        if !is_cube || side == 0.0 {
            let lengths = edges.map(|edge| format!("{:.4}", edge.length())).join(" x ");
            return Err(Error::new(
                format!("object {}", volume.object),
                format!("a box of {lengths} m"),
                "a cube, which is what the engine's container is",
                "Give the object sides of one length, or take a scene with such a box.",
            ));
        }
        Ok(Self { to_box: box_of(&volume.bounds) * DAffine3::from_mat4(to_world.inverse()), side })
    }

    /// Puts the scene's sun and world into a light model.
    fn light(&self, scene: &Scene, light: &mut LightModel) -> Result<()> {
        let exposure = light.terms.exposure;
        light.sun = [0.0; 3];
        let exposed = |light: [f64; 3]| light.map(|channel| channel * exposure);
        light.ambient = exposed(world_radiance(scene));
        let lights = delta_lights(scene)?;
        for (number, found) in lights.iter().enumerate() {
            let Source::Direction(towards) = found.source else {
                return Err(Error::new(
                    format!("light {}", scene.lights[number].name),
                    "a light that is no sun",
                    "suns: the engine knows light from one direction",
                    "Take the light away, or give another integrator.",
                ));
            };
            if number > 0 {
                return Err(Error::new(
                    format!("light {}", scene.lights[number].name),
                    "a second sun",
                    "one: the engine knows a single direction",
                    "Take a sun away, or give another integrator.",
                ));
            }
            light.sun = exposed(found.power);
            light.sun_direction = self.to_box.transform_vector3(towards).to_array();
        }
        if let Some(image) = &scene.world.image {
            return Err(Error::new(
                "$.world.image",
                format!("the picture \"{}\"", image.file),
                "a constant world: the engine's ambient light has no direction",
                "Leave the picture out, or give another integrator.",
            ));
        }
        Ok(())
    }
}

/// Adds the engine's god rays: the sun's glow times what the cloud lets through, at half the resolution, blurred towards the sun.
/// The original never renders that picture (defect PF-11).
fn add_god_rays(
    image: &mut Image,
    scene: &Scene,
    engine: &Engine,
    camera: &Camera,
    frame: &Frame,
    light: &LightModel,
    through: &[f32],
) -> Result<()> {
    let brightest = light.sun.into_iter().fold(0.0, f64::max);
    if brightest == 0.0 {
        return Ok(());
    }
    let from_box = frame.to_box.inverse();
    let to_sun = from_box.transform_vector3(DVec3::from(light.sun_direction)).normalize();
    let place = from_box.translation + to_sun * (SUN_DISTANCE * frame.side);
    let Some((sun, cosine)) = camera.device_coordinates(place) else {
        return Err(Error::new(
            "$.camera.projection",
            "a panorama",
            "a picture on a plane: god rays are straight there only",
            "Leave --god-rays out, or take another camera.",
        ));
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
    let colour = light.sun.map(|channel| channel / brightest * strength);
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
