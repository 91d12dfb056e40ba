//! Two density models in one box, under one camera and one light: what a page of the report shows.
//!
//! The density of a scene's node graph takes the place of a published engine's, with the engine's extinction, albedo and phase
//! function, so that pictures differ by the density alone. One factor on each density brings the mean optical depth along the box's
//! vertical lines to the same value. Both are then rendered by the engine's light as published, by every light model on its corrected form, and by
//! path tracing of the densities themselves with the light transport that these stand for.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::engines::Model;
use crate::engines::defects::Defects;
use crate::engines::domain::Container;
use crate::engines::light::models::LIGHTS;
use crate::engines::light::{SourceFactor, TwoLobes};
use crate::engines::parameters::Values;
use crate::engines::render;
use crate::engines::render::{EngineJitter, EngineSettings};
use crate::gpu::Backend;
use crate::gpu::Gpu;
use crate::graph::evaluate::Points;
use crate::integrators::path;
use crate::integrators::path::{GivenMedium, PathSettings, Subject};
use crate::measure::densities::statistics::FieldStatistics;
use crate::measure::images::{self, DisplaySettings};
use crate::measure::provenance::Provenance;
use crate::media::density::Density;
use crate::media::medium::Medium;
use crate::media::region::Region;
use crate::scene::image::Image;
use crate::scene::{Display, Scene};
use glam::DVec3;
use indexmap::IndexMap;
use ndarray::Array3;
use rand::{Rng as _, SeedableRng as _};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// What is compared and how closely.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Places per axis of the statistics.
    pub places: usize,
    /// Paths per pixel.
    pub samples: u32,
    /// Rays per pixel and axis of the engine.
    pub sub_pixels: u32,
    /// Mean optical depth of all; the first model's own where none is given.
    pub mean_depth: Option<f64>,
    /// Points of the timing.
    pub timed_points: usize,
}

/// What was found: `models.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// The builds that measured it; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// Name of the scene with camera, light and graph.
    pub scene: String,
    /// Its hash.
    pub scene_sha256: String,
    /// Name of the engine whose medium all densities are rendered as: the first model.
    pub model: String,
    /// Its parameters.
    pub parameters: IndexMap<String, f64>,
    /// How it was made.
    pub settings: Settings,
    /// Extinction per unit of density and side of the box.
    pub extinction: [f64; 3],
    /// Single-scattering albedo of path tracing and of the corrected light model.
    pub albedo: f64,
    /// The phase function.
    pub phase: TwoLobes,
    /// Most scattering events of a path.
    pub scattering_events: u32,
    /// The adapter of the timing, if there is one.
    pub adapter: Option<serde_json::Value>,
    /// The densities, the graph's first.
    pub sides: Vec<Side>,
    /// Pictures, by light model and density.
    pub pictures: Vec<Picture>,
}

/// One density.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Side {
    /// Its name, which file names hold.
    pub id: String,
    /// Its name in words.
    pub title: String,
    /// Factor on it that brings the mean optical depth to the common value.
    pub factor: f64,
    /// Its figures, factor included.
    pub statistics: FieldStatistics,
    /// What evaluates it on the CPU.
    pub evaluator: String,
    /// Nanoseconds of wall time per density at random places of the box, on all cores.
    pub cpu_nanoseconds: f64,
    /// The same on the adapter, transfers included.
    pub gpu_nanoseconds: Option<f64>,
}

/// One picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// The light model.
    pub light: String,
    /// Its name in words.
    pub light_title: String,
    /// The density.
    pub density: String,
    /// Scene-linear file.
    pub exr: String,
    /// File to look at, where it could be made.
    pub png: Option<String>,
    /// Wall time of the render, in seconds.
    pub seconds: f64,
    /// Mean of the colour channels over the picture, what the film holds.
    pub mean_radiance: f64,
    /// Mean over that of path tracing of the same density, less 1; none of path tracing itself, and in older files.
    #[serde(default)]
    pub bias: Option<f64>,
}

/// File name of the figure of both fields.
pub const FIGURE: &str = "models.svg";

/// Repetitions of the timing; their median counts.
const REPEATS: usize = 5;

/// Seed of the places of the timing.
const SEED: u64 = 42;

/// Places that are evaluated together.
const BATCH: usize = 1 << 18;

/// A model with its parameters.
pub type Compared = (&'static Model, Values);

/// Compares the density of a scene's graph with those of models; pictures are written to `folder` as they are made. All are rendered as the medium of
/// the first model, under its light.
pub fn run(
    scene: &Scene,
    models: &[Compared],
    settings: &Settings,
    folder: &Path,
    progress: Progress<'_>,
) -> Result<Comparison> {
    check(settings)?;
    let Some((model, values)) = models.first() else {
        return Err(Error::new("density models", "none", "one at least", "Name one: cloudparity models lists them."));
    };
    let ids: Vec<&str> = std::iter::once("graph").chain(models.iter().map(|(model, _)| model.id)).collect();
    if let Some(twice) = (1..ids.len()).find(|&index| ids[1..index].contains(&ids[index])) {
        return Err(Error::new(
            "density models",
            format!("{} twice", ids[twice]),
            "each once: pictures are named after them",
            "Compare other parameters of one model with a study.",
        )
        .with_setting("model"));
    }
    if let Some((model, _)) = models.iter().find(|(model, _)| model.is_of_scene) {
        return Err(Error::new(
            "density model",
            format!("\"{}\"", model.id),
            "a density model that is not the scene's own",
            "Give another one: cloudparity models lists them.",
        )
        .with_setting("model"));
    }
    files::make_folder(folder, "a folder for the results")?;
    let engine = |defects: &Defects| model.engine(scene, values, defects, 0.0);
    let corrected = engine(&Defects::NONE)?;
    let (extinction, light) = (corrected.extinction, corrected.light.clone());
    let SourceFactor::Albedo([albedo, ..]) = light.source else {
        unreachable!("the corrected form of an engine has an albedo");
    };
    let mean_extinction = extinction.iter().sum::<f64>() / 3.0;

    progress(0.0, "statistics of the fields");
    let graph = Medium::new(scene)?.density;
    let mut densities = vec![graph, corrected.density.clone()];
    for (model, values) in &models[1..] {
        densities.push(model.engine(scene, values, &Defects::NONE, 0.0)?.density);
    }
    let fields: Vec<Array3<f64>> = densities
        .iter()
        .map(|density| sample(&corrected.container, density, settings.places))
        .collect::<Result<_>>()?;
    let depths: Vec<f64> =
        fields.iter().map(|field| field.mean().expect("a field has places") * mean_extinction).collect();
    let titles: Vec<String> = std::iter::once(format!("node graph of {}", scene.name))
        .chain(models.iter().map(|(model, _)| model.id.to_owned()))
        .collect();
    for (depth, title) in depths.iter().zip(&titles) {
        if !(*depth > 0.0 && depth.is_finite()) {
            return Err(Error::new(
                format!("the density: {title}"),
                format!("a mean optical depth of {depth}"),
                "one above 0, so that it can be brought to the others'",
                "Look at the density with cloudparity eval or grid, and correct the scene or the parameters.",
            ));
        }
    }
    let target = settings.mean_depth.unwrap_or(depths[1]);
    let factors: Vec<f64> = depths.iter().map(|depth| target / depth).collect();

    progress(0.1, "cost per sample");
    let gpu = Gpu::open().ok();
    let costs = costs(&densities, settings.timed_points, gpu.as_ref())?;
    let figures = |(index, (cpu_nanoseconds, gpu_nanoseconds)): (usize, (f64, Option<f64>))| Side {
        id: ids[index].to_owned(),
        title: titles[index].clone(),
        factor: factors[index],
        statistics: FieldStatistics::of(&fields[index].mapv(|density| density * factors[index]), mean_extinction),
        // The Perlin-FBM cloud's bakes are read place by place.
        evaluator: if ids[index] == "perlin-fbm" { "f32, scalar" } else { "f32, vectors" }.to_owned(),
        cpu_nanoseconds,
        gpu_nanoseconds,
    };
    let sides: Vec<Side> = costs.into_iter().enumerate().map(figures).collect();

    let densities: Vec<Density> =
        densities.iter().zip(&factors).map(|(density, &factor)| density.scaled(factor)).collect();
    let mut pictures = Vec::new();
    let mut done = 0.15;
    let mut keep = |light: &str, title: &str, density: &str, image: &Image| -> Result<()> {
        let exr = format!("models-{light}-{density}.exr");
        image.write_exr(&folder.join(&exr), false)?;
        let sum: f64 = image.pixels.iter().flat_map(|pixel| &pixel[..3]).map(|&value| f64::from(value)).sum();
        pictures.push(Picture {
            light: light.to_owned(),
            light_title: title.to_owned(),
            density: density.to_owned(),
            exr,
            png: None,
            seconds: image.provenance.get("render_seconds").and_then(|text| text.parse().ok()).unwrap_or(f64::NAN),
            mean_radiance: sum / (3 * image.pixels.len()) as f64,
            bias: None,
        });
        Ok(())
    };
    let engine_settings =
        EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: settings.sub_pixels, god_rays: false };
    let mut lights = vec![(engine(&Defects::ALL)?, "as-published", "Light as published".to_owned())];
    for named in LIGHTS {
        let mut lit = corrected.with_density(corrected.density.clone());
        named.apply(&mut lit.light)?;
        lights.push((lit, named.id, format!("Light {}: {}", named.id, named.about)));
    }
    let share = 0.5 / (densities.len() * lights.len()) as f64;
    for (lit, id, title) in lights {
        for (density, side) in densities.iter().zip(&sides) {
            let engine = lit.with_density(density.clone());
            let report = |part: f64, what: &str| progress(done + share * part, what);
            let image = render::render(scene, &engine, &engine_settings, Backend::Cpu, &report)?;
            keep(id, &title, &side.id, &image)?;
            done += share;
        }
    }
    let path_settings = PathSettings { samples: settings.samples, ..PathSettings::default() };
    let share = 0.34 / densities.len() as f64;
    for ((density, side), factor) in densities.iter().zip(&sides).zip(&factors) {
        let engine = corrected.with_density(density.clone());
        let medium = GivenMedium {
            identity: format!("density {} times {factor} as {}", side.title, engine.medium_identity()),
            object: Arc::new(engine.medium()?),
        };
        let subject = Subject { scene, medium: Some(&medium) };
        let report = |part: f64, what: &str| progress(done + share * part, what);
        let image = path::render(subject, &path_settings, Backend::Cpu, None, &report)?;
        keep("path", "Path tracing", &side.id, &image)?;
        done += share;
    }
    let traced: Vec<(String, f64)> = pictures
        .iter()
        .filter(|picture| picture.light == "path")
        .map(|picture| (picture.density.clone(), picture.mean_radiance))
        .collect();
    for picture in pictures.iter_mut().filter(|picture| picture.light != "path") {
        let truth = traced.iter().find(|(density, _)| *density == picture.density);
        picture.bias = truth.map(|(_, mean)| picture.mean_radiance / mean - 1.0).filter(|bias| bias.is_finite());
    }
    Ok(Comparison {
        builds: vec![Identity::current().clone()],
        scene: scene.name.clone(),
        scene_sha256: scene.content_hash(),
        model: model.id.to_owned(),
        parameters: values.iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        settings: settings.clone(),
        extinction,
        albedo,
        phase: light.phase,
        scattering_events: scene.integrator.volume_bounces.min(scene.integrator.max_bounces) + 1,
        adapter: gpu.map(|gpu| serde_json::to_value(gpu.adapter()).expect("an adapter serialises")),
        sides,
        pictures,
    })
}

fn check(settings: &Settings) -> Result<()> {
    let wrong = |name: &str, found: String, expected: &str| {
        Err(Error::new(format!("setting {name}"), found, expected, "Correct the setting."))
    };
    if !(2..=512).contains(&settings.places) {
        return wrong("places", settings.places.to_string(), "2 to 512 per axis");
    }
    if let Some(depth) = settings.mean_depth.filter(|depth| !(*depth > 0.0 && depth.is_finite())) {
        return wrong("mean depth", depth.to_string(), "a positive finite optical depth");
    }
    Ok(())
}

/// Densities in the middle of `places`^3 equal parts of the box, by the object's x, y and z.
fn sample(container: &Container, density: &Density, places: usize) -> Result<Array3<f64>> {
    let Region { low, high } = container.outline.region();
    let step = (high - low) / places as f64;
    let place = |index: usize| {
        let number = [index / (places * places), index / places % places, index % places];
        low + step * (DVec3::from(number.map(|number| number as f64)) + 0.5)
    };
    let mut values = Vec::with_capacity(places.pow(3));
    for start in (0..places.pow(3)).step_by(BATCH) {
        let asked: Vec<[f32; 3]> =
            (start..places.pow(3).min(start + BATCH)).map(|index| place(index).as_vec3().to_array()).collect();
        values.extend(density.values(&asked)?.into_iter().map(f64::from));
    }
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        return Err(Error::new(
            format!("the density at {} of the object", place(index)),
            values[index].to_string(),
            "a finite density",
            "Correct the graph: cloudparity eval shows its values.",
        ));
    }
    Ok(Array3::from_shape_vec((places, places, places), values).expect("one value per place"))
}

/// Nanoseconds per density on the CPU and on the adapter, at the same random places of the box.
fn costs(densities: &[Density], count: usize, gpu: Option<&Gpu>) -> Result<Vec<(f64, Option<f64>)>> {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(SEED);
    let Region { low, high } = densities[0].bounds;
    let positions: Vec<[f32; 3]> = (0..count)
        .map(|_| {
            let part = DVec3::from(std::array::from_fn(|_| random.random_range(0.0..1.0)));
            (low + part * (high - low)).as_vec3().to_array()
        })
        .collect();
    let cost = |density: &Density| -> Result<(f64, Option<f64>)> {
        let cpu = nanoseconds(count, || density.values(&positions).map(drop))?;
        // A model without a shader has no cost there.
        let kernel = gpu.and_then(|gpu| gpu.field(density.program()).ok());
        let on_adapter = kernel
            .map(|kernel| nanoseconds(count, || kernel.evaluate(Points::new(&positions)).map(drop)))
            .transpose()?;
        Ok((cpu, on_adapter))
    };
    densities.iter().map(cost).collect()
}

/// Median time of some repetitions after one that does not count, over the number of points.
fn nanoseconds(count: usize, mut evaluate: impl FnMut() -> Result<()>) -> Result<f64> {
    evaluate()?;
    let mut seconds = Vec::with_capacity(REPEATS);
    for _ in 0..REPEATS {
        let begin = Instant::now();
        evaluate()?;
        seconds.push(begin.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    Ok(1e9 * seconds[REPEATS / 2] / count as f64)
}

/// Writes `models.json`.
pub fn write(comparison: &Comparison, folder: &Path) -> Result<()> {
    let text = serde_json::to_string_pretty(comparison).expect("figures serialise") + "\n";
    files::write_atomically(&folder.join("models.json"), text.as_bytes())
}

/// Makes what is looked at, which needs Python's packages: display pictures and the figure, named in `models.json` again.
pub fn show(comparison: &mut Comparison, display: &Display, folder: &Path) -> Result<()> {
    let settings = DisplaySettings::of(display, None);
    let images: Vec<serde_json::Value> = comparison
        .pictures
        .iter()
        .map(|picture| {
            let mut image = serde_json::to_value(&settings).expect("settings serialise");
            image["exr"] = json!(folder.join(&picture.exr));
            image["png"] = json!(folder.join(png_of(picture)));
            image
        })
        .collect();
    bridge::run_script(images::SCRIPT, &json!({"op": "display", "images": images}), CyclesKernel::Default, |_| ())?;
    comparison.pictures.iter_mut().for_each(|picture| picture.png = Some(png_of(picture)));
    write(comparison, folder)?;
    let [svg, png, pdf] = [FIGURE, "models.png", "models.pdf"].map(|name| folder.join(name));
    let request =
        json!({"sides": comparison.sides, "svg": svg, "png": png, "pdf": pdf, "made_by": Provenance::now(None).line()});
    bridge::run_script("model_comparison_plot.py", &request, CyclesKernel::Default, |_| ()).map(|_| ())
}

fn png_of(picture: &Picture) -> String {
    Path::new(&picture.exr).with_extension("png").display().to_string()
}
