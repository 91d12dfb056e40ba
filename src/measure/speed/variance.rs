//! Where the variance of path tracing comes from, decision by decision.
//!
//! A picture f depends on independent groups of random numbers, one for each [`Decision`]. Of two pictures whose numbers are the same but for
//! those of one decision i, half the mean square of the difference is E[Var(f | all others)]: the variance that would be left to that decision if
//! everything else were known, its *total effect* (Homma and Saltelli 1996, "Importance measures in global sensitivity analysis of nonlinear
//! models", eq. 14; estimator of Jansen 1999). An idea that makes decision i perfect takes that much away at most; since decisions act
//! together, total effects add up to the whole or more. Samples of a pixel are stratified, so pictures of several samples are compared, and the
//! variance is that of a sample: the picture's times their number.

use crate::base::error::Result;
use crate::base::identity::Identity;
use crate::base::progress::Progress;
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{PathSettings, Tracking};
use crate::measure::errors::{EPSILON, Uncertain};
use crate::scene::Scene;
use crate::view::sampler::{Decision, Redraw};
use serde::Serialize;
use strum::VariantArray as _;

/// What is rendered.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Samples of a pixel in each picture.
    pub samples: u32,
    /// Independent repetitions, at least 2.
    pub replicas: u32,
    /// How rays find their collisions.
    pub tracking: Tracking,
}

/// The total effect of a decision. A variance of a sample is the mean over pixels and channels of v / (m^2 + (0.01 M)^2), with a pixel's mean m and
/// the picture's M, as in relMSE; its standard error is that over the replicas.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Which.
    pub decision: Decision,
    /// Its variance.
    pub variance: Uncertain,
    /// Of the whole, which the decisions' shares reach together, or more.
    pub share: f64,
    /// Times fewer samples at most, were it perfect.
    pub gain: f64,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Variance {
    /// The build.
    pub build: Identity,
    /// The scene, and its hash.
    pub scene: String,
    /// Of the scene as it was rendered.
    pub scene_sha256: String,
    /// Pixels.
    pub resolution: [u32; 2],
    /// Samples of a pixel in each picture.
    pub samples: u32,
    /// Repetitions.
    pub replicas: u32,
    /// How rays found their collisions.
    pub tracking: Tracking,
    /// All decisions drawn again.
    pub whole: Uncertain,
    /// One after the other.
    pub rows: Vec<Row>,
}

/// Measures a scene: seven pictures for each replica.
pub fn run(scene: &Scene, settings: Settings, progress: Progress<'_>) -> Result<Variance> {
    let Settings { samples, replicas, tracking } = settings;
    // Kept, each decision drawn again, everything drawn again.
    let kinds: Vec<(u32, Redraw)> = std::iter::once((0, Redraw::Nothing))
        .chain(Decision::VARIANTS.iter().map(|&decision| (0, Redraw::Only(decision))))
        .chain([(1, Redraw::Nothing)])
        .collect();
    let all = f64::from(replicas) * kinds.len() as f64;
    let mut pictures: Vec<Vec<Vec<f64>>> = Vec::new();
    for replica in 0..replicas {
        let mut found = Vec::new();
        for (number, &(other, redraw)) in kinds.iter().enumerate() {
            progress((f64::from(replica) * kinds.len() as f64 + number as f64) / all, "pictures");
            let path = PathSettings { samples, seed: 2 * replica + other, tracking, redraw, ..PathSettings::default() };
            let image = path::render(scene, &path, Backend::Cpu, None, &|_, _| ())?;
            let colours = image.pixels.iter().flat_map(|pixel| [0, 1, 2].map(|channel| f64::from(pixel[channel])));
            found.push(colours.collect());
        }
        pictures.push(found);
    }
    let weights = weights(&pictures);
    let estimate = |kind: usize| {
        let halves = pictures.iter().map(|found| {
            let squares =
                found[0].iter().zip(&found[kind]).zip(&weights).map(|((a, b), weight)| weight * (a - b).powi(2));
            f64::from(samples) * squares.sum::<f64>() / 2.0
        });
        of_replicas(&halves.collect::<Vec<f64>>())
    };
    let whole = estimate(kinds.len() - 1);
    let row = |(number, &decision): (usize, &Decision)| {
        let variance = estimate(1 + number);
        let share = if whole.value > 0.0 { variance.value / whole.value } else { 0.0 };
        Row { decision, variance, share, gain: if share < 1.0 { 1.0 / (1.0 - share) } else { f64::INFINITY } }
    };
    Ok(Variance {
        build: Identity::current().clone(),
        scene: scene.name.clone(),
        scene_sha256: scene.content_hash(),
        resolution: scene.image_size(),
        samples,
        replicas,
        tracking,
        whole,
        rows: Decision::VARIANTS.iter().enumerate().map(row).collect(),
    })
}

/// Of each value of a picture in the mean over them, by the mean of all pictures.
fn weights(pictures: &[Vec<Vec<f64>>]) -> Vec<f64> {
    let all: Vec<&Vec<f64>> = pictures.iter().flatten().collect();
    let values = all[0].len();
    let means: Vec<f64> =
        (0..values).map(|place| all.iter().map(|picture| picture[place]).sum::<f64>() / all.len() as f64).collect();
    let dark = (EPSILON * means.iter().sum::<f64>() / values as f64).powi(2);
    // A black picture has no variance to weigh.
    means.into_iter().map(|mean| 1.0 / (mean.powi(2) + dark).max(f64::MIN_POSITIVE) / values as f64).collect()
}

fn of_replicas(values: &[f64]) -> Uncertain {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    Uncertain { value: mean, standard_error: (squares / (count - 1.0).max(1.0) / count).sqrt() }
}

impl Variance {
    /// For readers.
    pub fn table(&self) -> String {
        let [width, height] = self.resolution;
        let mut text = format!(
            "{}: variance of a sample relative to the picture, {width} x {height} pixels, {} samples, {} replicas, {} tracking\n\n\
             {:<16}{:>12}{:>12}{:>10}{:>26}\n",
            self.scene,
            self.samples,
            self.replicas,
            self.tracking,
            "drawn again",
            "variance",
            "error",
            "share",
            "fewer samples, at most"
        );
        for Row { decision, variance, share, gain } in &self.rows {
            text += &format!(
                "{:<16}{:>12.4}{:>12.4}{:>9.1}%{:>26}\n",
                decision.to_string(),
                variance.value,
                variance.standard_error,
                100.0 * share,
                if gain.is_finite() { format!("{gain:.2} times") } else { "no bound".into() }
            );
        }
        text + &format!("{:<16}{:>12.4}{:>12.4}\n", "all of them", self.whole.value, self.whole.standard_error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(name: &str) -> Scene {
        let path = format!("{}/parity/scenes/{name}.scene.json", env!("CARGO_MANIFEST_DIR"));
        let mut scene = Scene::load(path.as_ref()).expect("a committed scene loads");
        scene.film.resolution = [12, 8];
        scene
    }

    const SETTINGS: Settings = Settings { samples: 4, replicas: 3, tracking: Tracking::Proven };

    #[test]
    fn decisions_that_a_scene_does_not_make_have_no_variance() {
        // A homogeneous cube under a sun without a disc: bounds are the density, so that transmittance is exact, and one light is looked at in one
        // direction.
        let mut scene = scene("homogeneous-cube");
        scene.integrator.volume_bounces = 0;
        let found = run(&scene, SETTINGS, &|_, _| ()).expect("it renders");
        for row in &found.rows {
            let is_made = [Decision::Film, Decision::Distance].contains(&row.decision);
            assert_eq!(row.variance.value > 0.0, is_made, "{row:?}");
        }
        assert!(found.whole.value > 0.0);
    }

    #[test]
    fn total_effects_reach_the_whole() {
        let found = run(&scene("noise-anisotropic"), SETTINGS, &|_, _| ()).expect("it renders");
        let sum: f64 = found.rows.iter().map(|row| row.variance.value).sum();
        let error = found.rows.iter().map(|row| row.variance.standard_error.powi(2)).sum::<f64>().sqrt();
        // Total effects add up to the whole or more; three standard errors of both.
        assert!(sum > found.whole.value - 3.0 * error.hypot(found.whole.standard_error), "{}", found.table());
        assert!(found.rows.iter().filter(|row| row.variance.value > 0.0).count() >= 4, "{}", found.table());
    }
}
