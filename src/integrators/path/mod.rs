//! Path tracing of participating media without bias, on the CPU or the adapter.
//!
//! [`render`] gives a picture, [`render_replicas`] several with other seeds that share the majorants.
//! The algorithm is that of `tracer`; `volume` is what it asks of the media. All closures, several objects that may
//! overlap and a picture around the scene are known on the CPU; the adapter knows less and refuses the rest.
//!
//! A picture is made in passes of a fixed number of samples, a pass in ranges of paths that are traced
//! on all cores. Ranges are summed in order, so that equal settings and seeds give equal bits
//! whatever the number of threads.

mod accumulation;
mod gpu;
pub mod incoming;
mod opacity;
mod tracer;
mod volume;

pub use crate::media::majorant::Tracking;
#[cfg(feature = "tools")]
pub(crate) use gpu::LAYOUTS;
pub use gpu::{CONSTANTS, WORLD_PATH};
pub use tracer::Counters;

use crate::base::arrays::Mapped;
use crate::base::error::{Error, Result};
use crate::base::files::{json, sha256};
use crate::base::identity;
use crate::base::identity::{Identity, Resume};
use crate::base::progress::Progress as Report;
use crate::gpu::Backend;
use crate::gpu::Gpu;
use crate::media::majorant::{Caps, Effort};
use crate::media::objects::{Media, ObjectMedium};
use crate::scene::Scene;
use crate::scene::image::Image;
use crate::view::camera::Camera;
use crate::view::environment::Environment;
use crate::view::film::Warp;
use crate::view::lights::world_radiance;
use crate::view::memory;
use crate::view::sampled_lights::sampled_lights;
use crate::view::sampler::Redraw;
use accumulation::Accumulation;
use opacity::Thin;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use tracer::{Tracer, Work, World};
use volume::Volume;

/// Paths of one pass: enough to keep all cores busy, few enough to show progress.
const PASS_PATHS: u64 = 1 << 20;

/// The same on a software adapter, which is slower.
const SOFTWARE_PASS_PATHS: u64 = 1 << 16;

/// Paths of one range: the last paths of a range share batches with nobody.
const RANGE_PATHS: u64 = 1 << 15;

/// Pixels of one range that is looked through.
const RANGE_PIXELS: usize = 1 << 12;

/// Chooses the random numbers of the rays that look through pixels, whatever the seed of the picture.
const LOOKING_SEED: u32 = 0x6c62_272e;

/// Memory that a pixel takes while a picture is made: sums (7 numbers of 8 bytes), the sums of a pass, those of its ranges
/// (4 each), the picture and its channels for the file (4 of 4 bytes each), its opacity and what follows from it (8 and 4 bytes).
const BYTES_PER_PIXEL: u64 = (7 + 4 + 4) * 8 + 2 * 16 + 12;

/// Rays per path of which majorants take account: of a long path most rays are short.
const RAYS_PER_PATH: u32 = 8;

/// Passes that have to be done before an error is believed.
const PASSES_FOR_ERROR: u32 = 4;

/// Seconds between two writings of the state.
const SAVE_EVERY: f64 = 30.0;

/// How much work, and which random numbers. A render stops at whatever it reaches first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathSettings {
    /// Paths per pixel.
    pub samples: u32,
    /// Chooses the random numbers: pictures of different seeds are independent.
    pub seed: u32,
    /// Seconds after which no further pass begins, preparation not counted.
    pub time: Option<f64>,
    /// Estimated relative mean squared error that is good enough: the mean over pixels and channels of
    /// v / (m^2 + (0.01 M)^2) with the pixel's mean m, the variance v of it, and the picture's mean M.
    pub error: Option<f64>,
    /// How rays find their collisions.
    #[serde(default)]
    pub tracking: Tracking,
    /// Whether all rays of a pixel pass through its centre, without the film's pixel filter: what pictures of one ray per pixel converge to.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub pixel_centres: bool,
    /// What is drawn again, where the variance of a decision is measured: on the CPU, without a state file.
    #[serde(skip)]
    pub redraw: Redraw,
}

impl Default for PathSettings {
    fn default() -> Self {
        Self {
            samples: 64,
            seed: 0,
            time: None,
            error: None,
            tracking: Tracking::default(),
            pixel_centres: false,
            redraw: Redraw::Off,
        }
    }
}

/// Samples per pixel of which majorants take account at most: how long a render with a time limit lasts is not known.
const SAMPLES_FOR_MAJORANTS: u32 = 256;

/// What is reported while majorants are made.
pub const PREPARATION: &str = "majorants";

/// Most paths per pixel.
pub const MOST_SAMPLES: u32 = 1 << 24;

impl PathSettings {
    fn check(&self) -> Result<()> {
        let wrong = |name: &str, found: String, expected: String| {
            Err(Error::new(format!("setting {name}"), found, expected, "Correct the setting."))
        };
        if !(1..=MOST_SAMPLES).contains(&self.samples) {
            return wrong("samples", self.samples.to_string(), format!("1 to {MOST_SAMPLES}"));
        }
        for (name, value) in [("time", self.time), ("error", self.error)] {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return wrong(name, value.to_string(), "a positive finite number".into());
            }
        }
        Ok(())
    }

    /// What the samples depend on besides the build: renders that agree in it may go on from each other's state. The
    /// number of samples decides how far majorants are refined, and so belongs to it.
    fn identity(&self, subject: Subject<'_>, engine: &Engine<'_>) -> String {
        let Self { samples, seed, tracking, pixel_centres, .. } = self;
        let centres = if *pixel_centres { " pixel centres" } else { "" };
        format!("{} {samples} {seed} {tracking:?} {}{centres}", subject.content_hash(), engine.name())
    }
}

/// What is rendered: a scene, or a scene with another medium in the place of its volume.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// Camera, film, lights, world, depth of paths, and the volume where no other medium is given.
    pub scene: &'a Scene,
    /// Another medium.
    pub medium: Option<&'a GivenMedium>,
}

/// A medium that no scene file describes, such as that of a published system.
pub struct GivenMedium {
    /// Everything that it depends on, as text.
    pub identity: String,
    /// The medium.
    pub object: Arc<ObjectMedium>,
}

impl<'a> From<&'a Scene> for Subject<'a> {
    fn from(scene: &'a Scene) -> Self {
        Self { scene, medium: None }
    }
}

impl Subject<'_> {
    fn media(&self) -> Result<Vec<Arc<ObjectMedium>>> {
        match self.medium {
            Some(given) => Ok(vec![Arc::clone(&given.object)]),
            None => Ok(Media::new(self.scene)?.objects),
        }
    }

    /// Hash of all that it is.
    pub fn content_hash(&self) -> String {
        match self.medium {
            None => self.scene.content_hash(),
            Some(given) => sha256(format!("{} {}", self.scene.content_hash(), given.identity).as_bytes()),
        }
    }
}

/// Where an interrupted render keeps what it has.
#[derive(Debug, Clone)]
pub struct State<'a> {
    /// The file.
    pub path: &'a Path,
    /// Whose state it may go on from.
    pub resume: Resume,
}

impl<'a> State<'a> {
    /// A state that only this build goes on from.
    pub fn at(path: &'a Path) -> Self {
        Self { path, resume: Resume::default() }
    }
}

/// What traces paths.
enum Engine<'a> {
    Cpu(&'a Tracer),
    Adapter(Box<gpu::PathKernel<'a>>),
}

impl<'a> Engine<'a> {
    fn new(tracer: &'a Tracer, gpu: Option<&'a Gpu>) -> Result<Self> {
        let kernel = match gpu {
            // Where no ray can meet the medium there is nothing to do on an adapter.
            Some(gpu) => gpu::PathKernel::new(tracer, gpu)?,
            None => None,
        };
        Ok(kernel.map_or(Self::Cpu(tracer), |kernel| Self::Adapter(Box::new(kernel))))
    }

    /// Sums over some samples of every pixel.
    fn pass(&self, first_sample: u32, samples: u32, seed: u32) -> Result<(Vec<[f64; 4]>, Counters)> {
        match self {
            Self::Cpu(tracer) => tracer.pass(first_sample, samples, seed),
            Self::Adapter(kernel) => kernel.pass(first_sample, samples, seed),
        }
    }

    /// How many paths a pass has.
    fn pass_paths(&self) -> u64 {
        match self {
            Self::Adapter(kernel) if kernel.adapter().is_software() => SOFTWARE_PASS_PATHS,
            _ => PASS_PATHS,
        }
    }

    fn name(&self) -> String {
        match self {
            Self::Cpu(_) => "CPU".to_owned(),
            Self::Adapter(kernel) => format!("GPU, {}", json(kernel.adapter())),
        }
    }
}

/// Renders a scene by path tracing. The picture's provenance names the scene, settings, counters and times.
///
/// With a `state` file, what is done is written there now and then, a render goes on from what it finds there, and the file is removed
/// at the end. The picture is, bit for bit, the one of an uninterrupted render of as many samples.
pub fn render<'a>(
    subject: impl Into<Subject<'a>>,
    settings: &PathSettings,
    backend: Backend,
    state: Option<&State<'_>>,
    progress: Report<'_>,
) -> Result<Image> {
    let subject = subject.into();
    let prepared = Prepared::new(subject, settings, backend, progress)?;
    let image = prepared.render(subject, settings, &prepared.engine()?, state, progress)?;
    if let Some(State { path, .. }) = state {
        match std::fs::remove_file(path) {
            Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => {
                return Err(Error::io(path, "a file that can be removed", &cause));
            }
            _ => {}
        }
    }
    Ok(image)
}

/// [`render`] once per seed, without state files; the seed of `settings` does not count.
pub fn render_replicas<'a>(
    subject: impl Into<Subject<'a>>,
    settings: &PathSettings,
    backend: Backend,
    seeds: &[u32],
    progress: Report<'_>,
) -> Result<Vec<Image>> {
    let mut images = Vec::with_capacity(seeds.len());
    render_each(subject, settings, backend, seeds, progress, &mut |_, image| {
        images.push(image);
        Ok(())
    })?;
    Ok(images)
}

/// [`render_replicas`] that hands over each picture, with its seed, as soon as it is there.
pub fn render_each<'a>(
    subject: impl Into<Subject<'a>>,
    settings: &PathSettings,
    backend: Backend,
    seeds: &[u32],
    progress: Report<'_>,
    receive: &mut dyn FnMut(u32, Image) -> Result<()>,
) -> Result<()> {
    let subject = subject.into();
    let prepared = Prepared::new(subject, settings, backend, progress)?;
    // A kernel takes longer to compile than a small picture to trace.
    let engine = prepared.engine()?;
    let count = seeds.len() as f64;
    for (number, &seed) in seeds.iter().enumerate() {
        let report = |done: f64, what: &str| progress((number as f64 + done) / count, what);
        let settings = PathSettings { seed, ..settings.clone() };
        receive(seed, prepared.render(subject, &settings, &engine, None, &report)?)?;
    }
    Ok(())
}

/// What all pictures of a scene share, whatever their seed.
struct Prepared {
    tracer: Tracer,
    gpu: Option<Gpu>,
    /// Time that it took.
    seconds: f64,
}

impl Prepared {
    fn new(subject: Subject<'_>, settings: &PathSettings, backend: Backend, progress: Report<'_>) -> Result<Self> {
        settings.check()?;
        memory::check(subject.scene.image_size(), BYTES_PER_PIXEL)?;
        let gpu = backend.open()?;
        let begin = Instant::now();
        progress(0.0, PREPARATION);
        let tracer = Tracer::new(subject, settings)?;
        progress(0.0, "paths");
        Ok(Self { tracer, gpu, seconds: begin.elapsed().as_secs_f64() })
    }

    /// What traces the paths of all pictures.
    fn engine(&self) -> Result<Engine<'_>> {
        Engine::new(&self.tracer, self.gpu.as_ref())
    }

    /// One picture, from its state if there is one.
    fn render(
        &self,
        subject: Subject<'_>,
        settings: &PathSettings,
        engine: &Engine<'_>,
        state: Option<&State<'_>>,
        progress: Report<'_>,
    ) -> Result<Image> {
        self.tracer.render(subject, settings, engine, state, self.seconds, progress)
    }
}

impl World {
    fn new(scene: &Scene) -> Result<Self> {
        match Environment::load(scene)? {
            Some(picture) if picture.is_black() => return Ok(Self::Constant([0.0; 3])),
            Some(picture) => return Ok(Self::Picture(picture)),
            None => {}
        }
        let radiance = world_radiance(scene);
        if radiance.iter().all(|value| value.is_finite() && *value >= 0.0) {
            return Ok(Self::Constant(radiance));
        }
        let found = format!("radiance {radiance:?}");
        Err(Error::new("$.world", found, "finite radiance, none below 0", "Correct the color."))
    }
}

impl Tracer {
    fn new(subject: Subject<'_>, settings: &PathSettings) -> Result<Self> {
        let [width, height] = subject.scene.image_size();
        let samples = settings.samples.min(SAMPLES_FOR_MAJORANTS);
        let paths = f64::from(width) * f64::from(height) * f64::from(samples);
        let mut tracer = Self::with_paths(subject, settings, paths)?;
        tracer.thin = tracer.look_through(samples)?;
        Ok(tracer)
    }

    /// Finds the pixels in which little of the medium is seen by rays of their own. Where a picture shows what is behind the medium, nothing is
    /// looked at.
    fn look_through(&self, samples: u32) -> Result<Thin> {
        let rays = samples.div_ceil(opacity::SAMPLES_PER_RAY).min(opacity::MOST_RAYS);
        let scatters = self.volume.majorants.is_some() && self.volume.scatters() && self.events > 0;
        if !scatters || !self.shows_nothing_behind() {
            return Ok(Thin::default());
        }
        let size = self.size.mapped(|side| side as usize);
        let pixels = size[0] * size[1];
        let starts: Vec<usize> = (0..pixels).step_by(RANGE_PIXELS).collect();
        let look = |&start: &usize| -> Result<Vec<f64>> {
            let range = start..pixels.min(start + RANGE_PIXELS);
            let mut sums = vec![0.0; range.len()];
            let begun = range.flat_map(|pixel| (0..rays).map(move |ray| (pixel as u32, ray)));
            let begun = begun.map(|(pixel, ray)| self.begin_looking(pixel, ray, LOOKING_SEED));
            self.trace_paths(begun, &mut |path| sums[path.pixel as usize - start] += path.opacity / f64::from(rays))?;
            Ok(sums)
        };
        let opacities: Vec<f64> = starts.par_iter().map(look).collect::<Result<Vec<_>>>()?.concat();
        Ok(Thin::of(&opacities, size))
    }

    /// With majorants for so many paths.
    fn with_paths(subject: Subject<'_>, settings: &PathSettings, paths: f64) -> Result<Self> {
        let scene = subject.scene;
        let size = scene.image_size();
        let events = scene.integrator.volume_bounces.min(scene.integrator.max_bounces).saturating_add(1);
        // The camera ray, and per event a shadow ray and a sampled one.
        let rays = paths * f64::from(1 + 2 * events.min(RAYS_PER_PATH));
        Ok(Self {
            camera: Camera::new(scene, size)?,
            size,
            filter: if settings.pixel_centres {
                Warp::centre()
            } else {
                Warp::new(scene.film.pixel_filter, f64::from(scene.film.filter_width))
            },
            redraw: settings.redraw,
            thin: Thin::default(),
            transparent: scene.film.transparent,
            exposure: f64::from(scene.film.exposure),
            lights: sampled_lights(scene)?,
            world: World::new(scene)?,
            volume: Volume::new(subject.media()?, Effort { rays, tracking: settings.tracking })?,
            events,
        })
    }

    /// Boxes that were bounded for the majorants, and their leaves.
    fn tree(&self) -> [usize; 2] {
        self.volume.majorants.as_ref().map_or([0; 2], |majorants| [majorants.boxes, majorants.leaves()])
    }

    /// One replica, from its state if there is one.
    fn render(
        &self,
        subject: Subject<'_>,
        settings: &PathSettings,
        engine: &Engine<'_>,
        state: Option<&State<'_>>,
        preparation: f64,
        progress: Report<'_>,
    ) -> Result<Image> {
        let begin = Instant::now();
        let pixels = self.size.iter().map(|&side| u64::from(side)).product::<u64>();
        let per_pass = (engine.pass_paths() / pixels).clamp(1, MOST_SAMPLES as u64) as u32;
        let build = state.map_or(Identity::current(), |state| &state.resume.build);
        let mut sums = Accumulation::new(settings.identity(subject, engine), build, pixels as usize);
        if let Some(State { path, resume }) = state {
            sums = Accumulation::load(path, sums, resume)?;
        }
        let state = state.map(|state| state.path);
        let before = sums.progress.seconds;
        let mut saved = 0.0;
        while sums.progress.samples < settings.samples {
            let samples = per_pass.min(settings.samples - sums.progress.samples);
            let (pass, counters) = match engine.pass(sums.progress.samples, samples, settings.seed) {
                Ok(done) => done,
                // A lost device, say: what is done so far is kept for the next try.
                Err(cause) => {
                    if let Some(path) = state.filter(|_| sums.progress.samples > 0) {
                        sums.save(path)?;
                    }
                    return Err(cause);
                }
            };
            sums.add(&pass, samples);
            sums.progress.counters.add(&counters);
            let now = begin.elapsed().as_secs_f64();
            sums.progress.seconds = before + now;
            let error = sums.relative_error().filter(|_| sums.progress.passes >= PASSES_FOR_ERROR);
            let parts = [
                f64::from(sums.progress.samples) / f64::from(settings.samples),
                settings.time.map_or(0.0, |limit| sums.progress.seconds / limit),
                settings.error.and_then(|limit| Some(limit / error?)).unwrap_or(0.0),
            ];
            let done = parts.into_iter().fold(0.0, f64::max);
            progress(done.min(1.0), "paths");
            if done >= 1.0 {
                break;
            }
            if let Some(path) = state.filter(|_| now - saved > SAVE_EVERY) {
                sums.save(path)?;
                saved = now;
            }
        }
        Ok(self.picture(subject, settings, engine, &sums, preparation))
    }

    /// Sums over some samples of every pixel.
    fn pass(&self, first_sample: u32, samples: u32, seed: u32) -> Result<(Vec<[f64; 4]>, Counters)> {
        let pixels = self.size.iter().map(|&side| side as usize).product::<usize>();
        let total = pixels as u64 * u64::from(samples);
        let ranges: Vec<_> = (0..total)
            .step_by(RANGE_PATHS as usize)
            .map(|start| Work { items: start..total.min(start + RANGE_PATHS), first_sample, samples, seed })
            .collect();
        let parts: Vec<_> = ranges.par_iter().map(|work| self.trace(work)).collect::<Result<_>>()?;
        let mut sums = vec![[0.0; 4]; pixels];
        let mut counters = Counters::default();
        for part in parts {
            for (sum, found) in sums[part.first_pixel..].iter_mut().zip(part.pixels) {
                for (sum, found) in sum.iter_mut().zip(found) {
                    *sum += found;
                }
            }
            counters.add(&part.counters);
        }
        Ok((sums, counters))
    }

    /// The picture with its provenance.
    fn picture(
        &self,
        subject: Subject<'_>,
        settings: &PathSettings,
        engine: &Engine<'_>,
        sums: &Accumulation,
        preparation: f64,
    ) -> Image {
        let scene = subject.scene;
        let mut image = Image::new(self.size[0] as usize, self.size[1] as usize);
        let scale = 1.0 / f64::from(sums.progress.samples);
        for (pixel, sum) in image.pixels.iter_mut().zip(&sums.sums) {
            let [red, green, blue, opacity] = sum.mapped(|value| value * scale);
            let alpha = if self.transparent { opacity } else { 1.0 };
            let [red, green, blue] = [red, green, blue].mapped(|radiance| (radiance * self.exposure) as f32);
            *pixel = [red, green, blue, alpha as f32];
        }
        let counters = &sums.progress.counters;
        let [boxes, leaves] = self.tree();
        for (name, value) in [
            ("renderer", format!("cloudparity {} path", env!("CARGO_PKG_VERSION"))),
            (identity::ATTRIBUTE, identity::listed(&sums.progress.builds, |build| build.full().to_owned())),
            ("scene", scene.name.clone()),
            ("scene_sha256", scene.content_hash()),
            ("settings", json(settings)),
            ("film", json(&scene.film)),
            ("integrator", json(&scene.integrator)),
            ("backend", engine.name()),
            ("threads", rayon::current_num_threads().to_string()),
            ("seed", settings.seed.to_string()),
            ("samples", sums.progress.samples.to_string()),
            ("relative_error", sums.relative_error().map_or("unknown".to_owned(), |error| format!("{error:.3e}"))),
            ("majorant_boxes", boxes.to_string()),
            ("majorant_leaves", leaves.to_string()),
            ("paths", counters.paths.to_string()),
            ("collisions", counters.collisions.to_string()),
            ("null_share", format!("{:.4}", counters.null_collisions / (counters.collisions.max(1) as f64))),
            ("scatterings", counters.scatterings.to_string()),
            ("violations", counters.violations.to_string()),
            ("preparation_seconds", format!("{preparation:.3}")),
            ("render_seconds", format!("{:.3}", sums.progress.seconds)),
        ] {
            image.provenance.insert(name.to_owned(), value);
        }
        if let Some(given) = subject.medium {
            image.provenance.insert("medium".to_owned(), given.identity.clone());
        }
        if let Some(Caps { share, most }) = self.volume.caps {
            image.provenance.insert("capped_share".to_owned(), format!("{share:e}"));
            image.provenance.insert("capped_extinction".to_owned(), most.to_string());
        }
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> Scene {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/homogeneous-cube.scene.json");
        Scene::load(&file).expect("the committed scene loads")
    }

    #[test]
    fn a_lost_device_is_an_error_that_keeps_what_is_done() {
        let Ok(gpu) = Gpu::open() else {
            assert!(
                !std::env::var("CLOUDPARITY_REQUIRE").unwrap_or_default().contains("vulkan"),
                "an adapter is required"
            );
            return;
        };
        let scene = cube();
        let settings = PathSettings { samples: 1 << 16, seed: 3, ..PathSettings::default() };
        let tracer = Tracer::new(Subject::from(&scene), &settings).expect("a tracer");
        let engine = Engine::new(&tracer, Some(&gpu)).expect("a kernel");
        let Engine::Adapter(_) = engine else { panic!("the cube is rendered on the adapter") };
        let folder = tempfile::tempdir().expect("a folder");
        let state = folder.path().join("a.exr.state");
        // The device goes away at the first report, which is after the first pass.
        let report = |_: f64, _: &str| gpu.device().destroy();
        let error = tracer
            .render(Subject::from(&scene), &settings, &engine, Some(&State::at(&state)), 0.0, &report)
            .expect_err("it is lost");
        assert!(error.place.contains("adapter"), "{error}");
        let fresh = Accumulation::new(
            settings.identity(Subject::from(&scene), &engine),
            Identity::current(),
            tracer.size.iter().product::<u32>() as usize,
        );
        let kept = Accumulation::load(&state, fresh, &Resume::default()).expect("the state is whole");
        assert_eq!(kept.progress.passes, 1);
        assert!(kept.progress.samples > 0 && kept.progress.samples < settings.samples);
    }

    /// Means of pictures of some seeds, by channel, opacity last.
    fn means(tracer: &Tracer, seeds: std::ops::Range<u32>) -> Vec<[f64; 4]> {
        let mean = |seed| {
            let (sums, counters) = tracer.pass(0, 16, seed).expect("a pass");
            assert_eq!(counters.violations, 0);
            let scale = 1.0 / (16.0 * sums.len() as f64);
            std::array::from_fn(|channel| scale * sums.iter().map(|sum| sum[channel]).sum::<f64>())
        };
        seeds.map(mean).collect()
    }

    /// A committed scene.
    fn named(name: &str) -> Scene {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("parity/scenes/{name}.scene.json"));
        Scene::load(&file).expect("a committed scene loads")
    }

    #[test]
    fn both_ways_to_the_first_event_expect_the_same() {
        // The ramp, glowing as it is dense.
        let glowing = || {
            let mut scene = named("linear-ramp");
            let nodes = &mut scene.graph_mut().nodes;
            let node = nodes.iter_mut().find(|node| node.inputs.contains_key("Emission Strength")).expect("a closure");
            let density = node.inputs["Density"].clone();
            node.inputs.insert("Emission Strength".to_owned(), density);
            scene
        };
        // Tight and loose bounds, colours, several objects, a mesh, a world that shows through, few and many events, emission that varies.
        for (name, tracking) in [
            ("homogeneous-cube", Tracking::Proven),
            ("noise-anisotropic", Tracking::Proven),
            ("noise-anisotropic", Tracking::Adaptive),
            ("noise-anisotropic", Tracking::Global),
            ("noise-coloured", Tracking::Proven),
            ("noise-coloured", Tracking::Adaptive),
            ("overlapping-cubes", Tracking::Proven),
            ("linear-ramp", Tracking::Proven),
            ("mesh-hollow", Tracking::Proven),
            ("environment-image", Tracking::Proven),
            ("camera-inside", Tracking::Proven),
            ("glowing ramp", Tracking::Proven),
        ] {
            let mut scene = if name == "glowing ramp" { glowing() } else { named(name) };
            scene.film.resolution = [24, 16];
            let settings = PathSettings { samples: 16, tracking, ..PathSettings::default() };
            let mut tracer = Tracer::new(Subject::from(&scene), &settings).expect("a tracer");
            tracer.thin = Thin::default();
            let plain = means(&tracer, 0..24);
            tracer.thin = Thin::everywhere(24 * 16);
            let spaced = means(&tracer, 100..124);
            assert_ne!(means(&tracer, 0..1), plain[..1], "{name}: they are two ways");
            for channel in 0..4 {
                let estimate = |found: &[[f64; 4]]| {
                    let count = found.len() as f64;
                    let mean = found.iter().map(|one| one[channel]).sum::<f64>() / count;
                    let square = found.iter().map(|one| (one[channel] - mean).powi(2)).sum::<f64>() / (count - 1.0);
                    (mean, square / count)
                };
                let ((a, va), (b, vb)) = (estimate(&plain), estimate(&spaced));
                // 48 comparisons of 46 degrees of freedom: |t| > 4.2 in one of 200 runs, were both right. Where bounds are the density but for their
                // widening to f32 (2.4e-7 of a depth of 2), what is between them is a rare event.
                let error = (va + vb).sqrt().max(2.0 * 2.4e-7 * a.abs());
                assert!((a - b).abs() < 4.2 * error, "{name}, {tracking:?}, {channel}: {a} and {b} +- {error}");
                assert!(error < 0.03 * a.abs(), "{name}, {tracking:?}, {channel}: {error} of {a} says little");
            }
        }
    }

    #[test]
    fn thin_pixels_are_those_that_little_is_seen_in() {
        // A ramp of density 0 to 1 before nothing: some pixels are dense, some are thin, some see nothing.
        let mut scene = named("linear-ramp");
        scene.film.resolution = [48, 32];
        scene.film.transparent = true;
        let tracer = |scene: &Scene, samples| {
            let settings = PathSettings { samples, ..PathSettings::default() };
            Tracer::new(Subject::from(scene), &settings).expect("a tracer")
        };
        let found = tracer(&scene, 64);
        let (sums, _) = found.pass(0, 256, 7).expect("a pass");
        let opacity = |pixel: usize| sums[pixel][3] / 256.0;
        let mut kinds = [0; 2];
        for pixel in 0..sums.len() {
            // Proven rates: no opacity of any path is outside of 0 to 1.
            assert!((0.0..=1.0).contains(&opacity(pixel)), "{pixel}: {}", opacity(pixel));
            let is_thin = found.thin.candidates(pixel as u32) > 0.0;
            kinds[usize::from(is_thin)] += 1;
            // The opacity of a pixel is that of it and its neighbours.
            let [column, line] = [pixel % 48, pixel / 48];
            let inside = (1..47).contains(&column) && (1..31).contains(&line);
            let around = || (0..9).map(|at| opacity((line + at / 3 - 1) * 48 + column + at % 3 - 1));
            if inside && around().all(|opacity| opacity < 0.55) {
                assert!(is_thin, "{column}, {line}: {}", opacity(pixel));
            }
            if inside && around().all(|opacity| opacity > 0.9) {
                assert!(!is_thin, "{column}, {line}: {}", opacity(pixel));
            }
        }
        assert!(kinds.iter().all(|&count| count > 50), "{kinds:?}");
        // A single sample is worth it, too; it does not pay where the world shows through.
        let few = tracer(&scene, 1);
        assert!((0..48 * 32).any(|pixel| few.thin.candidates(pixel) > 0.0));
        scene.film.transparent = false;
        let shown = tracer(&scene, 64);
        assert!((0..48 * 32).all(|pixel| shown.thin.candidates(pixel) == 0.0));
    }

    #[test]
    fn an_interrupted_render_ends_in_the_picture_of_an_uninterrupted_one() {
        let mut scene = cube();
        // Passes of four samples.
        scene.film.resolution = [512, 512];
        let settings = PathSettings { samples: 8, seed: 3, ..PathSettings::default() };
        let tracer = Tracer::new(Subject::from(&scene), &settings).expect("a tracer");
        let (pass, counters) = tracer.pass(0, 4, settings.seed).expect("a pass");
        let identity = settings.identity(Subject::from(&scene), &Engine::Cpu(&tracer));
        let mut sums = Accumulation::new(identity, Identity::current(), pass.len());
        sums.add(&pass, 4);
        sums.progress.counters.add(&counters);
        let folder = tempfile::tempdir().expect("a folder");
        let state = folder.path().join("a.exr.state");
        sums.save(&state).expect("it is written");
        let go_on = |resume| render(&scene, &settings, Backend::Cpu, Some(&State { path: &state, resume }), &|_, _| {});
        let other = Identity::of("0.1.0", "another");
        let error = go_on(Resume { build: other.clone(), mix_builds: false }).expect_err("another build");
        assert!(error.found.contains(&Identity::current().to_string()), "{error}");
        assert!(error.expected.contains("0.1.0+another"), "{error}");
        let kept = std::fs::read(&state).expect("it is kept");
        let mixed = go_on(Resume { build: other.clone(), mix_builds: true }).expect("it goes on knowingly");
        assert_eq!(mixed.provenance["build"], format!("{}, {}", Identity::current().full(), other.full()));
        std::fs::write(&state, kept).expect("it is written");
        let resumed = go_on(Resume::default()).expect("it goes on");
        assert_eq!(resumed.provenance["build"], Identity::current().full());
        let whole = render(&scene, &settings, Backend::Cpu, None, &|_, _| {}).expect("it renders");
        assert_eq!(resumed.pixels, whole.pixels);
        assert_eq!(resumed.provenance["collisions"], whole.provenance["collisions"]);
        assert!(!state.exists(), "the state is removed at the end");
    }
}
