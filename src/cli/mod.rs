//! The commands, one file each: read arguments, call the library, print.
//!
//! Data goes to stdout, progress and warnings to stderr. Exit status 0: done, or both sides agree;
//! 1: they differ; 2: the command could not do its work.

mod bench;
mod bench_bake;
mod bench_compile;
mod bench_nodes;
mod bench_voxels;
mod bounds;
mod build;
mod choice;
mod compare_models;
mod convergence;
mod demo;
pub mod demonstration;
mod diff;
mod display;
mod doctor;
mod engine;
mod eval;
pub(crate) mod explain;
mod export;
mod first_files;
mod grid;
mod init;
mod lights;
mod march;
mod models;
mod modes;
mod nodes;
mod notices;
mod options;
mod params;
mod parity;
mod picture;
mod probe;
mod reference;
mod render;
mod report;
mod resume;
mod schema;
mod shader;
mod stability;
mod study;
mod time_to_error;
mod tune;

use crate::base::error::Result;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::io::IsTerminal;
use std::process::ExitCode;

/// Blender-parity research harness for procedural volumes.
#[derive(Parser)]
#[command(version, about)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bench(bench::Arguments),
    BenchBake(bench_bake::Arguments),
    BenchCompile(bench_compile::Arguments),
    BenchNodes(bench_nodes::Arguments),
    BenchVoxels(Box<bench_voxels::Arguments>),
    Bounds(bounds::Arguments),
    Build(build::Arguments),
    CompareModels(Box<compare_models::Arguments>),
    Convergence(Box<convergence::Arguments>),
    Demo(demo::Arguments),
    Diff(Box<diff::Arguments>),
    Display(display::Arguments),
    Doctor(doctor::Arguments),
    Engine(Box<engine::Arguments>),
    Eval(eval::Arguments),
    Explain(explain::Arguments),
    Export(export::Arguments),
    Grid(grid::Arguments),
    Init(init::Arguments),
    Lights(lights::Arguments),
    Models(models::Arguments),
    Modes(modes::Arguments),
    Nodes(nodes::Arguments),
    Params(params::Arguments),
    Parity(parity::Arguments),
    Probe(probe::Arguments),
    Recommend(study::RecommendArguments),
    Reference(reference::Arguments),
    Render(Box<render::Arguments>),
    Report(report::Arguments),
    Schema(schema::Arguments),
    Shader(shader::Arguments),
    Stability(stability::Arguments),
    Study(study::Arguments),
    TimeToError(time_to_error::Arguments),
    Tune(tune::Arguments),
}

/// Exit status of a command that could not do its work.
const COULD_NOT: u8 = 2;

/// Runs the program.
pub fn run() -> ExitCode {
    crate::bridge::install();
    notices::install();
    let mut all = CommandLine::command();
    let matches = all.get_matches_mut();
    let command_line = match CommandLine::from_arg_matches(&matches) {
        Ok(command_line) => command_line,
        Err(error) => error.format(&mut all).exit(),
    };
    let result = match command_line.command {
        Command::Bench(arguments) => bench::run(&arguments),
        Command::BenchBake(arguments) => bench_bake::run(&arguments),
        Command::BenchCompile(arguments) => bench_compile::run(&arguments),
        Command::BenchNodes(arguments) => bench_nodes::run(&arguments),
        Command::BenchVoxels(arguments) => bench_voxels::run(&arguments),
        Command::Bounds(arguments) => bounds::run(&arguments),
        Command::Build(arguments) => build::run(&arguments),
        Command::CompareModels(arguments) => compare_models::run(&arguments),
        Command::Convergence(arguments) => convergence::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Display(arguments) => display::run(&arguments),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Engine(arguments) => engine::run(&arguments),
        Command::Eval(arguments) => eval::run(&arguments),
        Command::Explain(arguments) => explain::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Grid(arguments) => grid::run(&arguments),
        Command::Init(arguments) => init::run(&arguments),
        Command::Lights(arguments) => lights::run(&arguments),
        Command::Models(arguments) => models::run(&arguments),
        Command::Modes(arguments) => modes::run(&arguments),
        Command::Nodes(arguments) => nodes::run(&arguments),
        Command::Params(arguments) => params::run(&arguments),
        Command::Parity(arguments) => parity::run(&arguments),
        Command::Probe(arguments) => probe::run(&arguments),
        Command::Recommend(arguments) => study::recommend(&arguments),
        Command::Reference(arguments) => reference::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Schema(arguments) => schema::run(&arguments),
        Command::Shader(arguments) => shader::run(&arguments),
        Command::Stability(arguments) => stability::run(&arguments),
        Command::Study(arguments) => study::run(&arguments),
        Command::TimeToError(arguments) => time_to_error::run(&arguments),
        Command::Tune(arguments) => tune::run(&arguments),
    };
    result.unwrap_or_else(|error| {
        let command = matches.subcommand_name().and_then(|name| all.find_subcommand(name));
        eprintln!("error: {}", options::message(&error, command));
        ExitCode::from(COULD_NOT)
    })
}

/// A bar on stderr with an estimate of the time left; hidden where stderr is no terminal. Warnings are printed above it.
pub(crate) fn progress_bar(length: u64) -> indicatif::ProgressBar {
    if !std::io::stderr().is_terminal() {
        return indicatif::ProgressBar::hidden();
    }
    let style = indicatif::ProgressStyle::with_template("{wide_bar} {percent:>3}% {eta:>6} {msg}")
        .expect("the template is well formed");
    let bar = indicatif::ProgressBar::new(length).with_style(style);
    notices::print_above(&bar);
    bar
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
