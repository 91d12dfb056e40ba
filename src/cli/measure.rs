//! `cloudparity measure`: experiments.

use super::{
    attribution, bench, bench_bake, bench_compile, bench_nodes, bench_quick, bench_voxels, bounds, compare_models,
    convergence, demo, drift, findings, growth, modes, parity, probe, sequence, stability, study, time_to_error, tune,
    variance,
};
use crate::base::error::Result;
use std::process::ExitCode;

/// Measure: error against time, fits, parity with Cycles, bounds, stability, speed.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Study(study::Arguments),
    Attribution(attribution::Arguments),
    Recommend(study::RecommendArguments),
    Sequence(sequence::Arguments),
    Tune(tune::Arguments),
    CompareModels(Box<compare_models::Arguments>),
    Probe(probe::Arguments),
    Parity(parity::Arguments),
    Modes(modes::Arguments),
    Drift(drift::Arguments),
    Findings(findings::Arguments),
    Bounds(bounds::Arguments),
    Stability(stability::Arguments),
    Convergence(Box<convergence::Arguments>),
    TimeToError(time_to_error::Arguments),
    Bench(bench::Arguments),
    BenchBake(bench_bake::Arguments),
    BenchCompile(bench_compile::Arguments),
    BenchNodes(bench_nodes::Arguments),
    BenchQuick(bench_quick::Arguments),
    BenchVoxels(Box<bench_voxels::Arguments>),
    Growth(growth::Arguments),
    Variance(variance::Arguments),
    Demo(demo::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.what {
        What::Study(arguments) => study::run(arguments),
        What::Attribution(arguments) => attribution::run(arguments),
        What::Recommend(arguments) => study::recommend(arguments),
        What::Sequence(arguments) => sequence::run(arguments),
        What::Tune(arguments) => tune::run(arguments),
        What::CompareModels(arguments) => compare_models::run(arguments),
        What::Probe(arguments) => probe::run(arguments),
        What::Parity(arguments) => parity::run(arguments),
        What::Modes(arguments) => modes::run(arguments),
        What::Drift(arguments) => drift::run(arguments),
        What::Findings(arguments) => findings::run(arguments),
        What::Bounds(arguments) => bounds::run(arguments),
        What::Stability(arguments) => stability::run(arguments),
        What::Convergence(arguments) => convergence::run(arguments),
        What::TimeToError(arguments) => time_to_error::run(arguments),
        What::Bench(arguments) => bench::run(arguments),
        What::BenchBake(arguments) => bench_bake::run(arguments),
        What::BenchCompile(arguments) => bench_compile::run(arguments),
        What::BenchNodes(arguments) => bench_nodes::run(arguments),
        What::BenchQuick(arguments) => bench_quick::run(arguments),
        What::BenchVoxels(arguments) => bench_voxels::run(arguments),
        What::Growth(arguments) => growth::run(arguments),
        What::Variance(arguments) => variance::run(arguments),
        What::Demo(arguments) => demo::run(arguments),
    }
}
