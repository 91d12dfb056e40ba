//! `cloudparity publish`: an engine in a scene as a shader bundle that carries its error.

use super::choice::choice;
use super::display;
use super::engine::EngineArguments;
use super::picture::SceneArguments;
use crate::base::choice::choice as named_values;
use crate::base::display_table::DisplayTable;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::numbers::uncertain;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::engines::Engine;
use crate::engines::bundle::field::FieldBundle;
use crate::engines::bundle::one_shader::OneShader;
use crate::engines::bundle::run_time::{Builder, Candidate, RunTime};
use crate::engines::bundle::targets::Program;
use crate::engines::bundle::{Bundle, Origin, Other};
use crate::engines::render::{self, EngineJitter};
use crate::gpu::{Backend, Gpu};
use crate::measure::errors;
use crate::measure::images;
use crate::measure::pictures::{DiffRequest, DiffResult, Tolerances};
use crate::measure::tuning::file::{Owner, owner};
use crate::scene::Scene;
use crate::scene::image::Image;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

named_values! {
    "lowercase",
    /// What a bundle is written for.
    enum Target {
        /// WebGPU: three compute kernels in WGSL, their data, and a page that runs them.
        Wgsl,
        /// three.js: GLSL for WebGL 2, WGSL for its node materials, and a page.
        Three,
        /// Godot 4: an include of its shading language, and a project.
        Godot,
        /// HLSL, with hosts for Unity and Unreal that are not validated.
        Hlsl,
        /// The density as 3-D textures in KTX2, of 16 and of 8 bits, with a pyramid of majorants.
        Texture,
        /// The density as OpenVDB, in metres, and as Unreal's importer wants it.
        Vdb,
    }
}

/// Write a scene for programs that run without this one, with its error.
///
/// DIR receives the density, the march and the light as shaders with everything that they read, a host that draws them, and certificate.json: what
/// the picture differs by from the same engine in double precision on the CPU, and from the truth where one is given. Of wgsl, bundle.json says
/// what goes where; of three, godot and hlsl, cloud.json, and one fragment shader that reads one texture; of texture and vdb, field.json, and there
/// are no shaders: the density alone. Numbers of the uniforms (extinction, light, steps, camera) change at run time, and those parameters of the
/// density that its constants follow from in proportion; what is baked into textures or says how often a loop runs is a constant of the shader.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity publish CLOUD.scene.json -o CLOUD-WEB --resolution 480x270
  cloudparity publish CLOUD.scene.json -o CLOUD-GODOT --to godot --resolution 1152x648
  cloudparity publish CLOUD.scene.json -o CLOUD-VOLUME --to texture --voxels 256
  cloudparity publish CLOUD.scene.json -o CLOUD-WEB --preset OWN.preset.json --truth TRUTH.seed-*.exr")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// What it is written for.
    #[arg(long, value_parser = choice::<Target>(), default_value_t = Target::Wgsl)]
    to: Target,
    /// Voxels along the longest side of the density's box, for texture and vdb.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(2..=4096))]
    voxels: u32,
    /// Instead of a model and its options, an engine as a tuned preset (*.preset.json) has it. Of wgsl several: the page has a choice of them.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    preset: Vec<PathBuf>,
    /// Pictures of the same camera and size that are right, such as the replicas of path tracing: the error against them goes into the
    /// certificate.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    truth: Vec<PathBuf>,
    /// Part, layer or pass of --truth, in files with several.
    #[arg(long, value_name = "PART", requires = "truth")]
    truth_part: Option<String>,
    /// Have the density's parameters as constants of the shader: its host cannot change them, and publishing is done sooner.
    #[arg(long)]
    fixed_density: bool,
    #[command(flatten)]
    engine: EngineArguments,
    /// The folder to write.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    arguments.engine.refuse_for_views(!arguments.preset.is_empty())?;
    if arguments.preset.len() > 1 && arguments.to != Target::Wgsl {
        return Err(Error::new(
            "--preset",
            format!("{} presets", arguments.preset.len()),
            "one preset: only the page of wgsl has a choice of several",
            "Publish each into a folder of its own.",
        ));
    }
    let engines = arguments.engines(&scene)?;
    let truth = Truth::read(&arguments.truth, arguments.truth_part.as_deref())?;
    if engines.len() > 1 {
        return several(arguments, &engines, truth.as_ref());
    }
    let Published { scene, engine, run_time, .. } = &engines[0];
    let publication = Publication {
        arguments,
        folder: &arguments.output,
        scene,
        engine,
        run_time: run_time.as_ref(),
        truth: truth.as_ref(),
    };
    let text = match arguments.to {
        Target::Wgsl => publication.kernels(&publication.shown(), &[]),
        Target::Three => publication.one_shader(Program::Three),
        Target::Godot => publication.one_shader(Program::Godot),
        Target::Hlsl => publication.one_shader(Program::Hlsl),
        Target::Texture | Target::Vdb => publication.field(),
    }?;
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// An engine that is published.
struct Published {
    /// What it is called, where that is said.
    title: String,
    /// The scene that it is in; a preset may change it.
    scene: Scene,
    engine: Engine,
    run_time: Option<RunTime>,
}

impl Arguments {
    fn engines(&self, scene: &Scene) -> Result<Vec<Published>> {
        if self.preset.is_empty() {
            // Once with its warnings.
            let engine = self.engine.engine(scene, "graph")?;
            let build = |changes: &[(&str, f64)]| {
                let mut scene = scene.clone();
                let mut texts = Vec::new();
                for (name, value) in changes {
                    match owner(name) {
                        (Owner::Scene, name) => scene.set(&format!("{name}={value}"))?,
                        (_, name) => texts.push(format!("{name}={value}")),
                    }
                }
                let engine = self.engine.with_parameters(&texts).silent(&scene, "graph")?;
                Ok((scene, engine))
            };
            let run_time = self.run_time(scene, &engine, &build)?;
            return Ok(vec![Published { title: String::new(), scene: scene.clone(), engine, run_time }]);
        }
        let built = |path: &PathBuf| -> Result<Published> {
            let preset = super::engine::preset(path, scene)?;
            let build = |changes: &[(&str, f64)]| {
                let mut preset = preset.clone();
                preset.parameters.extend(changes.iter().map(|(name, value)| ((*name).to_owned(), *value)));
                let (scene, engine, _) = preset.build(scene)?;
                Ok((scene, engine))
            };
            let (own, engine) = build(&[])?;
            let run_time = self.run_time(&own, &engine, &build)?;
            Ok(Published { title: preset.title.clone(), scene: own, engine, run_time })
        };
        self.preset.iter().map(built).collect()
    }

    /// Parameters of the density that a host changes.
    fn run_time(&self, scene: &Scene, engine: &Engine, build: Builder<'_>) -> Result<Option<RunTime>> {
        if self.fixed_density || matches!(self.to, Target::Texture | Target::Vdb) {
            return Ok(None);
        }
        let bar = super::progress_bar(1000);
        let progress = super::progress_on(&bar);
        let tell = |part| progress(part, "parameters of the density");
        let found = RunTime::find(&Candidate::all(scene, engine)?, engine.density.bounds, build, &tell);
        bar.finish_and_clear();
        found
    }
}

/// Bundles of several presets: the first one with the page, the others in folders of their own beneath it.
fn several(arguments: &Arguments, engines: &[Published], truth: Option<&Truth>) -> Result<ExitCode> {
    let mut taken: Vec<String> = Vec::new();
    for path in &arguments.preset {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.strip_suffix(".preset.json").unwrap_or(&name).to_owned();
        let is_taken = |name: &String| taken.contains(name);
        let free = (1..).map(|number| if number == 1 { stem.clone() } else { format!("{stem}-{number}") });
        taken.push(free.into_iter().find(|name| !is_taken(name)).expect("numbers do not end"));
    }
    let others: Vec<Other> = engines
        .iter()
        .zip(&taken)
        .enumerate()
        .map(|(number, (published, name))| Other {
            title: published.title.clone(),
            folder: if number == 0 { ".".into() } else { name.clone() },
        })
        .collect();
    let mut shown = None;
    let mut text = String::new();
    for (other, published) in others.iter().zip(engines) {
        let folder = arguments.output.join(&other.folder);
        let Published { title, scene, engine, run_time } = published;
        let publication = Publication { arguments, folder: &folder, scene, engine, run_time: run_time.as_ref(), truth };
        let shown = shown.get_or_insert_with(|| publication.shown());
        let is_first = other.folder == ".";
        let certified = publication.kernels(shown, if is_first { &others } else { &[] })?;
        text += &format!("{title}\n{certified}");
    }
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Colours along each axis of the table of the view transform in a page: half a megabyte.
const COLOURS: usize = 49;

/// Pictures that are right.
struct Truth {
    replicas: Vec<Image>,
    mean: Image,
}

impl Truth {
    fn read(paths: &[PathBuf], part: Option<&str>) -> Result<Option<Self>> {
        if paths.is_empty() {
            return Ok(None);
        }
        let replicas = images::read(paths, part, "--truth-part")?;
        let mean = Image::mean_of(&replicas)?;
        Ok(Some(Self { replicas, mean }))
    }
}

/// What is published.
struct Publication<'a> {
    arguments: &'a Arguments,
    folder: &'a Path,
    scene: &'a Scene,
    engine: &'a Engine,
    run_time: Option<&'a RunTime>,
    truth: Option<&'a Truth>,
}

/// A picture, and the milliseconds that it took.
type Timed = (Image, f64);

impl Publication<'_> {
    /// The table of the scene's view transform. Without Blender's colour management there is none, which is said.
    fn shown(&self) -> Option<DisplayTable> {
        display::table(&self.scene.display, COLOURS).unwrap_or_else(|error| {
            eprintln!("warning: the page shows colours as Standard, not as the scene says: {error}");
            None
        })
    }

    /// The kernels; with a page where there are presets to choose from, and where it is one alone.
    fn kernels(&self, shown: &Option<DisplayTable>, presets: &[Other]) -> Result<String> {
        let folder = self.folder;
        let mut bundle = Bundle::with_parameters(self.scene, self.engine, self.run_time)?
            .with_display(self.scene.display.exposure.into(), shown.as_ref());
        bundle.manifest.presets = presets.to_vec();
        let has_page = folder == self.arguments.output;
        if !has_page {
            bundle = bundle.without_hosts();
        }
        if let Some(truth) = self.truth {
            bundle = bundle.with_truth(&truth.mean).map_err(|error| error.with_setting("resolution"))?;
        }
        bundle.write(folder)?;
        // From the files, as everybody else reads them.
        let bundle = Bundle::load(folder)?;
        let drawn = self.on_adapter(|gpu| {
            let ready = bundle.ready(gpu)?;
            timed(|| ready.picture())
        })?;
        let certified = self.certified(&bundle.manifest.origin, drawn)?;
        Ok(if has_page { opened(folder, "index.html") } else { String::new() } + &certified)
    }

    fn one_shader(&self, program: Program) -> Result<String> {
        let folder = self.folder;
        let mut shader = OneShader::with_parameters(self.scene, self.engine, self.run_time)?;
        if let Some(truth) = self.truth {
            shader = shader.with_truth(&truth.mean).map_err(|error| error.with_setting("resolution"))?;
        }
        shader.write(folder, program.files(&shader)?)?;
        let drawn = self.on_adapter(|gpu| {
            let ready = shader.ready(gpu)?;
            timed(|| ready.picture())
        })?;
        let certified = self.certified(&shader.manifest.origin, drawn)?;
        let quoted = super::quoted(folder);
        let how = match program {
            Program::Three => format!("  npm install --prefix {quoted}\n") + &opened(folder, "index.html"),
            Program::Godot => format!("{}: a project of Godot 4:\n  godot --path {quoted}\n", folder.display()),
            Program::Hlsl => format!("{}: README.md says how to use it\n", folder.display()),
        };
        Ok(how + &certified)
    }

    /// The density alone. There is no shader to run: what the certificate compares are the engine's pictures of the stored forms.
    fn field(&self) -> Result<String> {
        let (folder, Arguments { to, voxels, .. }) = (self.folder, self.arguments);
        let bar = super::progress_bar(1000);
        let progress = super::progress_on(&bar);
        let field = FieldBundle::new(self.scene, self.engine, *voxels, &|part| progress(part, "the density"))?;
        bar.finish_and_clear();
        let files = if *to == Target::Texture { field.textures() } else { BTreeMap::new() };
        if *to == Target::Vdb {
            files::make_folder(folder, "a folder that can be made")?;
            bridge::volume_grid::write(&field.grid(), &folder.join("density.vdb"), true)?;
            bridge::volume_grid::write(&field.grid_of_unreal(), &folder.join("density-unreal.vdb"), true)?;
        }
        field.write(folder, &files)?;
        let [x, y, z] = field.manifest.size;
        let mut text = format!("{}: {x} x {y} x {z} voxels, field.json says where they lie\n", folder.display());
        let double = folder.join("double-precision.exr");
        self.double_precision(self.engine)?.write_exr(&double, false)?;
        let mut forms = Vec::new();
        for (stored, cache) in field.manifest.stored.iter().zip(&field.caches) {
            let picture = folder.join(format!("{}.exr", stored.format));
            self.double_precision(&self.engine.with_density(cache.density.clone()))?.write_exr(&picture, false)?;
            let mut form = json!({
                "format": stored.format,
                "largest_field_error": stored.largest_field_error,
                "root_mean_square_field_error": stored.root_mean_square_field_error,
            });
            self.compare(&mut form, &picture, &double)?;
            text += &format!(
                "{}: field off by {:.2e} at most (root mean square {:.2e}), picture by {:.2e} (root mean square {:.2e})\n",
                stored.format,
                stored.largest_field_error,
                stored.root_mean_square_field_error,
                form["largest_difference"].as_f64().unwrap_or(f64::NAN),
                form["root_mean_square_difference"].as_f64().unwrap_or(f64::NAN),
            );
            forms.push(form);
        }
        let mut certificate = certificate_of(&field.manifest.origin);
        certificate["forms"] = forms.into();
        write_certificate(folder, &certificate)?;
        Ok(text)
    }

    /// What a bundle draws on the adapter, and the adapter's name; none, with a warning, where there is no adapter.
    fn on_adapter(&self, draw: impl FnOnce(&Gpu) -> Result<Timed>) -> Result<Option<(String, Timed)>> {
        match Gpu::open() {
            Ok(gpu) => Ok(Some((gpu.adapter().name.clone(), draw(&gpu)?))),
            Err(error) => {
                eprintln!("warning: no certificate, as nothing can run the bundle here: {error}");
                Ok(None)
            }
        }
    }

    fn double_precision(&self, engine: &Engine) -> Result<Image> {
        let bar = super::progress_bar(1000);
        let settings = render::EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };
        let picture = render::render(self.scene, engine, &settings, Backend::Cpu, &super::progress_on(&bar))?;
        bar.finish_and_clear();
        Ok(picture)
    }

    /// What a bundle's picture differs by from the engine on the CPU, and from the truth. Both pictures are written, so that the figures can be
    /// found again.
    fn certified(&self, origin: &Origin, drawn: Option<(String, Timed)>) -> Result<String> {
        let Some((adapter, (picture, milliseconds))) = drawn else { return Ok(String::new()) };
        let folder = self.folder;
        let twin = self.double_precision(self.engine)?;
        let [ours, double] = ["bundle.exr", "double-precision.exr"].map(|name| folder.join(name));
        picture.write_exr(&ours, false)?;
        twin.write_exr(&double, false)?;
        let brightest = twin.pixels.iter().flat_map(|pixel| &pixel[..3]).fold(0.0_f32, |most, &value| most.max(value));
        let mut certificate = certificate_of(origin);
        certificate["adapter"] = adapter.into();
        certificate["milliseconds_a_picture"] = milliseconds.into();
        certificate["brightest_value"] = f64::from(brightest).into();
        self.compare(&mut certificate, &ours, &double)?;
        write_certificate(folder, &certificate)?;
        let figure = |name: &str| certificate[name].as_f64().unwrap_or(f64::NAN);
        let mut text = format!(
            "largest difference from double precision {:e}, root mean square {:e}, brightest value {brightest:e}\n",
            figure("largest_difference"),
            figure("root_mean_square_difference"),
        );
        if self.truth.is_some() {
            let relmse = &certificate["truth_errors_without_noise"]["relmse"];
            text += &match (relmse["value"].as_f64(), relmse["standard_error"].as_f64()) {
                (Some(value), Some(error)) => {
                    format!("relMSE against the truth, without its noise, {}\n", uncertain(value, error))
                }
                _ => format!("relMSE against the truth {:e}, with its noise\n", figure("truth_relmse")),
            };
        }
        Ok(text)
    }

    /// Puts into a part of a certificate what a picture differs by from double precision and from the truth.
    fn compare(&self, into: &mut Value, ours: &Path, double: &Path) -> Result<()> {
        let found = compared(vec![ours.to_owned()], vec![double.to_owned()], None)?;
        let colour = found.colour.ok_or_else(|| uncompared(&found.reasons))?;
        into["largest_difference"] = colour.max_error.into();
        into["root_mean_square_difference"] = colour.rms_error.into();
        if let Some(Truth { replicas, .. }) = self.truth {
            let found =
                compared(vec![ours.to_owned()], self.arguments.truth.clone(), self.arguments.truth_part.clone())?;
            let error = found.relmse.ok_or_else(|| uncompared(&found.reasons))?;
            into["truth_replicas"] = replicas.len().into();
            into["truth_relmse"] = error.pixel.into();
            into["truth_relmse_of_noise"] = error.noise_pixel.into();
            // Fewer say nothing of their own noise: the certificate says so by null.
            into["truth_errors_without_noise"] = match replicas.len() >= errors::FEWEST_REPLICAS {
                true => json!(errors::measure(&Image::read_exr(ours)?, replicas)?),
                false => Value::Null,
            };
        }
        Ok(())
    }
}

/// The second picture, and its time: drivers compile when a shader first runs.
fn timed(picture: impl Fn() -> Result<Image>) -> Result<Timed> {
    picture()?;
    let begin = Instant::now();
    let picture = picture()?;
    Ok((picture, begin.elapsed().as_secs_f64() * 1e3))
}

fn opened(folder: &Path, page: &str) -> String {
    let quoted = super::quoted(folder);
    format!(
        "{}: open {page} through a static server:\n  python3 -m http.server --directory {quoted}\n",
        folder.display()
    )
}

fn certificate_of(origin: &Origin) -> Value {
    json!({
        "format": "cloudparity certificate 1",
        "scene": origin.scene,
        "scene_sha256": origin.scene_sha256,
        "model": origin.model,
        "build": origin.build,
        "resolution": origin.resolution.map(|side| side.to_string()).join(" x "),
    })
}

fn write_certificate(folder: &Path, certificate: &Value) -> Result<()> {
    let text = serde_json::to_string_pretty(certificate).expect("a certificate is JSON") + "\n";
    files::write_atomically(&folder.join("certificate.json"), text.as_bytes())
}

fn compared(ours: Vec<PathBuf>, reference: Vec<PathBuf>, reference_part: Option<String>) -> Result<DiffResult> {
    let request = DiffRequest { reference_part, ..DiffRequest::new(ours, reference, Tolerances::default()) };
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
