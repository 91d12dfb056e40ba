//! Comparison of two scene-linear images: the request, the result and what the verdict means.
//!
//! The figures are computed by `blend/compare_images.py` (OpenImageIO, FLIP, numpy); this module
//! holds their types and formulas, with `o` a value of ours, `r` of the reference and the mean over
//! all pixels and colour channels unless said otherwise:
//!
//! | figure | formula |
//! | --- | --- |
//! | mean error, RMS, maximum | `mean abs(o - r)`, `sqrt(mean (o - r)^2)`, `max abs(o - r)` (OpenImageIO) |
//! | PSNR | `20 log10(1 / RMS)` decibel, peak 1; none where the images are equal |
//! | relative difference of a channel | `(mean o - mean r) / mean r` |
//! | relMSE, of pixels or of block means | `mean (o - r)^2 / (r^2 + e^2)`, `e` = 1 % of the mean of the reference |
//! | debiased block relMSE | `mean (o1 - r1)(o2 - r2) / (r^2 + e^2)` over two disjoint halves of the replicas |
//! | standard error of a mean over K replicas | `s / sqrt(K)`, `s` with K - 1 degrees of freedom |
//! | HDR-FLIP | 0 (no visible difference) to 1; exposures fixed by the reference |
//!
//! Where both sides have replicas, [`Statistics`] judge whether the two are the same picture as far as
//! their noise can tell; `blend/replica_statistics.py` derives the tests, and every result carries
//! their formulas.
//!
//! Values are linear radiance with Rec.709 primaries (alpha: 0 to 1). Pixels count from 0 at the
//! upper left.

pub mod parity;
mod statistics;

pub use crate::measure::images::{DisplaySettings, SCRIPT};
pub use statistics::{Statistics, StatisticsSettings};

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::identity::Identity;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::PathBuf;

/// What a comparison found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every check is within its tolerance.
    Agrees,
    /// At least one check is over its tolerance, or a value is not finite.
    Differs,
    /// The inputs do not fit together, nothing was judged, or noise hides the answer.
    CouldNotTell,
}

impl Verdict {
    /// Exit status of the program: 0 agrees, 1 differs, 2 could not tell.
    pub fn exit_status(self) -> u8 {
        match self {
            Self::Agrees => 0,
            Self::Differs => 1,
            Self::CouldNotTell => 2,
        }
    }

    /// The verdict as words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Agrees => "agrees",
            Self::Differs => "differs",
            Self::CouldNotTell => "could not tell",
        }
    }

    /// The verdict on several parts: one that differs decides, then one that could not be told.
    /// `None` for no part at all.
    pub fn worst(parts: impl IntoIterator<Item = Self>) -> Option<Self> {
        parts.into_iter().max_by_key(|part| match part {
            Self::Agrees => 0,
            Self::CouldNotTell => 1,
            Self::Differs => 2,
        })
    }
}

/// Limits chosen by the caller; a limit that is absent is not checked. All are at least 0, and a
/// value equal to its limit agrees.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerances {
    /// Relative difference of the mean of the worst channel, alpha included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel_mean_relative: Option<f64>,
    /// relMSE of block means.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub block_relmse: Option<f64>,
    /// relMSE of pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_relmse: Option<f64>,
    /// Largest absolute difference of a colour value, linear radiance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_error: Option<f64>,
    /// Share (0 to 1) of pixels that differ by more than the pixel threshold.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failing_share: Option<f64>,
    /// Largest absolute difference of alpha.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_max_error: Option<f64>,
    /// Mean HDR-FLIP error, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip_mean: Option<f64>,
}

choice! {
    "snake_case",
    /// What the values of a picture in integers (PNG, TIFF, JPEG) mean. The file does not say.
    pub enum Integers {
        /// Scene-linear, from 0 to 1.
        Linear,
        /// Light of a display, stored by the sRGB curve: decoded. Radiance only under the view
        /// Standard.
        Srgb,
        /// Display values, compared with display values as they are.
        Display,
    }
}

/// What the values of a side are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Values {
    /// Scene-linear floats.
    #[default]
    Radiance,
    /// [`Integers::Linear`].
    Linear,
    /// [`Integers::Srgb`].
    Srgb,
    /// [`Integers::Display`].
    Display,
}

/// One comparison. Several files on a side are replicas of one picture with other seeds; they are
/// averaged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiffRequest {
    /// Our EXR files, at least one.
    pub ours: Vec<PathBuf>,
    /// The reference's EXR files, at least one.
    pub reference: Vec<PathBuf>,
    /// Part, layer or pass to compare in files with several.
    pub part: Option<String>,
    /// That of our files, where it is another.
    pub ours_part: Option<String>,
    /// That of the reference's files, where it is another.
    pub reference_part: Option<String>,
    /// What the values of pictures in integers mean; without it such pictures are not compared.
    pub integers: Option<Integers>,
    /// Edge of a block in pixels, 1 to 4096.
    pub block: u32,
    /// A pixel fails where a colour channel differs by more than this, linear radiance.
    pub pixel_threshold: f64,
    /// What decides the verdict.
    pub tolerances: Tolerances,
    /// Folder for `diff.json` and the difference pictures.
    pub out: Option<PathBuf>,
    /// Makes `ours.png` and `reference.png` in `out`.
    pub display: Option<DisplaySettings>,
    /// End of the scale of the relative difference map; `None` covers 95 % of the lit pixels.
    pub range: Option<f64>,
    /// Asks for the statistical verdict; needs replicas of both sides.
    pub statistics: Option<StatisticsSettings>,
}

impl DiffRequest {
    /// Compares `ours` with `reference` with 8 x 8 blocks and a pixel threshold of 0.001, and
    /// writes nothing.
    pub fn new(ours: Vec<PathBuf>, reference: Vec<PathBuf>, tolerances: Tolerances) -> Self {
        Self {
            ours,
            reference,
            part: None,
            ours_part: None,
            reference_part: None,
            integers: None,
            block: 8,
            pixel_threshold: 1e-3,
            tolerances,
            out: None,
            display: None,
            range: None,
            statistics: None,
        }
    }

    /// Runs the comparison. `run` executes a script by name with a JSON request and returns its
    /// result; the program passes its Python runner.
    pub fn run(&self, run: impl FnOnce(&str, &Value) -> Result<Value>) -> Result<DiffResult> {
        let mut request = serde_json::to_value(self).map_err(|cause| {
            Error::new(
                "comparison request",
                cause.to_string(),
                "file names in UTF-8 and finite numbers",
                "Rename the files or correct the number.",
            )
        })?;
        request["op"] = "diff".into();
        request["program"] = Identity::current().full().into();
        let result = run(SCRIPT, &request)?;
        serde_path_to_error::deserialize(&result).map_err(|cause| {
            Error::new(
                format!("{SCRIPT}, result.{}", cause.path()),
                cause.inner().to_string(),
                "the result of this version's script",
                "Use the scripts that came with this program.",
            )
        })
    }
}

/// Everything that a comparison found. The figures are `None` where the images could not be
/// compared or hold values that are not finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiffResult {
    /// The answer.
    pub verdict: Verdict,
    /// Why, one sentence each.
    pub reasons: Vec<String>,
    /// One entry per tolerance.
    pub checks: Vec<Check>,
    /// The tolerances as given.
    pub tolerances: Tolerances,
    /// What a reader should know besides: negative values, shared files, assumptions.
    pub notes: Vec<String>,
    /// What was compared.
    pub images: Option<Images>,
    /// Values that are not finite or below zero, counted before any figure.
    pub finite: Option<Pair<BadValues>>,
    /// OpenImageIO's figures of the colour channels.
    pub colour: Option<ImageFigures>,
    /// The same for alpha, where there is one.
    pub alpha: Option<ImageFigures>,
    /// Means of every channel.
    pub channels: Option<Vec<ChannelMean>>,
    /// Relative squared errors.
    pub relmse: Option<RelMse>,
    /// The perceptual figure.
    pub flip: Option<Flip>,
    /// Bias apart from noise, and the tests of the statistical verdict.
    #[serde(default)]
    pub statistics: Option<Statistics>,
    /// Formula and range of the difference maps, where they were written.
    pub map: Option<DifferenceMap>,
    /// File name of each picture written, by kind, and the view of each display picture.
    pub files: IndexMap<String, String>,
    /// Versions of what computed this.
    pub versions: IndexMap<String, String>,
}

/// The same thing of both sides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pair<T> {
    /// Of our image.
    pub ours: T,
    /// Of the reference.
    pub reference: T,
}

/// One tolerance and how the images stand to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Name of the tolerance.
    pub name: String,
    /// The measured value, where there is one.
    pub value: Option<f64>,
    /// The largest value that agrees; for the number of replicas the smallest.
    pub limit: f64,
    /// The answer of this check alone.
    pub outcome: Verdict,
    /// The answer in one sentence.
    pub reason: String,
}

/// What was compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Images {
    /// Our files.
    pub ours: SideFiles,
    /// The reference's files.
    pub reference: SideFiles,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Channel names in file order.
    pub channels: Vec<String>,
    /// Part of a multi-part file.
    pub part: Option<String>,
}

/// The replicas of one side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SideFiles {
    /// One per replica.
    pub files: Vec<FileHash>,
    /// Their number.
    pub replicas: u32,
    /// The colour space that the file declares.
    pub colour_space: Option<String>,
    /// Part and layer that were read; empty where the file names none.
    #[serde(default)]
    pub picture: String,
    /// What its values are: radiance, or integers as the request stated.
    #[serde(default)]
    pub values: Values,
}

/// A file by name and content.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FileHash {
    /// Name without folder.
    pub file: String,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// Counts of channel values over all replicas of a side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct BadValues {
    /// Not a number.
    pub nan: u64,
    /// Plus or minus infinity.
    pub infinite: u64,
    /// Below zero.
    pub negative: u64,
}

/// OpenImageIO's `ImageBufAlgo::compare` (what `idiff` prints) of the averaged images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImageFigures {
    /// Mean absolute error, linear radiance.
    pub mean_error: f64,
    /// Root mean squared error, linear radiance.
    pub rms_error: f64,
    /// Decibel with peak 1; `None` where the images are equal.
    pub psnr: Option<f64>,
    /// Largest absolute error, linear radiance.
    pub max_error: f64,
    /// Where it is; `None` where the images are equal.
    pub max_at: Option<PixelPlace>,
    /// A pixel fails above this, linear radiance.
    pub threshold: f64,
    /// How many fail.
    pub failing_pixels: u64,
    /// The same as a share of all pixels, 0 to 1.
    pub failing_share: f64,
    /// Number of pixels compared.
    pub pixels: u64,
}

/// One channel of one pixel on both sides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PixelPlace {
    /// Column from 0 at the left.
    pub x: u32,
    /// Row from 0 at the top.
    pub y: u32,
    /// Channel name.
    pub channel: String,
    /// Our value.
    pub ours: f64,
    /// The reference's value.
    pub reference: f64,
}

/// The mean of one channel over all pixels and replicas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChannelMean {
    /// Channel name.
    pub channel: String,
    /// Our mean.
    pub ours: f64,
    /// The reference's mean.
    pub reference: f64,
    /// `(ours - reference) / reference`; `None` where only the reference's mean is 0.
    pub relative_difference: Option<f64>,
    /// Standard error of our mean, from two replicas on.
    pub ours_standard_error: Option<f64>,
    /// Standard error of the reference's mean, from two replicas on.
    pub reference_standard_error: Option<f64>,
    /// Root of the sum of squares of the known standard errors, relative to the reference's mean.
    pub standard_error_relative: Option<f64>,
}

/// relMSE figures; formulas at the head of this module. `None` where the reference is black.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RelMse {
    /// The formula in words.
    pub formula: String,
    /// The epsilon used, linear radiance.
    pub epsilon: f64,
    /// Where the epsilon comes from.
    pub epsilon_rule: String,
    /// Edge of a block, pixels; edge blocks may be smaller and count by their pixels.
    pub block_size: u32,
    /// Number of blocks.
    pub block_count: u64,
    /// relMSE of pixels, noise of both sides included.
    pub pixel: Option<f64>,
    /// relMSE of block means, noise of both sides included.
    pub block: Option<f64>,
    /// Part of `pixel` that the noise of the sides in `noise_from` is expected to add.
    pub noise_pixel: Option<f64>,
    /// The same for `block`.
    pub noise_block: Option<f64>,
    /// Block relMSE whose expectation holds no noise; needs two replicas per side; may be below 0.
    pub debiased_block: Option<f64>,
    /// Sides with two or more replicas.
    pub noise_from: Vec<String>,
}

/// HDR-FLIP: a perceptual error over a range of exposures, the worst exposure of each pixel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Flip {
    /// Always `HDR-FLIP`.
    pub kind: String,
    /// Mean over pixels, 0 to 1.
    pub mean: Option<f64>,
    /// Why there is no mean.
    pub why_not: Option<String>,
    /// First exposure, stops.
    pub exposure_start: Option<f64>,
    /// Last exposure, stops.
    pub exposure_stop: Option<f64>,
    /// How the exposures follow from the reference.
    pub exposure_rule: String,
    /// Tone mapper.
    pub tonemapper: String,
    /// Assumed pixels per degree of the viewer's field.
    pub pixels_per_degree: Option<f64>,
}

/// Formula and scale of the difference maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DifferenceMap {
    /// Formula of the signed relative map.
    pub formula: String,
    /// Its epsilon, luminance.
    pub epsilon: f64,
    /// The scale runs from minus this to plus this.
    pub range: f64,
    /// Who chose the range.
    pub range_rule: String,
    /// Share of pixels beyond the scale, 0 to 1.
    pub clipped_share: f64,
    /// The absolute map runs from 0 to this, linear radiance.
    pub absolute_range: f64,
    /// Share of pixels beyond it, 0 to 1.
    pub absolute_clipped_share: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exit_status_follows_the_verdict() {
        let status = [Verdict::Agrees, Verdict::Differs, Verdict::CouldNotTell].map(Verdict::exit_status);
        assert_eq!(status, [0, 1, 2]);
    }

    #[test]
    fn a_difference_outweighs_doubt_and_doubt_outweighs_agreement() {
        use Verdict::{Agrees, CouldNotTell, Differs};
        assert_eq!(Verdict::worst([Agrees, Differs, CouldNotTell]), Some(Differs));
        assert_eq!(Verdict::worst([CouldNotTell, Agrees]), Some(CouldNotTell));
        assert_eq!(Verdict::worst([]), None);
    }

    #[test]
    fn the_request_has_the_keys_of_the_script_and_leaves_absent_tolerances_out() {
        let tolerances = Tolerances { block_relmse: Some(0.01), ..Tolerances::default() };
        let request = DiffRequest::new(vec!["a.exr".into()], vec!["b.exr".into(), "c.exr".into()], tolerances);
        let mut sent = Value::Null;
        let answer = request.run(|script, request| {
            assert_eq!(script, SCRIPT);
            sent = request.clone();
            Ok(serde_json::json!({"verdict": "agrees"}))
        });
        assert_eq!(sent["op"], "diff");
        assert_eq!(sent["tolerances"], serde_json::json!({"block_relmse": 0.01}));
        assert_eq!(sent["reference"][1], "c.exr");
        assert!(answer.unwrap_err().found.contains("missing field"), "an incomplete result is refused");
    }
}
