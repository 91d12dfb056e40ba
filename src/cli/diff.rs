//! `cloudparity diff`: two pictures, or two sets of replicas, compared with stated tolerances.

use crate::base::error::{Error, Result};
use crate::base::numbers::{figure, percent, signed_percent};
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::cli::choice::choice;
use crate::measure::pictures::{
    Check, DiffRequest, DiffResult, DisplaySettings, ImageFigures, Integers, Statistics, StatisticsSettings,
    Tolerances, Verdict,
};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare pictures, scene-linear EXR files above all: exit status 0 agrees, 1 differs, 2 could not
/// tell.
///
/// Several files on a side are replicas, the same picture with other seeds; they are averaged and give standard
/// errors. Replicas of both sides are judged by statistics: whether they show the same picture, as far as their noise
/// can tell. Otherwise only tolerances that are named are judged; without any the figures are printed and the status
/// is 2.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cloudparity diff --ours OURS.exr --reference CYCLES.exr --block-relmse 0.001 -o DIFFERENCE\n  cloudparity diff --ours OURS.seed-0.exr OURS.seed-1.exr --reference CYCLES.seed-5000.exr CYCLES.seed-5001.exr\n  cloudparity diff --ours OURS.exr --reference MULTILAYER.exr --reference-part ViewLayer.Combined --max-error 0.01"
)]
pub(super) struct Arguments {
    /// Our pictures.
    #[arg(long, required = true, num_args = 1.., value_name = "EXR")]
    ours: Vec<PathBuf>,
    /// The reference's pictures.
    #[arg(long, required = true, num_args = 1.., value_name = "EXR")]
    reference: Vec<PathBuf>,
    /// Part, layer or pass to compare in files with several, by its name or the end of it:
    /// ViewLayer.Combined, Combined. Without it: the only picture, else the one without a layer's
    /// name, else the only Combined.
    #[arg(long)]
    part: Option<String>,
    /// That of our files, in the place of --part.
    #[arg(long, value_name = "PART")]
    ours_part: Option<String>,
    /// That of the reference's files, in the place of --part.
    #[arg(long, value_name = "PART")]
    reference_part: Option<String>,
    /// What the values of 8-bit and 16-bit pictures (PNG, TIFF, JPEG) mean; the files do not say.
    #[arg(long, value_name = "WHAT", value_parser = choice::<Integers>())]
    integers: Option<Integers>,
    /// Every figure and check, with the formulas, instead of the short answer.
    #[arg(long, conflicts_with = "json")]
    verbose: bool,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Folder for diff.json and the pictures of the difference.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    tolerances: ToleranceArguments,
    /// Edge of the blocks of --block-relmse, pixels.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=4096))]
    block: u32,
    /// A pixel counts as failing where a channel differs by more than this, linear radiance.
    #[arg(long, default_value_t = 1e-3, value_parser = limit)]
    pixel_threshold: f64,
    /// End of the scale of the relative difference map; without it, the map covers 95 % of the lit pixels.
    #[arg(long, requires = "output", value_parser = limit)]
    range: Option<f64>,
    #[command(flatten)]
    statistics: StatisticsArguments,
    #[command(flatten)]
    display: DisplayArguments,
}

/// When replicas are judged by statistics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum WhenStatistics {
    /// Where both sides have several files.
    Auto,
    /// Always: anything else than replicas of both sides is an error.
    On,
    /// Never: replicas are averaged only.
    Off,
}

/// Replicas as random variables.
#[derive(clap::Args)]
#[command(next_help_heading = "Statistics of replicas")]
struct StatisticsArguments {
    /// Whether replicas are judged by statistics.
    #[arg(long, value_enum, default_value = "auto", value_name = "WHEN")]
    statistics: WhenStatistics,
    /// Take one file per side, at N times the resolution per axis, as N x N replicas in pairs: the images at each
    /// position of the N x N pixels of a cell.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=64))]
    pixels_as_replicas: Option<u32>,
    /// Share of the reference that a difference may have besides noise, an error that all its seeds share: 0 for
    /// none. Without it, Cycles' measured budget: 0.002 from 1024 samples on, 0.005 from 256, 0.01 from 64.
    #[arg(long, value_name = "SHARE", value_parser = limit)]
    systematic_allowance: Option<f64>,
    /// Level of every family of tests.
    #[arg(long, value_name = "LEVEL", default_value_t = StatisticsSettings::default().significance, value_parser = level)]
    significance: f64,
    /// Largest relMSE without noise: 0.001 for quick references, 0.0001 for converged ones.
    #[arg(long, value_name = "ERROR", default_value_t = StatisticsSettings::default().debiased_relmse, value_parser = limit)]
    debiased_relmse: f64,
}

/// Largest values that still agree.
#[derive(clap::Args)]
#[command(next_help_heading = "Tolerances")]
struct ToleranceArguments {
    /// Relative difference of the mean of the worst channel.
    #[arg(long, value_name = "SHARE", value_parser = limit)]
    channel_mean: Option<f64>,
    /// relMSE of block means.
    #[arg(long, value_name = "ERROR", value_parser = limit)]
    block_relmse: Option<f64>,
    /// relMSE of pixels.
    #[arg(long, value_name = "ERROR", value_parser = limit)]
    pixel_relmse: Option<f64>,
    /// Largest absolute difference of a colour value, linear radiance.
    #[arg(long, value_name = "RADIANCE", value_parser = limit)]
    max_error: Option<f64>,
    /// Share of failing pixels, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = limit)]
    failing_share: Option<f64>,
    /// Largest absolute difference of alpha.
    #[arg(long, value_name = "ALPHA", value_parser = limit)]
    alpha_max_error: Option<f64>,
    /// Mean HDR-FLIP error, 0 to 1.
    #[arg(long, value_name = "FLIP", value_parser = limit)]
    flip_mean: Option<f64>,
}

/// How ours.png and reference.png in --output are made.
#[derive(clap::Args)]
#[command(next_help_heading = "Display pictures, with --output")]
struct DisplayArguments {
    /// View transform: AgX, Standard, Filmic, Khronos PBR Neutral or Raw.
    #[arg(long, requires = "output", default_value = "AgX", value_name = "NAME")]
    view: String,
    /// Look.
    #[arg(long, requires = "output", default_value = "None", value_name = "NAME")]
    look: String,
    /// Stops.
    #[arg(long, requires = "output", default_value_t = 0.0, allow_negative_numbers = true, value_name = "STOPS")]
    exposure: f64,
    /// The display value is raised to 1 / gamma.
    #[arg(long, requires = "output", default_value_t = 1.0)]
    gamma: f64,
    /// Linear radiance behind a transparent film; without it the pictures stay transparent.
    #[arg(long, requires = "output", value_name = "R,G,B", value_parser = colour)]
    background: Option<[f64; 3]>,
}

/// A tolerance: a number of at least 0.
fn limit(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite() && *value >= 0.0).ok_or("expected a number >= 0".into())
}

/// A level of significance: over 0, at most 0.5.
fn level(text: &str) -> std::result::Result<f64, String> {
    limit(text)?;
    text.parse().ok().filter(|value| (1e-12..=0.5).contains(value)).ok_or("expected a number from 1e-12 to 0.5".into())
}

/// Three values joined by commas.
pub(super) fn colour(text: &str) -> std::result::Result<[f64; 3], String> {
    let values: std::result::Result<Vec<f64>, String> = text.split(',').map(|part| limit(part.trim())).collect();
    values?.try_into().map_err(|_| "expected three numbers joined by commas".into())
}

impl Arguments {
    fn request(&self) -> DiffRequest {
        let DisplayArguments { view, look, exposure, gamma, background } = &self.display;
        DiffRequest {
            ours: self.ours.clone(),
            reference: self.reference.clone(),
            part: self.part.clone(),
            ours_part: self.ours_part.clone(),
            reference_part: self.reference_part.clone(),
            integers: self.integers,
            block: self.block,
            pixel_threshold: self.pixel_threshold,
            tolerances: Tolerances {
                channel_mean_relative: self.tolerances.channel_mean,
                block_relmse: self.tolerances.block_relmse,
                pixel_relmse: self.tolerances.pixel_relmse,
                max_error: self.tolerances.max_error,
                failing_share: self.tolerances.failing_share,
                alpha_max_error: self.tolerances.alpha_max_error,
                flip_mean: self.tolerances.flip_mean,
            },
            out: self.output.clone(),
            display: self.output.as_ref().map(|_| DisplaySettings {
                view: view.clone(),
                look: look.clone(),
                exposure: *exposure,
                gamma: *gamma,
                background: *background,
            }),
            range: self.range,
            statistics: self.statistics(),
        }
    }

    /// The statistical verdict, where it is wanted.
    fn statistics(&self) -> Option<StatisticsSettings> {
        let StatisticsArguments {
            statistics,
            pixels_as_replicas: sub_pixels,
            systematic_allowance,
            significance,
            debiased_relmse,
        } = self.statistics;
        let has_replicas = sub_pixels.is_some() || (self.ours.len() > 1 && self.reference.len() > 1);
        let is_wanted = match statistics {
            WhenStatistics::Auto => has_replicas || systematic_allowance.is_some(),
            WhenStatistics::On => true,
            WhenStatistics::Off => false,
        };
        is_wanted.then_some(StatisticsSettings { significance, systematic_allowance, debiased_relmse, sub_pixels })
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let bar = super::progress_bar(1000);
    let result = arguments
        .request()
        .run(|script, request| bridge::run_script(script, request, CyclesKernel::Default, super::report_to(&bar)))?;
    bar.finish_and_clear();
    let text = if arguments.json {
        let text = serde_json::to_string_pretty(&result).map_err(|cause| {
            Error::new("comparison", cause.to_string(), "finite figures", "Report it with the two pictures.")
        })?;
        text + "\n"
    } else if arguments.verbose {
        describe(&result)
    } else {
        answer(&result)
    };
    super::print(&text)?;
    if let (Some(folder), false) = (&arguments.output, arguments.json) {
        super::print(&format!("{}: figures and pictures\n", folder.display()))?;
    }
    Ok(ExitCode::from(result.verdict.exit_status()))
}

/// The short answer: the verdict with its reasons, and the figures that one looks at first.
fn answer(result: &DiffResult) -> String {
    let mut lines = vec![result.verdict.words().to_owned()];
    lines.extend(result.reasons.iter().map(|reason| format!("  {reason}")));
    let unmet =
        result.checks.iter().filter(|check| check.outcome != result.verdict && check.outcome != Verdict::Agrees);
    lines.extend(unmet.map(|check| format!("  {}: {}", check.outcome.words(), check.reason)));
    lines.extend(result.notes.iter().map(|note| format!("  note: {note}")));
    let means: Vec<String> = result
        .channels
        .iter()
        .flatten()
        .map(|channel| {
            let error = channel.standard_error_relative.map(|error| format!(" +- {}", percent(Some(error))));
            format!("{} {}{}", channel.channel, signed_percent(channel.relative_difference), error.unwrap_or_default())
        })
        .collect();
    if !means.is_empty() {
        lines.push(format!("  ours against the reference, means: {}", means.join(", ")));
    }
    let mut errors = Vec::new();
    if let Some(relmse) = &result.relmse {
        let (value, what) = match relmse.debiased_block {
            Some(value) => (value, "relMSE of block means without noise"),
            None => (relmse.block.unwrap_or(f64::NAN), "relMSE of block means"),
        };
        errors.push(format!("{what} {}", figure(Some(value))));
    }
    if let Some(flip) = &result.flip {
        errors.push(format!("HDR-FLIP {}", figure(flip.mean)));
    }
    if !errors.is_empty() {
        lines.push(format!("  {}", errors.join(", ")));
    }
    if !result.checks.is_empty() {
        let agree = result.checks.iter().filter(|check| check.outcome == Verdict::Agrees).count();
        lines
            .push(format!("  {agree} of {} checks agree; --verbose shows them with every figure", result.checks.len()));
    }
    lines.join("\n") + "\n"
}

/// The result as text: the verdict and its reasons first, then every figure.
fn describe(result: &DiffResult) -> String {
    let mut text = String::new();
    let mut line = |parts: std::fmt::Arguments<'_>| {
        writeln!(text, "{parts}").expect("writing to a string cannot fail");
    };
    line(format_args!("{}", result.verdict.words()));
    for reason in &result.reasons {
        line(format_args!("  {reason}"));
    }
    // The statistics list every check below.
    let is_listed_below = result.statistics.is_some();
    for check in result.checks.iter().filter(|check| !is_listed_below && check.outcome != result.verdict) {
        line(format_args!("  {}: {}", check.outcome.words(), check.reason));
    }
    for note in &result.notes {
        line(format_args!("  note: {note}"));
    }
    if let Some(images) = &result.images {
        line(format_args!(
            "{} x {} pixels, {} of ours, {} of the reference",
            images.width, images.height, images.ours.replicas, images.reference.replicas
        ));
    }
    for (name, figures) in [("colour", &result.colour), ("alpha", &result.alpha)] {
        if let Some(figures) = figures {
            line(format_args!("{name}: {}", describe_figures(figures)));
        }
    }
    for channel in result.channels.iter().flatten() {
        line(format_args!(
            "mean of {}: ours {}, reference {}, difference {}, standard error {}",
            channel.channel,
            figure(Some(channel.ours)),
            figure(Some(channel.reference)),
            signed_percent(channel.relative_difference),
            signed_percent(channel.standard_error_relative).trim_start_matches('+')
        ));
    }
    if let Some(relmse) = &result.relmse {
        line(format_args!(
            "relMSE: block means {}, without noise {}, pixels {}",
            figure(relmse.block),
            figure(relmse.debiased_block),
            figure(relmse.pixel)
        ));
    }
    if let Some(flip) = &result.flip {
        line(format_args!("HDR-FLIP mean: {}", figure(flip.mean)));
    }
    if let Some(statistics) = &result.statistics {
        text.push_str(&describe_statistics(statistics, &result.checks));
    }
    text
}

/// The statistical verdict as text: every check, bias and noise by channel, and the formulas.
fn describe_statistics(statistics: &Statistics, checks: &[Check]) -> String {
    let mut lines = vec![format!(
        "statistics: {} of ours, {} of the reference, {}, level {}, systematic allowance {} ({})",
        statistics.replicas.ours,
        statistics.replicas.reference,
        statistics.design.words(),
        figure(Some(statistics.significance)),
        percent(Some(statistics.systematic_allowance)),
        statistics.allowance_rule
    )];
    lines.extend(checks.iter().map(|check| format!("  {}: {}: {}", check.outcome.words(), check.name, check.reason)));
    for row in &statistics.means {
        lines.push(format!(
            "  bias of {}: {} ({} to {}), t {} with {} degrees of freedom; noise variance of a pixel: ours {}, \
             reference {}",
            row.channel,
            signed_percent(row.relative_bias),
            signed_percent(row.relative_low),
            signed_percent(row.relative_high),
            figure(Some(row.t)),
            figure(Some(row.degrees)),
            figure(Some(row.noise_variance_ours)),
            figure(Some(row.noise_variance_reference))
        ));
    }
    let relmse = &statistics.relmse;
    lines.push(format!(
        "  relMSE: {} of which noise {}; without noise {}, standard error {}; by halves {}; epsilon {}",
        figure(relmse.plain),
        figure(relmse.noise),
        figure(relmse.debiased),
        figure(relmse.standard_error),
        figure(relmse.debiased_halves),
        figure(Some(relmse.epsilon))
    ));
    for row in &statistics.structure {
        lines.push(format!(
            "  t of {}: mean {}, correlation of neighbours {} ({} standard errors)",
            row.channel,
            figure(Some(row.mean_t)),
            figure(row.neighbour_correlation),
            figure(row.neighbour_z)
        ));
    }
    for row in &statistics.tails {
        lines.push(format!(
            "  kurtosis of {}: {}, of normal noise {}",
            row.of,
            figure(Some(row.kurtosis)),
            figure(Some(row.kurtosis_of_normal_noise))
        ));
    }
    lines.extend(statistics.formulas.iter().map(|(name, formula)| format!("  {}: {formula}", name.replace('_', " "))));
    lines.join("\n") + "\n"
}

fn describe_figures(figures: &ImageFigures) -> String {
    let mut text = format!(
        "mean error {}, RMS {}, {} of {} pixels over {}, maximum {}",
        figure(Some(figures.mean_error)),
        figure(Some(figures.rms_error)),
        figures.failing_pixels,
        figures.pixels,
        figure(Some(figures.threshold)),
        figure(Some(figures.max_error))
    );
    if let Some(place) = &figures.max_at {
        let (ours, reference) = (figure(Some(place.ours)), figure(Some(place.reference)));
        write!(text, " at {}, {} in {}: ours {ours}, reference {reference}", place.x, place.y, place.channel)
            .expect("writing to a string cannot fail");
    }
    text
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

    fn parse(words: &str) -> std::result::Result<DiffRequest, clap::Error> {
        Line::try_parse_from(words.split(' ')).map(|line| line.arguments.request())
    }

    #[test]
    fn replicas_tolerances_and_display_reach_the_request() {
        let words = "diff --ours a.exr --reference b.exr c.exr --channel-mean 0.01 -o run --view AgX \
                     --exposure -1.5 --background 0,0.5,1";
        let request = parse(words).expect("a complete line");
        assert_eq!((request.ours.len(), request.reference.len()), (1, 2));
        assert_eq!(request.tolerances, Tolerances { channel_mean_relative: Some(0.01), ..Tolerances::default() });
        let display = request.display.expect("--view asks for pictures");
        assert_eq!((display.view.as_str(), display.exposure), ("AgX", -1.5));
        assert_eq!(display.background, Some([0.0, 0.5, 1.0]));
    }

    #[test]
    fn replicas_of_both_sides_are_judged_by_statistics() {
        let statistics = |words: &str| parse(words).expect("a complete line").statistics;
        assert!(statistics("diff --ours a b --reference c").is_none());
        assert_eq!(statistics("diff --ours a b --reference c d"), Some(StatisticsSettings::default()));
        assert!(statistics("diff --ours a b --reference c d --statistics off").is_none());
        // The script refuses what are no replicas; what was asked for is not left out silently.
        assert!(statistics("diff --ours a --reference c --statistics on").is_some());
        let asked = statistics("diff --ours a --reference c --pixels-as-replicas 4 --systematic-allowance 0").unwrap();
        assert_eq!((asked.sub_pixels, asked.systematic_allowance), (Some(4), Some(0.0)));
        for wrong in ["--pixels-as-replicas 1", "--significance 0", "--significance 0.6", "--debiased-relmse -1"] {
            assert!(parse(&format!("diff --ours a --reference c {wrong}")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn nothing_is_judged_unless_named_and_bad_limits_are_refused() {
        let request = parse("diff --ours a.exr --reference b.exr").expect("tolerances are optional");
        assert_eq!(request.tolerances, Tolerances::default());
        assert!(request.display.is_none());
        for more in ["--flip-mean -1", "--flip-mean nan", "--view AgX", "--block 0", "--background 1,2"] {
            assert!(parse(&format!("diff --ours a.exr --reference b.exr {more}")).is_err(), "{more}");
        }
        assert!(parse("diff --ours a.exr").is_err());
    }
}
