//! `cloudparity publish`: an engine in a scene as a shader bundle that carries its error.

use super::choice::choice;
use super::engine::EngineArguments;
use super::picture::SceneArguments;
use crate::base::choice::choice as named_values;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::engines::Engine;
use crate::engines::bundle::Bundle;
use crate::engines::render::{self, EngineJitter};
use crate::gpu::{Backend, Gpu};
use crate::measure::pictures::{DiffRequest, DiffResult, Tolerances};
use crate::scene::Scene;
use crate::scene::image::Image;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

named_values! {
    "lowercase",
    /// What a bundle is written for.
    enum Target {
        /// WebGPU: three compute kernels in WGSL, their data, and a page that runs them.
        Wgsl,
    }
}

/// Write a scene as shaders that run without this program, with their error.
///
/// DIR receives the density, the march and the light as WGSL with everything that they read, bundle.json, which says what goes where, a page
/// in plain WebGPU (index.html, host.js) that runs them from any static server, and certificate.json: what the bundle's picture differs by from
/// the same engine in double precision on the CPU, and from the truth where one is given. Numbers of the uniforms (extinction, light, steps,
/// camera) change at run time; parameters of the density are constants of the shader.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity publish CLOUD.scene.json -o CLOUD-WEB --resolution 480x270
  cloudparity publish CLOUD.scene.json -o CLOUD-WEB --preset OWN.preset.json --truth TRUTH.seed-*.exr")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// What it is written for.
    #[arg(long, value_parser = choice::<Target>(), default_value_t = Target::Wgsl)]
    to: Target,
    /// Instead of a model and its options, an engine as a tuned preset (*.preset.json) has it.
    #[arg(long, value_name = "FILE")]
    preset: Option<PathBuf>,
    /// Pictures of the same camera and size that are right, such as the replicas of path tracing: the error against them goes into the
    /// certificate.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    truth: Vec<PathBuf>,
    #[command(flatten)]
    engine: EngineArguments,
    /// The folder to write.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    let (scene, engine) = arguments.engine(scene)?;
    let folder = &arguments.output;
    let Target::Wgsl = arguments.to;
    let mut bundle = Bundle::new(&scene, &engine)?;
    if !arguments.truth.is_empty() {
        let pictures: Vec<Image> = arguments.truth.iter().map(|path| Image::read_exr(path)).collect::<Result<_>>()?;
        bundle = bundle.with_truth(&Image::mean_of(&pictures)?).map_err(|error| error.with_setting("resolution"))?;
    }
    bundle.write(folder)?;
    // From the files, as everybody else reads them.
    let bundle = Bundle::load(folder)?;
    let mut text = format!("{}: open index.html through a static server:\n", folder.display());
    text += &format!("  python3 -m http.server --directory {}\n", super::quoted(folder));
    match Gpu::open() {
        Err(error) => eprintln!("warning: no certificate, as nothing can run the bundle here: {error}"),
        Ok(gpu) => {
            let certificate = certificate((&scene, &engine), &bundle, &gpu, &arguments.truth, folder)?;
            let written = serde_json::to_string_pretty(&certificate).expect("a certificate is JSON") + "\n";
            files::write_atomically(&folder.join("certificate.json"), written.as_bytes())?;
            text += &format!(
                "largest difference from double precision {:e}, root mean square {:e}, brightest value {:e}\n",
                certificate["largest_difference"].as_f64().unwrap_or(f64::NAN),
                certificate["root_mean_square_difference"].as_f64().unwrap_or(f64::NAN),
                certificate["brightest_value"].as_f64().unwrap_or(f64::NAN),
            );
            if let Some(error) = certificate["truth_relmse"].as_f64() {
                text += &format!("relMSE against the truth {error:e}\n");
            }
        }
    }
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    /// The engine, and the scene that it is in: a preset may change both.
    fn engine(&self, scene: Scene) -> Result<(Scene, Engine)> {
        self.engine.refuse_for_views(self.preset.is_some())?;
        let Some(path) = &self.preset else {
            let engine = self.engine.engine(&scene, "graph")?;
            return Ok((scene, engine));
        };
        let (scene, engine, _) = super::engine::preset(path)?.build(&scene)?;
        Ok((scene, engine))
    }
}

/// What the bundle's picture differs by from the engine on the CPU, and from the truth. Both pictures are written, so that the figures can be
/// found again.
fn certificate(
    (scene, engine): (&Scene, &Engine),
    bundle: &Bundle,
    gpu: &Gpu,
    truth: &[PathBuf],
    folder: &Path,
) -> Result<Value> {
    let ready = bundle.ready(gpu)?;
    // Drivers compile when a kernel first runs.
    ready.picture()?;
    let begin = Instant::now();
    let picture = ready.picture()?;
    let milliseconds = begin.elapsed().as_secs_f64() * 1e3;
    let bar = super::progress_bar(1000);
    let settings = render::EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };
    let twin = render::render(scene, engine, &settings, Backend::Cpu, &super::progress_on(&bar))?;
    bar.finish_and_clear();
    let [ours, double] = ["bundle.exr", "double-precision.exr"].map(|name| folder.join(name));
    picture.write_exr(&ours, false)?;
    twin.write_exr(&double, false)?;
    let found = compared(vec![ours.clone()], vec![double])?;
    let colour = found.colour.ok_or_else(|| uncompared(&found.reasons))?;
    let brightest = twin.pixels.iter().flat_map(|pixel| &pixel[..3]).fold(0.0_f32, |most, &value| most.max(value));
    let origin = &bundle.manifest.origin;
    let mut certificate = json!({
        "format": "cloudparity certificate 1",
        "scene": origin.scene,
        "scene_sha256": origin.scene_sha256,
        "model": origin.model,
        "build": origin.build,
        "adapter": gpu.adapter().name,
        "resolution": origin.resolution.map(|side| side.to_string()).join(" x "),
        "milliseconds_a_picture": milliseconds,
        "largest_difference": colour.max_error,
        "root_mean_square_difference": colour.rms_error,
        "brightest_value": brightest,
    });
    if !truth.is_empty() {
        let found = compared(vec![ours], truth.to_vec())?;
        let error = found.relmse.ok_or_else(|| uncompared(&found.reasons))?;
        certificate["truth_replicas"] = truth.len().into();
        certificate["truth_relmse"] = error.pixel.into();
        certificate["truth_relmse_of_noise"] = error.noise_pixel.into();
    }
    Ok(certificate)
}

fn compared(ours: Vec<PathBuf>, reference: Vec<PathBuf>) -> Result<DiffResult> {
    let request = DiffRequest::new(ours, reference, Tolerances::default());
    request.run(|script, request| bridge::run_script(script, request, CyclesKernel::Default, |_| ()))
}

fn uncompared(reasons: &[String]) -> Error {
    Error::new(
        "the pictures of the certificate",
        reasons.join(" "),
        "pictures of one size whose values are finite",
        "Give the truth in the size of the bundle: --resolution.",
    )
}
