//! A published cloud engine in a scene: its density in the scene's box, its march and light, the scene's camera, sun and world.
//!
//! The box of the scene's volume is the engine's container, and must be a cube; the engine's y axis is the box's z axis, and its z
//! axis the box's -y axis. The sun delivers `strength` and the world's radiance is the ambient one, so that the engine's picture and a
//! path-traced one are of one scene.

use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::base::progress::Progress;
use crate::engines::Engine;
use crate::engines::light::LightModel;
use crate::engines::march;
use crate::engines::march::RealTimeRay;
use crate::engines::march::adapter::RealTimeKernel;
use crate::engines::passes::compositing::mean_transmittance;
use crate::engines::passes::god_rays::GodRayPass;
use crate::engines::passes::{Channels, Pass, Sun, View};
use crate::gpu::Gpu;
use crate::gpu::{Backend, worker};
use crate::media::averages::WithCoarse;
use crate::media::density::DensityModel;
use crate::scene::image::Image;
use crate::scene::{self, Bounds, Scene};
use crate::view::camera::Camera;
use crate::view::lights::{Source, delta_lights, world_radiance};
use crate::view::{blue_noise, film, jitter_table, memory};
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
    /// At a place from the table that the reference pictures of a published engine have, moved by the golden ratio from frame to frame.
    Table,
    /// At a place from a tile of blue noise, moved likewise.
    BlueNoise,
}

impl EngineJitter {
    /// Part of a step before the first sample, 0 to 1, of a fragment: a ray of the picture, in columns and rows of rays from the bottom-left
    /// corner. So the rays of a pixel have a value each.
    pub fn value(self, [column, row]: [usize; 2], frame: u32) -> f64 {
        match self {
            Self::None => 0.5,
            Self::Table => jitter_table::value(column, row, frame),
            Self::BlueNoise => blue_noise::value(column, row, frame),
        }
    }
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
        let passes: Vec<Box<dyn Pass>> = if settings.god_rays {
            vec![Box::new(GodRayPass { rays: engine.god_rays, compositing: engine.compositing })]
        } else {
            Vec::new()
        };
        let keeps_transmittance = engine.compositing.keeps_transmittance(scene.film.transparent);
        let has_transmittance = keeps_transmittance || Channels::of(&passes).transmittance;
        image.transmittance = has_transmittance.then(|| vec![[1.0; 3]; width * height]);
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
                    let fragment = [column * strata + part % strata, line * strata + part / strata];
                    let jitter = settings.jitter.value(fragment, settings.frame);
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
                let background = (!scene.film.transparent).then_some(background);
                image.pixels[pixel] = engine.compositing.compose(parts, background, f64::from(scene.film.exposure));
                if let Some(transmittance) = &mut image.transmittance {
                    transmittance[pixel] = mean_transmittance(parts);
                }
            }
            progress((first + PIXELS).min(image.pixels.len()) as f64 / image.pixels.len() as f64, "view rays");
        }
        let view = View {
            camera: &camera,
            exposure: f64::from(scene.film.exposure),
            suns: &[frame.sun(light)],
            centre: frame.to_box.inverse().translation,
            side: frame.side,
        };
        passes.iter().try_for_each(|pass| pass.run(&mut image, &view))?;
        if !keeps_transmittance {
            image.transmittance = None;
        }
        for (name, value) in [
            ("renderer", format!("cloudparity {} engine {}", env!("CARGO_PKG_VERSION"), engine.model)),
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

    /// The sun of a light model in the scene.
    fn sun(&self, light: &LightModel) -> Sun {
        let towards = self.to_box.inverse().transform_vector3(DVec3::from(light.sun_direction)).normalize();
        Sun { towards, light: light.sun }
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
