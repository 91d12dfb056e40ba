//! What keeps the integrators finite and accurate, each with its place in the code and the test that covers it.
//!
//! Tests of the suite read the sources and fail where a guard or its test is gone.

use crate::base::error::{Error, Result};
use crate::measure::stability::Judgement;
use serde::{Deserialize, Serialize};

/// A guard in the code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Guard {
    /// Name in the table.
    pub name: &'static str,
    /// What it does, in a sentence.
    pub keeps: &'static str,
    /// Files and the text in each that is the guard.
    pub places: &'static [(&'static str, &'static str)],
    /// File and name of the test that covers it.
    pub test: (&'static str, &'static str),
}

/// A guard as files hold it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Described {
    /// See [`Guard::name`].
    pub name: String,
    /// See [`Guard::keeps`].
    pub keeps: String,
    /// Files, and what is looked for in each.
    pub place: String,
    /// Name of the test.
    pub test: String,
    /// Its file.
    pub test_place: String,
}

/// All guards.
pub const GUARDS: &[Guard] = &[
    Guard {
        name: "exponential",
        keeps: "only exp(-depth) of a depth that is not negative is taken: it falls to 0 and never overflows",
        places: &[
            ("src/media/transfer.rs", "pub fn transmittance"),
            ("shaders/media/transfer.wgsl", "fn transmittance"),
        ],
        test: ("src/media/transfer.rs", "an_opaque_step_weighs_a_mean_free_path"),
    },
    Guard {
        name: "absorbed",
        keeps: "1 - exp(-depth) by a function of its own, or by a series below SMALL_DEPTH, so that small depths keep their bits",
        places: &[("src/media/transfer.rs", "exp_m1()"), ("shaders/media/transfer.wgsl", "const SMALL_DEPTH")],
        test: ("src/media/transfer.rs", "a_step_without_extinction_weighs_its_length"),
    },
    Guard {
        name: "mean-transmittance",
        keeps: "the weight of an energy-conserving step without extinction is its length: nothing is divided by 0",
        places: &[
            ("src/media/transfer.rs", "if depth < constant(NO_DEPTH)"),
            ("shaders/media/transfer.wgsl", "series(depth), depth < vec3f(SMALL_DEPTH)"),
        ],
        test: ("src/media/transfer.rs", "a_step_without_extinction_weighs_its_length"),
    },
    Guard {
        name: "phase-base",
        keeps: "the base of Henyey-Greenstein is a sum of parts that are not negative, at least (1 - |g|)^2",
        places: &[
            ("src/media/phase.rs", "let base = least * least"),
            ("shaders/media/phase.wgsl", "let base = least * least"),
        ],
        test: ("src/media/phase.rs", "the_base_stays_positive_for_cosines_beyond_one"),
    },
    Guard {
        name: "anisotropy-limit",
        keeps: "materials' |g| is at most LARGEST_ANISOTROPY, as in Cycles",
        places: &[("src/media/phase.rs", "fn limited(")],
        test: ("src/media/phase.rs", "the_base_stays_positive_for_cosines_beyond_one"),
    },
    Guard {
        name: "isotropic",
        keeps: "|g| below SMALLEST_ANISOTROPY is isotropic, as in Cycles",
        places: &[
            ("src/media/phase.rs", "const SMALLEST_ANISOTROPY"),
            ("shaders/media/phase.wgsl", "const SMALLEST_ANISOTROPY"),
        ],
        test: ("src/media/phase.rs", "sampled_cosines_stay_within_one_for_every_eccentricity"),
    },
    Guard {
        name: "sampled-cosine",
        keeps: "no division by a small g, no difference of nearly equal numbers for g < 0, and a clamp to -1 .. 1",
        places: &[
            ("src/media/phase.rs", "const SMALL_ANISOTROPY"),
            ("shaders/media/phase.wgsl", "const SMALL_ANISOTROPY"),
        ],
        test: ("src/media/phase.rs", "sampled_cosines_stay_within_one_for_every_eccentricity"),
    },
    Guard {
        name: "compressed-depth",
        keeps: "a compressed depth by a quotient without differences, of a root whose base stays within f32",
        places: &[
            ("src/engines/light/terms.rs", "const LARGEST_COMPRESSED"),
            ("shaders/engines/light/terms.wgsl", "min(2.0 * compression * depth, vec3f(1e38))"),
        ],
        test: ("tests/light_terms.rs", "compressed_depths_are_as_they_are_when_small_and_roots_when_large"),
    },
    Guard {
        name: "silver-lining",
        keeps: "a power is taken of positive cosines only",
        places: &[
            ("src/engines/light/terms.rs", "cosine.max(T::zero())"),
            ("shaders/engines/light/terms.wgsl", "if cosine <= 0.0"),
        ],
        test: ("tests/stability.rs", "every_kernel_is_finite_and_within_its_bound"),
    },
    Guard {
        name: "parallel-rays",
        keeps: "a ray that runs in a face is inside; nothing is divided by a direction's 0",
        places: &[
            ("src/media/region.rs", "if direction[axis] == 0.0"),
            ("shaders/engines/march.wgsl", "if way[axis] == 0.0"),
        ],
        test: ("src/media/region.rs", "a_ray_crosses_a_box_at_its_faces"),
    },
    Guard {
        name: "ray-inside",
        keeps: "engines march from where a ray enters the box, found in f64, with a direction of length 1; what misses or \
                grazes has length 0",
        places: &[("src/engines/march/mod.rs", "pub fn inside(&self, outline: &Outline)")],
        test: ("src/engines/march/mod.rs", "rays_of_any_length_and_start_cross_alike"),
    },
    Guard {
        name: "unit-direction",
        keeps: "a direction is divided by its largest part before it is squared",
        places: &[("src/engines/domain.rs", "pub fn unit("), ("src/engines/light/mod.rs", "pub fn towards")],
        test: ("src/engines/march/mod.rs", "rays_of_any_length_and_start_cross_alike"),
    },
    Guard {
        name: "camera-scale",
        keeps: "the axes of cameras and lights are normalised: their scale has no effect",
        places: &[
            ("src/view/camera.rs", "column.truncate().normalize()"),
            ("src/view/lights.rs", "matrix.z_axis.truncate().normalize()"),
        ],
        test: ("tests/stability.rs", "the_scale_of_camera_and_sun_changes_nothing"),
    },
    Guard {
        name: "near-clip",
        keeps: "a ray begins at the near clip, not behind the camera",
        places: &[("src/integrators/march/mod.rs", "let start = enter.max(ray.near)")],
        test: ("tests/stability.rs", "the_suite_holds_on_the_committed_cloud"),
    },
    Guard {
        name: "relative-places",
        keeps: "places of the adapter are relative to the middle of the box: scenes far from the origin keep their accuracy",
        places: &[
            ("src/integrators/march/gpu.rs", "ray.origin - self.middle"),
            ("src/integrators/path/gpu.rs", "path.origin - self.middle"),
        ],
        test: ("tests/stability.rs", "a_scene_far_from_the_origin_looks_the_same_on_the_adapter"),
    },
    Guard {
        name: "loop-budget",
        keeps: "a dispatch of a software adapter ends before the adapter ends its loops in silence",
        places: &[
            ("src/engines/march/gpu.rs", "fn steps_together("),
            ("src/integrators/march/gpu.rs", "const SOFTWARE_STEPS"),
            ("src/integrators/path/gpu.rs", "const SOFTWARE_BUDGETS"),
        ],
        test: ("tests/stability.rs", "ten_thousand_steps_are_taken_on_the_adapter"),
    },
    Guard {
        name: "safe-division",
        keeps: "nodes that divide by 0 give 0, as in Cycles",
        places: &[("src/nodes/real.rs", "fn safe_divide"), ("shaders/nodes/shared/numeric.wgsl", "fn safe_divide")],
        test: ("src/nodes/real.rs", "divisions_and_powers_that_are_undefined_are_zero"),
    },
    Guard {
        name: "safe-power",
        keeps: "the power of a negative number to a fraction, and of 0, is 0, as in Cycles",
        places: &[("src/nodes/real.rs", "fn safe_power"), ("shaders/nodes/shared/numeric.wgsl", "fn safe_pow")],
        test: ("src/nodes/real.rs", "divisions_and_powers_that_are_undefined_are_zero"),
    },
    Guard {
        name: "negative-density",
        keeps: "a density below 0 acts as 0; NaN stays to be seen",
        places: &[
            ("src/media/density.rs", "if *value < 0.0"),
            ("shaders/integrators/march/march.wgsl", "select(value, 0.0, value < 0.0)"),
            ("shaders/integrators/path/path.wgsl", "select(value, 0.0, value < 0.0)"),
        ],
        test: ("tests/stability.rs", "the_suite_holds_on_the_committed_cloud"),
    },
];

/// The guards that rows name.
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
                "a guard that is listed with its place and test",
                "This is a defect of the program: add the guard to src/measure/stability/guards.rs.",
            )
        })?;
        let places: Vec<String> = guard.places.iter().map(|(file, text)| format!("`{text}` in {file}")).collect();
        found.push(Described {
            name: guard.name.into(),
            keeps: guard.keeps.into(),
            place: places.join(", "),
            test: guard.test.1.into(),
            test_place: guard.test.0.into(),
        });
    }
    Ok(found)
}
