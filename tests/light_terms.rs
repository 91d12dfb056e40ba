//! Terms of light models against closed forms of published systems, where their values are there, and against limits that hold always.

mod support;

use cloudparity::engines::defects::Defects;
use cloudparity::engines::light::models;
use cloudparity::engines::light::terms::{Boost, Octaves, Powder, SilverLining, Terms, ray_powder};
use cloudparity::engines::light::{LightModel, TwoLobes};
use cloudparity::engines::parameters::Values;
use cloudparity::engines::perlin_fbm::settings;
use cloudparity::media::transfer::Integration;
use cloudparity::media::transfer::step_weight;
use support::published::{numbers, published};

/// A few roundings of f64 each.
const ROUNDING: f64 = 1e-12;

fn light(octaves: Octaves, phase: TwoLobes) -> LightModel {
    let mut light = settings::light(&Values::defaults(settings::PARAMETERS), &Defects::NONE);
    light.terms.octaves = octaves;
    light.phase = phase;
    light
}

fn close(found: f64, expected: f64, tolerance: f64, place: &str) {
    assert!((found - expected).abs() <= tolerance * expected.abs().max(1e-3), "{place}: {found}, not {expected}");
}

#[test]
fn eight_octaves_are_those_of_takram() {
    let Some(golden) = published("takram_octaves") else { return };
    let phase = TwoLobes::new([0.7, -0.2], 0.5);
    let (depths, cosines) = (numbers(&golden["tau"]), numbers(&golden["mu"]));
    let octaves = |count| Octaves { count, contribution: 0.5, attenuation: 0.5, eccentricity: 0.5, compression: 0.0 };
    for (depth, row) in depths.iter().zip(golden["value"].as_array().expect("rows")) {
        for (&cosine, expected) in cosines.iter().zip(numbers(row)) {
            let light = light(octaves(8), phase);
            let found = light.terms.octaves.sum(&light.weights(cosine), *depth);
            // Phase functions below a mean cosine of 0.001 do not occur: 0.2 / 2^7 is above it.
            close(found, expected, ROUNDING, &format!("depth {depth}, cosine {cosine}"));
        }
    }
    for (count, row) in numbers(&golden["octave_counts"]).iter().zip(golden["value_mu0"].as_array().expect("rows")) {
        for (&depth, expected) in depths.iter().zip(numbers(row)) {
            let light = light(octaves(*count as u32), phase);
            let found = light.terms.octaves.sum(&light.weights(0.0), depth);
            close(found, expected, ROUNDING, &format!("{count} octaves, depth {depth}"));
        }
    }
}

#[test]
fn four_octaves_are_those_of_bestclouds() {
    let Some(golden) = published("multiple_octaves") else { return };
    let octaves = Octaves { count: 4, contribution: 0.5, attenuation: 0.25, eccentricity: 0.5, compression: 0.0 };
    let light = light(octaves, TwoLobes::new([-0.1, 0.3], 0.7));
    let (extinctions, cosines, steps) =
        (numbers(&golden["extinction"]), numbers(&golden["mu"]), numbers(&golden["step"]));
    for (extinction, of_cosine) in extinctions.iter().zip(golden["octave_sum"].as_array().expect("rows")) {
        for (&cosine, of_step) in cosines.iter().zip(of_cosine.as_array().expect("rows")) {
            for (step, expected) in steps.iter().zip(numbers(of_step)) {
                let found = light.terms.octaves.sum(&light.weights(cosine), extinction * step);
                // The original's 4 pi is 4 times 3.1415, 3e-5 less.
                close(found, expected, 4e-5, &format!("extinction {extinction}, cosine {cosine}, step {step}"));
            }
        }
    }
}

#[test]
fn powder_and_silver_lining_are_the_published_ones() {
    let Some(golden) = published("light_terms") else { return };
    let powder = Powder { strength: 1.0, length: 2.0, ambient: 1.0 };
    for (density, expected) in numbers(&golden["density"]).iter().zip(numbers(&golden["powder_2"])) {
        close(powder.factor(*density), expected, ROUNDING, &format!("powder at {density}"));
    }
    let powder = Powder { strength: 0.8, length: 150.0, ambient: 1.0 };
    let takram = &golden["takram_powder"];
    for (extinction, expected) in numbers(&takram["extinction"]).iter().zip(numbers(&takram["factor"])) {
        close(powder.factor(*extinction), expected, ROUNDING, &format!("powder at {extinction}"));
    }
    let silver = SilverLining { strength: 1.0, exponent: 8.0 };
    for (cosine, expected) in numbers(&golden["cosine"]).iter().zip(numbers(&golden["silver_pow8"])) {
        close(silver.value(*cosine), expected, ROUNDING, &format!("silver lining at {cosine}"));
    }
}

/// Published values of phase functions are relative to 1e-12; near the peak of g = 0.99 theirs loses digits of the base 1 + g^2 - 2 g c,
/// 2^-52 of 2 over (1 - g)^2, to the power of 3/2.
fn peak_rounding(anisotropy: f64) -> f64 {
    ROUNDING + 3.0 * f64::EPSILON / (1.0 - anisotropy.abs()).powi(2)
}

#[test]
fn phase_functions_are_the_published_ones() {
    for (name, alpha) in [("phase_hg", 0.0), ("phase_cornette_shanks", 1.0)] {
        let Some(golden) = published(name) else { return };
        let cosines = numbers(&golden["mu"]);
        for (g, row) in numbers(&golden["g"]).iter().zip(golden["value"].as_array().expect("rows")) {
            let phase = TwoLobes { alpha: [alpha; 2], ..TwoLobes::new([*g; 2], 0.0) };
            for (&cosine, expected) in cosines.iter().zip(numbers(row)) {
                let tolerance = peak_rounding(*g) * expected.max(1.0) / expected.clamp(1e-3, 1.0);
                close(phase.evaluate(cosine), expected, tolerance, &format!("{name} {g} at {cosine}"));
            }
        }
    }
    let golden = published("phase_rayleigh").expect("the others are there");
    let rayleigh = TwoLobes { alpha: [1.0; 2], ..TwoLobes::new([0.0; 2], 0.0) };
    for (&cosine, expected) in numbers(&golden["mu"]).iter().zip(numbers(&golden["value"])) {
        close(rayleigh.evaluate(cosine), expected, ROUNDING, &format!("Rayleigh at {cosine}"));
    }
    let golden = published("phase_double_hg").expect("the others are there");
    for set in golden["sets"].as_array().expect("sets") {
        let number = |name: &str| set[name].as_f64().expect("a number");
        let (forward, backward) = (number("forward_weight"), number("backward_weight"));
        let lobes = [number("backward_g"), number("forward_g")];
        let gain = forward + backward;
        let phase = TwoLobes { gain, ..TwoLobes::new(lobes, forward / gain) };
        for (&cosine, expected) in numbers(&golden["mu"]).iter().zip(numbers(&set["value"])) {
            let tolerance = lobes.map(peak_rounding).into_iter().fold(0.0, f64::max) * expected.max(1.0)
                / expected.clamp(1e-3, 1.0);
            close(phase.evaluate(cosine), expected, tolerance, &format!("{} at {cosine}", set["name"]));
        }
        // Theirs is a quadrature of the values, as their integral, whose error shows.
        let error = (number("integral_over_sphere") - gain).abs().max(1e-9);
        let mean = number("mean_cosine");
        assert!(
            (phase.mean_cosine() - mean).abs() <= 10.0 * error
                || (gain * phase.mean_cosine() - mean).abs() <= 10.0 * error,
            "{}",
            set["name"]
        );
    }
    let golden = published("phase_hg_draine").expect("the others are there");
    let number = |name: &str| golden[name].as_f64().expect("a number");
    for (scale, row) in numbers(&golden["c"]).iter().zip(golden["value"].as_array().expect("rows")) {
        let anisotropy = [number("gH") * scale, number("gD") * scale];
        let phase = TwoLobes { alpha: [0.0, number("alpha")], ..TwoLobes::new(anisotropy, number("w")) };
        for (&cosine, expected) in numbers(&golden["mu"]).iter().zip(numbers(row)) {
            let tolerance = peak_rounding(anisotropy[0]) * expected.max(1.0) / expected.clamp(1e-3, 1.0);
            close(phase.evaluate(cosine), expected, tolerance, &format!("droplets, scale {scale}, at {cosine}"));
        }
    }
}

#[test]
fn draines_mean_cosine_is_that_of_its_values() {
    for (g, alpha) in [(0.3, 1.0), (-0.6, 1.0), (0.55, 22.0), (0.0, 1.0), (0.8, 0.0)] {
        let phase = TwoLobes { alpha: [alpha; 2], ..TwoLobes::new([g; 2], 0.0) };
        // Midpoints of 200,000 parts: an error of some 1e-9.
        let parts = 200_000;
        let step = 2.0 / f64::from(parts);
        let (mut whole, mut mean) = (0.0, 0.0);
        for number in 0..parts {
            let cosine = -1.0 + (f64::from(number) + 0.5) * step;
            let share = 2.0 * std::f64::consts::PI * phase.evaluate(cosine) * step;
            whole += share;
            mean += share * cosine;
        }
        assert!((whole - 1.0).abs() < 1e-7 && (mean - phase.mean_cosine()).abs() < 1e-7, "{g} {alpha}: {whole} {mean}");
    }
}

#[test]
fn half_powder_rim_and_light_rays_are_the_published_ones() {
    let Some(golden) = published("light_terms") else { return };
    let mut half = light(Terms::NONE.octaves, TwoLobes::new([0.0; 2], 0.0));
    models::find("half-powder").expect("a light").apply(&mut half).expect("in range");
    for (depth, expected) in numbers(&golden["density"]).iter().zip(numbers(&golden["beer_powder_half"])) {
        let weights = half.weights(0.0);
        close(
            half.terms.octaves.sum(&weights, *depth) / weights[0],
            expected,
            ROUNDING,
            &format!("half powder at {depth}"),
        );
    }
    let rim = TwoLobes { rim: 1.0, gain: 0.0, ..TwoLobes::new([0.0; 2], 0.0) };
    for (cosine, expected) in numbers(&golden["cosine"]).iter().zip(numbers(&golden["rim_as_published"])) {
        close(rim.evaluate(*cosine), expected, ROUNDING, &format!("rim at {cosine}"));
    }
    let boost = Boost { light: 0.0, ambient: 1.0, length: 1e9, by_angle: true };
    for (cosine, expected) in numbers(&golden["cosine"]).iter().zip(numbers(&golden["second_scatter"])) {
        close(boost.factors(1.0, *cosine)[1], expected, ROUNDING, &format!("second order at {cosine}"));
    }
    let golden = published("multiple_octaves").expect("the other is there");
    let octaves = Octaves { count: 4, contribution: 0.5, attenuation: 0.25, eccentricity: 0.5, compression: 0.0 };
    let light = light(octaves, TwoLobes::new([-0.1, 0.3], 0.7));
    let steps = numbers(&golden["step"]);
    for (extinction, of_cosine) in
        numbers(&golden["extinction"]).iter().zip(golden["light_ray"].as_array().expect("rows"))
    {
        for (&cosine, of_step) in numbers(&golden["mu"]).iter().zip(of_cosine.as_array().expect("rows")) {
            for (step, expected) in steps.iter().zip(numbers(of_step)) {
                let depth = extinction * step;
                let found = ray_powder(light.terms.octaves.sum(&light.weights(cosine), depth), depth, cosine);
                // Their 4 pi again.
                close(found, expected, 4e-5, &format!("extinction {extinction}, cosine {cosine}, step {step}"));
            }
        }
    }
}

/// The least extinction that the published step divides by.
const LEAST_EXTINCTION: f64 = 1e-6;

#[test]
fn steps_are_the_published_ones() {
    let Some(golden) = published("energy_step") else { return };
    for row in golden["rows"].as_array().expect("rows") {
        let row = numbers(row);
        let [scattering, absorption, density, step, red, _, _, before, added, _, _, after, plain, _, _] = row[..]
        else {
            panic!("15 columns");
        };
        let (source, extinction) = (red * scattering * density, (scattering + absorption) * density);
        // Theirs divides by an extinction of at least 1e-6, below which its step falls to nothing; ours does not, and is held to the
        // same numerator.
        let divided = extinction / extinction.max(LEAST_EXTINCTION);
        let found = before * source * step_weight(Integration::EnergyConserving, extinction, step) * divided;
        // Theirs takes the difference of 1 and an exponential, which loses the bits of a small depth: 2^-52 over it.
        let lost = f64::EPSILON / (extinction * step).max(f64::EPSILON);
        let most = found.abs().max(added.abs());
        assert!((found - added).abs() <= (ROUNDING + 4.0 * lost) * most, "{row:?}: {found}");
        close(before * source * step_weight(Integration::Plain, extinction, step), plain, ROUNDING, "plain");
        close(before * (-extinction * step).exp(), after, ROUNDING, "transmittance");
    }
}

#[test]
fn octaves_have_their_limits() {
    let phase = TwoLobes::new([0.6, -0.2], 0.3);
    let single =
        light(Octaves { count: 1, contribution: 0.5, attenuation: 0.5, eccentricity: 0.5, compression: 0.0 }, phase);
    for (depth, cosine) in [(0.0, 0.3), (1.5, -0.8), (50.0, 1.0)] {
        let found = single.terms.octaves.sum(&single.weights(cosine), depth);
        close(found, phase.evaluate(cosine) * f64::exp(-depth), ROUNDING, "one octave is single scattering");
    }
    // Octaves of equal weight, depth and shape are as many times single scattering; without depth the weights alone count.
    let same =
        light(Octaves { count: 5, contribution: 1.0, attenuation: 1.0, eccentricity: 1.0, compression: 0.0 }, phase);
    close(
        same.terms.octaves.sum(&same.weights(0.2), 2.0),
        5.0 * phase.evaluate(0.2) * (-2.0_f64).exp(),
        ROUNDING,
        "five",
    );
    let halves =
        light(Octaves { count: 16, contribution: 0.5, attenuation: 0.5, eccentricity: 1.0, compression: 0.0 }, phase);
    let geometric = 2.0 * (1.0 - 0.5_f64.powi(16));
    close(
        halves.terms.octaves.sum(&halves.weights(0.2), 0.0),
        geometric * phase.evaluate(0.2),
        ROUNDING,
        "a geometric series",
    );
}

#[test]
fn compressed_depths_are_as_they_are_when_small_and_roots_when_large() {
    let octaves = |compression| Octaves { compression, ..Terms::NONE.octaves };
    for depth in [0.0, 1e-6, 0.7, 1e6] {
        close(octaves(0.0).compressed(depth), depth, ROUNDING, "no compression");
        // t - r t^2 / 2 to second order; r t is at most 1e-4 here.
        close(octaves(1e-10).compressed(depth), depth * (1.0 - 5e-11 * depth), 1e-8, "little compression");
    }
    close(octaves(0.5).compressed(1e12), 2e6, 1e-5, "the root of 2 t / r");
    // What is compressed solves d + r d^2 / 2 = t.
    for (compression, depth) in [(0.3, 2.0), (4.0, 0.1), (1.0, 50.0)] {
        let found = octaves(compression).compressed(depth);
        close(found + compression * found * found / 2.0, depth, ROUNDING, "its equation");
    }
    assert_eq!(octaves(1e300).compressed(f64::INFINITY), f64::INFINITY);
}
