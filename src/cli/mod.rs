//! The commands, one file each: read arguments, call the library, print.
//!
//! Data goes to stdout, progress and warnings to stderr. Exit status 0: done, or both sides agree;
//! 1: they differ; 2: the command could not do its work.

mod attribution;
mod bench;
mod bench_bake;
mod bench_compile;
mod bench_nodes;
mod bench_quick;
mod bench_voxels;
mod bounds;
mod build;
mod choice;
mod compare_models;
mod completions;
mod convergence;
mod cycles;
mod demo;
pub mod demonstration;
mod diff;
mod display;
mod doctor;
mod drift;
mod engine;
mod eval;
pub(crate) mod explain;
mod export;
mod findings;
mod first_files;
mod grid;
mod growth;
mod init;
mod lights;
mod man;
mod march;
mod measure;
mod models;
mod modes;
mod nodes;
mod notices;
mod options;
mod params;
mod parity;
mod passes;
mod picture;
mod probe;
mod publish;
mod render;
mod report;
mod resume;
mod schema;
mod sequence;
mod shader;
mod show;
mod stability;
mod study;
mod time_to_error;
mod tune;
#[cfg(feature = "viewer")]
mod variance;
mod view;
#[cfg(test)]
mod vocabulary;

use crate::base::error::Result;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::io::IsTerminal;
use std::process::ExitCode;

/// Blender's volume materials, exact and fast: values, pictures, error and time.
#[derive(Parser)]
#[command(version)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Init(init::Arguments),
    Export(Box<export::Arguments>),
    Show(show::Arguments),
    #[cfg(feature = "viewer")]
    View(Box<view::Arguments>),
    Render(Box<render::Arguments>),
    Diff(Box<diff::Arguments>),
    Report(report::Arguments),
    Measure(Box<measure::Arguments>),
    Eval(eval::Arguments),
    Publish(Box<publish::Arguments>),
    Shader(shader::Arguments),
    Grid(grid::Arguments),
}

/// The commands by what one wants to do, as the help shows them: each in a line of a terminal of 80 columns.
const TASKS: [(&str, &[(&str, &str)]); 4] = [
    (
        "A cloud of your own",
        &[
            ("init", "begin with a .blend: its scene, a study, a tuning, what to do next"),
            ("export", "convert: .blend to scene file and back, EXR to PNG"),
            ("show", "what a scene evaluates, parameters, nodes, models, this machine"),
        ],
    ),
    (
        "Pictures",
        &[
            #[cfg(feature = "viewer")]
            ("view", "a window: turn a scene beside the truth, error against time"),
            ("render", "render a scene: march, path, engine, or Cycles"),
            ("diff", "compare pictures, by tolerances or by statistics"),
            ("report", "one page of what a folder of results holds"),
            ("publish", "shaders and a WebGPU page that run elsewhere, with their error"),
        ],
    ),
    (
        "Values of the field",
        &[
            ("eval", "density, or any inner output, at points"),
            ("shader", "the density as WGSL, SPIR-V, GLSL, HLSL or MSL"),
            ("grid", "the density as an OpenVDB grid"),
        ],
    ),
    ("Experiments", &[("measure", "study, tune, recommend, parity, bounds, stability, speed ...")]),
];

/// Commands whose subcommands may be called without them.
const GROUPS: [&str; 2] = ["show", "measure"];

/// The command line with its help.
fn command_line() -> clap::Command {
    let mut all = CommandLine::command();
    let text = overview(&all);
    all = all.help_template("{about}\n\n{usage-heading} {usage}{after-help}").after_help(text);
    for group in GROUPS {
        all = all.mut_subcommand(group, |group| {
            let note =
                format!("A subcommand may be called without {}: cloudparity {}", group.get_name(), example_of(&group));
            group.after_help(note).disable_help_subcommand(true)
        });
    }
    all.disable_help_subcommand(true)
}

/// What of the command line takes a path: names of commands with their group, and the option
/// (`--output`) or argument (`<SCENE>`). Tests compare it with the list of what they try.
pub fn path_options() -> Vec<(String, String)> {
    fn collect(command: &clap::Command, name: &str, found: &mut Vec<(String, String)>) {
        for argument in command.get_arguments() {
            if argument.get_value_parser().type_id() == std::any::TypeId::of::<std::path::PathBuf>() {
                let shown = match argument.get_long() {
                    Some(long) => format!("--{long}"),
                    None => format!("<{}>", argument.get_id().as_str().to_uppercase()),
                };
                found.push((name.to_owned(), shown));
            }
        }
        for below in command.get_subcommands() {
            collect(below, format!("{name} {}", below.get_name()).trim_start(), found);
        }
    }
    let mut found = Vec::new();
    collect(&command_line(), "", &mut found);
    found
}

/// A subcommand's example, as it stands in its help, without the program's and the group's names.
fn example_of(group: &clap::Command) -> String {
    let of = |command: &clap::Command| {
        let text = command.get_after_help()?.to_string();
        let line = text.lines().find_map(|line| line.trim().strip_prefix("cloudparity "))?.to_owned();
        Some(line)
    };
    group.get_subcommands().find_map(of).unwrap_or_default()
}

/// All commands in the order of tasks, one line each.
fn overview(all: &clap::Command) -> clap::builder::StyledStr {
    use std::fmt::Write;
    let styles = all.get_styles();
    let (header, literal) = (styles.get_header(), styles.get_literal());
    let mut text = clap::builder::StyledStr::new();
    for (task, names) in TASKS {
        writeln!(text, "{header}{task}:{header:#}").expect("writing to a string cannot fail");
        for (name, what) in names {
            writeln!(text, "  {literal}{name:<8}{literal:#} {what}").expect("writing to a string cannot fail");
        }
    }
    write!(text, "Begin with: cloudparity init CLOUD.blend. COMMAND --help says more.")
        .expect("writing to a string cannot fail");
    text
}

/// The words of the command line, with the name of its group before a subcommand that is called without it.
fn with_group(all: &clap::Command, mut words: Vec<OsString>) -> Vec<OsString> {
    let Some(first) = words.get(1).and_then(|word| word.to_str()) else { return words };
    if all.find_subcommand(first).is_some() {
        return words;
    }
    let has_it = |group: &str| all.find_subcommand(group).is_some_and(|group| group.find_subcommand(first).is_some());
    if let Some(group) = GROUPS.into_iter().find(|group| has_it(group)) {
        words.insert(1, OsString::from(group));
    }
    words
}

/// Exit status of a command that could not do its work.
const COULD_NOT: u8 = 2;

/// Runs the program.
pub fn run() -> ExitCode {
    crate::bridge::install();
    notices::install();
    let mut all = command_line();
    let words = with_group(&all, std::env::args_os().collect());
    let matches = all.try_get_matches_from_mut(words).unwrap_or_else(|error| error.exit());
    let command_line = match CommandLine::from_arg_matches(&matches) {
        Ok(command_line) => command_line,
        Err(error) => error.format(&mut all).exit(),
    };
    let result = match command_line.command {
        Command::Init(arguments) => init::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Show(arguments) => show::run(&arguments),
        #[cfg(feature = "viewer")]
        Command::View(arguments) => view::run(*arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Measure(arguments) => measure::run(&arguments),
        Command::Eval(arguments) => eval::run(&arguments),
        Command::Publish(arguments) => publish::run(&arguments),
        Command::Shader(arguments) => shader::run(&arguments),
        Command::Grid(arguments) => grid::run(&arguments),
    };
    result.unwrap_or_else(|error| {
        let mut command = &all;
        let mut matched = &matches;
        while let Some((name, below)) = matched.subcommand() {
            command = command.find_subcommand(name).expect("a command that was matched");
            matched = below;
        }
        eprintln!("error: {}", options::message(&error, Some(command)));
        ExitCode::from(COULD_NOT)
    })
}

/// A bar on stderr that moves while it waits, with the time that passed and an estimate of what is left; hidden where stderr is no terminal. Warnings are printed above it.
pub(crate) fn progress_bar(length: u64) -> indicatif::ProgressBar {
    if !std::io::stderr().is_terminal() {
        return indicatif::ProgressBar::hidden();
    }
    let style = indicatif::ProgressStyle::with_template(
        "{spinner} {wide_bar} {percent:>3}% {elapsed:>4}, {eta:>4} left  {msg}",
    )
    .expect("the template is well formed");
    let bar = indicatif::ProgressBar::new(length).with_style(style);
    // Cycles says nothing for minutes while it looks at a volume: the time still passes.
    bar.enable_steady_tick(std::time::Duration::from_millis(250));
    notices::print_above(&bar);
    bar
}

/// Shows the progress of a computation.
pub(crate) fn progress_on(bar: &indicatif::ProgressBar) -> impl Fn(f64, &str) + '_ {
    |done, what| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    }
}

/// Shows a script's progress.
pub(crate) fn report_to(bar: &indicatif::ProgressBar) -> impl FnMut(crate::bridge::Message) + '_ {
    bar.set_length(1000);
    move |message| {
        bar.set_position((message.done * 1000.0) as u64);
        bar.set_message(message.what);
    }
}

/// An error where live Cycles cannot be asked; `what` "are" or "is" compared with it.
pub(crate) fn need_bpy(what: &str) -> Result<()> {
    if crate::bridge::has_bpy() {
        return Ok(());
    }
    Err(crate::base::error::Error::new(
        format!("interpreter {}", crate::bridge::interpreter().display()),
        "no module bpy",
        format!("Blender as a Python module: live Cycles is what {what} compared with"),
        "Run make setup.",
    ))
}

/// `R.exr` and `variance` make `R.variance.exr`.
pub(crate) fn beside(output: &std::path::Path, what: &str) -> std::path::PathBuf {
    let extension = output.extension().map_or("exr".into(), |extension| extension.to_string_lossy().into_owned());
    output.with_extension(format!("{what}.{extension}"))
}

/// As a shell reads it.
pub(crate) fn quoted(path: &std::path::Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "-_./+:,@%".contains(c);
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// Prints to stdout; a reader that closed the pipe early is no error.
pub(crate) fn print(text: &str) -> Result<()> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(cause) if cause.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(crate::base::error::Error::io(std::path::Path::new("stdout"), "a place to print to", &cause))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::beside;
    use std::path::Path;

    #[test]
    fn files_of_replicas_lie_beside_their_mean() {
        assert_eq!(beside(Path::new("a/R.exr"), "seed-5000"), Path::new("a/R.seed-5000.exr"));
        assert_eq!(beside(Path::new("R"), "variance"), Path::new("R.variance.exr"));
    }
}
