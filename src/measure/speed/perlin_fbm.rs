//! How long the bake takes beside a straightforward one.

use crate::base::error::Result;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::engines::perlin_fbm::gpu::BakeKernel;
use crate::gpu::Gpu;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment};
use crate::nodes::perlin_fbm::Volume;
use crate::nodes::perlin_fbm::bake::Bake;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::sync::Arc;
use std::time::Instant;

/// Bakes once.
type Way<'a> = Box<dyn Fn() -> Result<Volume> + 'a>;

/// What one way of baking took.
#[derive(Debug, Clone, Serialize)]
pub struct BakeTime {
    /// Which way.
    pub what: &'static str,
    /// Seconds of wall time, the median of the repeats.
    pub seconds: f64,
    /// Seconds of the plain bake over these, within one run.
    pub ratio: f64,
    /// Texels that differ from the plain bake's.
    pub differing: usize,
    /// Largest difference of a byte.
    pub largest_difference: u8,
}

/// Bakes that are timed.
struct Running<'a> {
    ways: Vec<(&'static str, Way<'a>)>,
    side: usize,
    repeats: usize,
    /// The first bake of the first way, which the others are compared with.
    plain: Option<Arc<[u8]>>,
}

/// One bake.
#[derive(Serialize, Deserialize)]
struct Once {
    seconds: f64,
    differing: usize,
    largest_difference: u8,
}

/// Bakes of the default parameters with `side` texels per axis: in double precision, texel by texel on one core; then each other
/// way. Those are repeated and interleaved, so that other work on the machine meets all of them; the adapter's kernel is
/// compiled before.
pub fn run(side: usize, repeats: usize, gpu: Option<&Gpu>, progress: Progress<'_>) -> Result<Vec<BakeTime>> {
    let bake = Bake::default();
    let kernel = gpu.map(BakeKernel::new).transpose()?;
    let mut ways: Vec<(&str, Way)> = vec![
        ("f64, one core, texel by texel", Box::new(|| bake.volume_plain(side))),
        ("f64, all cores, row by row", Box::new(|| bake.volume(side))),
        ("f32, all cores, row by row", Box::new(|| bake.volume_in::<f32>(side))),
    ];
    if let Some(kernel) = &kernel {
        ways.push(("WGSL", Box::new(|| kernel.volume(&bake, side))));
    }
    let mut running = Running { ways, side, repeats: repeats.max(1), plain: None };
    experiment::run(&mut running, None, &experiment::Settings::default(), progress)?.all()
}

impl Experiment for Running<'_> {
    /// Repetition and way.
    type Job = (usize, usize);
    type Record = Once;
    type Summary = Vec<BakeTime>;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: "cloudparity-bench-bake/1", of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<Self::Job>> {
        Ok((0..self.repeats).flat_map(|repeat| (0..self.ways.len()).map(move |way| (repeat, way))).collect())
    }

    fn inputs(&self, (repeat, way): &Self::Job) -> Result<Json> {
        Ok(json!({"side": self.side, "way": self.ways[*way].0, "repeat": repeat}))
    }

    fn label(&self, (_, way): &Self::Job) -> String {
        self.ways[*way].0.to_owned()
    }

    fn run(&mut self, (_, way): &Self::Job, _desk: &Desk<'_>) -> Result<Found<Once>> {
        let begin = Instant::now();
        let volume = self.ways[*way].1()?;
        let seconds = begin.elapsed().as_secs_f64();
        let plain = self.plain.get_or_insert_with(|| Arc::clone(&volume.texels));
        let differences = volume.texels.iter().zip(plain.iter()).map(|(a, b)| a.abs_diff(*b));
        let (differing, largest_difference) = differences.fold((0, 0), |(count, largest), difference| {
            (count + usize::from(difference > 0), difference.max(largest))
        });
        Ok(Found::Record(Once { seconds, differing, largest_difference }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<Vec<BakeTime>> {
        let all = experiment::records(found);
        let count = self.ways.len();
        let median = |way: usize| {
            let mut seconds: Vec<f64> = all.iter().skip(way).step_by(count).map(|once| once.seconds).collect();
            seconds.sort_by(f64::total_cmp);
            seconds[seconds.len() / 2]
        };
        let of_way = |(way, (what, _)): (usize, &(&'static str, Way))| BakeTime {
            what,
            seconds: median(way),
            ratio: median(0) / median(way),
            differing: all[way].differing,
            largest_difference: all[way].largest_difference,
        };
        Ok(self.ways.iter().enumerate().map(of_way).collect())
    }
}
