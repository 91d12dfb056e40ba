//! `cloudparity reference`: the picture of a scene by Cycles, rendered once.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge::reference::{
    FIRST_REPLICA_SEED, Quality, Reference, ReferenceSettings, WorldSampling, cache_folder, references,
};
use crate::bridge::{CyclesKernel, run_script};
use crate::cli::picture::PictureArguments;
use crate::measure::pictures;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Render a scene with Cycles under the settings of a comparison; the same request is rendered once.
///
/// With several replicas, OUTPUT is their mean; beside it lie OUTPUT.variance.exr (of one replica, per pixel) and every
/// replica as OUTPUT.seed-N.exr, which `cloudparity diff --reference` takes.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    picture: PictureArguments,
    /// Samples and replicas: ci is 64 and 8, standard 1024 and 4, converged 4096 and 4. Sizes that fit are 64x64,
    /// 128x128 and 256x256. Accept a heterogeneous medium where --volume-biased --step-rate 0.05 agrees.
    #[arg(long, value_enum)]
    quality: Option<QualityName>,
    /// Samples per pixel [default: those of --quality, else 256].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    samples: Option<u32>,
    /// Replicas with seeds that count on from --seed [default: those of --quality, else 1].
    #[arg(long, conflicts_with = "multilayer", value_parser = clap::value_parser!(u32).range(1..=1024))]
    replicas: Option<u32>,
    /// Seed; other seeds give independent replicas [default: 101, of several replicas 5000].
    #[arg(long, value_parser = clap::value_parser!(u32).range(..=2_147_482_623))]
    seed: Option<u32>,
    /// Ray marching instead of null collision.
    #[arg(long)]
    volume_biased: bool,
    /// Factor on the step of ray marching.
    #[arg(long, default_value_t = ReferenceSettings::default().step_rate)]
    step_rate: f64,
    /// Sample the world as a light where it is not constant. Wrong in media with several phase lobes, needed for a
    /// picture as world in the others.
    #[arg(long)]
    sample_world: bool,
    /// Threads; 0 takes all.
    #[arg(long, default_value_t = ReferenceSettings::default().threads)]
    threads: u32,
    /// Write all passes as parts of one file.
    #[arg(long, conflicts_with = "quality")]
    multilayer: bool,
}

/// Command line name of a quality.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum QualityName {
    Ci,
    Standard,
    Converged,
}

impl From<QualityName> for Quality {
    fn from(name: QualityName) -> Self {
        match name {
            QualityName::Ci => Self::Ci,
            QualityName::Standard => Self::Standard,
            QualityName::Converged => Self::Converged,
        }
    }
}

impl Arguments {
    /// What is rendered, and with which seeds.
    fn plan(&self) -> (ReferenceSettings, Vec<u32>) {
        let quality = self.quality.map(Quality::from);
        let default = ReferenceSettings::default();
        let count = self.replicas.or(quality.map(Quality::replicas)).unwrap_or(1);
        let first = self.seed.unwrap_or(if count > 1 { FIRST_REPLICA_SEED } else { default.seed });
        let settings = ReferenceSettings {
            samples: self.samples.or(quality.map(Quality::samples)).unwrap_or(default.samples),
            seed: first,
            volume_biased: self.volume_biased,
            step_rate: self.step_rate,
            threads: self.threads,
            multilayer: self.multilayer,
            world_sampling: if self.sample_world { WorldSampling::Automatic } else { WorldSampling::None },
        };
        (settings, (first..first + count).collect())
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.picture.load()?;
    let (settings, seeds) = arguments.plan();
    let bar = super::progress_bar(1000);
    let found = references(&scene, &settings, &seeds, &cache_folder()?, super::report_to(&bar))?;
    bar.finish_and_clear();
    let output = &arguments.picture.output;
    if let [only] = found.as_slice() {
        copy(only, output)?;
        super::print(&line(only, output))?;
        return Ok(ExitCode::SUCCESS);
    }
    for (reference, seed) in found.iter().zip(&seeds) {
        let path = super::beside(output, &format!("seed-{seed}"));
        copy(reference, &path)?;
        super::print(&line(reference, &path))?;
    }
    let variance = super::beside(output, "variance");
    let images: Vec<&PathBuf> = found.iter().map(|reference| &reference.path).collect();
    let request = json!({"op": "combine", "images": images, "mean": output, "variance": variance});
    run_script(pictures::SCRIPT, &request, CyclesKernel::Default, |_| ())?;
    super::print(&format!("{} mean\n{} variance of one replica\n", output.display(), variance.display()))?;
    Ok(ExitCode::SUCCESS)
}

fn copy(reference: &Reference, path: &Path) -> Result<()> {
    let bytes =
        std::fs::read(&reference.path).map_err(|cause| Error::io(&reference.path, "the cached reference", &cause))?;
    files::write_atomically(path, &bytes)
}

fn line(reference: &Reference, path: &Path) -> String {
    let source = if reference.cached { "from the cache" } else { "rendered" };
    format!("{} {source} ({})\n", path.display(), reference.key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn plan(words: &str) -> (ReferenceSettings, Vec<u32>) {
        let words = format!("reference scene.json -o R.exr {words}");
        Line::try_parse_from(words.split_whitespace()).expect("a complete line").arguments.plan()
    }

    #[test]
    fn a_quality_gives_samples_and_replicas_that_can_be_changed() {
        let (settings, seeds) = plan("");
        assert_eq!((settings, seeds), (ReferenceSettings::default(), vec![101]));
        let (settings, seeds) = plan("--quality ci");
        assert_eq!((settings.samples, seeds), (64, (5000..5008).collect()));
        let (settings, seeds) = plan("--quality converged --replicas 2 --seed 7 --samples 16 --sample-world");
        assert_eq!((settings.samples, seeds), (16, vec![7, 8]));
        assert_eq!(settings.world_sampling, WorldSampling::Automatic);
        let mixed = "reference scene.json -o R.exr --replicas 2 --multilayer";
        assert!(Line::try_parse_from(mixed.split(' ')).is_err());
    }
}
