//! The published engine's parameters, presets and light, under the names of this program.
//!
//! Defaults are those that its document calls mandatory, but for the mask, whose documented settings divide by zero: there they are
//! the values that the mask itself begins with, the only ones with which it works as published.

use crate::base::error::Result;
use crate::engines::defects::Defects;
use crate::engines::light::terms::Terms;
use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, ShadowMarch, SourceFactor, Sun, TwoLobes};
use crate::engines::march::{Leftover, RealTimeSettings};
use crate::engines::parameters::{DERIVED, Parameter, Range, Values, parameter};
use crate::engines::passes::compositing::Compositing;
use crate::engines::passes::god_rays::GodRays;
use crate::engines::perlin_fbm::TINT;
use crate::engines::perlin_fbm::defects;
use crate::media::transfer::Integration;
use crate::nodes::perlin_fbm::bake::{Bake, LARGEST, MOST_OCTAVES};
use crate::nodes::perlin_fbm::mask::{Deformation, Mask};
use crate::nodes::perlin_fbm::noise::Octaves;
use crate::nodes::perlin_fbm::{Evaluation, Parameters};

const BOX_SIDES: &str = "sides of the box";
const PERIODS: &str = "periods of the texture";
const SPEED: &str = "periods per second";
const FLAT: &str = "factor on the radius; not above 0 divides by zero in the original";
const UNIT: Range = Range::Between(0.0, 1.0);

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter(
        "texture_size",
        96.0,
        Range::Whole(2, LARGEST as u32),
        [32.0, 256.0],
        "texels",
        "texels of the volume per axis",
    ),
    parameter("coverage", 0.55, UNIT, [0.0, 1.0], "", "centre of the threshold on the noise"),
    parameter("softness", 0.05, Range::Positive, [1e-3, 0.5], "", "half width of the threshold"),
    parameter("noise_scale", 3.5, Range::Positive, [0.5, 12.0], "units of noise", "noise across the box"),
    parameter("octaves", 5.0, Range::Whole(1, MOST_OCTAVES), [1.0, 8.0], "", "octaves of noise"),
    parameter("persistence", 0.5, UNIT, [0.0, 1.0], "", "amplitude of an octave over that of the one before"),
    parameter("lacunarity", 3.0, Range::Positive, [1.1, 4.0], "", "frequency of an octave over that of the one before"),
    parameter("intensity", 1.0, Range::Positive, [0.2, 4.0], "", "exponent on the noise before the threshold"),
    parameter("seed", 42.0, Range::Any, [0.0, 1000.0], "", "seed of the noise (the original's is random)"),
    parameter("mask_radius", 0.52, Range::Any, [0.0, 1.2], BOX_SIDES, "radius of the mask; not above 0: no cloud"),
    parameter("mask_softness", 0.17, Range::Positive, [0.01, 1.0], BOX_SIDES, "distance over which the mask fades in"),
    parameter("flatten_top", 0.7, Range::Any, [0.0, 2.0], "", FLAT),
    parameter("flatten_bottom", 0.3, Range::Any, [0.0, 2.0], "", FLAT),
    parameter("flatten_x_positive", 0.9, Range::Any, [0.0, 2.0], "", FLAT),
    parameter("flatten_x_negative", 0.9, Range::Any, [0.0, 2.0], "", FLAT),
    parameter("flatten_z_positive", 0.9, Range::Any, [0.0, 2.0], "", FLAT),
    parameter("flatten_z_negative", 0.9, Range::Any, [0.0, 2.0], "", FLAT),
    parameter("mask_seed", DERIVED, Range::Any, [0.0, 1000.0], "", "seed of the main deformation; not given: seed"),
    parameter("noise_strength", 0.05, Range::Any, [0.0, 0.3], BOX_SIDES, "largest main deformation"),
    parameter("noise_frequency", 2.7, Range::Any, [0.0, 20.0], "units of noise", "main deformation in the radius"),
    parameter(
        "detail_seed",
        DERIVED,
        Range::Any,
        [0.0, 1000.0],
        "",
        "seed of the fine deformation; not given: seed + 10",
    ),
    parameter("detail_strength", 0.036, Range::Any, [0.0, 0.2], BOX_SIDES, "largest fine deformation"),
    parameter("detail_frequency", 10.5, Range::Any, [0.0, 40.0], "units of noise", "fine deformation in the radius"),
    parameter("tiling", 2.0, Range::Positive, [0.5, 6.0], PERIODS, "texture across the box"),
    parameter("threshold", 0.0, UNIT, [0.0, 1.0], "", "texel values below it are empty"),
    parameter("density_multiplier", 50.0, Range::NotNegative, [0.0, 200.0], "", "density of a texel of value 1"),
    parameter("opacity", 6.0, Range::NotNegative, [0.0, 20.0], "per side of the box", "extinction per unit of density"),
    parameter("speed_x", 0.02, Range::Any, [-0.1, 0.1], SPEED, "motion of the texture, the mask stays"),
    parameter("speed_y", 0.0, Range::Any, [-0.1, 0.1], SPEED, "motion of the texture, the mask stays"),
    parameter("speed_z", 0.01, Range::Any, [-0.1, 0.1], SPEED, "motion of the texture, the mask stays"),
    parameter("show_mask", 0.0, Range::Whole(0, 1), [0.0, 0.0], "", "1: the mask alone, every texel counts as 1"),
    parameter("exact", 0.0, Range::Whole(0, 1), [0.0, 0.0], "", "1: noise at each place instead of textures; CPU only"),
    parameter("march_steps", 44.0, Range::Whole(1, 100_000), [1.0, 128.0], "", "steps of a view ray"),
    parameter("light_steps", 1.0, Range::Whole(1, 1000), [1.0, 8.0], "", "steps towards the sun"),
    parameter("god_ray_density", 0.96, Range::NotNegative, [0.0, 1.0], "", "factor on the god rays"),
    parameter("god_ray_decay", 0.95, UNIT, [0.5, 1.0], "", "weight of a read over that of the one before"),
    parameter("god_ray_weight", 0.5, Range::NotNegative, [0.0, 1.0], "", "weight of the first read"),
    parameter("god_ray_exposure", 0.6, Range::NotNegative, [0.0, 1.0], "", "another factor on the god rays"),
    parameter("god_ray_samples", 100.0, Range::Whole(1, 10_000), [1.0, 128.0], "", "reads per pixel"),
    parameter("albedo", 1.0, UNIT, [0.0, 1.0], "", "single-scattering albedo; without defect PF-5 only"),
];

/// Levels of quality as the engine names them. The engine applies one always, so that its mandatory 44 steps and 1 become 30 and 2
/// (defect PF-12).
pub const QUALITIES: &[(&str, &[(&str, f64)])] = &[
    ("low", &[("texture_size", 64.0), ("march_steps", 20.0), ("light_steps", 1.0), ("god_ray_samples", 60.0)]),
    ("medium", &[("texture_size", 96.0), ("march_steps", 30.0), ("light_steps", 2.0), ("god_ray_samples", 80.0)]),
    ("high", &[("texture_size", 128.0), ("march_steps", 44.0), ("light_steps", 4.0), ("god_ray_samples", 120.0)]),
];

/// The mask's settings as the document states them: four of its flattenings are 0.
pub const DOCUMENTED_MASK: &[(&str, f64)] = &[
    ("mask_radius", 1.0),
    ("mask_softness", 0.5),
    ("flatten_top", 0.0),
    ("flatten_bottom", 0.0),
    ("flatten_x_positive", 0.0),
    ("flatten_x_negative", 0.0),
    ("flatten_z_positive", 0.0),
    ("flatten_z_negative", 0.0),
    ("noise_strength", 0.1),
    ("noise_frequency", 1.0),
    ("detail_strength", 0.05),
    ("detail_frequency", 2.0),
];

/// What the original adds to the seed for its fine deformation.
const DETAIL_SEED: f64 = 10.0;

/// What makes the density with the defects that are `kept`, after `seconds` of animation, and what is to be said about it: each defect of
/// the parameters by name.
pub fn parameters(values: &Values, kept: &Defects, seconds: f64) -> Result<(Parameters, Vec<String>)> {
    let get = |name: &str| values.get(name);
    let mut warnings = Vec::new();
    let mut radius = get("mask_radius");
    let mut flattening = |name: &str| {
        let value = get(name);
        if value > 0.0 {
            return value;
        }
        let outcome = if kept.has(&defects::FLATTENING_BY_ZERO) {
            radius = 0.0;
            "as published there is no cloud"
        } else {
            "it counts as 1, no flattening"
        };
        warnings.push(format!("parameter {name} is {value}, which divides by zero: {outcome} (defect PF-1)"));
        1.0
    };
    let flattening = [
        ["flatten_x_negative", "flatten_bottom", "flatten_z_negative"].map(&mut flattening),
        ["flatten_x_positive", "flatten_top", "flatten_z_positive"].map(&mut flattening),
    ];
    // The engine hands its seed, and the seed plus 10, to the mask. The original makes the mask's textures once, from what its mask
    // begins with, so that they never arrive.
    let seed = get("seed");
    let wanted = [
        Deformation {
            seed: values.given("mask_seed").unwrap_or(seed),
            strength: get("noise_strength"),
            frequency: get("noise_frequency"),
        },
        Deformation {
            seed: values.given("detail_seed").unwrap_or(seed + DETAIL_SEED),
            strength: get("detail_strength"),
            frequency: get("detail_frequency"),
        },
    ];
    let first = Mask::default().deformations;
    let deformations = std::array::from_fn(|number| match kept.has(&defects::MASK_NOISE_KEPT) {
        true => Deformation { strength: wanted[number].strength, ..first[number] },
        false => wanted[number],
    });
    let offset = ["speed_x", "speed_y", "speed_z"].map(|name| (get(name) * seconds).rem_euclid(1.0));
    let parameters = Parameters {
        bake: Bake {
            coverage: get("coverage"),
            softness: get("softness"),
            noise_scale: get("noise_scale"),
            octaves: Octaves {
                count: get("octaves") as u32,
                persistence: get("persistence"),
                lacunarity: get("lacunarity"),
            },
            intensity: get("intensity"),
            seed,
        },
        texture_size: get("texture_size") as usize,
        mask: Mask {
            radius,
            softness: get("mask_softness"),
            flattening,
            deformations,
            reads_textures: !kept.has(&defects::MASK_NOT_UPLOADED),
        },
        tiling: get("tiling"),
        offset,
        threshold: get("threshold"),
        density_multiplier: get("density_multiplier"),
        shows_mask: get("show_mask") == 1.0,
        evaluation: if get("exact") == 1.0 { Evaluation::Exact } else { Evaluation::Baked },
    };
    if kept.has(&defects::SOURCE_OF_DENSITY) && get("opacity") * TINT[0] < 1.0 {
        warnings.push(format!(
            "parameter opacity is {}: as published the albedo is 1 / (opacity x {}), above 1 in red (defect PF-5)",
            get("opacity"),
            TINT[0]
        ));
    }
    Ok((parameters, warnings))
}

/// The engine's light: a white sun of intensity 1 from (1, 1, 1), an ambient radiance of 0.3, two lobes.
pub fn light(values: &Values, kept: &Defects) -> LightModel {
    let (shadow_length, extinction) = if kept.has(&defects::SHORT_SHADOW) {
        (ShadowLength::Fixed(1.0), ShadowExtinction::Density)
    } else {
        (ShadowLength::ToExit, ShadowExtinction::View)
    };
    let source = if kept.has(&defects::SOURCE_OF_DENSITY) {
        SourceFactor::Density
    } else {
        SourceFactor::Albedo([values.get("albedo"); 3])
    };
    LightModel {
        suns: vec![Sun { direction: [1.0; 3], irradiance: [1.0; 3] }],
        ambient: [0.3; 3],
        phase: TwoLobes::new([-0.3, 0.3], 0.8),
        shadow: ShadowMarch::new(values.get("light_steps") as u32, shadow_length, extinction),
        source,
        terms: Terms::NONE,
    }
}

/// Extinction per unit of density, tint and side of the box.
pub fn opacity(values: &Values) -> Result<f64> {
    let opacity = values.get("opacity");
    crate::nodes::perlin_fbm::finite("opacity", opacity)?;
    Ok(opacity)
}

/// How the engine marches.
pub fn march(values: &Values, kept: &Defects) -> RealTimeSettings {
    let is_plain = kept.has(&defects::PLAIN_SUM);
    RealTimeSettings {
        steps: values.get("march_steps") as u32,
        integration: if is_plain { Integration::Plain } else { Integration::EnergyConserving },
        growth: 1.0,
        exit_fade: kept.has(&defects::EXIT_FADE),
        least_density: 0.01,
        least_transmittance: 0.01,
        leftover: Leftover::Kept,
        distance_levels: None,
        doubled_start: false,
    }
}

/// How the engine's pixels are put over a background.
pub fn compositing(kept: &Defects) -> Compositing {
    Compositing { alpha_of_red: kept.has(&defects::ALPHA_OF_RED), alpha_twice: kept.has(&defects::ALPHA_TWICE) }
}

/// The engine's god rays.
pub fn god_rays(values: &Values, kept: &Defects) -> GodRays {
    GodRays {
        density: values.get("god_ray_density"),
        decay: values.get("god_ray_decay"),
        weight: values.get("god_ray_weight"),
        exposure: values.get("god_ray_exposure"),
        samples: values.get("god_ray_samples") as u32,
        reach: 1.0,
        centre: 0.0,
        from_behind: kept.has(&defects::GOD_RAYS_FROM_BEHIND),
    }
}
