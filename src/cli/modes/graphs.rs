//! `cloudparity modes --graphs N`: random graphs of many nodes.

use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::Identity;
use crate::bridge::Message;
use crate::cli;
use crate::cli::modes::Arguments;
use crate::gpu::Gpu;
use crate::measure::nodes::random_graphs;
use crate::measure::nodes::random_graphs::{Cycles, GraphComparison, Judge, RandomGraph, WGSL_LIMIT};
use rayon::prelude::*;
use serde_json::{Value as Json, json};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Points per graph.
const POINTS: usize = 128;

/// Graphs that one Blender process evaluates.
const TOGETHER: u64 = 32;

/// Where failing graphs go when no folder is given.
const FOLDER: &str = "failed-graphs";

pub(super) fn run(arguments: &Arguments, count: u64) -> Result<ExitCode> {
    let gpu = if arguments.without_gpu { None } else { Some(Gpu::open()) };
    let opened = gpu.as_ref().and_then(|found| found.as_ref().ok());
    let judge = Judge { gpu: opened, compile: &random_graphs::compile };
    let folder = arguments.output.clone().unwrap_or_else(|| PathBuf::from(FOLDER));
    let adapter = opened.map(|gpu| format!("{} ({})", gpu.adapter().name, gpu.adapter().driver));
    let bar = cli::progress_bar(count);
    let mut outcomes: Vec<GraphComparison> = Vec::new();
    let mut done = 0;
    while done < count {
        let end = count.min(done + TOGETHER);
        let seeds: Vec<u64> = (done..end).map(|number| arguments.seed.wrapping_add(number)).collect();
        let mut graphs: Vec<RandomGraph> =
            seeds.par_iter().map(|&seed| random_graphs::generate(seed, POINTS)).collect::<Result<_>>()?;
        random_graphs::with_folded_textures(&mut graphs, |_: Message| bar.tick())?;
        let mut cycles = Cycles(|_: Message| bar.tick());
        let mut found = random_graphs::run(&graphs, &judge, &mut cycles);
        for (graph, outcome) in graphs.iter().zip(&mut found).filter(|(_, outcome)| !outcome.failures.is_empty()) {
            bar.set_message(format!("making the graph of seed {} small", graph.seed));
            random_graphs::keep(graph, outcome, &judge, &mut cycles, &folder)?;
        }
        outcomes.extend(found);
        done = end;
        let failed = outcomes.iter().filter(|outcome| !outcome.failures.is_empty()).count();
        bar.set_position(done);
        bar.set_message(format!("{failed} failing"));
        // What is known so far, should the run be stopped.
        if arguments.output.is_some() {
            let json = document(&Summary::of(&outcomes, adapter.clone()), &outcomes);
            files::write_atomically(&folder.join("graphs.json"), json.as_bytes())?;
        }
        if arguments.first.is_some_and(|most| failed >= most) {
            break;
        }
    }
    bar.finish_and_clear();
    let summary = Summary::of(&outcomes, adapter);
    cli::print(&if arguments.json { document(&summary, &outcomes) } else { summary.text(&outcomes) })?;
    if let Some(Err(error)) = &gpu {
        eprintln!("left out: WGSL: {error}");
    }
    Ok(match (summary.holds(), gpu) {
        (false, _) => ExitCode::FAILURE,
        (true, Some(Err(_))) => ExitCode::from(cli::COULD_NOT),
        _ => ExitCode::SUCCESS,
    })
}

/// All figures as JSON.
fn document(summary: &Summary, outcomes: &[GraphComparison]) -> String {
    let document = json!({"build": Identity::current(), "summary": summary.json(), "graphs": outcomes});
    serde_json::to_string_pretty(&document).expect("outcomes serialise") + "\n"
}

/// Figures over all graphs.
struct Summary {
    /// Adapter and driver of the WGSL.
    adapter: Option<String>,
    graphs: usize,
    failed: usize,
    values: usize,
    equal: usize,
    within_spread: usize,
    differing: usize,
    outputs: usize,
    outputs_of_library: usize,
    shaders: usize,
    impossible: usize,
    beyond: usize,
    bounded: usize,
    undetermined: usize,
    unexplained: usize,
    /// Values of WGSL, and percentiles of all differences and of those of determined values.
    wgsl_values: usize,
    all: [f64; 3],
    determined: [f64; 3],
    samples: usize,
    violations: usize,
}

impl Summary {
    fn of(outcomes: &[GraphComparison], adapter: Option<String>) -> Self {
        let cpu = || outcomes.iter().filter_map(|outcome| outcome.cpu.as_ref());
        let wgsl = || outcomes.iter().filter_map(|outcome| outcome.wgsl.as_ref());
        let bounds = || outcomes.iter().filter_map(|outcome| outcome.bounds.as_ref());
        let all: Vec<f32> = outcomes.iter().flat_map(|outcome| outcome.differences.all.iter().copied()).collect();
        let determined: Vec<f32> =
            outcomes.iter().flat_map(|outcome| outcome.differences.determined.iter().copied()).collect();
        Self {
            adapter,
            graphs: outcomes.len(),
            failed: outcomes.iter().filter(|outcome| !outcome.failures.is_empty()).count(),
            values: cpu().map(|found| found.values).sum(),
            equal: cpu().map(|found| found.equal).sum(),
            within_spread: cpu().map(|found| found.within_spread).sum(),
            differing: cpu().map(|found| found.differing).sum(),
            outputs: cpu().map(|found| found.outputs).sum(),
            outputs_of_library: cpu().map(|found| found.outputs_of_library).sum(),
            shaders: wgsl().count(),
            impossible: outcomes.iter().filter(|outcome| outcome.no_wgsl.is_some()).count(),
            beyond: wgsl().map(|found| found.beyond).sum(),
            bounded: wgsl().map(|found| found.bounded).sum(),
            undetermined: wgsl().map(|found| found.undetermined).sum(),
            unexplained: wgsl().map(|found| found.unexplained).sum(),
            wgsl_values: all.len(),
            all: percentiles(all),
            determined: percentiles(determined),
            samples: bounds().map(|found| found.samples).sum(),
            violations: bounds().map(|found| found.violations).sum(),
        }
    }

    /// Whether no graph fails and WGSL is within its limit over all of them.
    fn holds(&self) -> bool {
        self.failed == 0 && self.determined[2] < WGSL_LIMIT
    }

    fn json(&self) -> Json {
        let percentiles = |[p50, p99, p999]: [f64; 3]| json!({"p50": p50, "p99": p99, "p999": p999});
        json!({
            "graphs": self.graphs, "failed": self.failed, "holds": self.holds(),
            "cpu": {
                "values": self.values, "equal": self.equal, "within_spread": self.within_spread, "differing": self.differing,
                "outputs": self.outputs, "outputs_of_library": self.outputs_of_library,
            },
            "wgsl": {
                "adapter": self.adapter, "graphs": self.shaders, "graphs_without_shader": self.impossible, "values": self.wgsl_values,
                "limit": WGSL_LIMIT, "all": percentiles(self.all), "determined": percentiles(self.determined),
                "beyond": self.beyond, "bounded": self.bounded, "undetermined": self.undetermined,
                "unexplained": self.unexplained,
            },
            "bounds": {"samples": self.samples, "violations": self.violations},
        })
    }

    fn text(&self, outcomes: &[GraphComparison]) -> String {
        let mut text = String::new();
        let mut line =
            |parts: std::fmt::Arguments<'_>| writeln!(text, "{parts}").expect("writing to a string cannot fail");
        if self.failed > 0 {
            line(format_args!("{:>12}  {:<20}{:>6}  {}", "seed", "failure", "nodes", "where, after making it small"));
        }
        for outcome in outcomes {
            for saved in &outcome.saved {
                line(format_args!(
                    "{:>12}  {:<20}{:>6}  {}; saved as {}",
                    outcome.seed,
                    saved.failure.kind.name(),
                    saved.nodes,
                    saved.failure.detail,
                    saved.path.display()
                ));
            }
        }
        line(format_args!("{} random graphs, {} of them fail", self.graphs, self.failed));
        line(format_args!(
            "CPU against Cycles (sse42 kernel): {} values, {} equal bit for bit, {} within the spread of the C library, {} not; \
             the library takes part in {} of {} outputs",
            self.values, self.equal, self.within_spread, self.differing, self.outputs_of_library, self.outputs
        ));
        if self.shaders > 0 {
            let show = |[p50, p99, p999]: [f64; 3]| format!("p50 {p50:.1e}, p99 {p99:.1e}, p99.9 {p999:.1e}");
            line(format_args!(
                "WGSL against CPU, {}: {} graphs ({} have constants that WGSL cannot write), {} ordinary values: {}",
                self.adapter.as_deref().unwrap_or("no adapter"),
                self.shaders,
                self.impossible,
                self.wgsl_values,
                show(self.all)
            ));
            line(format_args!(
                "  beyond {WGSL_LIMIT:.0e}: {}, of which {} are within their rounding bound, {} are not determined by f32 (they move \
                 as far with the last bits), {} are neither; without the first two kinds: {} (limit: p99.9 below {WGSL_LIMIT:.0e})",
                self.beyond,
                self.bounded,
                self.undetermined,
                self.unexplained,
                show(self.determined)
            ));
        }
        line(format_args!("bounds: {} of {} samples outside", self.violations, self.samples));
        text
    }
}

/// Median, 99th and 99.9th percentile (nearest rank).
fn percentiles(mut values: Vec<f32>) -> [f64; 3] {
    values.sort_by(f32::total_cmp);
    [0.5, 0.99, 0.999].map(|share| {
        let rank = (share * values.len() as f64).ceil() as usize;
        values.get(rank.saturating_sub(1)).copied().map_or(0.0, f64::from)
    })
}
