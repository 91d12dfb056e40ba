//! What keeps the integrators finite and accurate, each with what it does where the plain formula fails.
//!
//! A guard of one formula has a [`Witness`], which every suite and the tests run: the input at which the formula as one would write it
//! without a thought fails, and what the guarded code makes of it. Guards that only whole pictures show have a test each; the table in
//! `tests/stability.rs` holds them by name. Neither reads the sources: they fail when the behaviour goes.

use crate::base::error::{Error, Result};
use crate::engines::domain::{Outline, unit};
use crate::engines::light::terms::{compressed, silver};
use crate::engines::march::RealTimeRay;
use crate::measure::stability::Judgement;
use crate::measure::stability::pictures::Uniform;
use crate::media::phase::{PhaseFunction, henyey_greenstein, henyey_greenstein_by_lack, sample_henyey_greenstein};
use crate::media::region::Region;
use crate::media::transfer::{absorbed, mean_transmittance, transmittance};
use crate::nodes::closure::Phase;
use crate::nodes::real::Real;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// A guard in the code.
#[derive(Debug, Clone, Copy)]
pub struct Guard {
    /// Name in the table.
    pub name: &'static str,
    /// What it does, in a sentence.
    pub keeps: &'static str,
    /// Files of the code that is the guard.
    pub files: &'static [&'static str],
    /// How it is known to be at work.
    pub proof: Proof,
}

/// How a guard is known to be at work.
#[derive(Debug, Clone, Copy)]
pub enum Proof {
    /// By what it computes where the plain formula fails.
    Witness(fn() -> Result<Witness>),
    /// By a test of pictures, which shows this.
    Pictures(&'static str),
}

/// What a guarded formula and the plain one compute at an input. Their errors are those of f32 where nothing else is said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Witness {
    /// The input, in words.
    pub at: &'static str,
    /// What the code computes.
    pub found: f64,
    /// What the plain formula computes; NaN is a failure like any other.
    pub plain: f64,
    /// What is right.
    pub truth: f64,
    /// How far from it a value may be: what rounding explains.
    pub within: f64,
}

impl Witness {
    /// Whether the code is right, and the plain formula is not, so that the guard is what makes the difference.
    pub fn holds(&self) -> bool {
        let is_right = |value: f64| (value - self.truth).abs() <= self.within;
        is_right(self.found) && !is_right(self.plain)
    }
}

impl std::fmt::Display for Witness {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { at, found, plain, truth, .. } = self;
        write!(out, "{at}: {found:.6e}, plain {plain:.6e}, exact {truth:.6e}")
    }
}

/// A guard as files hold it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Described {
    /// See [`Guard::name`].
    pub name: String,
    /// See [`Guard::keeps`].
    pub keeps: String,
    /// See [`Guard::files`].
    pub files: Vec<String>,
    /// What shows that it is at work.
    pub shown_by: String,
    /// Whether its witness holds; so it is for those that tests show.
    pub holds: bool,
}

/// Rounding of some ten operations in f32, relative.
const TEN_ROUNDINGS: f64 = 10.0 / (1_u64 << 24) as f64;

/// All guards.
pub const GUARDS: &[Guard] = &[
    Guard {
        name: "exponential",
        keeps: "only exp(-depth) of a depth that is not negative is taken: it falls to 0 and never overflows",
        files: &["src/media/transfer.rs", "shaders/media/transfer.wgsl"],
        proof: Proof::Witness(|| {
            // 2^-149, the smallest number of f32, is what rounding may take from so small a value.
            let (depth, smallest) = (100.0_f32, f64::from(f32::from_bits(1)));
            let plain = 1.0 / depth.exp();
            let truth = (-100.0_f64).exp();
            Ok(Witness {
                at: "depth 100",
                found: transmittance(depth).into(),
                plain: plain.into(),
                truth,
                within: smallest,
            })
        }),
    },
    Guard {
        name: "absorbed",
        keeps: "1 - exp(-depth) by a function of its own, or by a series below SMALL_DEPTH, so that small depths keep their bits",
        files: &["src/media/transfer.rs", "shaders/media/transfer.wgsl"],
        proof: Proof::Witness(|| {
            let depth = 1e-9_f32;
            let (found, plain) = (absorbed(depth).into(), (1.0 - (-depth).exp()).into());
            let truth = absorbed(f64::from(depth));
            Ok(Witness { at: "depth 1e-9", found, plain, truth, within: truth * TEN_ROUNDINGS })
        }),
    },
    Guard {
        name: "mean-transmittance",
        keeps: "the weight of an energy-conserving step without extinction is its length: nothing is divided by 0",
        files: &["src/media/transfer.rs", "shaders/media/transfer.wgsl"],
        proof: Proof::Witness(|| {
            let depth = 0.0_f32;
            let (found, plain) = (mean_transmittance(depth).into(), (absorbed(depth) / depth).into());
            Ok(Witness { at: "depth 0", found, plain, truth: 1.0, within: 0.0 })
        }),
    },
    Guard {
        name: "phase-base",
        keeps: "the base of Henyey-Greenstein is a sum of parts that are not negative, at least (1 - |g|)^2",
        files: &["src/media/phase.rs", "shaders/media/phase.wgsl"],
        proof: Proof::Witness(|| {
            let g = 0.999_99_f32;
            let truth = henyey_greenstein_by_lack(f64::from(g), 0.0);
            let base = 1.0 + g * g - 2.0 * g;
            let plain = (1.0 - g * g) / (4.0 * std::f32::consts::PI * base.powf(1.5));
            let found = henyey_greenstein(g, 1.0).into();
            Ok(Witness {
                at: "eccentricity 0.99999, cosine 1",
                found,
                plain: plain.into(),
                truth,
                within: truth * TEN_ROUNDINGS,
            })
        }),
    },
    Guard {
        name: "anisotropy-limit",
        keeps: "materials' |g| is at most LARGEST_ANISOTROPY, as in Cycles",
        files: &["src/media/phase.rs"],
        proof: Proof::Witness(|| {
            let found = PhaseFunction::new(Phase::HenyeyGreenstein { anisotropy: 1.0 }).evaluate(1.0);
            let (plain, truth) = (henyey_greenstein(1.0, 1.0), henyey_greenstein(0.999, 1.0));
            Ok(Witness { at: "a material of anisotropy 1, forwards", found, plain, truth, within: truth * 1e-12 })
        }),
    },
    Guard {
        name: "isotropic",
        keeps: "|g| below SMALLEST_ANISOTROPY is isotropic, as in Cycles",
        files: &["src/media/phase.rs", "shaders/media/phase.wgsl"],
        proof: Proof::Witness(|| {
            let (found, plain) = (henyey_greenstein(5e-4, 1.0), henyey_greenstein_by_lack(5e-4, 0.0));
            let truth = 0.25 * std::f64::consts::FRAC_1_PI;
            Ok(Witness {
                at: "eccentricity 5e-4, which Cycles takes as 0, cosine 1",
                found,
                plain,
                truth,
                within: 1e-15,
            })
        }),
    },
    Guard {
        name: "sampled-cosine",
        keeps: "no division by a small g, no difference of nearly equal numbers for g < 0, and a clamp to -1 .. 1",
        files: &["src/media/phase.rs", "shaders/media/phase.wgsl"],
        proof: Proof::Witness(|| {
            let (g, uniform) = (1.1e-3_f32, 0.3_f32);
            let ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * uniform);
            let plain = (1.0 + g * g - ratio * ratio) / (2.0 * g);
            let truth = sample_henyey_greenstein(f64::from(g), f64::from(uniform));
            Ok(Witness {
                at: "eccentricity 1.1e-3, uniform number 0.3",
                found: sample_henyey_greenstein(g, uniform).into(),
                plain: plain.into(),
                truth,
                within: TEN_ROUNDINGS,
            })
        }),
    },
    Guard {
        name: "compressed-depth",
        keeps: "a compressed depth by a quotient without differences, of a root whose base stays within f32",
        files: &["src/engines/light/terms.rs", "shaders/engines/light/terms.wgsl"],
        proof: Proof::Witness(|| {
            let (compression, depth) = (1e-6_f32, 1e-3_f32);
            let plain = ((1.0 + 2.0 * compression * depth).sqrt() - 1.0) / compression;
            let truth = compressed(f64::from(compression), f64::from(depth));
            Ok(Witness {
                at: "depth 1e-3, compression 1e-6",
                found: compressed(compression, depth).into(),
                plain: plain.into(),
                truth,
                within: truth * TEN_ROUNDINGS,
            })
        }),
    },
    Guard {
        name: "silver-lining",
        keeps: "a power is taken of positive cosines only",
        files: &["src/engines/light/terms.rs", "shaders/engines/light/terms.wgsl"],
        proof: Proof::Witness(|| {
            let (found, plain) = (silver(1.0_f32, 0.5, -0.5).into(), (-0.5_f32).powf(0.5).into());
            Ok(Witness { at: "cosine -0.5, exponent 0.5", found, plain, truth: 0.0, within: 0.0 })
        }),
    },
    Guard {
        name: "parallel-rays",
        keeps: "a ray that runs in a face is inside; nothing is divided by a direction's 0",
        files: &["src/media/region.rs", "shaders/engines/march.wgsl"],
        proof: Proof::Witness(|| {
            let region = Region { low: DVec3::splat(-1.0), high: DVec3::splat(1.0) };
            let (origin, direction) = (DVec3::new(-1.0, 0.0, -5.0), DVec3::Z);
            let [low, high] = [region.low, region.high].map(|corner| (corner - origin) / direction);
            let (enter, leave) = (low.min(high).max_element(), low.max(high).min_element());
            let plain = if enter < leave { enter } else { f64::NAN };
            let found = region.segment(origin, direction).map_or(f64::NAN, |(enter, _)| enter);
            Ok(Witness { at: "a ray in the face x = -1 of a box, 4 before it", found, plain, truth: 4.0, within: 0.0 })
        }),
    },
    Guard {
        name: "ray-inside",
        keeps: "engines march from where a ray enters the box, found in f64, with a direction of length 1; what misses or \
                grazes has length 0",
        files: &["src/engines/march/mod.rs"],
        proof: Proof::Witness(|| {
            let (half, far) = (0.5, 1e6);
            let direction = DVec3::new(0.6, -0.3, 0.7).normalize();
            let outline = Outline::Box(Region { low: DVec3::splat(-half), high: DVec3::splat(half) });
            let ray = RealTimeRay { origin: -direction * far, way: direction, direction, jitter: 0.5, farthest: 1e9 };
            // Towards the middle: the ray enters through the face across the axis that it follows most.
            let entry = -direction * (half / direction.abs().max_element());
            let (origin, way) = (ray.origin.as_vec3(), direction.as_vec3());
            let [low, high] = [-0.5_f32, 0.5].map(|side| (Vec3::splat(side) - origin) / way);
            let plain = origin + way * low.min(high).max_element();
            Ok(Witness {
                at: "how far off a ray enters a box of side 1 that is 1e6 away",
                found: ray.inside(&outline).origin.distance(entry),
                plain: plain.as_dvec3().distance(entry),
                truth: 0.0,
                // f64 holds places 1e6 away to 2^-34.
                within: 1e-9,
            })
        }),
    },
    Guard {
        name: "unit-direction",
        keeps: "a direction is divided by its largest part before it is squared",
        files: &["src/engines/domain.rs", "src/engines/light/mod.rs"],
        proof: Proof::Witness(|| {
            let short = DVec3::new(0.0, 0.0, 1e-200);
            let found = unit(short).map_or(f64::NAN, |direction| direction.z);
            Ok(Witness {
                at: "a direction of length 1e-200",
                found,
                plain: (short / short.length_squared().sqrt()).z,
                truth: 1.0,
                within: 0.0,
            })
        }),
    },
    Guard {
        name: "camera-scale",
        keeps: "the axes of cameras and lights are normalised: their scale has no effect",
        files: &["src/view/camera.rs", "src/view/lights.rs"],
        proof: Proof::Pictures("scaling the axes of camera and sun by 2^-20 moves no bit of a picture"),
    },
    Guard {
        name: "near-clip",
        keeps: "a ray begins at the near clip, not behind the camera",
        files: &["src/integrators/march/mod.rs"],
        proof: Proof::Pictures(
            "a camera inside a homogeneous medium sees as much of it as lies between near clip and wall",
        ),
    },
    Guard {
        name: "relative-places",
        keeps: "places of the adapter are relative to the middle of the box: scenes far from the origin keep their accuracy",
        files: &["src/integrators/march/gpu.rs", "src/integrators/path/gpu.rs"],
        proof: Proof::Pictures("a scene 10^6 from the origin looks on the adapter as on the CPU"),
    },
    Guard {
        name: "loop-budget",
        keeps: "a dispatch of a software adapter ends before the adapter ends its loops in silence",
        files: &["src/engines/march/gpu.rs", "src/integrators/march/gpu.rs", "src/integrators/path/gpu.rs"],
        proof: Proof::Pictures("10,000 steps, with 24 towards the sun each, are all taken on a software adapter"),
    },
    Guard {
        name: "safe-division",
        keeps: "nodes that divide by 0 give 0, as in Cycles",
        files: &["src/nodes/real.rs", "shaders/nodes/shared/numeric.wgsl"],
        proof: Proof::Witness(|| {
            let (found, plain) = (Real::safe_divide(1.0_f32, 0.0).into(), (1.0_f32 / 0.0).into());
            Ok(Witness { at: "1 / 0", found, plain, truth: 0.0, within: 0.0 })
        }),
    },
    Guard {
        name: "safe-power",
        keeps: "the power of a negative number to a fraction, and of 0, is 0, as in Cycles",
        files: &["src/nodes/real.rs", "shaders/nodes/shared/numeric.wgsl"],
        proof: Proof::Witness(|| {
            let (found, plain) = (Real::safe_power(-2.0_f32, 0.5).into(), (-2.0_f32).powf(0.5).into());
            Ok(Witness { at: "-2 to the power 0.5", found, plain, truth: 0.0, within: 0.0 })
        }),
    },
    Guard {
        name: "negative-density",
        keeps: "a density below 0 acts as 0; NaN stays to be seen",
        files: &["src/media/density.rs", "shaders/integrators/march/march.wgsl", "shaders/integrators/path/path.wgsl"],
        proof: Proof::Witness(|| {
            let found = Uniform::new(-4.0, [1.0; 3]).value()?;
            Ok(Witness { at: "a density of -4", found, plain: -4.0, truth: 0.0, within: 0.0 })
        }),
    },
];

/// The guards that rows name, with what their witnesses say now.
pub(super) fn described(rows: &[Judgement]) -> Result<Vec<Described>> {
    let mut found: Vec<Described> = Vec::new();
    for name in rows.iter().flat_map(|row| &row.guards) {
        if found.iter().any(|known| known.name == *name) {
            continue;
        }
        let guard = GUARDS.iter().find(|guard| guard.name == name).ok_or_else(|| {
            Error::new(
                "the stability table",
                format!("the guard \"{name}\""),
                "a guard that is listed with what shows it at work",
                "This is a defect of the program: add the guard to src/measure/stability/guards.rs.",
            )
        })?;
        let (shown_by, holds) = match guard.proof {
            Proof::Witness(witness) => witness().map(|witness| (witness.to_string(), witness.holds()))?,
            Proof::Pictures(what) => (format!("test: {what}"), true),
        };
        let files = guard.files.iter().map(|&file| file.to_owned()).collect();
        found.push(Described { name: guard.name.into(), keeps: guard.keeps.into(), files, shown_by, holds });
    }
    Ok(found)
}
