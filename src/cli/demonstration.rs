//! The main job from one command: a scene through every stage into a run directory with a report.
//!
//! A .blend is built from the scene file and exported again (they must be equal); the field is
//! probed in live Cycles; the picture is rendered and compared with Cycles' picture; slices, modes,
//! bounds and the explanation are added. What a machine cannot do is listed in the report with the
//! remedy. Each result is on disk as soon as it is there.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{COMPILER, Identity};
use crate::bridge;
use crate::bridge::reference::{ReferenceSettings, cache_folder, reference};
use crate::bridge::{CyclesKernel, Message};
use crate::cli::explain::describe;
use crate::engines;
use crate::gpu::Backend;
use crate::gpu::Gpu;
use crate::graph::bounds::Bounds3;
use crate::graph::bounds_check::Survey;
use crate::graph::{Program, target};
use crate::integrators;
use crate::integrators::MarchSettings;
use crate::measure::densities::comparison;
use crate::measure::fields;
use crate::measure::fields::{Domain, Evaluator, Sampling, domain, slices};
use crate::measure::nodes::suite;
use crate::measure::nodes::suite::Selection;
use crate::measure::pictures::{DiffRequest, DisplaySettings, Tolerances, Verdict};
use crate::measure::stability;
use crate::measure::study;
use crate::measure::study::Study;
use crate::measure::study::file::StudyFile;
use crate::measure::timing::machine;
use crate::report;
use crate::report::inputs::{LeftOut, Run, Timing};
use crate::scene::{PixelFilter, Scene};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The scene of the demonstration, so that the program shows it from any folder.
const SCENE: &str = include_str!("../../parity/scenes/procedural-clouds.scene.json");

/// Camera and light under which the cloud stands beside the other density model.
const DAYLIGHT: &str = include_str!("../../parity/scenes/clouds-in-daylight.scene.json");

/// The scene of the pictures of the stability suite.
const RAMP: &str = include_str!("../../parity/scenes/linear-ramp.scene.json");

/// The study of the demonstration.
const STUDY: &str = include_str!("../../parity/studies/small.study.toml");

/// Cycles' picture of it: 320x180, the mean of four replicas of 256 samples.
const REFERENCE: &[u8] = include_bytes!("../../parity/reference/procedural-clouds-320x180.exr");

/// Pixels of the picture.
const RESOLUTION: [u32; 2] = [320, 180];

/// Mean optical depth of the two clouds: dense enough to look like clouds, thin enough for a few dozen scattering events.
const MODELS_DEPTH: f64 = 4.0;

/// Points of the probe.
const POINTS: usize = 65_536;

/// Points per mode of the suite: enough to see every special value.
const SUITE_POINTS: usize = 1024;

/// Agreement of a deterministic picture with one that has noise: 1 % of the channel means (Cycles'
/// own systematic error at 256 samples is up to 0.5 %), and a relMSE of block means of 1e-2.
pub const TOLERANCES: Tolerances = Tolerances {
    channel_mean_relative: Some(0.01),
    block_relmse: Some(0.01),
    pixel_relmse: None,
    max_error: None,
    failing_share: None,
    alpha_max_error: None,
    flip_mean: None,
};

/// What to do.
pub struct Settings {
    /// The run directory.
    pub output: PathBuf,
    /// Render the reference in Cycles now instead of taking the committed one.
    pub live: bool,
    /// Compare every mode of every node, too.
    pub modes: bool,
}

/// What came out.
pub struct Outcome {
    /// The page to open.
    pub report: PathBuf,
    /// The verdict on the picture, where there is one.
    pub picture: Option<Verdict>,
    /// Whether every judged evaluator agrees with Cycles; none without Cycles.
    pub field: Option<bool>,
}

/// A run in progress.
struct Demo<'a> {
    settings: &'a Settings,
    scene: Scene,
    run: Run,
    gpu: Option<Gpu>,
    receive: &'a (dyn Fn(f64, &str) + Sync),
}

/// Runs everything; `receive` hears the fraction of the present step and its name.
pub fn run(settings: &Settings, receive: &(dyn Fn(f64, &str) + Sync)) -> Result<Outcome> {
    files::make_folder(&settings.output, "a folder for the results")?;
    let value = serde_json::from_str(SCENE).expect("the committed scene is JSON");
    let scene = Scene::from_value(value, "the committed scene")?;
    let mut demo = Demo { settings, scene, run: Run::default(), gpu: None, receive };
    demo.open()?;
    let has_bpy = bridge::has_bpy();
    let mut field = None;
    if has_bpy {
        demo.timed("round trip through a .blend", Demo::round_trip)?;
        field = Some(demo.timed("probe of the field", Demo::probe)?);
    } else {
        demo.leave_out(
            "round trip, probe of the field, error of slices, modes",
            "Python has no module bpy",
            "make setup",
        );
    }
    demo.timed("slices of the field", |demo| demo.slices(has_bpy))?;
    demo.timed("bounds of the field", Demo::bounds)?;
    demo.timed("picture", Demo::picture)?;
    let picture = demo.timed("comparison of the pictures", Demo::compare)?;
    if has_bpy && settings.modes {
        let agree = demo.timed("every mode of every node", Demo::modes)?;
        field = field.map(|before| before && agree);
    }
    demo.timed("density models side by side", Demo::models)?;
    demo.timed("error against time", Demo::study)?;
    demo.timed("numerical stability", Demo::stability)?;
    let report = demo.finish()?;
    Ok(Outcome { report, picture, field })
}

impl Demo<'_> {
    fn path(&self, name: &str) -> PathBuf {
        self.settings.output.join(name)
    }

    fn write_json(&self, name: &str, value: &impl serde::Serialize) -> Result<()> {
        let text = serde_json::to_string_pretty(value).expect("results serialise") + "\n";
        files::write_atomically(&self.path(name), text.as_bytes())
    }

    fn leave_out(&mut self, what: &str, why: &str, remedy: &str) {
        self.run.left_out.push(LeftOut { what: what.into(), why: why.into(), remedy: remedy.into() });
    }

    fn timed<T>(&mut self, what: &str, step: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        (self.receive)(0.0, what);
        let begin = Instant::now();
        let result = step(self)?;
        self.run.timings.push(Timing { what: what.into(), seconds: begin.elapsed().as_secs_f64() });
        Ok(result)
    }

    /// A receiver of script messages that passes progress on.
    fn messages(&self, what: &'static str) -> impl FnMut(Message) + use<'_> {
        move |message| (self.receive)(message.done, what)
    }

    /// Scene, explanation, versions and adapter.
    fn open(&mut self) -> Result<()> {
        files::write_atomically(&self.path("scene.json"), SCENE.as_bytes())?;
        let program = Program::density(&self.scene)?;
        files::write_atomically(&self.path("explain.txt"), describe(&program).as_bytes())?;
        self.run.title = Some("Procedural clouds: Cycles and cloudparity".into());
        self.run.scene = Some(self.scene.name.clone());
        self.run.scene_sha256 = Some(self.scene.content_hash());
        self.run.command = Some(format!("cloudparity demo{}", if self.settings.live { " --live" } else { "" }));
        let version = |module: &str, expression: &str| {
            bridge::module_version(module, expression).unwrap_or_else(|_| "missing".into())
        };
        self.run.versions = [
            ("cloudparity", Identity::current().full().to_owned()),
            ("Blender (bpy)", version("bpy", "bpy.app.version_string")),
            ("OpenImageIO", version("OpenImageIO", "OpenImageIO.VERSION_STRING")),
        ]
        .into_iter()
        .map(|(name, version)| (name.to_owned(), Json::from(version)))
        .collect();
        for (name, version) in bridge::package_versions() {
            self.run.versions.entry(name).or_insert_with(|| version.into());
        }
        self.run.versions.insert("Compiler".into(), COMPILER.into());
        self.run.versions.insert("Machine".into(), machine().into());
        match Gpu::open() {
            Ok(gpu) => {
                if let Json::Object(fields) = serde_json::to_value(gpu.adapter()).expect("an adapter serialises") {
                    self.run.adapter = fields.into_iter().collect();
                }
                self.gpu = Some(gpu);
            }
            Err(error) => self.leave_out("WGSL", &error.found, &error.remedy),
        }
        Ok(())
    }

    /// Scene file to .blend to scene file: nothing may change.
    fn round_trip(&mut self) -> Result<()> {
        let blend = self.path("procedural-clouds.blend");
        let absolute = std::path::absolute(&blend).unwrap_or(blend);
        let request = json!({"scene": self.scene, "blend": absolute});
        bridge::run_script("build_scene.py", &request, CyclesKernel::Default, |_| ())?;
        let request = json!({"blend": absolute, "object": null});
        let result = bridge::run_script("export_scene.py", &request, CyclesKernel::Default, |_| ())?;
        let exported = Scene::from_value(result["scene"].clone(), "the exported scene")?;
        if exported != self.scene {
            return Err(Error::new(
                "round trip through a .blend",
                "a scene that differs from the one that was built",
                "the same scene",
                "This is a defect of the exporter or the builder: report it.",
            ));
        }
        Ok(())
    }

    fn evaluators(&self) -> &'static [Evaluator] {
        if self.gpu.is_some() { &Evaluator::ALL } else { &[Evaluator::Cpu, Evaluator::Oracle] }
    }

    fn probe(&mut self) -> Result<bool> {
        let mut probes = Vec::new();
        for domain in [Domain::Box, Domain::Wide, Domain::Adversarial] {
            let target = target::density(&self.scene)?;
            let messages = self.messages("probe of the field");
            let sampling = Sampling { domain, points: POINTS, seed: 1, rounding_bound: false };
            probes.extend(fields::probe(&self.scene, &[target], sampling, self.evaluators(), messages)?);
        }
        self.write_json("probe.json", &probes)?;
        let figures = probes.iter().flat_map(|probe| probe.evaluators.values());
        Ok(figures.filter_map(|figures| figures.agrees()).all(|agrees| agrees))
    }

    fn slices(&mut self, cycles: bool) -> Result<()> {
        const SIDE: usize = 256;
        let program = Program::density(&self.scene)?;
        let region = domain::region(&program, self.scene.volume.bounds)?;
        let planes = slices::planes(&region, &[0.25, 0.5], SIDE);
        let folder = self.path("slices");
        files::make_folder(&folder, "a folder")?;
        let evaluator = if self.gpu.is_some() { Evaluator::Gpu } else { Evaluator::Cpu };
        let messages = self.messages("slices of the field");
        let slices = slices::save(&self.scene, planes, &[evaluator], cycles, &folder, messages)?;
        let requests: Vec<Json> = slices
            .iter()
            .map(|slice| {
                let file = |name: &str| slice.files.iter().find(|(who, _)| *who == name).map(|(_, path)| path);
                let stem: String = slice.plane.name.chars().filter(|letter| !letter.is_whitespace()).collect();
                json!({
                    "title": format!("{}, {}", slice.plane.name, evaluator_title(evaluator)),
                    "ours": file(evaluator.name()),
                    "reference": file("cycles"),
                    "png_prefix": self.path(&format!("slice-{stem}")),
                })
            })
            .collect();
        let request = json!({"op": "field_slices", "slices": requests});
        match bridge::run_script("compare_images.py", &request, CyclesKernel::Default, |_| ()) {
            Ok(result) => self.write_json("slices.json", &result["slices"]),
            Err(error) => {
                self.leave_out("pictures of slices", &error.found, &error.remedy);
                Ok(())
            }
        }
    }

    /// A small survey of the bounds; `cloudparity bounds` makes a large one.
    fn bounds(&mut self) -> Result<()> {
        let program = Program::density(&self.scene)?;
        let region = domain::region(&program, self.scene.volume.bounds)?;
        let survey = Survey {
            layer: Bounds3::new(region.min, region.max),
            boxes: 1000,
            samples: 200,
            grid: 64,
            cells: 2000,
            refine: 1,
            seed: 1,
        };
        self.write_json("bounds.json", &survey.run(&program)?)
    }

    /// The scene as the picture shows it.
    fn picture_scene(&self) -> Scene {
        let mut scene = self.scene.clone();
        scene.film.resolution = RESOLUTION;
        scene.film.resolution_percentage = 100;
        scene.film.pixel_filter = PixelFilter::Box;
        scene.film.transparent = true;
        scene
    }

    fn picture(&mut self) -> Result<()> {
        let image = integrators::render(&self.picture_scene(), &MarchSettings::default(), Backend::Cpu, self.receive)?;
        image.write_exr(&self.path("ours.exr"), false)
    }

    fn compare(&mut self) -> Result<Option<Verdict>> {
        let reference_path = self.path("reference.exr");
        if self.settings.live {
            let settings = ReferenceSettings { samples: 256, seed: 101, ..ReferenceSettings::default() };
            let messages = self.messages("reference in Cycles");
            let found = reference(&self.picture_scene(), &settings, &cache_folder()?, messages)?;
            let bytes = std::fs::read(&found.path)
                .map_err(|cause| Error::io(&found.path, "the reference in the cache", &cause))?;
            files::write_atomically(&reference_path, &bytes)?;
        } else {
            files::write_atomically(&reference_path, REFERENCE)?;
        }
        let mut request = DiffRequest::new(vec![self.path("ours.exr")], vec![reference_path], TOLERANCES);
        request.out = Some(self.settings.output.clone());
        let world = &self.scene.world;
        let background = world.color.map(|value| f64::from(value * world.strength));
        request.display = Some(DisplaySettings::of(&self.scene.display, Some(background)));
        match request.run(|script, request| bridge::run_script(script, request, CyclesKernel::Default, |_| ())) {
            Ok(result) => Ok(Some(result.verdict)),
            Err(error) => {
                self.leave_out("comparison of the pictures", &error.found, &error.remedy);
                Ok(None)
            }
        }
    }

    /// Every node on the CPU, and in WGSL those of this cloud: on a software adapter a shader of each mode takes minutes.
    fn modes(&mut self) -> Result<bool> {
        let program = Program::density(&self.scene)?;
        let in_cloud = |label: &str| program.instructions.iter().any(|node| node.node_type.label == label);
        let cases = suite::cases(SUITE_POINTS, 1, None, Selection::Everything)?;
        let (shaded, others): (Vec<_>, Vec<_>) = cases.into_iter().partition(|case| in_cloud(case.node));
        let mut rows = Vec::new();
        for (cases, gpu) in [(shaded, self.gpu.as_ref()), (others, None)] {
            rows.extend(suite::run(&cases, gpu, false, self.messages("every mode of every node"))?.rows);
        }
        self.write_json("modes.json", &rows)?;
        Ok(rows.iter().all(|row| row.pass))
    }

    /// The cloud in daylight.
    fn daylight(&self) -> Result<Scene> {
        let mut value: Json = serde_json::from_str(DAYLIGHT).expect("the committed scene is JSON");
        // The graph of the scene of the demonstration, which the file names.
        value["graph"] = serde_json::to_value(self.scene.graph()).expect("a graph serialises");
        let mut scene = Scene::from_value(value, "the committed scene in daylight")?;
        scene.film.resolution_percentage = 100;
        Ok(scene)
    }

    /// The cloud beside the Perlin-FBM cloud, small; `cloudparity compare-models` makes it large.
    fn models(&mut self) -> Result<()> {
        let mut scene = self.daylight()?;
        scene.film.resolution = [256, 144];
        let model = engines::find("perlin-fbm")?;
        let settings = comparison::Settings {
            places: 96,
            samples: 32,
            sub_pixels: 1,
            mean_depth: Some(MODELS_DEPTH),
            timed_points: 1 << 16,
        };
        let values = model.values(Some("high"), &[])?;
        let folder = self.settings.output.clone();
        let mut found = comparison::run(&scene, &[(model, values)], &settings, &folder, self.receive)?;
        comparison::write(&found, &folder)?;
        if let Err(error) = comparison::show(&mut found, &scene.display, &folder) {
            self.leave_out("pictures of the density models", &error.found, &error.remedy);
        }
        Ok(())
    }

    /// A small study of error against time; `cloudparity study` makes large ones.
    fn study(&mut self) -> Result<()> {
        let mut file = StudyFile::parse(STUDY, "the committed study")?;
        // Engines are made for adapters: where there is one, it renders the runs, those of the graph, too.
        if self.gpu.is_some() {
            file.timing.backend = Backend::Gpu;
        }
        let mut scene = self.daylight()?;
        for axis in &file.axes.scenes {
            axis.prepare(&mut scene, file.resolution)?;
        }
        let folder = self.path("study");
        // The demonstration makes everything anew; its study goes on only where this very build was interrupted.
        if folder.exists() && study::is_of_another_build(&folder)? {
            std::fs::remove_dir_all(&folder)
                .map_err(|cause| Error::io(&folder, "a folder that can be removed", &cause))?;
        }
        let results = Study::new(file, vec![scene]).run(&folder, &Default::default(), self.receive)?.all()?;
        for left_out in &results.left_out {
            self.leave_out("figures of the study", left_out, "Run make setup.");
        }
        if let Err(error) = results.draw(&folder) {
            self.leave_out("figure of error against time", &error.found, &error.remedy);
        }
        Ok(())
    }

    /// Stiff and extreme cases of the cloud, which `cloudparity stability` measures for any scene.
    fn stability(&mut self) -> Result<()> {
        let ramp = serde_json::from_str(RAMP).expect("the committed scene is JSON");
        let ramp = Scene::from_value(ramp, "the committed linear ramp")?;
        // Nothing is kept: the demonstration makes everything anew.
        let gpu = self.gpu.as_ref();
        let table = stability::run(&self.scene, &ramp, gpu, None, &Default::default(), self.receive)?.all()?;
        table.write(&self.settings.output)
    }

    fn finish(self) -> Result<PathBuf> {
        self.write_json("run.json", &self.run)?;
        report::write_report(&self.settings.output, super::report::MAKERS)
    }
}

fn evaluator_title(evaluator: Evaluator) -> &'static str {
    match evaluator {
        Evaluator::Cpu => "CPU",
        Evaluator::Gpu => "WGSL",
        Evaluator::Oracle => "oracle",
    }
}

/// Whether `path` lies on a file system that can be written, before a long run starts.
pub fn check_writable(path: &Path) -> Result<()> {
    files::write_atomically(&path.join(".cloudparity-write-check"), b"")?;
    std::fs::remove_file(path.join(".cloudparity-write-check"))
        .map_err(|cause| Error::io(path, "a writable folder", &cause))
}
