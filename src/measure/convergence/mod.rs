//! How fast `march` converges: error against the number of steps, and the bias of density caches.
//!
//! The truth is made here: the energy-conserving picture with [`REFERENCE_FACTOR`] times the finest
//! steps. Both integrations converge to it, since their difference vanishes with the step. Only the
//! view steps change; shadow rays, light grid and early exit stay as the settings say.
//!
//! Errors are over all pixels and the channels R, G, B, with o ours and r the reference:
//! relMSE = mean (o - r)^2 / (r^2 + e^2) with e = 1 % of the mean of r, its root, the relative RMS
//! sqrt(mean (o - r)^2) / mean r, and the relative mean error (mean o - mean r) / mean r. The first and the
//! last are the formulas of [`crate::measure::pictures`]; relMSE is ruled by dark pixels, the relative RMS by bright ones.
//!
//! An order p is that of error = c steps^-p: minus the least-squares slope of log(error) over
//! log(steps). It is fitted over the asymptotic part ([`fit`]).

use crate::base::error::{Error, Result};
use crate::base::identity;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::integrators::march::render_each;
use crate::integrators::{MarchSettings, mean_world_side};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::media::density_cache::{CacheFilter, CacheFormat};
use crate::media::density_cache::{CacheReport, DensityCache, Samples};
use crate::media::medium::Medium;
use crate::media::transfer::Integration;
use crate::scene::Scene;
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::Path;
use std::time::Instant;

/// Format of the results.
const FORMAT: &str = "cloudparity-convergence/1";

/// Formats and filters of caches that are compared.
const FORMATS: [CacheFormat; 3] = [CacheFormat::F32, CacheFormat::F16, CacheFormat::Unorm8];
const FILTERS: [CacheFilter; 2] = [CacheFilter::Nearest, CacheFilter::Trilinear];

/// Steps of the reference for each of the finest.
pub const REFERENCE_FACTOR: u32 = 4;

/// Part of the mean of the reference that relMSE adds to its denominator.
const RELATIVE_EPSILON: f64 = 0.01;

/// Correlation squared of log(error) and log(steps) from which a run of points counts as a power law.
const STRAIGHT: f64 = 0.99;

/// Errors below this part of the reference are those of pictures in f32 (2^-24 per value), with a margin of 8.
const FLOOR: f64 = 5e-7;

/// Steps per mean side of the medium beyond which a picture takes hours.
const MOST_STEPS: u32 = 1 << 20;

/// What to measure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConvergenceSettings {
    /// Steps per mean world side of the medium's box, rising.
    pub steps: Vec<u32>,
    /// Cells of the caches along the longest side; none for no caches.
    pub cache_cells: Vec<u32>,
    /// Everything that does not vary. View step, integration and cache are set by the measurement.
    pub march: MarchSettings,
}

impl Default for ConvergenceSettings {
    fn default() -> Self {
        Self {
            steps: vec![4, 8, 16, 32, 64, 128, 256],
            cache_cells: vec![16, 32, 64, 128],
            // An exit would end all errors at its own size.
            march: MarchSettings { exit_transmittance: 0.0, ..MarchSettings::default() },
        }
    }
}

/// Difference of two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// mean (o - r)^2 / (r^2 + e^2).
    pub relmse: f64,
    /// Root of relMSE: an error relative to the radiance.
    pub root_relmse: f64,
    /// sqrt(mean (o - r)^2) / mean r.
    pub relative_rms: f64,
    /// (mean o - mean r) / mean r.
    pub relative_mean_error: f64,
}

/// One picture of a number of steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepPoint {
    /// How steps add up.
    pub integration: Integration,
    /// Steps per mean side.
    pub steps: u32,
    /// Longest step in metres.
    pub view_step: f64,
    /// Against the reference.
    #[serde(flatten)]
    pub error: PictureError,
    /// Seconds of wall time that the view rays took.
    pub seconds: f64,
}

/// An order of convergence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Order {
    /// How steps add up.
    pub integration: Integration,
    /// `root_relmse`, `relative_rms` or `relative_mean_error` (its magnitude).
    pub figure: String,
    /// p of error = factor steps^-p.
    pub order: f64,
    /// The error that the fit gives to a single step.
    pub factor: f64,
    /// Steps of the fitted points.
    pub fitted_steps: Vec<u32>,
    /// Correlation squared of log(error) and log(steps) over them.
    pub r_squared: f64,
    /// Whether the fitted points are a power law; else the order is a mean slope only.
    pub asymptotic: bool,
}

/// One cache against no cache.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CachePoint {
    /// Size, format, filter and field error.
    pub cache: CacheReport,
    /// Against the picture without cache at the same steps.
    #[serde(flatten)]
    pub error: PictureError,
    /// Seconds of wall time for light grid and view rays; the bake of the cache is in its report.
    pub seconds: f64,
}

/// All that was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// Format and version of this document.
    pub format: String,
    /// Version of the program.
    pub version: String,
    /// The builds that measured it; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// Name of the scene.
    pub scene: String,
    /// Hash of its content.
    pub scene_sha256: String,
    /// Pixels.
    pub resolution: [u32; 2],
    /// Mean world side of the medium's box in metres: a step is this over the number of steps.
    pub mean_side: f64,
    /// What was asked for.
    pub settings: ConvergenceSettings,
    /// Steps of the reference, energy-conserving.
    pub reference_steps: u32,
    /// Mean of the reference over pixels and R, G, B.
    pub reference_mean: f64,
    /// What the figures are.
    pub formulas: Vec<String>,
    /// Integration by integration, steps rising.
    pub points: Vec<StepPoint>,
    /// Of every integration and figure that has points enough.
    pub orders: Vec<Order>,
    /// Steps of the pictures with and without cache.
    pub cache_steps: u32,
    /// Cells by cells, format by format, filter by filter.
    pub caches: Vec<CachePoint>,
}

/// A unit of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    /// The pictures of all numbers of steps, which share what is prepared.
    Steps,
    /// The density caches of so many cells.
    Caches(u32),
}

/// Errors by steps, and what caches are compared with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Steps {
    reference_mean: f64,
    points: Vec<StepPoint>,
    /// The picture with the most steps, below the folder.
    uncached: String,
}

/// What a job came to; its file holds the content alone.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Record {
    Steps(Steps),
    Caches(Vec<CachePoint>),
}

/// A measurement of convergence while it is run.
struct Running<'a> {
    scene: &'a Scene,
    settings: &'a ConvergenceSettings,
    /// Resolved with the default step, so that the shadow step is the same for all.
    march: MarchSettings,
    side: f64,
    /// The energy-conserving picture with the most steps.
    uncached: Option<Image>,
}

/// Measures one scene on the CPU; without a folder nothing is kept.
pub fn measure(
    scene: &Scene,
    what: &ConvergenceSettings,
    folder: Option<&Path>,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Convergence>> {
    check(what)?;
    let march = MarchSettings { view_step: 0.0, density_cache: None, ..what.march.clone() }.resolved(scene)?;
    let mut running = Running { scene, settings: what, march, side: mean_world_side(scene), uncached: None };
    experiment::run(&mut running, folder, settings, progress)
}

impl Running<'_> {
    fn finest(&self) -> u32 {
        *self.settings.steps.last().expect("checked not to be empty")
    }

    fn step(&self, steps: u32) -> f64 {
        self.side / f64::from(steps)
    }

    fn steps(&mut self, desk: &Desk<'_>) -> Result<Steps> {
        let mut variants = vec![(self.step(self.finest() * REFERENCE_FACTOR), Integration::EnergyConserving)];
        let mut named = Vec::new();
        for integration in [Integration::EnergyConserving, Integration::Plain] {
            for &steps in &self.settings.steps {
                variants.push((self.step(steps), integration));
                named.push((integration, steps));
            }
        }
        let mut images: Vec<(Image, f64)> = Vec::new();
        let mut clock = Instant::now();
        let each = |_: usize, image: Image| {
            images.push((image, clock.elapsed().as_secs_f64()));
            clock = Instant::now();
        };
        render_each(self.scene, &self.march, None, &variants, each, &|done, what| desk.report(done, what))?;
        for (image, _) in &images {
            image.check_finite("a picture of convergence")?;
        }
        let (reference, _) = images.remove(0);
        let points: Vec<StepPoint> = named
            .iter()
            .zip(&images)
            .map(|(&(integration, steps), (image, seconds))| StepPoint {
                integration,
                steps,
                view_step: self.step(steps),
                error: compare(image, &reference),
                seconds: *seconds,
            })
            .collect();
        // Of the energy-conserving pictures, which come first, the one with the most steps.
        let (mut uncached, _) = images.swap_remove(self.settings.steps.len() - 1);
        let name = format!("pictures/{}.exr", desk.key);
        if let Some(folder) = desk.ledger.folder() {
            uncached.provenance.insert(identity::ATTRIBUTE.into(), desk.ledger.own().full().to_owned());
            uncached.write_exr(&folder.join(&name), false)?;
        }
        self.uncached = Some(uncached);
        Ok(Steps { reference_mean: mean(&reference), points, uncached: name })
    }

    fn caches(&mut self, cells: u32, desk: &Desk<'_>) -> Result<Vec<CachePoint>> {
        let medium = Medium::new(self.scene)?;
        if medium.density.occupied.is_empty() {
            return Ok(Vec::new());
        }
        let inputs = self.inputs(&Job::Steps)?;
        if self.uncached.is_none() {
            let steps: Steps = desk.obtain("records", &inputs, |_| self.steps(desk))?;
            if self.uncached.is_none() {
                self.uncached = Some(Image::read_exr(&desk.folder()?.join(&steps.uncached))?);
            }
        }
        let uncached = self.uncached.as_ref().expect("it was just made or read");
        let samples = Samples::bake(&medium.density, &medium.to_object, cells, CacheFormat::F32, &|_| {})?;
        let mut found = Vec::new();
        for format in FORMATS {
            for filter in FILTERS {
                let cache = DensityCache::new(&samples, format, filter)?;
                let begin = Instant::now();
                let mut picture = None;
                let each = |_: usize, image: Image| picture = Some(image);
                let variant = [(self.step(self.finest()), Integration::EnergyConserving)];
                render_each(self.scene, &self.march, Some(cache), &variant, each, &|_, _| {})?;
                let seconds = begin.elapsed().as_secs_f64();
                let picture = picture.expect("one picture was asked for");
                let cache = CacheReport::of(&picture).expect("it was rendered with a cache");
                found.push(CachePoint { cache, error: compare(&picture, uncached), seconds });
                desk.report(found.len() as f64 / (FORMATS.len() * FILTERS.len()) as f64, "density caches");
            }
        }
        Ok(found)
    }
}

impl Experiment for Running<'_> {
    type Job = Job;
    type Record = Record;
    type Summary = Convergence;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: FORMAT, of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<Job>> {
        Ok([Job::Steps].into_iter().chain(self.settings.cache_cells.iter().map(|&cells| Job::Caches(cells))).collect())
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        let steps = json!({"scene": self.scene.content_hash(), "march": self.march, "steps": self.settings.steps});
        Ok(match job {
            Job::Steps => steps,
            Job::Caches(cells) => json!({"steps": steps, "cells": cells}),
        })
    }

    fn label(&self, job: &Job) -> String {
        match job {
            Job::Steps => "steps".into(),
            Job::Caches(cells) => format!("caches of {cells} cells"),
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        Ok(Found::Record(match job {
            Job::Steps => Record::Steps(self.steps(desk)?),
            Job::Caches(cells) => Record::Caches(self.caches(*cells, desk)?),
        }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Convergence> {
        let (mut points, mut reference_mean, mut caches) = (Vec::new(), 0.0, Vec::new());
        for done in found {
            match done.found {
                Found::Record(Record::Steps(steps)) => (points, reference_mean) = (steps.points, steps.reference_mean),
                Found::Record(Record::Caches(found)) => caches.extend(found),
                Found::LeftOut(_) => {}
            }
        }
        Ok(Convergence {
            format: FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            builds: desk.ledger.builds(),
            scene: self.scene.name.clone(),
            scene_sha256: self.scene.content_hash(),
            resolution: self.scene.image_size(),
            mean_side: self.side,
            settings: ConvergenceSettings { march: self.march.clone(), ..self.settings.clone() },
            reference_steps: self.finest() * REFERENCE_FACTOR,
            reference_mean,
            formulas: formulas(),
            orders: orders(&points),
            points,
            cache_steps: self.finest(),
            caches,
        })
    }
}

fn check(settings: &ConvergenceSettings) -> Result<()> {
    let steps = &settings.steps;
    let most = MOST_STEPS / REFERENCE_FACTOR;
    let rising = steps.windows(2).all(|pair| pair[0] < pair[1]);
    if steps.len() < 4 || !rising || steps.iter().any(|steps| !(1..=most).contains(steps)) {
        return Err(Error::new(
            "setting steps",
            format!("{steps:?}"),
            format!("at least four rising numbers from 1 to {most}: the finest is left out of fits, which need three"),
            "Take for example 4, 8, 16, 32, 64.",
        )
        .with_setting("steps"));
    }
    if settings.cache_cells.contains(&0) {
        return Err(Error::new(
            "setting cache_cells",
            format!("{:?}", settings.cache_cells),
            "at least 1 cell along the longest side",
            "Take for example 16, 32, 64.",
        )
        .with_setting("cache_cells"));
    }
    Ok(())
}

fn formulas() -> Vec<String> {
    [
        "relMSE = mean over pixels and R, G, B of (o - r)^2 / (r^2 + e^2), e = 0.01 mean(r); root relMSE is its root",
        "relative RMS = root of mean (o - r)^2, over mean(r)",
        "relative mean error = (mean(o) - mean(r)) / mean(r) over pixels and R, G, B",
        "steps: per mean world side of the medium's box; the longest step is that side over steps",
        "order p: least squares of log(error) = log(factor) - p log(steps); fitted points: without the finest (the \
         reference's own error would show) and without errors below 5e-7 (f32), from the finest backwards as many as \
         keep r^2 >= 0.99, at least three",
    ]
    .map(str::to_owned)
    .to_vec()
}

fn mean(image: &Image) -> f64 {
    image.mean()[..3].iter().sum::<f64>() / 3.0
}

/// The error of a picture against another of the same size.
pub fn compare(ours: &Image, reference: &Image) -> PictureError {
    let (ours_mean, reference_mean) = (mean(ours), mean(reference));
    let epsilon = RELATIVE_EPSILON * reference_mean.abs();
    let (mut sum, mut squares) = (0.0, 0.0);
    for (o, r) in ours.pixels.iter().zip(&reference.pixels) {
        for channel in 0..3 {
            let (o, r) = (f64::from(o[channel]), f64::from(r[channel]));
            let square = (o - r).powi(2);
            squares += square;
            // A black reference: equal is right, and anything else is infinitely wrong.
            sum += if square == 0.0 { 0.0 } else { square / (r * r + epsilon * epsilon) };
        }
    }
    let count = (3 * reference.pixels.len()).max(1) as f64;
    let relmse = sum / count;
    let relative = |error: f64| if error == 0.0 { 0.0 } else { error / reference_mean };
    PictureError {
        relmse,
        root_relmse: relmse.sqrt(),
        relative_rms: relative((squares / count).sqrt()),
        relative_mean_error: relative(ours_mean - reference_mean),
    }
}

/// A straight line through points in logarithms.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// p of error = factor steps^-p.
    pub order: f64,
    /// The error at one step.
    pub factor: f64,
    /// Number of the first fitted point and of the one after the last.
    pub range: std::ops::Range<usize>,
    /// Correlation squared.
    pub r_squared: f64,
}

/// Fits an order to errors at rising numbers of steps; None with fewer than three points to fit.
///
/// Left out are the finest point, where the reference's own error (a quarter of it at first order, a
/// sixteenth at second) would steepen the slope, and errors that are those of f32. Of the rest, the run
/// of points that ends at the finest and is as long as its logarithms stay on a line (r^2 at least 0.99)
/// is the asymptotic part. If not even three do, the last three are fitted, and their r^2 says so.
pub fn fit(points: &[(f64, f64)]) -> Option<Fit> {
    let end = points[..points.len().saturating_sub(1)].iter().take_while(|(_, error)| *error > FLOOR).count();
    let candidates = (0..=end.checked_sub(3)?).map(|begin| line(points, begin..end));
    let mut last = None;
    for candidate in candidates {
        if candidate.r_squared >= STRAIGHT {
            return Some(candidate);
        }
        last = Some(candidate);
    }
    last
}

fn line(points: &[(f64, f64)], range: std::ops::Range<usize>) -> Fit {
    let logs: Vec<(f64, f64)> = points[range.clone()].iter().map(|(steps, error)| (steps.ln(), error.ln())).collect();
    let count = logs.len() as f64;
    let mean_x = logs.iter().map(|(x, _)| x).sum::<f64>() / count;
    let mean_y = logs.iter().map(|(_, y)| y).sum::<f64>() / count;
    let xx: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    let xy: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let yy: f64 = logs.iter().map(|(_, y)| (y - mean_y).powi(2)).sum();
    let slope = xy / xx;
    let r_squared = if yy > 0.0 { xy * xy / (xx * yy) } else { 0.0 };
    Fit { order: -slope, factor: (mean_y - slope * mean_x).exp(), range, r_squared }
}

fn orders(points: &[StepPoint]) -> Vec<Order> {
    let mut orders = Vec::new();
    for integration in [Integration::EnergyConserving, Integration::Plain] {
        let own: Vec<&StepPoint> = points.iter().filter(|point| point.integration == integration).collect();
        type Figure = fn(&PictureError) -> f64;
        let figures: [(&str, Figure); 3] = [
            ("root_relmse", |error| error.root_relmse),
            ("relative_rms", |error| error.relative_rms),
            ("relative_mean_error", |error| error.relative_mean_error.abs()),
        ];
        for (figure, value) in figures {
            let values: Vec<(f64, f64)> =
                own.iter().map(|point| (f64::from(point.steps), value(&point.error))).collect();
            let Some(found) = fit(&values) else { continue };
            orders.push(Order {
                integration,
                figure: figure.to_owned(),
                order: found.order,
                factor: found.factor,
                fitted_steps: own[found.range].iter().map(|point| point.steps).collect(),
                r_squared: found.r_squared,
                asymptotic: found.r_squared >= STRAIGHT,
            });
        }
    }
    orders
}

impl Convergence {
    /// One row per picture; what a row does not have is empty.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "kind,integration,steps,view_step_m,cells,format,filter,relmse,root_relmse,relative_rms,\
             relative_mean_error,field_max_error,field_rms_error,seconds\n",
        );
        for point in &self.points {
            let PictureError { relmse, root_relmse, relative_rms, relative_mean_error } = point.error;
            text += &format!(
                "steps,{},{},{},,,,{relmse:e},{root_relmse:e},{relative_rms:e},{relative_mean_error:e},,,{:.4}\n",
                point.integration.name(),
                point.steps,
                point.view_step,
                point.seconds,
            );
        }
        for point in &self.caches {
            let PictureError { relmse, root_relmse, relative_rms, relative_mean_error } = point.error;
            let settings = &point.cache.settings;
            text += &format!(
                "cache,{},{},,{},{},{},{relmse:e},{root_relmse:e},{relative_rms:e},{relative_mean_error:e},{:e},{:e},{:.4}\n",
                Integration::EnergyConserving.name(),
                self.cache_steps,
                settings.cells,
                settings.format.name(),
                settings.filter.name(),
                point.cache.relative_max_error,
                point.cache.relative_rms_error,
                point.seconds,
            );
        }
        text
    }

    /// The figures as a person reads them.
    pub fn summary(&self) -> String {
        let mut text = format!(
            "{}, {} x {}, against {} steps per {:.4} m, energy-conserving\n",
            self.scene, self.resolution[0], self.resolution[1], self.reference_steps, self.mean_side
        );
        for point in &self.points {
            text += &format!(
                "{:17} {:6} steps: root relMSE {:.3e}, relative RMS {:.3e}, relative mean error {:+.3e}\n",
                point.integration.name(),
                point.steps,
                point.error.root_relmse,
                point.error.relative_rms,
                point.error.relative_mean_error,
            );
        }
        for order in &self.orders {
            text += &format!(
                "{:17} order {:.2} of {} over steps {:?} (r^2 {:.4}{})\n",
                order.integration.name(),
                order.order,
                order.figure.replace('_', " "),
                order.fitted_steps,
                order.r_squared,
                if order.asymptotic { "" } else { ", no power law" },
            );
        }
        for point in &self.caches {
            let settings = &point.cache.settings;
            text += &format!(
                "cache {:4} {:6} {:9}: root relMSE {:.3e}, relative RMS {:.3e}, relative mean error {:+.3e}; field \
                 error max {:.2e}, RMS {:.2e} of the largest\n",
                settings.cells,
                settings.format.name(),
                settings.filter.name(),
                point.error.root_relmse,
                point.error.relative_rms,
                point.error.relative_mean_error,
                point.cache.relative_max_error,
                point.cache.relative_rms_error,
            );
        }
        text
    }
}

impl Integration {
    /// The name in settings and on the command line.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_found_after_its_pre_asymptotic_points() {
        let law = |order: f64| -> Vec<(f64, f64)> {
            (0..8)
                .map(|index| {
                    let steps = f64::from(4 << index);
                    // Two coarse points that stopped growing.
                    (steps, (3.0 * steps.powf(-order)).min(3.0 * 16.0_f64.powf(-order)))
                })
                .collect()
        };
        for order in [1.0, 2.0] {
            let points = law(order);
            let found = fit(&points).expect("there are points enough");
            assert_eq!(found.range.end, 7, "the finest is left out");
            assert!(found.range.start >= 1 && found.r_squared >= STRAIGHT, "{found:?}");
            // One flat point may stay within r^2 >= 0.99; over the six others it costs less than 15 %.
            assert!((found.order / order - 1.0).abs() < 0.15, "{found:?}");
        }
        let noise: Vec<(f64, f64)> = law(1.0).iter().enumerate().map(|(i, p)| (p.0, [1.0, 2.0][i % 2])).collect();
        assert!(fit(&noise).expect("three points are there").r_squared < STRAIGHT);
        assert_eq!(fit(&law(1.0)[..3]), None);
        let exact: Vec<(f64, f64)> = law(1.0).iter().map(|point| (point.0, 0.0)).collect();
        assert_eq!(fit(&exact), None);
    }

    #[test]
    fn the_error_of_a_picture_is_what_its_formula_says() {
        let mut reference = Image::new(2, 1);
        reference.pixels = vec![[1.0, 1.0, 1.0, 1.0], [3.0, 3.0, 3.0, 1.0]];
        let mut ours = reference.clone();
        assert_eq!(compare(&ours, &reference).relmse, 0.0);
        ours.pixels[1][0] = 3.5;
        let found = compare(&ours, &reference);
        // Mean of the reference 2, so epsilon 0.02.
        let expected: f64 = 0.25 / (9.0 + 0.0004) / 6.0;
        assert!((found.relmse / expected - 1.0).abs() < 1e-12);
        assert!((found.root_relmse / expected.sqrt() - 1.0).abs() < 1e-12);
        assert!((found.relative_rms - (0.25_f64 / 6.0).sqrt() / 2.0).abs() < 1e-12);
        assert!((found.relative_mean_error - 0.5 / 12.0).abs() < 1e-12);
    }
}
