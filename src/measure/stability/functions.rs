//! The scalar functions of the integrators, each one text for f32 and f64 and a twin in WGSL, over all that may reach them.
//!
//! Inputs are f32 and the same for all evaluators, so that a row shows the function's own error. Bounds follow from the accuracy of the
//! operations: half an ulp for a rounding, 1 ulp for functions of the C library, and for WGSL what its section "Floating point accuracy"
//! promises: exp within 3 + 2 |x| ulp, log2 within 2^-21 between 0.5 and 2 and 3 ulp elsewhere, division within 2.5 ulp, a square root
//! through inverseSqrt (2 ulp) and a division. Below the smallest normal number anything is flushed.

use crate::base::error::Result;
use crate::engines::light::terms::{MOST_OCTAVES, compressed, octaves, powder, silver};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::wgsl::Linker;
use crate::measure::stability::{Bound, Head, Judgement, Subject};
use crate::media::phase::{henyey_greenstein_by_lack, sample_henyey_greenstein};
use crate::media::transfer::Integration;
use crate::media::transfer::{absorbed, mean_transmittance, step_weight, transmittance};
use crate::shader_struct;
use num_traits::Float;
use std::ops::RangeInclusive;

/// The entry point that calls one of them per invocation.
pub const SHADER: &str = include_str!("../../../shaders/measure/stability/functions.wgsl");

/// A unit in the last place, relative to the value, at most.
const ULP: f64 = 1.0 / 8_388_608.0;

/// Largest relative error of a rounding.
const ROUNDING: f64 = ULP / 2.0;

/// Absolute error of log2 between 0.5 and 2.
const LOGARITHM: f64 = 1.0 / 2_097_152.0;

/// Optical depth from which on WGSL may take a difference instead of a series, rounding allowed for.
pub(super) const SWITCH: f64 = 0.0499;

/// What flushing loses at most.
const FLUSHED: f64 = f32::MIN_POSITIVE as f64;

/// Largest error of a pass: ten roundings.
const LIMIT: f64 = 10.0 * ULP;

/// Arguments of a function; those that it does not have are 0.
pub type Arguments<T> = [T; 4];

/// Which of the two evaluators of f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The generic text in f32.
    Cpu,
    /// The twin on the adapter.
    Wgsl,
}

/// A function of the integrators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is the function of its name")]
pub enum ScalarFunction {
    Transmittance,
    Absorbed,
    MeanTransmittance,
    StepWeight,
    HenyeyGreenstein,
    SampleHenyeyGreenstein,
    Powder,
    Silver,
    Octaves,
    Compressed,
}

impl ScalarFunction {
    /// All of them, in the order of their numbers in the shader.
    pub const ALL: [Self; 10] = [
        Self::Transmittance,
        Self::Absorbed,
        Self::MeanTransmittance,
        Self::StepWeight,
        Self::HenyeyGreenstein,
        Self::SampleHenyeyGreenstein,
        Self::Powder,
        Self::Silver,
        Self::Octaves,
        Self::Compressed,
    ];

    /// Its value, in f32 or f64.
    pub fn value<T: Float>(self, [a, b, c, _]: Arguments<T>) -> T {
        match self {
            Self::Transmittance => transmittance(a),
            Self::Absorbed => absorbed(a),
            Self::MeanTransmittance => mean_transmittance(a),
            Self::StepWeight => step_weight(Integration::EnergyConserving, a, b),
            // The argument is what the cosine lacks to 1, which f32 holds near 1 and the cosine does not.
            Self::HenyeyGreenstein => henyey_greenstein_by_lack(a, b),
            Self::SampleHenyeyGreenstein => sample_henyey_greenstein(a, b),
            Self::Powder => powder(a, b, c),
            Self::Silver => silver(a, b, c),
            Self::Octaves => {
                let next = |share: &T| Some(*share * b);
                let weights: Vec<T> = std::iter::successors(Some(T::one()), next).take(MOST_OCTAVES as usize).collect();
                octaves(&weights, c, a)
            }
            Self::Compressed => compressed(b, a),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Transmittance => "transmittance",
            Self::Absorbed => "absorbed",
            Self::MeanTransmittance => "mean-transmittance",
            Self::StepWeight => "step-weight",
            Self::HenyeyGreenstein => "henyey-greenstein",
            Self::SampleHenyeyGreenstein => "sampled-cosine",
            Self::Powder => "powder",
            Self::Silver => "silver-lining",
            Self::Octaves => "octaves",
            Self::Compressed => "compressed-depth",
        }
    }

    fn varied(self) -> &'static str {
        match self {
            Self::Transmittance | Self::Absorbed | Self::MeanTransmittance => {
                "optical depth 0 and 1e-6 to 1e6 of a step"
            }
            Self::StepWeight => "extinction 0 and 1e-8 to 1e8 times steps of 1e-6 to 1e2",
            Self::HenyeyGreenstein => "eccentricity 0 to 1 - 1e-6, 1 minus the cosine 0 and 1e-12 to 2",
            Self::SampleHenyeyGreenstein => "eccentricity -(1 - 1e-6) to 1 - 1e-6, uniform number 0 to 1 - 2^-24",
            Self::Powder => "strength 0 to 1, length 1e-3 to 1e3, extinction 0 to 1e8",
            Self::Silver => "exponent 0.5 to 64, cosine -1 to 1",
            Self::Octaves => "16 octaves, optical depth 0 and 1e-6 to 1e6, contribution and attenuation 0 to 1",
            Self::Compressed => "optical depth 0 and 1e-6 to 1e6, compression 1e-8 to 1e8",
        }
    }

    fn guards(self) -> Vec<&'static str> {
        match self {
            Self::Transmittance => vec!["exponential"],
            Self::Absorbed => vec!["absorbed"],
            Self::MeanTransmittance | Self::StepWeight => vec!["mean-transmittance"],
            Self::HenyeyGreenstein => vec!["phase-base", "isotropic"],
            Self::SampleHenyeyGreenstein => vec!["sampled-cosine", "isotropic"],
            Self::Powder => vec!["absorbed"],
            Self::Silver => vec!["silver-lining"],
            Self::Octaves => vec!["exponential"],
            Self::Compressed => vec!["compressed-depth"],
        }
    }

    fn cycles(self) -> &'static str {
        match self {
            Self::Transmittance | Self::Absorbed | Self::MeanTransmittance | Self::StepWeight => {
                "yes, as a function: Cycles' homogeneous medium is one exponential, of furnace value 1 to 7 digits (measured)"
            }
            Self::HenyeyGreenstein => {
                "yes: within 5e-5 of Cycles for delta lights, the same limits |g| >= 0.001 and <= 0.999 (measured)"
            }
            Self::SampleHenyeyGreenstein => "not to compare: a picture does not show single samples",
            Self::Powder | Self::Silver | Self::Octaves | Self::Compressed => "no such term in Cycles",
        }
    }

    /// What is put in.
    pub fn arguments(self) -> Vec<Arguments<f32>> {
        let depths = || std::iter::once(0.0).chain(logarithmic(1e-6..=1e6, 256)).collect::<Vec<f32>>();
        let of = |first: &[f32], second: &[f32], third: &[f32]| {
            let mut all = Vec::new();
            for &a in first {
                for &b in second {
                    all.extend(third.iter().map(|&c| [a, b, c, 0.0]));
                }
            }
            all
        };
        let extinctions: Vec<f32> = std::iter::once(0.0).chain(logarithmic(1e-8..=1e8, 129)).collect();
        match self {
            Self::Transmittance | Self::Absorbed | Self::MeanTransmittance => of(&depths(), &[0.0], &[0.0]),
            Self::StepWeight => of(&extinctions, &[1e-6, 1e-3, 0.1, 1.0, 100.0], &[0.0]),
            Self::HenyeyGreenstein => {
                let lacks: Vec<f32> = std::iter::once(0.0).chain(logarithmic(1e-12..=2.0, 128)).collect();
                of(&eccentricities(), &lacks, &[0.0])
            }
            Self::SampleHenyeyGreenstein => {
                let both: Vec<f32> = eccentricities().iter().flat_map(|&g| [g, -g]).collect();
                // Multiples of 2^-24, which the random numbers of both backends are.
                let numbers: Vec<f32> = (0..257).map(|number| (number * 65_535) as f32 / 16_777_216.0).collect();
                let edges = [1.0 / 16_777_216.0, 1.0 - 1.0 / 16_777_216.0];
                of(&both, &[numbers, edges.to_vec()].concat(), &[0.0])
            }
            Self::Powder => of(&[0.0, 0.5, 0.8, 0.999, 1.0], &[1e-3, 0.1, 1.0, 1e3], &extinctions),
            Self::Silver => {
                let cosines: Vec<f32> = (0..=256).map(|number| number as f32 / 128.0 - 1.0).collect();
                of(&[1.0], &[0.5, 1.0, 8.0, 64.0], &cosines)
            }
            Self::Octaves => of(&depths(), &[0.0, 0.5, 1.0], &[0.0, 0.25, 0.5, 1.0]),
            Self::Compressed => of(&depths(), &[0.0, 1e-8, 1e-3, 0.1, 1.0, 10.0, 1e8], &[0.0]),
        }
    }

    /// Scale of the errors: a cosine is of order 1, everything else is judged relative to itself.
    fn scale(self) -> f64 {
        if self == Self::SampleHenyeyGreenstein { 1.0 } else { FLUSHED }
    }

    /// The f64 value and how far an evaluator may be from it.
    pub fn bound(self, arguments: Arguments<f32>, side: Side) -> Bound {
        let wide = arguments.map(f64::from);
        let truth: f64 = self.value(wide);
        let [a, b, c, _] = wide;
        let is_wgsl = side == Side::Wgsl;
        let exponential = |x: f64| if is_wgsl { (3.0 + 2.0 * x.abs()) * ULP } else { ULP };
        let division = if is_wgsl { 2.5 * ULP } else { ROUNDING };
        let root = if is_wgsl { 4.5 * ULP } else { ROUNDING };
        // Relative error of 1 - exp(-d): the CPU has a function of its own; WGSL takes a series below 0.05, of which the first term left
        // out and six roundings count, and the difference above, which makes the error of the exponential one of 1.
        // At the switch itself rounding decides.
        let absorption = |depth: f64| match () {
            () if !is_wgsl => ULP,
            () if depth < SWITCH => depth.powi(4) / 120.0 + 6.0 * ROUNDING,
            () => (exponential(depth) * (-depth).exp() + ROUNDING) / -(-depth).exp_m1(),
        };
        let distance = match self {
            Self::Transmittance => exponential(a) * truth,
            Self::Absorbed => (absorption(a) + 2.0 * ROUNDING) * truth,
            Self::MeanTransmittance => (absorption(a) + division + 2.0 * ROUNDING) * truth,
            // The product of the depth is rounded, and the mean changes by at most as much.
            Self::StepWeight => (absorption(a * b) + division + 4.0 * ROUNDING) * truth,
            // A base of positive parts (5 roundings), to the power 1.5 by a root and a product, three factors and a quotient.
            Self::HenyeyGreenstein => (1.5 * 5.0 * ROUNDING + root + division + 6.0 * ROUNDING) * truth,
            Self::SampleHenyeyGreenstein => {
                let (g, u) = (a.abs(), if a < 0.0 { 1.0 - b } else { b });
                if g < 0.25 {
                    // Terms of at most 1.7 in sum over a square of at least 0.56.
                    8.0 * ROUNDING + (8.0 * ROUNDING * 1.7 + 6.0 * ROUNDING + division) / 0.56
                } else {
                    let ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
                    let of_ratio = 6.0 * ROUNDING + division;
                    ((2.0 * of_ratio + ROUNDING) * ratio * ratio + 3.0 * ROUNDING * (1.0 + g * g)) / (2.0 * g)
                        + division
                        + ROUNDING
                }
            }
            Self::Powder => (absorption(b * c) + 4.0 * ROUNDING) * truth,
            Self::Silver => {
                if c <= 0.0 || !is_wgsl {
                    2.0 * ULP * truth
                } else {
                    // pow(c, k) = exp2(k log2(c)).
                    let logarithm = c.log2().abs();
                    let own = if c < 0.5 { 3.0 * ULP * logarithm } else { LOGARITHM };
                    let exponent = b * logarithm;
                    let inherited = std::f64::consts::LN_2 * (b * own + ROUNDING * exponent);
                    (inherited.exp_m1() + (3.0 + 2.0 * exponent) * ULP + ROUNDING) * truth
                }
            }
            Self::Octaves => {
                let (mut share, mut dimmed, mut sum) = (1.0, a, 0.0);
                for number in 0..MOST_OCTAVES {
                    let roundings = f64::from(2 * number + MOST_OCTAVES) * ROUNDING;
                    let own = exponential(dimmed) + dimmed * f64::from(number) * ROUNDING + roundings;
                    sum += share * (-dimmed).exp() * own;
                    (share, dimmed) = (share * b, dimmed * c);
                }
                sum
            }
            // Below the root two roundings, of which it halves what counts; two sums, a quotient.
            Self::Compressed => (2.0 * ROUNDING + root + division + 2.0 * ROUNDING) * truth,
        };
        // Every term of the octaves may be lost.
        let flushed = if self == Self::Octaves { f64::from(MOST_OCTAVES) } else { 1.0 };
        Bound { truth, distance: distance + flushed * FLUSHED }
    }

    fn reason(self) -> &'static str {
        match self {
            Self::Transmittance | Self::Octaves => {
                "limit: 10 ulp; bound: WGSL promises exp(x) within 3 + 2 |x| ulp, so what is left behind a depth of 80 may be off by 163 ulp"
            }
            Self::Absorbed | Self::MeanTransmittance | Self::StepWeight | Self::Powder => {
                "limit: 10 ulp; bound: above a depth of 0.05 the error of WGSL's exponential stands beside a difference that is small there"
            }
            Self::Compressed => "limit: 10 ulp; bound: root, quotient and 4 roundings",
            Self::HenyeyGreenstein => "limit: 10 ulp; bound: root, quotient and 14 roundings",
            Self::SampleHenyeyGreenstein => {
                "limit: 10 ulp of 1; bound: the quotient's error times its square over the eccentricity, 3 at most"
            }
            Self::Silver => "limit: 10 ulp; bound: WGSL's pow inherits the error of log2 times the exponent",
        }
    }

    fn head(self, side: Side) -> Head {
        let (mark, evaluator) = match side {
            Side::Cpu => ("cpu", "f32 on the CPU against f64"),
            Side::Wgsl => ("wgsl", "WGSL against f64"),
        };
        Head {
            id: format!("{}/{mark}", self.name()),
            subject: Subject::Function,
            varied: self.varied().into(),
            evaluator: evaluator.into(),
            limit: LIMIT,
            reason: self.reason().into(),
            guards: self.guards(),
            cycles: self.cycles().into(),
        }
    }

    /// Judges values for the function's own arguments.
    pub fn judge(self, side: Side, values: &[f32]) -> Judgement {
        let bounds: Vec<Bound> = self.arguments().into_iter().map(|arguments| self.bound(arguments, side)).collect();
        let values: Vec<f64> = values.iter().copied().map(f64::from).collect();
        self.head(side).judge(self.scale(), &values, &bounds)
    }
}

/// `count` numbers in equal ratios.
pub(super) fn logarithmic(range: RangeInclusive<f64>, count: usize) -> impl Iterator<Item = f32> {
    let (low, high) = (range.start().ln(), range.end().ln());
    (0..count).map(move |number| (low + (high - low) * number as f64 / (count - 1) as f64).exp() as f32)
}

/// Eccentricities up to what f32 holds beside 1.
fn eccentricities() -> Vec<f32> {
    vec![0.0, 9e-4, 1.1e-3, 0.01, 0.1, 0.249, 0.251, 0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999, 0.999999]
}

/// The rows of all functions; those of WGSL where there is an adapter.
pub fn rows(gpu: Option<&Gpu>) -> Result<Vec<Judgement>> {
    let pipeline = match gpu {
        Some(gpu) => Some(Pipeline::new(gpu, SHADER)?),
        None => None,
    };
    let mut rows = Vec::new();
    for function in ScalarFunction::ALL {
        let arguments = function.arguments();
        let single: Vec<f32> = arguments.iter().map(|&arguments| function.value(arguments)).collect();
        rows.push(function.judge(Side::Cpu, &single));
        if let Some(pipeline) = &pipeline {
            rows.push(function.judge(Side::Wgsl, &pipeline.values(function, &arguments)?));
        }
    }
    Ok(rows)
}

shader_struct! {
    /// Which function is asked, and how often.
    struct Request = "Request" {
        function: u32,
        count: u32,
        padding: [u32; 2],
    }
}

/// The functions on the adapter.
pub struct Pipeline<'a> {
    gpu: &'a Gpu,
    kernel: ComputeKernel,
}

impl<'a> Pipeline<'a> {
    /// Compiles an entry text, [`SHADER`] or a change of it.
    pub fn new(gpu: &'a Gpu, source: &str) -> Result<Self> {
        let module = Linker::bare().link("measure/stability/functions.wgsl", source)?;
        Ok(Self { gpu, kernel: gpu.kernel("functions", &module, &[Layout::of::<Request>()])? })
    }

    /// Values of a function.
    pub fn values(&self, function: ScalarFunction, arguments: &[Arguments<f32>]) -> Result<Vec<f32>> {
        let number = ScalarFunction::ALL.iter().position(|&known| known == function).expect("all functions are listed");
        let request = Request { function: number as u32, count: arguments.len() as u32, padding: [0; 2] };
        let storage = wgpu::BufferUsages::STORAGE;
        let request = self.gpu.upload("request", bytemuck::bytes_of(&request), wgpu::BufferUsages::UNIFORM);
        let inputs = self.gpu.upload("inputs", bytemuck::cast_slice(arguments), storage);
        // NaN in what no invocation wrote is counted.
        let unwritten = vec![f32::NAN; arguments.len()];
        let usage = storage | wgpu::BufferUsages::COPY_SRC;
        let results = self.gpu.upload("results", bytemuck::cast_slice(&unwritten), usage);
        let bindings = Bindings::new().group(0, [&request, &inputs, &results]);
        self.gpu.dispatch(&self.kernel, &bindings, [arguments.len() as u32, 1, 1])?;
        Ok(bytemuck::pod_collect_to_vec(&self.gpu.read_back(&results, 4 * arguments.len() as u64)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kernel_without_its_guard_fails() {
        let function = ScalarFunction::MeanTransmittance;
        let unguarded: Vec<f32> =
            function.arguments().iter().map(|[depth, ..]| (1.0 - (-depth).exp()) / depth).collect();
        let row = function.judge(Side::Cpu, &unguarded);
        assert_eq!((row.verdict, row.nonfinite), (super::super::Verdict::Fails, 1), "{row:?}");
    }
}
