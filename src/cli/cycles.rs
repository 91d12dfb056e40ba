//! `cloudparity render --integrator cycles`: the picture of a scene by Cycles, rendered once.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge::reference::{
    FIRST_REPLICA_SEED, Quality, Reference, ReferenceSettings, WorldSampling, cache_folder, references,
};
use crate::bridge::{CyclesKernel, run_script};
use crate::measure::pictures;
use crate::scene::{Release, Scene};
use serde_json::json;
use std::path::{Path, PathBuf};

/// What only `--integrator cycles` takes.
///
/// With several replicas, OUTPUT is their mean; beside it lie OUTPUT.variance.exr (of one replica, per pixel) and every
/// replica as OUTPUT.seed-N.exr or OUTPUT.subset-N.exr, which `cloudparity diff --reference` takes.
#[derive(clap::Args)]
pub(super) struct CyclesArguments {
    /// cycles: samples and replicas at once: ci is 64 and 8, standard 1024 and 4, converged 4096 and 4. Sizes that fit are 64x64,
    /// 128x128 and 256x256. Accept a heterogeneous medium where --volume-biased --step-rate 0.05 agrees.
    #[arg(long, value_enum)]
    effort: Option<Effort>,
    /// cycles: ray marching instead of null collision.
    #[arg(long)]
    volume_biased: bool,
    /// cycles: factor on the step of ray marching [default: 1].
    #[arg(long, value_name = "FACTOR")]
    step_rate: Option<f64>,
    /// cycles: sample the world as a light where it is not constant. Wrong in media with several phase lobes, needed for a
    /// picture as world in the others.
    #[arg(long)]
    sample_world: bool,
    /// cycles: replicas are disjoint subsets of one sequence of samples instead of renders with other seeds, which share a part of
    /// Cycles' error (docs/findings).
    #[arg(long, conflicts_with_all = ["seed", "multilayer"])]
    by_subset: bool,
    /// cycles: threads; 0 takes all [default: 0].
    #[arg(long, value_name = "N")]
    threads: Option<u32>,
    /// cycles: write all passes as parts of one file.
    #[arg(long, conflicts_with_all = ["effort", "replicas"])]
    multilayer: bool,
}

/// Samples and replicas by one name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Effort {
    Ci,
    Standard,
    Converged,
}

impl From<Effort> for Quality {
    fn from(name: Effort) -> Self {
        match name {
            Effort::Ci => Self::Ci,
            Effort::Standard => Self::Standard,
            Effort::Converged => Self::Converged,
        }
    }
}

/// The largest first seed: others count on from it.
const MOST_SEED: u32 = 2_147_482_623;

impl CyclesArguments {
    /// Options by name, and whether each is given.
    pub(super) fn given(&self) -> [(&'static str, bool); 7] {
        [
            ("--effort", self.effort.is_some()),
            ("--volume-biased", self.volume_biased),
            ("--step-rate", self.step_rate.is_some()),
            ("--sample-world", self.sample_world),
            ("--by-subset", self.by_subset),
            ("--threads", self.threads.is_some()),
            ("--multilayer", self.multilayer),
        ]
    }

    /// What is rendered, and with which seeds.
    fn plan(&self, samples: Option<u32>, replicas: Option<u32>, seed: Option<u32>) -> (ReferenceSettings, Vec<u32>) {
        let effort = self.effort.map(Quality::from);
        let default = ReferenceSettings::default();
        let count = replicas.or(effort.map(Quality::replicas)).unwrap_or(1);
        let first = seed.unwrap_or(if count > 1 || self.by_subset { FIRST_REPLICA_SEED } else { default.seed });
        let settings = ReferenceSettings {
            samples: samples.or(effort.map(Quality::samples)).unwrap_or(default.samples),
            seed: first,
            volume_biased: self.volume_biased,
            step_rate: self.step_rate.unwrap_or(default.step_rate),
            threads: self.threads.unwrap_or(default.threads),
            multilayer: self.multilayer,
            world_sampling: if self.sample_world { WorldSampling::Automatic } else { WorldSampling::None },
            by_subset: self.by_subset,
        };
        (settings, (first..first + count).collect())
    }

    /// Renders, or takes from the cache what was rendered; returns what it was.
    pub(super) fn render(
        &self,
        scene: &Scene,
        (samples, replicas, seed): (Option<u32>, Option<u32>, Option<u32>),
        output: &Path,
    ) -> Result<String> {
        if let Some(seed) = seed.filter(|seed| *seed > MOST_SEED) {
            let expected = format!("0 to {MOST_SEED} with --integrator cycles");
            return Err(Error::new("--seed", seed.to_string(), expected, "Correct the option."));
        }
        let (settings, seeds) = self.plan(samples, replicas, seed);
        let bar = super::progress_bar(1000);
        let found = references(scene, &settings, &seeds, &cache_folder()?, super::report_to(&bar))?;
        bar.finish_and_clear();
        let what = |cached: bool| {
            let origin = if cached { ", from the cache" } else { "" };
            // Null collision came with 5.0; asked for it, older releases march.
            let way = match scene.graph().blender {
                release if release.is_default() => String::new(),
                release if release > Release::V5_0 => format!(" {release}"),
                release => format!(" {release}, by ray marching at the step rate {}", settings.step_rate),
            };
            format!("Cycles{way}, {} samples{origin}", settings.samples)
        };
        if let [only] = found.as_slice() {
            copy(only, output)?;
            return Ok(what(only.cached));
        }
        let first = seeds[0];
        for (reference, seed) in found.iter().zip(&seeds) {
            let name = if self.by_subset { format!("subset-{}", seed - first) } else { format!("seed-{seed}") };
            let path = super::beside(output, &name);
            copy(reference, &path)?;
            super::print(&line(reference, &path))?;
        }
        let variance = super::beside(output, "variance");
        let images: Vec<&PathBuf> = found.iter().map(|reference| &reference.path).collect();
        let request = json!({"op": "combine", "images": images, "mean": output, "variance": variance});
        run_script(pictures::SCRIPT, &request, CyclesKernel::Default, |_| ())?;
        super::print(&format!("{}: variance of one replica\n", variance.display()))?;
        let cached = found.iter().all(|reference| reference.cached);
        Ok(format!("mean of {} replicas: {}", found.len(), what(cached)))
    }
}

fn copy(reference: &Reference, path: &Path) -> Result<()> {
    let bytes =
        std::fs::read(&reference.path).map_err(|cause| Error::io(&reference.path, "the cached reference", &cause))?;
    files::write_atomically(path, &bytes)
}

fn line(reference: &Reference, path: &Path) -> String {
    let source = if reference.cached { "from the cache" } else { "rendered" };
    format!("{}: {source} ({})\n", path.display(), reference.key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: CyclesArguments,
        #[arg(long)]
        samples: Option<u32>,
        #[arg(long)]
        replicas: Option<u32>,
        #[arg(long)]
        seed: Option<u32>,
    }

    fn plan(words: &str) -> (ReferenceSettings, Vec<u32>) {
        let line = Line::try_parse_from(format!("render {words}").split_whitespace()).expect("a complete line");
        line.arguments.plan(line.samples, line.replicas, line.seed)
    }

    #[test]
    fn an_effort_gives_samples_and_replicas_that_can_be_changed() {
        let (settings, seeds) = plan("");
        assert_eq!((settings, seeds), (ReferenceSettings::default(), vec![101]));
        let (settings, seeds) = plan("--effort ci");
        assert_eq!((settings.samples, seeds), (64, (5000..5008).collect()));
        let (settings, seeds) = plan("--effort converged --replicas 2 --seed 7 --samples 16 --sample-world");
        assert_eq!((settings.samples, seeds), (16, vec![7, 8]));
        assert_eq!(settings.world_sampling, WorldSampling::Automatic);
        let mixed = "render --replicas 2 --multilayer";
        assert!(Line::try_parse_from(mixed.split(' ')).is_err());
    }
}
