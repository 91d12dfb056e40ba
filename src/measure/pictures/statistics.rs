//! Settings and results of the statistical verdict on replicas.
//!
//! A, B: means over the replicas of ours and of the reference; SE: standard error of their
//! difference; nu: its degrees of freedom; t = (A - B) / SE. The formulas, with their epsilons, travel
//! in [`Statistics::formulas`]; `blend/replica_statistics.py` derives them.

use crate::measure::pictures::Pair;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// What the statistical verdict is asked.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StatisticsSettings {
    /// Level of every family of tests, 0 to 0.5.
    pub significance: f64,
    /// Share of the reference that a difference may have besides noise: an error of the reference that
    /// its seeds share. `None` takes the measured budget of Cycles for the reference's samples.
    pub systematic_allowance: Option<f64>,
    /// Largest relMSE without noise.
    pub debiased_relmse: f64,
    /// One file per side, at this many times the resolution per axis, is taken as replicas in pairs.
    pub sub_pixels: Option<u32>,
}

impl Default for StatisticsSettings {
    fn default() -> Self {
        Self { significance: 0.01, systematic_allowance: None, debiased_relmse: 1e-3, sub_pixels: None }
    }
}

/// How the replicas were compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Design {
    /// Independent seeds: Welch's test.
    Unpaired,
    /// Sub-pixel images: the difference at each position is the unit.
    Paired,
}

impl Design {
    /// The design as words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Unpaired => "unpaired",
            Self::Paired => "in pairs",
        }
    }
}

/// Everything that the statistical verdict rests on; its checks stand among the checks of the result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// How the replicas were compared.
    pub design: Design,
    /// Their numbers.
    pub replicas: Pair<u32>,
    /// Level of every family of tests.
    pub significance: f64,
    /// Share of the reference that a difference may have besides noise.
    pub systematic_allowance: f64,
    /// Where that share comes from.
    pub allowance_rule: String,
    /// Coverage of the intervals, 0 to 1.
    pub interval: f64,
    /// Bias of the image means, one per colour channel.
    pub means: Vec<MeanTest>,
    /// One family of block means per size.
    pub blocks: Vec<BlockTest>,
    /// The family of pixels.
    pub pixels: PixelTest,
    /// Whether t favours one sign, one per channel that has noise.
    pub structure: Vec<Structure>,
    /// Squared relative bias.
    pub relmse: DebiasedRelMse,
    /// The same tests of alpha, where there is one.
    pub alpha: Option<AlphaTest>,
    /// How far the noise is from normal.
    pub tails: Vec<Tails>,
    /// The t-image runs from minus this to plus this.
    pub t_range: f64,
    /// Formula of every figure, by name.
    pub formulas: IndexMap<String, String>,
}

/// Bias and noise of one channel. Relative figures are `None` where the reference's mean is 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeanTest {
    /// Channel name.
    pub channel: String,
    /// A, linear radiance.
    pub ours: f64,
    /// B, linear radiance.
    pub reference: f64,
    /// A - B.
    pub bias: f64,
    /// SE, with the variance floor.
    pub standard_error: f64,
    /// nu.
    pub degrees: f64,
    /// t.
    pub t: f64,
    /// Two-sided, of what the systematic allowance does not cover.
    pub p: f64,
    /// Bias over the reference.
    pub relative_bias: Option<f64>,
    /// Lower end of its interval.
    pub relative_low: Option<f64>,
    /// Upper end of its interval.
    pub relative_high: Option<f64>,
    /// SE over the reference.
    pub relative_standard_error: Option<f64>,
    /// Largest absolute relative bias that agrees.
    pub relative_limit: Option<f64>,
    /// Variance of a pixel of one replica of ours, mean over the pixels.
    pub noise_variance_ours: f64,
    /// The same of the reference.
    pub noise_variance_reference: f64,
    /// Every value is 0 on both sides.
    pub is_black: bool,
}

/// Tests of the means of square blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BlockTest {
    /// Edge, pixels.
    pub size: u32,
    /// Blocks times channels.
    pub tests: u64,
    /// Level of each test.
    pub level: f64,
    /// How many are below it.
    pub rejected: u64,
    /// The smallest p.
    pub smallest_p: f64,
    /// Left column of the block with the smallest p.
    pub worst_x: u32,
    /// Its upper row.
    pub worst_y: u32,
    /// Its channel.
    pub worst_channel: String,
    /// Its t.
    pub worst_t: f64,
    /// Its bias over the reference.
    pub worst_relative_bias: Option<f64>,
}

/// Tests of single pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PixelTest {
    /// Pixels times channels that have noise.
    pub tests: u64,
    /// Those without noise on either side, compared by value.
    pub exact: u64,
    /// Level of each test.
    pub level: f64,
    /// Share of pixels that differ in any channel.
    pub rejected_share: f64,
    /// Standard deviation of t over the one that noise alone gives; `None` without noise.
    pub spread: Option<f64>,
    /// Largest spread that agrees.
    pub spread_limit: f64,
    /// Share of tests where the variance floor is larger than the noise.
    pub floored_share: f64,
}

/// Sign and shape of the t-image of one channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Structure {
    /// Channel name.
    pub channel: String,
    /// Mean of t over the pixels with noise.
    pub mean_t: f64,
    /// Largest absolute mean that agrees.
    pub limit: f64,
    /// Correlation of t with that of the neighbouring pixels.
    pub neighbour_correlation: Option<f64>,
    /// Number of such pairs.
    pub neighbour_pairs: u64,
    /// The correlation in standard errors.
    pub neighbour_z: Option<f64>,
}

/// Squared relative difference with and without noise; `None` where the reference is black.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DebiasedRelMse {
    /// Linear radiance.
    pub epsilon: f64,
    /// With the noise of both sides.
    pub plain: Option<f64>,
    /// What noise adds to `plain`.
    pub noise: Option<f64>,
    /// Without noise; may be below 0.
    pub debiased: Option<f64>,
    /// The same from one split of the replicas into halves, which is noisier.
    pub debiased_halves: Option<f64>,
    /// Standard error of `debiased`, from three replicas on.
    pub standard_error: Option<f64>,
    /// Largest value that agrees.
    pub limit: f64,
    /// Mean of (A - B)^2, squared radiance.
    pub mean_squared_difference: f64,
    /// What noise adds to it.
    pub mean_squared_noise: f64,
    /// The difference of the two: the squared bias.
    pub mean_squared_bias: f64,
}

/// The tests of alpha.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlphaTest {
    /// Image means.
    pub means: Vec<MeanTest>,
    /// Block means.
    pub blocks: BlockTest,
}

/// Kurtosis of the noise of single pixels over the replicas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tails {
    /// `ours`, `reference`, or their `difference`.
    pub of: String,
    /// Mean over the pixels.
    pub kurtosis: f64,
    /// What normal noise has with as many replicas.
    pub kurtosis_of_normal_noise: f64,
}
