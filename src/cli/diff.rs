//! `cloudparity diff`: two pictures, or two sets of replicas, compared with stated tolerances.

use crate::blender::{self, Kernel};
use crate::compare::{DiffRequest, DiffResult, DisplaySettings, ImageFigures, Tolerances};
use crate::error::{Error, Result};
use crate::report::numbers::{figure, signed_percent};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare scene-linear EXR pictures: exit status 0 agrees, 1 differs, 2 could not tell.
///
/// Several files on a side are replicas, the same picture with other seeds; they are averaged and give standard
/// errors. Only tolerances that are named are judged; without any the figures are printed and the status is 2.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Our EXR files.
    #[arg(long, required = true, num_args = 1.., value_name = "EXR")]
    ours: Vec<PathBuf>,
    /// The reference's EXR files.
    #[arg(long, required = true, num_args = 1.., value_name = "EXR")]
    reference: Vec<PathBuf>,
    /// Part (render pass) to compare in files with several.
    #[arg(long)]
    part: Option<String>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Folder for diff.json and the pictures of the difference.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    tolerances: ToleranceArguments,
    /// Edge of the blocks of --block-relmse, pixels.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=4096))]
    block: u32,
    /// A pixel counts as failing where a channel differs by more than this, linear radiance.
    #[arg(long, default_value_t = 1e-3, value_parser = limit)]
    pixel_threshold: f64,
    /// End of the scale of the relative difference map; without it, the map covers 95 % of the lit pixels.
    #[arg(long, requires = "out", value_parser = limit)]
    range: Option<f64>,
    #[command(flatten)]
    display: DisplayArguments,
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

/// How ours.png and reference.png in --out are made.
#[derive(clap::Args)]
#[command(next_help_heading = "Display pictures, with --out")]
struct DisplayArguments {
    /// View transform: AgX, Standard, Filmic, Khronos PBR Neutral or Raw.
    #[arg(long, requires = "out")]
    view: Option<String>,
    /// Look.
    #[arg(long, requires = "view", default_value = "None")]
    look: String,
    /// Stops.
    #[arg(long, requires = "view", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f64,
    /// The display value is raised to 1 / gamma.
    #[arg(long, requires = "view", default_value_t = 1.0)]
    gamma: f64,
    /// Linear radiance behind a transparent film; without it the pictures stay transparent.
    #[arg(long, requires = "view", value_name = "R,G,B", value_parser = colour)]
    background: Option<[f64; 3]>,
}

/// A tolerance: a number of at least 0.
fn limit(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite() && *value >= 0.0).ok_or("expected a number >= 0".into())
}

fn colour(text: &str) -> std::result::Result<[f64; 3], String> {
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
            out: self.out.clone(),
            display: view.clone().map(|view| DisplaySettings {
                view,
                look: look.clone(),
                exposure: *exposure,
                gamma: *gamma,
                background: *background,
            }),
            range: self.range,
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let bar = super::progress_bar(1000);
    let result = arguments
        .request()
        .run(|script, request| blender::run_script(script, request, Kernel::Default, blender::report_to(&bar)))?;
    bar.finish_and_clear();
    let text = if arguments.json {
        let text = serde_json::to_string_pretty(&result).map_err(|cause| {
            Error::new("comparison", cause.to_string(), "finite figures", "Report it with the two pictures.")
        })?;
        text + "\n"
    } else {
        describe(&result)
    };
    super::print(&text)?;
    Ok(ExitCode::from(result.verdict.exit_status()))
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
    for check in result.checks.iter().filter(|check| check.outcome != result.verdict) {
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
    text
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
        let words = "diff --ours a.exr --reference b.exr c.exr --channel-mean 0.01 --out run --view AgX \
                     --exposure -1.5 --background 0,0.5,1";
        let request = parse(words).expect("a complete line");
        assert_eq!((request.ours.len(), request.reference.len()), (1, 2));
        assert_eq!(request.tolerances, Tolerances { channel_mean_relative: Some(0.01), ..Tolerances::default() });
        let display = request.display.expect("--view asks for pictures");
        assert_eq!((display.view.as_str(), display.exposure), ("AgX", -1.5));
        assert_eq!(display.background, Some([0.0, 0.5, 1.0]));
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
