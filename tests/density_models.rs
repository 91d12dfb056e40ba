//! Density models: no parameters make a picture with a value that is no number, on the CPU and on the adapter.

mod support;

use cloudparity::engines::defects::Defects;
use cloudparity::engines::march::gpu::MarchKernel;
use cloudparity::engines::march::{RealTimePixel, RealTimeRay};
use cloudparity::engines::parameters::{Range, Values};
use cloudparity::engines::perlin_fbm::settings;
use cloudparity::gpu::Gpu;
use cloudparity::nodes::perlin_fbm::Cloud;
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use support::cloud::{Boxed, local_box};

/// Sets of parameters on the CPU, in which one wrong value would be found.
const SETS: usize = 10_000;

/// One in so many is also marched on the adapter, where each costs the compilation of a kernel; odd, for both.
const ADAPTER_EVERY: usize = 101;

/// Rays of a picture.
const RAYS: usize = 12;

/// Sets that share what makes a mask's textures, 128^3 texels each, and those that share a volume.
const SETS_OF_A_MASK: usize = 500;
const SETS_OF_A_VOLUME: usize = 20;

const MASK_TEXTURES: &[&str] = &["mask_seed", "noise_frequency", "detail_seed", "detail_frequency"];
const VOLUME: &[&str] =
    &["coverage", "softness", "noise_scale", "octaves", "persistence", "lacunarity", "intensity", "seed"];

/// Random values within the usual ranges. One in eight is an end of its range, where things break.
fn random_values(random: &mut ChaCha8Rng) -> Values {
    let mut values = Values::defaults(settings::PARAMETERS);
    for parameter in settings::PARAMETERS {
        let [low, high] = parameter.usual;
        let drawn = match random.random_range(0..16) {
            0 => low,
            1 => high,
            _ => random.random_range(low..=high),
        };
        let value = match parameter.range {
            Range::Whole(..) => drawn.round(),
            _ => drawn,
        };
        let value = if parameter.name == "texture_size" { 32.0 } else { value };
        values.set(settings::PARAMETERS, parameter.name, value, "a random trial").expect("usual values are allowed");
    }
    values
}

/// Rays from everywhere, also from inside, along axes and along faces.
fn random_rays(random: &mut ChaCha8Rng) -> Vec<RealTimeRay> {
    let mut point = |scale: f64| DVec3::from_array(std::array::from_fn(|_| random.random_range(-scale..scale)));
    let mut rays: Vec<RealTimeRay> = (0..RAYS)
        .map(|number| {
            let origin = point(if number % 3 == 0 { 0.5 } else { 1.5 });
            let direction = (point(0.4) - origin).normalize();
            local_box().ray(origin, direction, f64::INFINITY, (point(0.5).x + 0.5).clamp(0.0, 1.0))
        })
        .collect();
    let along = |origin: DVec3, direction: DVec3| local_box().ray(origin, direction, 2.0, 0.5);
    rays.push(along(DVec3::new(0.0, 0.0, 2.0), DVec3::NEG_Z));
    rays.push(along(DVec3::new(-1.0, 0.5, 0.0), DVec3::X));
    rays.push(along(DVec3::ZERO, DVec3::Y));
    rays
}

/// Every value is a number, transmittance a share, light not negative.
fn check(pixels: &[RealTimePixel], what: &dyn Fn() -> String) -> f64 {
    for pixel in pixels {
        for (radiance, transmittance) in pixel.radiance.iter().zip(pixel.transmittance) {
            assert!(radiance.is_finite() && *radiance >= 0.0, "radiance {radiance}: {}", what());
            assert!((0.0..=1.0).contains(&transmittance), "transmittance {transmittance}: {}", what());
        }
    }
    pixels.iter().map(|pixel| 1.0 - pixel.transmittance[0]).sum()
}

#[test]
fn no_parameters_make_a_value_that_is_no_number() {
    let gpu = support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"));
    let mut random = ChaCha8Rng::seed_from_u64(4);
    // With all defects and with none, for the mask's textures.
    let mut last: [Option<Arc<Cloud>>; 2] = [None, None];
    let mut opacity = 0.0;
    let mut warned = 0;
    let mut masks = random_values(&mut random);
    let mut volumes = masks.clone();
    for set in 0..SETS {
        let mut values = random_values(&mut random);
        if set % SETS_OF_A_MASK == 0 {
            masks = values.clone();
        }
        if set % SETS_OF_A_VOLUME == 0 {
            volumes = values.clone();
        }
        for (names, from) in [(MASK_TEXTURES, &masks), (VOLUME, &volumes)] {
            for name in names {
                values.set(settings::PARAMETERS, name, from.get(name), "a random trial").expect("allowed before");
            }
        }
        let defects = if set % 2 == 0 { Defects::NONE } else { Defects::ALL };
        let (parameters, warnings) = settings::parameters(&values, &defects, f64::from(set as u32)).expect("in range");
        warned += usize::from(!warnings.is_empty());
        let cloud = Arc::new(Cloud::new_after(parameters, last[set % 2].as_deref()).expect("in range"));
        let of_density = settings::opacity(&values).expect("in range");
        let rays = random_rays(&mut random);
        let (light, rule) = (settings::light(&values, &defects), settings::march(&values, &defects));
        let what = || format!("set {set}, {defects}: {values:?}");
        let pixels = Boxed::filling(&cloud, of_density).marched(&light).march(&rule, &rays).expect("marched");
        opacity += check(&pixels, &what);
        if let Some(gpu) = gpu.as_ref().filter(|_| set % ADAPTER_EVERY == 0) {
            // With the table of what is provably empty, as an engine has it: on the CPU it changes nothing.
            let again = Cloud::new_after(cloud.parameters().clone(), Some(&cloud)).expect("in range");
            let engine = Boxed::new(again, of_density);
            assert_eq!(engine.marched(&light).march(&rule, &rays).expect("marched"), pixels, "{}", what());
            let kernel = MarchKernel::new(gpu, &engine.marched(&light), &rule).expect("a kernel");
            check(&kernel.march(&rays).expect("pixels"), &what);
        }
        last[set % 2] = Some(cloud);
    }
    // The trials are worth something: clouds were seen, and flattenings of 0 too.
    assert!(opacity > 0.01 * (SETS * (RAYS + 3)) as f64, "hardly any cloud: {opacity}");
    assert!(warned > SETS / 100, "hardly any flattening of 0: {warned}");
}

#[test]
fn a_flattening_of_zero_is_defined_and_named() {
    let mut values = Values::defaults(settings::PARAMETERS);
    for &(name, value) in settings::DOCUMENTED_MASK {
        values.set(settings::PARAMETERS, name, value, "documented").expect("documented values are allowed");
    }
    let rays = random_rays(&mut ChaCha8Rng::seed_from_u64(1));
    for (defects, is_empty) in [(Defects::ALL, true), (Defects::NONE, false)] {
        let (parameters, warnings) = settings::parameters(&values, &defects, 0.0).expect("in range");
        for side in ["top", "bottom", "x_positive", "x_negative", "z_positive", "z_negative"] {
            let name = format!("flatten_{side} is 0");
            assert!(warnings.iter().any(|warning| warning.contains(&name)), "{name} is not in {warnings:?}");
        }
        let cloud =
            Boxed::new(Cloud::new(parameters).expect("in range"), settings::opacity(&values).expect("in range"));
        let (light, rule) = (settings::light(&values, &defects), settings::march(&values, &defects));
        let pixels = cloud.marched(&light).march(&rule, &rays).expect("marched");
        let opacity = check(&pixels, &|| format!("{defects}"));
        assert_eq!(opacity == 0.0, is_empty, "{defects}: {opacity}");
    }
}

/// Root of the mean square of the difference of the textured density from the exact one over random places, and the largest
/// exact density.
fn baking_error(texture_size: f64) -> [f64; 2] {
    let mut values = Values::defaults(settings::PARAMETERS);
    // A smooth field, which textures can follow.
    let changes =
        [("octaves", 2.0), ("lacunarity", 2.0), ("softness", 0.3), ("tiling", 1.0), ("texture_size", texture_size)];
    let mut cloud = |exact: f64| {
        for (name, value) in changes.into_iter().chain([("exact", exact)]) {
            values.set(settings::PARAMETERS, name, value, "a test").expect("in range");
        }
        let (parameters, _) = settings::parameters(&values, &Defects::NONE, 0.0).expect("in range");
        Cloud::new(parameters).expect("in range")
    };
    let (baked, exact) = (cloud(0.0), cloud(1.0));
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let (mut square, mut largest) = (0.0, 0.0_f64);
    for _ in 0..4000 {
        let place = std::array::from_fn(|_| random.random_range(-0.4..0.4));
        let (found, wanted): (f64, f64) = (baked.at(place).density, exact.at(place).density);
        square += (found - wanted).powi(2) / 4000.0;
        largest = largest.max(wanted);
    }
    [square.sqrt(), largest]
}

#[test]
fn textures_tend_to_the_exact_evaluation() {
    let [coarse, largest] = baking_error(32.0);
    let [fine, _] = baking_error(128.0);
    // The plane of texels that is there twice shifts values by up to a texel: first order, a quarter for four times the texels. Bytes,
    // which round down, add at most 1/255 of the largest density, and the mask's bytes their own.
    assert!(fine < 0.5 * coarse, "{coarse} with 32 texels, {fine} with 128");
    assert!(fine < 0.02 * largest, "{fine} of {largest}");
}
