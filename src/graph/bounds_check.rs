//! Checking bounds against samples: violations over random boxes, tightness over a grid.

use crate::base::error::Result;
use crate::graph::Program;
use crate::graph::bounds::{Bounds3, Workspace};
use crate::graph::evaluate::{Arithmetic, Points};
use crate::nodes::Interval;
use crate::scene::Scene;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::time::Instant;

/// What to look at.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Where boxes and the grid lie.
    pub layer: Bounds3,
    /// Number of random boxes.
    pub boxes: usize,
    /// Samples per box and per cell.
    pub samples: usize,
    /// Grid cells per unit; 0 for no grid.
    pub grid: u32,
    /// Grid cells to look at; 0 for all.
    pub cells: usize,
    /// How often each grid cell is divided into eight for its bounds.
    pub refine: u32,
    /// Seed of boxes and samples.
    pub seed: u64,
}

/// What a [`Survey`] found. Of the program's outputs the first component counts.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Report {
    /// Random boxes.
    pub boxes: usize,
    /// Samples per box.
    pub samples: usize,
    /// Samples outside of their box's bounds, f32 and f64 evaluation.
    pub violations: usize,
    /// The first violations in words.
    pub examples: Vec<String>,
    /// One thread's time per random box.
    pub microseconds_per_random_box: f64,
    /// The grid's figures.
    pub grid: Option<GridReport>,
}

/// Tightness on the grid.
#[derive(Debug, Clone, serde::Serialize)]
pub struct GridReport {
    /// Cells per unit.
    pub per_unit: u32,
    /// Cells looked at.
    pub cells: usize,
    /// One thread's time per cell.
    pub microseconds_per_cell: f64,
    /// Samples outside of their cell's bounds.
    pub violations: usize,
    /// Cells whose samples are all 0.
    pub empty: usize,
    /// Of these, cells that the bounds prove empty.
    pub proven_empty: usize,
    /// `proven_empty / empty`.
    pub proven_empty_share: f64,
    /// Cells with a positive sample.
    pub occupied: usize,
    /// Mean over these of majorant / largest sample.
    pub mean_ratio: f64,
    /// Mean over the occupied cells whose largest sample reaches a hundredth of the grid's largest.
    /// Elsewhere the quotient says how near to zero the samples are, not how good the bound is.
    pub mean_ratio_dense: f64,
    /// Median of the same.
    pub median_ratio: f64,
    /// 90th percentile of the same.
    pub ratio_90: f64,
    /// Sum of the majorants over the sum of the largest samples.
    pub ratio_of_sums: f64,
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "random boxes: {} with {} samples each", self.boxes, self.samples)?;
        writeln!(f, "violations: {}", self.violations)?;
        for example in &self.examples {
            writeln!(f, "  {example}")?;
        }
        writeln!(f, "time per random box: {:.1} us (one thread)", self.microseconds_per_random_box)?;
        let Some(grid) = &self.grid else { return Ok(()) };
        writeln!(f, "grid of 1/{}: {} cells, {} samples each", grid.per_unit, grid.cells, self.samples)?;
        writeln!(f, "time per cell: {:.1} us (one thread)", grid.microseconds_per_cell)?;
        writeln!(f, "violations: {}", grid.violations)?;
        let share = 100.0 * grid.proven_empty_share;
        writeln!(f, "empty by sampling: {}, proven empty: {} ({share:.1} %)", grid.empty, grid.proven_empty)?;
        writeln!(
            f,
            "majorant / largest sample over {} occupied cells: mean {:.2} \
             ({:.2} without nearly empty cells), median {:.2}, 90 % below {:.2}; of sums {:.2}",
            grid.occupied, grid.mean_ratio, grid.mean_ratio_dense, grid.median_ratio, grid.ratio_90, grid.ratio_of_sums
        )
    }
}

/// The part of the volume's bounds up to `altitude` above the object's origin.
pub fn layer(scene: &Scene, altitude: f32) -> Bounds3 {
    let bounds = &scene.volume.bounds;
    let mut high = bounds.max;
    high[2] = high[2].min(altitude);
    Bounds3::new(bounds.min, high)
}

/// Random points of a box, corners first: extremes of monotone fields lie there.
pub fn points_in(place: &Bounds3, count: usize, random: &mut impl Rng) -> Vec<[f32; 3]> {
    let corners = (0..8_usize).map(|corner| {
        std::array::from_fn(|axis| if corner >> axis & 1 == 1 { place.high[axis] } else { place.low[axis] })
    });
    let mut points: Vec<[f32; 3]> = corners.take(count).collect();
    points.resize_with(count, || {
        std::array::from_fn(|axis| {
            let t: f32 = random.random();
            (place.low[axis] + t * (place.high[axis] - place.low[axis])).clamp(place.low[axis], place.high[axis])
        })
    });
    points
}

/// Values outside of their enclosures, counted over the components of all points.
pub fn violations(enclosures: &[Interval], values: &[f64]) -> usize {
    values
        .chunks(enclosures.len().max(1))
        .map(|point| point.iter().zip(enclosures).filter(|(value, bounds)| !bounds.contains(**value)).count())
        .sum()
}

struct Sampled {
    violations: usize,
    largest: f64,
    example: Option<String>,
}

fn sample(program: &Program, place: &Bounds3, bounds: &[Interval], count: usize, seed: u64) -> Result<Sampled> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let points = points_in(place, count, &mut random);
    let single = program.evaluate(Points::new(&points), Arithmetic::Single)?;
    // The f64 evaluation is slow and differs little: a tenth of the points.
    let oracle = program.evaluate(Points::new(&points[..count.div_ceil(10)]), Arithmetic::Oracle)?;
    let found = violations(bounds, &single) + violations(bounds, &oracle);
    let width = bounds.len().max(1);
    let largest = single.iter().step_by(width).fold(f64::NEG_INFINITY, |largest, &x| largest.max(x));
    let example = (found > 0).then(|| {
        let smallest = single.iter().step_by(width).fold(f64::INFINITY, |smallest, &x| smallest.min(x));
        format!("{place:?}: samples {smallest} to {largest}, bounds {:?}", bounds.first())
    });
    Ok(Sampled { violations: found, largest, example })
}

impl Survey {
    /// Runs the survey on the program's density.
    pub fn run(&self, program: &Program) -> Result<Report> {
        let places = self.random_boxes();
        let (bounds, microseconds) = timed(program, &places, 0)?;
        let width = program.output_components();
        let sampled = self.sample_all(program, &places, &bounds)?;
        let grid = if self.grid > 0 { Some(self.survey_grid(program)?) } else { None };
        Ok(Report {
            boxes: places.len(),
            samples: self.samples,
            violations: sampled.iter().map(|found| found.violations).sum::<usize>()
                + grid.as_ref().map_or(0, |grid| grid.violations),
            examples: sampled.into_iter().filter_map(|found| found.example).take(5).collect(),
            microseconds_per_random_box: if width == 0 { 0.0 } else { microseconds },
            grid,
        })
    }

    fn sample_all(&self, program: &Program, places: &[Bounds3], bounds: &[Interval]) -> Result<Vec<Sampled>> {
        let width = program.output_components().max(1);
        places
            .par_iter()
            .zip(bounds.par_chunks(width))
            .enumerate()
            .map(|(number, (place, bounds))| {
                let seed = self.seed.wrapping_mul(0x9E37_79B9).wrapping_add(number as u64);
                sample(program, place, bounds, self.samples, seed)
            })
            .collect()
    }

    /// Boxes of side 2^-1 to 2^-8 within the layer.
    fn random_boxes(&self) -> Vec<Bounds3> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let layer = &self.layer;
        (0..self.boxes)
            .map(|_| {
                let side = 0.5_f32.powf(random.random_range(1.0..=8.0));
                let low = std::array::from_fn(|axis| {
                    let room = (layer.high[axis] - layer.low[axis] - side).max(0.0);
                    layer.low[axis] + random.random::<f32>() * room
                });
                let high = std::array::from_fn(|axis: usize| (low[axis] + side).min(layer.high[axis]));
                Bounds3::new(low, high)
            })
            .collect()
    }

    fn survey_grid(&self, program: &Program) -> Result<GridReport> {
        let places = self.grid_cells();
        let (bounds, microseconds_per_cell) = timed(program, &places, self.refine)?;
        let width = program.output_components().max(1);
        let sampled = self.sample_all(program, &places, &bounds)?;
        let mut report = GridReport {
            per_unit: self.grid,
            cells: places.len(),
            microseconds_per_cell,
            violations: 0,
            empty: 0,
            proven_empty: 0,
            proven_empty_share: 0.0,
            occupied: 0,
            mean_ratio: 0.0,
            mean_ratio_dense: 0.0,
            median_ratio: 0.0,
            ratio_90: 0.0,
            ratio_of_sums: 0.0,
        };
        let mut ratios = Vec::new();
        let (mut majorants, mut largest) = (0.0, 0.0);
        for (found, bounds) in sampled.iter().zip(bounds.chunks(width)) {
            report.violations += found.violations;
            let majorant = f64::from(bounds[0].high);
            if found.largest > 0.0 {
                ratios.push(majorant / found.largest);
                majorants += majorant;
                largest += found.largest;
            } else {
                report.empty += 1;
                report.proven_empty += usize::from(majorant <= 0.0);
            }
        }
        report.proven_empty_share = report.proven_empty as f64 / report.empty.max(1) as f64;
        report.occupied = ratios.len();
        if !ratios.is_empty() {
            let threshold = 0.01 * sampled.iter().fold(0.0_f64, |most, found| most.max(found.largest));
            let dense: Vec<f64> = sampled
                .iter()
                .zip(bounds.chunks(width))
                .filter(|(found, _)| found.largest >= threshold && found.largest > 0.0)
                .map(|(found, bounds)| f64::from(bounds[0].high) / found.largest)
                .collect();
            report.mean_ratio_dense = dense.iter().sum::<f64>() / dense.len() as f64;
            ratios.sort_by(f64::total_cmp);
            report.mean_ratio = ratios.iter().sum::<f64>() / ratios.len() as f64;
            report.median_ratio = ratios[ratios.len() / 2];
            report.ratio_90 = ratios[ratios.len() * 9 / 10];
            report.ratio_of_sums = majorants / largest;
        }
        Ok(report)
    }

    fn grid_cells(&self) -> Vec<Bounds3> {
        let side = 1.0 / self.grid as f32;
        let layer = &self.layer;
        let counts: [usize; 3] =
            std::array::from_fn(|axis| ((layer.high[axis] - layer.low[axis]) / side).floor() as usize);
        let total: usize = counts.iter().product();
        let cell = |index: usize| {
            let place = [index % counts[0], index / counts[0] % counts[1], index / (counts[0] * counts[1])];
            let at = |axis: usize, step: usize| layer.low[axis] + (place[axis] + step) as f32 * side;
            Bounds3::new([at(0, 0), at(1, 0), at(2, 0)], [at(0, 1), at(1, 1), at(2, 1)])
        };
        if total == 0 || self.cells == 0 || self.cells >= total {
            return (0..total).map(cell).collect();
        }
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        (0..self.cells).map(|_| cell(random.random_range(0..total))).collect()
    }
}

/// Boxes that are timed together.
const BATCH: usize = 20;

/// Bounds of all boxes, and one thread's microseconds per box, from a part of them.
fn timed(program: &Program, places: &[Bounds3], depth: u32) -> Result<(Vec<Interval>, f64)> {
    let bounds = program.bounds_refined(places, depth)?;
    let mut workspace = Workspace::new(program);
    let mut result = vec![Interval::EVERYTHING; program.output_components()];
    // The median over small batches: other processes' time slices count in few of them.
    let mut microseconds: Vec<f64> = places[..places.len().min(4_000)]
        .chunks(BATCH)
        .map(|batch| {
            let start = Instant::now();
            batch.iter().for_each(|place| workspace.run_refined(program, place, depth, &mut result));
            1e6 * start.elapsed().as_secs_f64() / batch.len() as f64
        })
        .collect();
    microseconds.sort_by(f64::total_cmp);
    Ok((bounds, microseconds.get(microseconds.len() / 2).copied().unwrap_or(0.0)))
}
