//! Attribution: which stage of an engine makes its difference from path tracing.
//!
//! The stages of a picture ([`stage`], made exact by [`stages`]) are replaced by their exact twins one after the other, from the engine as it is to a picture in which
//! every stage is exact. What a replacement takes from the error depends on what was replaced before it; its mean over all orders is the stage's
//! share, and the shares of all add up to the whole ([`shares`]). A stage may have a negative share: its error hides another's.
//!
//! Two values are shared out. relMSE, with the noise of truth and added light taken out of it ([`crate::measure::errors`]); and the signed difference
//! of every pixel, which gives a map per stage, and of the picture's mean. What is left when every stage is exact is the remainder: 0 within its
//! standard error where the exact twins are fine enough.
//!
//! Light that no engine computes is path traced in the same replicas as the truth ([`components`]): the picture of replica r with a set S of exact stages
//! is P(S) + [orders in S] O(r) + [world in S] W(r), and its difference from the truth of the same replica has little noise.

pub mod components;
pub mod file;
pub mod shares;
pub mod stage;
pub mod stages;

use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::numbers::uncertain;
use crate::base::plain_text::csv_cell;
use crate::base::progress::Progress;
use crate::bridge::reference::{self, FIRST_REPLICA_SEED, ReferenceSettings};
use crate::bridge::{self, CyclesKernel, Message};
use crate::engines::render::{Drawn, EngineRenderer};
use crate::measure::attribution::components::{Components, Rendered};
use crate::measure::attribution::file::{AttributionFile, ByCycles};
use crate::measure::attribution::shares::Orders;
use crate::measure::attribution::stage::{Stage, Stages};
use crate::measure::attribution::stages::{Made, Staged};
use crate::measure::errors::{self, Uncertain};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::seeds;
use crate::measure::timing::machine;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::collections::HashMap;
use std::path::Path;

/// Format of the results.
pub const FORMAT: &str = "cloudparity-attribution-results/1";

const PURPOSE: Purpose = Purpose { mark: "attribution-folder.json", format: FORMAT, of: Json::Null };

/// What a stage has of an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// The stage.
    pub stage: Stage,
    /// Of relMSE.
    pub relmse: Uncertain,
    /// Of the relative difference of the pictures' means.
    pub brightness: Uncertain,
    /// relMSE that is left when this stage alone is replaced.
    pub alone: Uncertain,
    /// The map: the stage's share of each pixel's signed difference, EXR relative to the folder.
    pub map: String,
}

/// What an engine came to in a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attributed {
    /// The scene.
    pub scene: String,
    /// The engine's name in the file.
    pub engine: String,
    /// relMSE of the engine as it is.
    pub relmse: Uncertain,
    /// Relative difference of the means.
    pub brightness: Uncertain,
    /// By stage, those that differ from their exact twins.
    pub shares: Vec<Share>,
    /// relMSE that is left where every stage is exact.
    pub remainder: Uncertain,
    /// The same of the means.
    pub brightness_remainder: Uncertain,
    /// Orders that were drawn; none where all count.
    pub drawn_orders: Option<u32>,
    /// Pictures that were made.
    pub pictures: u32,
    /// Processor seconds, path tracing not counted.
    pub seconds: f64,
    /// The engine's picture and the truth's mean, EXRs relative to the folder.
    pub compared: [String; 2],
}

impl Attributed {
    /// The sum of all stages' shares of relMSE.
    pub fn sum(&self) -> f64 {
        self.shares.iter().map(|share| share.relmse.value).sum()
    }

    /// A stage's part of the sum of all shares' sizes.
    pub fn part(&self, share: &Share) -> f64 {
        let all: f64 = self.shares.iter().map(|share| share.relmse.value.abs()).sum();
        if all == 0.0 { 0.0 } else { share.relmse.value / all }
    }

    /// Whether the shares add up to the whole error: the remainder is 0 within two standard errors.
    pub fn adds_up(&self) -> bool {
        self.remainder.value.abs() <= 2.0 * self.remainder.standard_error
    }
}

/// Everything that was found: `attribution.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// [`FORMAT`].
    pub format: String,
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// The file.
    pub attribution: AttributionFile,
    /// What did the work.
    pub machine: String,
    /// By scene, then by engine.
    pub attributed: Vec<Attributed>,
}

impl Results {
    /// A table in plain text.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let percent = |found: Uncertain| format!("{} %", uncertain(100.0 * found.value, 100.0 * found.standard_error));
        let relative = |found: Uncertain| uncertain(found.value, found.standard_error);
        for one in &self.attributed {
            text += &format!(
                "{}, {}: relMSE {}, brightness {}\n  {:24}  {:>16}  {:>6}  {:>14}  left where it alone is exact\n",
                one.scene,
                one.engine,
                relative(one.relmse),
                percent(one.brightness),
                "stage",
                "relMSE",
                "part",
                "brightness",
            );
            for share in &one.shares {
                text += &format!(
                    "  {:24}  {:>16}  {:>4.0} %  {:>14}  {}\n",
                    share.stage.title(),
                    relative(share.relmse),
                    100.0 * one.part(share),
                    percent(share.brightness),
                    relative(share.alone),
                );
            }
            text += &format!(
                "  {:24}  {:>16}  {:6}  {:>14}  {}\n",
                "left when all are exact",
                relative(one.remainder),
                "",
                percent(one.brightness_remainder),
                if one.adds_up() {
                    "0 within two standard errors: the shares are the whole"
                } else if self.attribution.cycles.is_some() {
                    "not 0: Cycles' pictures differ from path tracing, or the exact twins are too coarse"
                } else {
                    "not 0: the exact twins are too coarse; raise exact.steps and exact.light_steps"
                },
            );
        }
        text
    }

    /// One line per scene, engine and stage.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "scene,engine,stage,relmse,relmse_standard_error,part,brightness,brightness_standard_error,relmse_alone,\
             relmse_alone_standard_error\n",
        );
        let mut line = |names: [&str; 3], numbers: &[f64]| {
            let mut fields: Vec<String> = names.iter().map(|name| csv_cell(name)).collect();
            fields
                .extend(numbers.iter().map(|number| if number.is_nan() { String::new() } else { number.to_string() }));
            text += &(fields.join(",") + "\n");
        };
        for one in &self.attributed {
            let both = |relmse: Uncertain, part: f64, brightness: Uncertain, alone: [f64; 2]| {
                let Uncertain { value, standard_error } = relmse;
                vec![value, standard_error, part, brightness.value, brightness.standard_error, alone[0], alone[1]]
            };
            let none = [f64::NAN; 2];
            line([&one.scene, &one.engine, "whole"], &both(one.relmse, f64::NAN, one.brightness, none));
            for share in &one.shares {
                let alone = [share.alone.value, share.alone.standard_error];
                let stage = share.stage.to_string();
                line([&one.scene, &one.engine, &stage], &both(share.relmse, one.part(share), share.brightness, alone));
            }
            line(
                [&one.scene, &one.engine, "remainder"],
                &both(one.remainder, f64::NAN, one.brightness_remainder, none),
            );
        }
        text
    }

    /// Draws the waterfalls and the maps as `.svg`, `.png` and `.pdf`. Needs matplotlib.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        let share = |share: &Share| {
            json!({
                "name": share.stage.title(), "relmse": share.relmse,
                "map": folder.join(&share.map),
            })
        };
        let cases: Vec<Json> = self
            .attributed
            .iter()
            .map(|one| {
                json!({
                    "scene": one.scene, "density": one.engine, "relmse": one.relmse, "remainder": one.remainder,
                    "shares": one.shares.iter().map(share).collect::<Vec<_>>(),
                    "compared": one.compared.each_ref().map(|name| folder.join(name)),
                })
            })
            .collect();
        let file = |extension: &str| folder.join(format!("attribution.{extension}"));
        let request = json!({
            "title": self.attribution.title, "cases": cases, "svg": file("svg"), "png": file("png"), "pdf": file("pdf"),
        });
        bridge::run_script("attribution_plot.py", &request, CyclesKernel::Default, |_| ()).map(drop)
    }
}

/// Goes through an attribution file in a folder, and sums up.
pub fn measure(path: &Path, folder: &Path, settings: &Settings, progress: Progress<'_>) -> Result<Outcome<Results>> {
    let file = AttributionFile::load(path)?;
    let scenes = file.load_scenes(path.parent().unwrap_or(Path::new(".")), &path.display().to_string())?;
    run(file, scenes, folder, settings, progress)
}

/// The same with scenes that are there.
pub fn run(
    file: AttributionFile,
    scenes: Vec<Scene>,
    folder: &Path,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Results>> {
    experiment::run(&mut Running { file, scenes }, Some(folder), settings, progress)
}

/// Positions in the lists of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    /// Path tracing of a scene with the density of an engine.
    Light(usize, usize),
    /// A scene and an engine.
    Engine(usize, usize),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Record {
    Light(Rendered),
    Engine(Box<Attributed>),
}

struct Running {
    file: AttributionFile,
    scenes: Vec<Scene>,
}

/// What a set of exact stages came to.
struct Value {
    /// Of all replicas, and with each left out.
    relmse: Vec<f64>,
    /// Likewise: the difference of the means over the truth's.
    brightness: Vec<f64>,
    /// The mean signed difference of each number.
    difference: Vec<f64>,
}

/// Figures of a combination of values, figure by figure.
fn add(to: &mut Vec<f64>, weight: f64, from: &[f64]) {
    to.resize(from.len(), 0.0);
    to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
}

impl Value {
    fn of(made: &[Vec<f64>], truth: &[Image]) -> Result<Self> {
        let truths: Vec<Vec<f64>> = truth.iter().map(errors::numbers).collect();
        let differences: Vec<Vec<f64>> = made
            .iter()
            .zip(&truths)
            .map(|(made, truth)| made.iter().zip(truth).map(|(made, truth)| made - truth).collect())
            .collect();
        let mut difference = Vec::new();
        differences.iter().for_each(|one| add(&mut difference, 1.0 / truth.len() as f64, one));
        Ok(Self {
            relmse: errors::relmse_of_differences(&differences, truth)?,
            brightness: errors::brightness_of_differences(&differences, truth),
            difference,
        })
    }
}

fn picture(size: [usize; 2], numbers: &[f64]) -> Image {
    let mut image = Image::new(size[0], size[1]);
    for (pixel, found) in image.pixels.iter_mut().zip(numbers.as_chunks::<3>().0) {
        let [red, green, blue] = found.map(|number| number as f32);
        *pixel = [red, green, blue, 1.0];
    }
    image
}

impl Running {
    fn size(&self) -> [usize; 2] {
        self.file.resolution.map(|side| side as usize)
    }

    fn inputs_of_light(&self, scene: usize, engine: usize) -> Json {
        components::inputs(&self.scenes[scene], &self.file.engines[engine].density, &self.file.truth)
    }

    fn rendered(&self, scene: usize, engine: usize, desk: &Desk<'_>) -> Result<Rendered> {
        desk.obtain(components::PART, &self.inputs_of_light(scene, engine), |key| {
            components::render(&self.scenes[scene], &self.file.engines[engine].density, &self.file.truth, key, desk)
        })
    }

    fn cycles_settings(ByCycles { samples }: ByCycles) -> ReferenceSettings {
        ReferenceSettings { samples, by_subset: true, ..ReferenceSettings::default() }
    }

    fn replicas_of_cycles(&self) -> Vec<u32> {
        (FIRST_REPLICA_SEED..FIRST_REPLICA_SEED + self.file.truth.replicas).collect()
    }

    /// Cycles' pictures of a scene, in replicas.
    fn by_cycles(&self, scene: usize, cycles: ByCycles, desk: &Desk<'_>) -> Result<Vec<Image>> {
        let (settings, replicas) = (Self::cycles_settings(cycles), self.replicas_of_cycles());
        let report = |message: Message| desk.report(message.done, &message.what);
        let found =
            reference::references(&self.scenes[scene], &settings, &replicas, &reference::cache_folder()?, report)?;
        found.iter().map(|reference| Image::read_exr(&reference.path)).collect()
    }

    fn attributed(&self, scene: usize, engine: usize, desk: &Desk<'_>) -> Result<Attributed> {
        let rendered = self.rendered(scene, engine, desk)?;
        let components = rendered.components(desk, &self.file.truth, self.size())?;
        let by_cycles = self.file.cycles.map(|cycles| self.by_cycles(scene, cycles, desk)).transpose()?;
        let truth = by_cycles.as_ref().unwrap_or(&components.truth);
        let begin = ProcessTime::now();
        let (scene, measured) = (&self.scenes[scene], &self.file.engines[engine]);
        let staged = Staged::new(scene, measured, self.file.exact)?;
        let stages = staged.differing()?;
        let seed = seeds::first(
            &json!({"scene": scene.content_hash(), "engine": measured, "purpose": "orders of replacement"}),
        );
        let orders = Orders::of(&stages, self.file.orders, u64::from(seed));
        let singles = stages.iter().map(|&stage| Stages::from([stage]));
        let mut sets: Vec<Stages> = orders.sets(&stages).into_iter().chain(singles).collect();
        sets.sort();
        sets.dedup();
        let mut values: HashMap<&Stages, Value> = HashMap::new();
        let mut own = Vec::new();
        for (number, set) in sets.iter().enumerate() {
            let made = self.made(&staged, set, &components)?;
            if set.is_empty() {
                made.iter().for_each(|one| add(&mut own, 1.0 / made.len() as f64, one));
            }
            values.insert(set, Value::of(&made, truth)?);
            desk.report((number + 1) as f64 / sets.len() as f64, "");
        }
        let all: Stages = stages.iter().copied().collect();
        let value = |set: &Stages| &values[set];
        let relmse = |set: &Stages| errors::from_left_out(&value(set).relmse);
        let brightness = |set: &Stages| errors::from_left_out(&value(set).brightness);
        let mut shares = Vec::new();
        for &stage in &stages {
            let (mut of_relmse, mut of_brightness, mut map) = (Vec::new(), Vec::new(), Vec::new());
            orders.share(&stages, stage, |weight, before, after| {
                let (before, after) = (value(before), value(after));
                for (sign, one) in [(weight, before), (-weight, after)] {
                    add(&mut of_relmse, sign, &one.relmse);
                    add(&mut of_brightness, sign, &one.brightness);
                    add(&mut map, sign, &one.difference);
                }
            });
            let with_orders = |found: &[f64], of: &dyn Fn(&Value) -> f64| {
                let drawn = orders.standard_error(&stages, stage, |set| of(value(set)));
                let Uncertain { value, standard_error } = errors::from_left_out(found);
                Uncertain { value, standard_error: standard_error.hypot(drawn) }
            };
            let name = format!("maps/{}.{stage}.exr", desk.key);
            picture(self.size(), &map).write_exr(&desk.folder()?.join(&name), false)?;
            shares.push(Share {
                stage,
                relmse: with_orders(&of_relmse, &|value| value.relmse[0]),
                brightness: with_orders(&of_brightness, &|value| value.brightness[0]),
                alone: relmse(&Stages::from([stage])),
                map: name,
            });
        }
        let mut mean = Vec::new();
        truth.iter().for_each(|image| add(&mut mean, 1.0 / truth.len() as f64, &errors::numbers(image)));
        let compared = [("engine", own), ("truth", mean)].map(|(name, numbers)| {
            let name = format!("pictures/{}.{name}.exr", desk.key);
            desk.folder()
                .and_then(|folder| picture(self.size(), &numbers).write_exr(&folder.join(&name), false))
                .map(|()| name)
        });
        let [ours, other] = compared;
        Ok(Attributed {
            scene: scene.name.clone(),
            engine: measured.name.clone(),
            relmse: relmse(&Stages::new()),
            brightness: brightness(&Stages::new()),
            remainder: relmse(&all),
            brightness_remainder: brightness(&all),
            drawn_orders: match &orders {
                Orders::All => None,
                Orders::Drawn(orders) => Some(orders.len() as u32),
            },
            pictures: sets.len() as u32,
            seconds: begin.elapsed().as_secs_f64(),
            shares,
            compared: [ours?, other?],
        })
    }

    /// The picture with a set of exact stages, in replicas. Light behind what the engine computes is added before passes and display.
    fn made(
        &self,
        staged: &Staged<'_>,
        set: &Stages,
        Components { first_seed, orders, ambient, .. }: &Components,
    ) -> Result<Vec<Vec<f64>>> {
        let Made { scene, engine, settings, is_drawn, gamma } = staged.made(set)?;
        let renderer = EngineRenderer::new(&scene, &engine, None)?;
        let compose = |drawn: Option<Drawn>| renderer.composed(&settings, drawn, &|_, _| ());
        let common = if is_drawn { None } else { Some(compose(None)?) };
        let replica = |index: usize| -> Result<Vec<f64>> {
            let mut image = match &common {
                Some(image) => image.clone(),
                None => compose(Some(Drawn { seed: first_seed + index as u32, rays: self.file.exact.rays }))?,
            };
            for (number, pixel) in image.pixels.iter_mut().enumerate() {
                for channel in 0..3 {
                    for (stage, light) in [(Stage::Orders, orders), (Stage::Ambient, ambient)] {
                        if staged.is_exact(set, stage) {
                            pixel[channel] += light[index][3 * number + channel] as f32;
                        }
                    }
                }
            }
            renderer.finish(&mut image, &settings)?;
            let mut numbers = errors::numbers(&image);
            if gamma != 1.0 {
                numbers.iter_mut().for_each(|number| *number = number.signum() * number.abs().powf(gamma));
            }
            Ok(numbers)
        };
        (0..self.file.truth.replicas as usize).map(replica).collect()
    }
}

impl Experiment for Running {
    type Job = Job;
    type Record = Record;
    type Summary = Results;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let pairs =
            (0..self.scenes.len()).flat_map(|scene| (0..self.file.engines.len()).map(move |engine| (scene, engine)));
        let is_first = |&(scene, engine): &(usize, usize)| {
            (0..engine).all(|other| self.inputs_of_light(scene, other) != self.inputs_of_light(scene, engine))
        };
        let light = pairs.clone().filter(is_first).map(|(scene, engine)| Job::Light(scene, engine));
        Ok(light.chain(pairs.map(|(scene, engine)| Job::Engine(scene, engine))).collect())
    }

    fn part(&self, job: &Job) -> &'static str {
        match job {
            Job::Light(..) => components::PART,
            Job::Engine(..) => "records",
        }
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        Ok(match *job {
            Job::Light(scene, engine) => self.inputs_of_light(scene, engine),
            Job::Engine(scene, engine) => {
                let mut inputs = json!({
                    "light": self.inputs_of_light(scene, engine), "engine": self.file.engines[engine],
                    "exact": self.file.exact, "orders": self.file.orders,
                });
                if let Some(cycles) = self.file.cycles {
                    let settings = Self::cycles_settings(cycles);
                    inputs["cycles"] =
                        json!(reference::keys(&self.scenes[scene], &settings, &self.replicas_of_cycles())?);
                }
                inputs
            }
        })
    }

    fn label(&self, job: &Job) -> String {
        match *job {
            Job::Light(scene, engine) => {
                format!("light of {} in {}", self.file.engines[engine].density, self.scenes[scene].name)
            }
            Job::Engine(scene, engine) => format!("{} in {}", self.file.engines[engine].name, self.scenes[scene].name),
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        Ok(Found::Record(match *job {
            Job::Light(scene, engine) => {
                let density = &self.file.engines[engine].density;
                Record::Light(components::render(&self.scenes[scene], density, &self.file.truth, desk.key, desk)?)
            }
            Job::Engine(scene, engine) => Record::Engine(Box::new(self.attributed(scene, engine, desk)?)),
        }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Results> {
        let attributed = experiment::records(found).into_iter().filter_map(|record| match record {
            Record::Engine(one) => Some(*one),
            Record::Light(_) => None,
        });
        let results = Results {
            format: FORMAT.into(),
            builds: desk.ledger.builds(),
            attribution: self.file.clone(),
            machine: machine(),
            attributed: attributed.collect(),
        };
        let folder = desk.folder()?;
        files::write_atomically(&folder.join("attribution.json"), to_json(&results).as_bytes())?;
        files::write_atomically(&folder.join("attribution.csv"), results.csv().as_bytes())?;
        Ok(results)
    }
}
