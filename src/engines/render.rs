//! An engine in a scene: its density in its domain, its march and light, the scene's camera, suns and world.
//!
//! A sun delivers its `strength`, and the world's mean radiance over all directions is the ambient one; behind the cloud stands the world
//! itself. So the engine's picture and a path-traced one are of one scene.
//!
//! On the adapter a picture is marched, composed and post-processed there, and stays there as a [`Frame`] until somebody reads it.

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::base::identity;
use crate::base::identity::Identity;
use crate::base::progress::Progress;
use crate::engines::Engine;
use crate::engines::domain::Container;
use crate::engines::frame_kernel::{FrameKernel, Look};
use crate::engines::light::{LightModel, Sun};
use crate::engines::march::camera::{CameraKernel, ViewUniform};
use crate::engines::march::gpu::{Form, MarchKernel, MarchParts, OfRays, goes_at_once};
use crate::engines::march::shadow_map::ShadowMap;
use crate::engines::march::{Marched, ReadyMarch, RealTimePixel, RealTimeRay};
use crate::engines::passes::compositing::{self, CompositeKernel, Part, mean_transmittance};
use crate::engines::passes::frame::Frame;
use crate::engines::passes::god_rays::GodRayPass;
use crate::engines::passes::{Channels, Pass, PassKernel, View};
use crate::engines::reconstruction::Shot;
use crate::gpu::Gpu;
use crate::gpu::{Backend, worker};
use crate::scene::image::Image;
use crate::scene::{LightKind, Scene};
use crate::view::camera::Camera;
use crate::view::environment::Environment;
use crate::view::film::Warp;
use crate::view::lights::{suns, world_radiance};
use crate::view::sampler::Sampler;
use crate::view::{blue_noise, jitter_table, memory};
use glam::DVec2;
use rayon::iter::Either;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Pixels that are marched between two reports.
const PIXELS: usize = 1 << 14;

/// The same where hardware makes the rays itself: 64 MiB of them.
const PIXELS_OF_HARDWARE: usize = 1 << 20;

/// Part of a pixel that is no distance: the filter's middle is found by a table.
const MIDDLE: f64 = 1e-6;

/// Rays that are marched together at most on the CPU, but for those of one pixel.
const MOST_RAYS: usize = 1 << 20;

/// Memory that a picture takes at most while it is made, per pixel: rays, their results, the pixel and its channels for the file.
const BYTES_PER_PIXEL: u64 = 256;

choice! {
    "kebab-case",
    /// Where within its steps a ray takes its samples.
    pub enum EngineJitter {
        /// In the middle; with defect TK-3 at the end.
        None,
        /// At a place from the table that the reference pictures of a published engine have, moved by the golden ratio from frame to frame.
        Table,
        /// At a place from a tile of blue noise, moved likewise.
        BlueNoise,
    }
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

/// An engine that is ready to make pictures of a scene: lit, and compiled on an adapter once a picture, or [`EngineRenderer::compile`], asks.
pub struct EngineRenderer<'a> {
    scene: &'a Scene,
    engine: &'a Engine,
    light: LightModel,
    background: Background,
    camera: Camera,
    /// Where in a pixel its rays pass.
    warp: Warp,
    /// Shadow maps of the suns, where the light reads them.
    maps: Vec<ShadowMap>,
    adapter: Option<OnAdapter<'a>>,
}

/// What an engine is on an adapter.
struct OnAdapter<'a> {
    gpu: &'a Gpu,
    /// How it makes rays of pixels that have one each, in the middle; none where the processor makes them.
    view: Option<ViewUniform>,
    /// Those of the last frame.
    kernels: Mutex<Option<Kernels<'a>>>,
}

/// The kernels of a frame.
struct Kernels<'a> {
    kind: FrameKind,
    stages: Stages<'a>,
    passes: Vec<Box<dyn PassKernel + 'a>>,
}

/// What decides which kernels a frame needs.
#[derive(Clone, Copy, PartialEq, Eq)]
struct FrameKind {
    god_rays: bool,
    /// Whether the adapter makes the rays.
    own_rays: bool,
}

/// How pixels are made.
enum Stages<'a> {
    /// All in one.
    One(FrameKernel<'a>),
    /// Rays, where the adapter makes them, march and compositing.
    Several { camera: Option<CameraKernel<'a>>, march: MarchKernel<'a>, composite: CompositeKernel<'a> },
}

impl<'a> OnAdapter<'a> {
    /// The kernels of the last frame, which are no longer here then.
    fn last(&self) -> Option<Kernels<'a>> {
        self.kernels.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn keep(&self, kernels: Kernels<'a>) {
        *self.kernels.lock().unwrap_or_else(PoisonError::into_inner) = Some(kernels);
    }
}

choice! {
    "kebab-case",
    /// Where the rays of a picture on an adapter are made.
    pub enum RayMaker {
        /// On all cores, in f64.
        Processor,
        /// On the adapter, in f32, where pixels have one ray each without jitter, a perspective or orthographic camera looks at a box, and one colour
        /// stands behind: as near as f32's rounding of the distance to the camera.
        Adapter,
    }
}

impl RayMaker {
    /// Hardware would wait for the processor. Software is the processor: there rays are the adapter's where f32 does not show.
    fn of(gpu: &Gpu, view: &ViewUniform, container: &Container) -> Self {
        if !gpu.adapter().is_software() || view.is_near(container) { Self::Adapter } else { Self::Processor }
    }
}

/// Rays of a pixel that its filter draws, instead of one for each stratum: those of path tracing with the same seed and as many samples, so that
/// the noise of where they pass goes out of a difference. The places in their steps are drawn, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Drawn {
    /// The seed.
    pub seed: u32,
    /// Rays of a pixel.
    pub rays: u32,
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

    /// Mean radiance behind the rays of a pixel.
    fn behind(&self, rays: &[RealTimeRay]) -> [f64; 3] {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Picture(picture) => {
                let mut sum = [0.0; 3];
                for ray in rays {
                    let found = picture.radiance(ray.direction);
                    (0..3).for_each(|channel| sum[channel] += found[channel] / rays.len() as f64);
                }
                sum
            }
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

/// What a picture of these settings is made of.
struct Plan {
    passes: Vec<Arc<dyn Pass>>,
    /// Channels while it is made, and whether those beside the colour stay in it.
    channels: Channels,
    keeps_transmittance: bool,
    /// Places of a pixel's rays along an axis.
    offsets: Vec<f64>,
}

impl<'a> EngineRenderer<'a> {
    /// On the adapter where one is given, else on all cores.
    pub fn new(scene: &'a Scene, engine: &'a Engine, gpu: Option<&'a Gpu>) -> Result<Self> {
        Self::by_maker(scene, engine, gpu, None)
    }

    /// On an adapter, whose rays this one makes where it can.
    pub fn on_adapter(scene: &'a Scene, engine: &'a Engine, gpu: &'a Gpu, ray_maker: RayMaker) -> Result<Self> {
        Self::by_maker(scene, engine, Some(gpu), Some(ray_maker))
    }

    fn by_maker(
        scene: &'a Scene,
        engine: &'a Engine,
        gpu: Option<&'a Gpu>,
        ray_maker: Option<RayMaker>,
    ) -> Result<Self> {
        let mut renderer = Self::prepared(scene, engine)?;
        let Some(gpu) = gpu else { return Ok(renderer) };
        // A panorama and another domain have no such view; a picture behind the cloud needs the rays, air and levels of distance where they begin.
        let is_plain = matches!(renderer.background, Background::Constant(_))
            && engine.air.is_none()
            && engine.march.distance_levels.is_none();
        let view = is_plain.then(|| ViewUniform::new(&renderer.camera, &engine.container, scene.image_size()).ok());
        let view = view.flatten().filter(|view| {
            ray_maker.unwrap_or_else(|| RayMaker::of(gpu, view, &engine.container)) == RayMaker::Adapter
        });
        renderer.adapter = Some(OnAdapter { gpu, view, kernels: Mutex::new(None) });
        Ok(renderer)
    }

    /// Compiles what pictures under these settings need on an adapter, which the first of them does otherwise.
    pub fn compile(&self, settings: &EngineSettings) -> Result<()> {
        let Some(adapter) = &self.adapter else { return Ok(()) };
        let kernels = adapter.gpu.block_on(self.kernels_async(adapter, settings, &self.plan(settings)))??;
        adapter.keep(kernels);
        Ok(())
    }

    /// The kernels of a frame: those of the last one, if it was alike.
    async fn kernels_async(
        &self,
        adapter: &OnAdapter<'a>,
        settings: &EngineSettings,
        plan: &Plan,
    ) -> Result<Kernels<'a>> {
        let OnAdapter { gpu, view, .. } = *adapter;
        // The adapter's rays are those in the middle of pixels.
        let is_middle = plan.offsets.len() == 1 && plan.offsets[0].abs() < MIDDLE;
        let view = view.filter(|_| is_middle && settings.jitter == EngineJitter::None);
        let kind = FrameKind { god_rays: settings.god_rays, own_rays: view.is_some() };
        if let Some(last) = adapter.last().filter(|last| last.kind == kind) {
            return Ok(last);
        }
        let march = &self.engine.march;
        let marched = self.marched()?;
        let look = Look {
            compositing: self.engine.compositing,
            // A picture is read for each frame.
            background: self.behind_frames(gpu, &[0.0; 3]),
            channels: plan.channels,
            exposure: f64::from(self.scene.film.exposure),
        };
        let stages = match view {
            Some(view) if goes_at_once(gpu, &marched, march) => {
                Stages::One(FrameKernel::new_async(gpu, &marched, march, view, &look).await?)
            }
            _ => Stages::Several {
                camera: match view {
                    Some(view) => Some(CameraKernel::new_async(gpu, view).await?),
                    None => None,
                },
                march: MarchKernel::new_async(gpu, &marched, march).await?,
                composite: CompositeKernel::new_async(gpu, look.compositing, look.background, look.channels).await?,
            },
        };
        let mut passes = Vec::with_capacity(plan.passes.len());
        for pass in &plan.passes {
            passes.push(pass.compile(gpu).await?);
        }
        Ok(Kernels { kind, stages, passes })
    }

    /// What stands behind the cloud on the adapter; of a picture the radiance of each pixel, three numbers.
    fn behind_frames(&self, gpu: &Gpu, of_picture: &[f32]) -> compositing::Background {
        match &self.background {
            _ if self.scene.film.transparent => compositing::Background::None,
            Background::Constant(radiance) => compositing::Background::Constant(*radiance),
            Background::Picture(_) => compositing::Background::PerPixel(gpu.upload(
                "background",
                bytemuck::cast_slice(of_picture),
                wgpu::BufferUsages::STORAGE,
            )),
        }
    }

    /// Radiance behind each pixel, three numbers, along the rays of these settings.
    fn radiance_behind(&self, plan: &Plan, settings: &EngineSettings) -> Vec<f32> {
        let [width, height] = self.scene.image_size().map(|side| side as usize);
        let total = width * height;
        let mut radiance: Vec<f32> = Vec::with_capacity(3 * total);
        for first in (0..total).step_by(PIXELS) {
            let rays = self.rays(plan, settings, first..total.min(first + PIXELS));
            let of_pixels = rays.chunks_exact(plan.offsets.len().pow(2));
            radiance.extend(of_pixels.flat_map(|rays| self.background.behind(rays).map(|value| value as f32)));
        }
        radiance
    }

    fn prepared(scene: &'a Scene, engine: &'a Engine) -> Result<Self> {
        let background = Background::of(scene)?;
        let mut light = lit_by(scene, &background, engine.light.clone())?;
        if engine.light_volume.is_some() {
            // It has the light of the world.
            light.ambient = [0.0; 3];
        }
        let camera = Camera::new(scene, scene.image_size())?;
        let maps = ShadowMap::of(&engine.marched(&light)?, Some(&camera))?;
        let warp = Warp::new(scene.film.pixel_filter, f64::from(scene.film.filter_width));
        let renderer = Self { scene, engine, light, background, camera, warp, maps, adapter: None };
        renderer.marched()?.check()?;
        Ok(renderer)
    }

    /// What is marched through.
    fn marched(&self) -> Result<Marched<'_>> {
        Ok(Marched { maps: &self.maps, ..self.engine.marched(&self.light)? })
    }

    fn plan(&self, settings: &EngineSettings) -> Plan {
        let Self { scene, engine, .. } = self;
        let mut passes = engine.passes.clone();
        if settings.god_rays {
            passes.push(Arc::new(GodRayPass { rays: engine.god_rays, compositing: engine.compositing }));
        }
        let keeps_transmittance = engine.compositing.keeps_transmittance(scene.film.transparent);
        let channels = Channels { transmittance: keeps_transmittance }.and(Channels::of(&passes));
        let offsets = self.warp.strata(settings.sub_pixels as usize);
        Plan { passes, channels, keeps_transmittance, offsets }
    }

    /// The ray through a raster position, and the metres from the camera's place to where it begins.
    fn ray(&self, raster: DVec2, jitter: f64) -> (RealTimeRay, f64) {
        let ray = self.camera.ray(raster);
        let start = ray.origin + ray.direction * ray.near;
        (self.engine.container.ray(start, ray.direction, ray.far - ray.near, jitter), ray.near)
    }

    /// The ray of a number, where those of each pixel lie one behind the other.
    fn ray_of(&self, plan: &Plan, settings: &EngineSettings, number: usize) -> RealTimeRay {
        let [width, height] = self.scene.image_size().map(|side| side as usize);
        let strata = plan.offsets.len();
        // Quotients take as long as a square root; most pictures have one ray a pixel.
        let (pixel, [across, up]) = match strata {
            1 => (number, [0, 0]),
            _ => (number / strata.pow(2), [number % strata, number % strata.pow(2) / strata]),
        };
        let (column, line) = (pixel % width, height - 1 - pixel / width);
        let raster = DVec2::new(column as f64 + 0.5 + plan.offsets[across], line as f64 + 0.5 + plan.offsets[up]);
        let fragment = [column * strata + across, line * strata + up];
        self.ray(raster, settings.jitter.value(fragment, settings.frame)).0
    }

    /// The rays of some pixels, those of each one behind the other.
    fn rays(&self, plan: &Plan, settings: &EngineSettings, pixels: Range<usize>) -> Vec<RealTimeRay> {
        let per_pixel = plan.offsets.len().pow(2);
        let numbers = pixels.start * per_pixel..pixels.end * per_pixel;
        numbers.into_par_iter().map(|number| self.ray_of(plan, settings, number)).collect()
    }

    /// A ray that the pixel filter draws, by its number.
    fn drawn_ray(&self, drawn: Drawn, number: usize) -> RealTimeRay {
        let [width, height] = self.scene.image_size().map(|side| side as usize);
        let (pixel, part) = (number / drawn.rays as usize, number % drawn.rays as usize);
        let (column, line) = (pixel % width, height - 1 - pixel / width);
        // Path tracing takes the third for its first flight.
        let [across, up, _, jitter] = Sampler::new(pixel as u32, part as u32, drawn.seed).camera();
        let at = |place: usize, quantile: f64| place as f64 + 0.5 + self.warp.offset(quantile);
        self.ray(DVec2::new(at(column, across), at(line, up)), jitter).0
    }

    /// What passes know.
    pub(crate) fn view(&self) -> View<'_> {
        let container = &self.engine.container;
        View {
            camera: &self.camera,
            exposure: f64::from(self.scene.film.exposure),
            suns: &self.light.suns,
            centre: container.centre(),
            side: container.unit,
        }
    }

    /// A picture; its provenance says what was used.
    pub fn picture(&self, settings: &EngineSettings, progress: Progress<'_>) -> Result<Image> {
        check_memory(self.scene, settings)?;
        let begin = Instant::now();
        let plan = self.plan(settings);
        let mut image = match &self.adapter {
            Some(OnAdapter { gpu, .. }) => gpu.block_on(async {
                let frame = self.frame_async(settings, progress).await?;
                frame.read_back_async(gpu).await
            })??,
            None => {
                let mut image = self.composed(settings, None, progress)?;
                self.finish(&mut image, settings)?;
                image
            }
        };
        if !plan.keeps_transmittance {
            image.transmittance = None;
        }
        self.describe(&mut image, &plan, settings, begin.elapsed().as_secs_f64());
        Ok(image)
    }

    /// A picture before its passes, made on all cores, with the channels that these read. Its rays pass through the strata of the pixel filter; or
    /// they are drawn.
    pub(crate) fn composed(
        &self,
        settings: &EngineSettings,
        drawn: Option<Drawn>,
        progress: Progress<'_>,
    ) -> Result<Image> {
        let Self { scene, engine, background, .. } = self;
        let plan = &self.plan(settings);
        let marched = self.marched()?;
        let [width, height] = scene.image_size().map(|side| side as usize);
        let mut image = Image::new(width, height);
        image.transmittance = plan.channels.transmittance.then(|| vec![[1.0; 3]; width * height]);
        let per_pixel = drawn.map_or_else(|| plan.offsets.len().pow(2), |drawn| drawn.rays as usize);
        let exposure = f64::from(scene.film.exposure);
        let ready = marched.ready(&engine.march)?;
        let ray_of = |number| match drawn {
            Some(drawn) => self.drawn_ray(drawn, number),
            None => self.ray_of(plan, settings, number),
        };
        let total = image.pixels.len();
        // Between two reports. A task has whole pixels, and composes them.
        let together = (MOST_RAYS / per_pixel).clamp(1, PIXELS);
        let of_task = ReadyMarch::rays_of_task(together.min(total) * per_pixel).div_ceil(per_pixel);
        for first in (0..total).step_by(together) {
            let pixels = first..total.min(first + together);
            let tasks = pixels.len().div_ceil(of_task);
            let through = match &mut image.transmittance {
                Some(through) => Either::Left(through[pixels.clone()].par_chunks_mut(of_task).map(Some)),
                None => Either::Right((0..tasks).into_par_iter().map(|_| None)),
            };
            let shown = image.pixels[pixels.clone()].par_chunks_mut(of_task);
            shown.zip(through).enumerate().try_for_each_init(
                || None,
                |desk, (task, (shown, mut through))| -> Result<()> {
                    let (marcher, rays, found) = match desk {
                        Some(desk) => desk,
                        None => desk.insert((ready.marcher()?, Vec::new(), Vec::new())),
                    };
                    let begin = (first + task * of_task) * per_pixel;
                    rays.clear();
                    rays.extend((begin..begin + shown.len() * per_pixel).map(ray_of));
                    found.resize(rays.len(), RealTimePixel::NOTHING);
                    marcher.march(rays, found)?;
                    let of_pixels = rays.chunks_exact(per_pixel).zip(found.chunks_exact(per_pixel));
                    for (index, (rays, parts)) in of_pixels.enumerate() {
                        let behind = (!scene.film.transparent).then(|| background.behind(rays));
                        shown[index] = engine.compositing.compose(parts, behind, exposure);
                        if let Some(through) = &mut through {
                            through[index] = mean_transmittance(parts);
                        }
                    }
                    Ok(())
                },
            )?;
            progress(pixels.end as f64 / total as f64, "view rays");
        }
        Ok(image)
    }

    /// Runs the passes of a picture on all cores.
    pub(crate) fn finish(&self, image: &mut Image, settings: &EngineSettings) -> Result<()> {
        let view = self.view();
        self.plan(settings).passes.iter().try_for_each(|pass| pass.run(image, &view))
    }

    /// What rays through raster positions find on all cores, in pixels from the bottom-left corner, without passes: for frames of a sequence
    /// ([`crate::engines::reconstruction`]). Jitter is that of the pixel that a position lies in.
    pub fn shots(&self, rasters: &[DVec2], settings: &EngineSettings) -> Result<Vec<Shot>> {
        let Self { scene, engine, background, .. } = self;
        let (rays, nears): (Vec<RealTimeRay>, Vec<f64>) = rasters
            .iter()
            .map(|&raster| {
                let fragment = [raster.x, raster.y].map(|coordinate| coordinate.max(0.0) as usize);
                self.ray(raster, settings.jitter.value(fragment, settings.frame))
            })
            .unzip();
        let found = self.marched()?.march(&engine.march, &rays)?;
        let exposure = f64::from(scene.film.exposure);
        let shot = |((ray, pixel), near): ((&RealTimeRay, &RealTimePixel), f64)| {
            let behind = background.behind(std::slice::from_ref(ray));
            let [red, green, blue, _] =
                engine.compositing.compose(std::slice::from_ref(pixel), Some(behind), exposure).map(f64::from);
            let distance = pixel.distance.map_or(f64::INFINITY, |distance| near + distance * engine.container.unit);
            Shot { color: [red, green, blue], distance }
        };
        Ok(rays.iter().zip(&found).zip(nears).map(shot).collect())
    }

    /// What its march on an adapter is made of.
    pub(crate) fn march_parts(&self, form: &Form<'_>) -> Result<MarchParts> {
        MarchParts::new(&self.marched()?, &self.engine.march, form)
    }

    /// What stands behind the cloud in a finished picture: None where that has an alpha. An error where it is a picture.
    pub(crate) fn constant_background(&self) -> Result<Option<[f64; 3]>> {
        match &self.background {
            _ if self.scene.film.transparent => Ok(None),
            Background::Constant(radiance) => Ok(Some(*radiance)),
            Background::Picture(_) => Err(Error::new(
                "the world of the scene",
                "a picture",
                "one colour, or a film that is transparent: bundles carry no picture of a world",
                "Leave the world out of what the camera sees, or make it one colour.",
            )
            .with_setting("film_transparent")),
        }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Metres along the ray through a raster position to the domain of the medium; infinite where it misses.
    pub fn entry(&self, raster: DVec2) -> f64 {
        let container = &self.engine.container;
        let (ray, near) = self.ray(raster, 0.5);
        let inside = ray.inside(&container.outline);
        if inside.length == 0.0 { f64::INFINITY } else { near + inside.parts.start * container.unit }
    }

    /// A picture that stays on the adapter: marched, composed and post-processed there. An error where the engine was not prepared for an
    /// adapter.
    pub async fn frame_async(&self, settings: &EngineSettings, progress: Progress<'_>) -> Result<Frame> {
        let Some(adapter) = &self.adapter else {
            return Err(Error::new(
                "a frame on the adapter",
                "an engine that was prepared for the CPU",
                "one that was prepared for an adapter",
                "Prepare it with an adapter.",
            ));
        };
        let plan = self.plan(settings);
        let gpu = adapter.gpu;
        let frame = Frame::new(gpu, self.scene.image_size(), plan.channels)?;
        let total = frame.pixels() as usize;
        let mut kernels = self.kernels_async(adapter, settings, &plan).await?;
        match &mut kernels.stages {
            Stages::One(kernel) => kernel.run(&frame, progress)?,
            Stages::Several { camera, march, composite } => {
                if matches!(self.background, Background::Picture(_)) && !self.scene.film.transparent {
                    let radiance = self.radiance_behind(&plan, settings);
                    composite.set_background(self.behind_frames(gpu, &radiance))?;
                }
                let per_pixel = plan.offsets.len().pow(2);
                let exposure = f64::from(self.scene.film.exposure);
                let together = match camera {
                    Some(_) if !gpu.adapter().is_software() => PIXELS_OF_HARDWARE,
                    _ => PIXELS,
                };
                for first in (0..total).step_by(together) {
                    let pixels = first..total.min(first + together);
                    let marched = match camera {
                        Some(camera) => {
                            let rays = camera.rays(first as u32, pixels.len() as u32)?;
                            march.march_buffer(&rays, pixels.len(), &[], &OfRays::default())?
                        }
                        None => {
                            let begin = pixels.start * per_pixel;
                            march.march_made(pixels.len() * per_pixel, |number| {
                                self.ray_of(&plan, settings, begin + number)
                            })?
                        }
                    };
                    let part = Part { first: first as u32, count: pixels.len() as u32, rays: per_pixel as u32 };
                    composite.run(&frame, &marched, part, exposure)?;
                    // So that what is reported is done, and buffers of rays do not pile up.
                    gpu.wait_async().await?;
                    progress(pixels.end as f64 / total as f64, "view rays");
                }
            }
        }
        let view = self.view();
        kernels.passes.iter().try_for_each(|pass| pass.run(&frame, &view))?;
        adapter.keep(kernels);
        Ok(frame)
    }

    /// Says what was used.
    fn describe(&self, image: &mut Image, plan: &Plan, settings: &EngineSettings, seconds: f64) {
        let Self { scene, engine, light, .. } = self;
        let passes: Vec<String> = plan.passes.iter().map(|pass| format!("{} {}", pass.id(), pass.settings())).collect();
        let terms: Vec<&str> = engine.terms.iter().map(|term| term.import_path()).collect();
        for (name, value) in [
            ("renderer", format!("cloudparity {} engine {}", env!("CARGO_PKG_VERSION"), engine.model)),
            ("domain", engine.container.domain.to_string()),
            (identity::ATTRIBUTE, Identity::current().full().to_owned()),
            ("defects", engine.defects.to_string()),
            ("parameters", json(&engine.values)),
            ("light", json(light)),
            ("light_terms", json(&terms)),
            ("march", json(&engine.march)),
            ("passes", json(&passes)),
            ("settings", json(settings)),
            ("scene", scene.name.clone()),
            ("scene_sha256", scene.content_hash()),
            ("film", json(&scene.film)),
            ("backend", worker(self.adapter.as_ref().map(|adapter| adapter.gpu))),
            ("render_seconds", format!("{seconds:.3}")),
        ] {
            image.provenance.insert(name.to_owned(), value);
        }
        if let Some(air) = &engine.air {
            image.provenance.insert("air".into(), json(air));
        }
        if let Some(volume) = &engine.light_volume {
            image.provenance.insert("light_volume".into(), json(&volume.report()));
        }
    }
}

/// A light model under a scene's suns and world.
fn lit_by(scene: &Scene, background: &Background, mut light: LightModel) -> Result<LightModel> {
    let exposure = light.terms.exposure;
    let exposed = |light: [f64; 3]| light.map(|channel| channel * exposure);
    light.ambient = exposed(background.mean());
    light.suns.clear();
    if let Some(other) = scene.lights.iter().find(|light| !matches!(light.kind, LightKind::Sun { .. })) {
        return Err(Error::new(
            format!("light {}", other.name),
            "a light that is no sun",
            "suns: engines know light from directions alone",
            "Render by path tracing, which knows every light, or put a sun in its place.",
        ));
    }
    for (towards, power) in suns(scene)? {
        light.suns.push(Sun { direction: towards.to_array(), irradiance: exposed(power) });
    }
    Ok(light)
}
