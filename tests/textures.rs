//! Textures and what is made of them: f32 on the CPU and WGSL against f64, and enclosures, for every format, filter and outside.

mod support;

use cloudparity::base::texture::{Outside, TexelFormat, Texture, TextureFilter, TextureHandle};
use cloudparity::engines::defects::Defects;
use cloudparity::engines::parameters::Values;
use cloudparity::engines::perlin_fbm::settings;
use cloudparity::gpu::Gpu;
use cloudparity::graph::Program;
use cloudparity::graph::build::IDENTITY;
use cloudparity::graph::evaluate::{Arithmetic, Points};
use cloudparity::media::averages::Averages;
use cloudparity::media::density::Density;
use cloudparity::media::density_cache::{CacheFilter, CacheFormat, DensityCache, Samples};
use cloudparity::media::medium::Medium;
use cloudparity::nodes::Interval;
use cloudparity::nodes::perlin_fbm::Cloud;
use cloudparity::nodes::texture_lookup;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Largest relative error of one rounding to f32.
const U: f64 = 1.0 / 16_777_216.0;

/// Of a trilinear value from its exact one, over the largest texel: each of three interpolations behind each other has a difference (2), its
/// product (2) and a sum (1); a part of a cell is rounded once where the index is below 0 (1, of a difference of 2, per axis); a byte is a quotient
/// (5 in WGSL), a difference, a product and a sum (2 each at most).
const TRILINEAR: f64 = (3.0 * 5.0 + 3.0 + 8.0) * U;

/// Denormals that an adapter takes for 0, in each operation.
const FLUSHED: f64 = 32.0 * f32::MIN_POSITIVE as f64;

const FORMATS: [TexelFormat; 3] = [TexelFormat::F32, TexelFormat::F16, TexelFormat::Unorm8];
const FILTERS: [TextureFilter; 2] = [TextureFilter::Nearest, TextureFilter::Trilinear];
const OUTSIDES: [Outside; 3] = [Outside::Clamp, Outside::Repeat, Outside::Zero];
const SIZES: [[usize; 3]; 3] = [[1, 1, 1], [2, 1, 3], [5, 4, 7]];

fn texture(
    size: [usize; 3],
    format: TexelFormat,
    filter: TextureFilter,
    outside: Outside,
    random: &mut ChaCha8Rng,
) -> Texture {
    let values = (0..size.iter().product()).map(|_| random.random_range(-3.0..5.0_f32)).collect();
    Texture::store(size, values, format, filter, outside, "a test").expect("ordinary values")
}

/// Indices inside, around and far outside; whole ones, halves, and their neighbours.
fn indices(size: [usize; 3], random: &mut ChaCha8Rng) -> Vec<[f32; 3]> {
    (0..400)
        .map(|_| {
            std::array::from_fn(|axis| {
                let side = size[axis] as f32;
                let near = random.random_range(-3.0..side + 3.0_f32);
                match random.random_range(0..12) {
                    0 => near.round(),
                    1 => near.round().next_up(),
                    2 => near.round().next_down(),
                    3 => near.floor() + 0.5,
                    4 => [-0.0, -1e-8, 1e-8, -1e-30, side - 1.0, side][random.random_range(0..6)],
                    5 => near + [-1e4, 1e5, -1e6][random.random_range(0..3)],
                    6 => [-1e9, 1e9, -2e9, 2e9, 2_147_483_520.0, -2_147_483_648.0][random.random_range(0..6)],
                    _ => near,
                }
            })
        })
        .collect()
}

/// Whether rounding may take an index to another texel than f64 does: within a few roundings of the middle between two.
fn is_between(index: [f32; 3]) -> bool {
    index.iter().any(|&coordinate| {
        let part = (f64::from(coordinate) + 0.5).rem_euclid(1.0);
        part.min(1.0 - part) <= 4.0 * U * f64::from(coordinate.abs()).max(1.0)
    })
}

/// Every texture of the test, with indices.
fn for_each(mut check: impl FnMut(&str, Texture, Vec<[f32; 3]>)) {
    let mut random = ChaCha8Rng::seed_from_u64(17);
    for size in SIZES {
        for format in FORMATS {
            for filter in FILTERS {
                for outside in OUTSIDES {
                    let texture = texture(size, format, filter, outside, &mut random);
                    let indices = indices(size, &mut random);
                    check(&format!("{size:?} {format} {filter} {outside:?}"), texture, indices);
                }
            }
        }
    }
}

fn largest_texel(texture: &Texture) -> f64 {
    let size = texture.size();
    let [low, high] = texture.range([0; 3], size.map(|side| side as i64 - 1));
    f64::from(low.abs().max(high.abs()))
}

#[test]
fn reads_in_single_precision_are_within_their_rounding() {
    let mut between = 0;
    let mut share = 0.0_f64;
    for_each(|what, texture, indices| {
        let largest = largest_texel(&texture);
        for index in indices {
            let single: f32 = texture_lookup::read(&texture, index);
            let double: f64 = texture_lookup::read(&texture, index.map(f64::from));
            if texture.filter() == TextureFilter::Nearest && is_between(index) {
                between += 1;
                assert!(f64::from(single).abs() <= largest, "{what} at {index:?}: {single}");
                continue;
            }
            let error = (f64::from(single) - double).abs();
            let bound = if texture.filter() == TextureFilter::Nearest { 0.0 } else { TRILINEAR * largest };
            assert!(error <= bound, "{what} at {index:?}: {single}, not {double}: {error:e} of {bound:e}");
            share = share.max(error / (TRILINEAR * largest));
        }
    });
    println!("f32 on the CPU: {share:.2} of the bound, {between} between two texels");
    assert!(between > 0);
}

#[test]
fn the_twin_in_wgsl_is_within_its_rounding() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut share = 0.0_f64;
    for_each(|what, texture, indices| {
        let largest = largest_texel(&texture);
        let texture = TextureHandle::new(texture);
        let program = Program::of_texture("texture", texture.clone(), IDENTITY);
        let kernel = gpu.field(&program).expect("a kernel");
        let found = kernel.evaluate(Points::new(&indices)).expect("values");
        for (&index, found) in indices.iter().zip(found) {
            let double: f64 = texture_lookup::read(&texture, index.map(f64::from));
            if texture.filter() == TextureFilter::Nearest && is_between(index) {
                assert!(f64::from(found).abs() <= largest * (1.0 + TRILINEAR), "{what} at {index:?}: {found}");
                continue;
            }
            let error = (f64::from(found) - double).abs();
            let bound = TRILINEAR * largest + FLUSHED;
            assert!(error <= bound, "{what} at {index:?}: {found}, not {double}: {error:e} of {bound:e}");
            share = share.max(error / bound);
        }
    });
    println!("WGSL on {}: {share:.2} of the bound", gpu.adapter().name);
}

/// Asserts that values at random places of random boxes lie within the enclosure of the box, and gives how many enclosures say more than
/// that of everything.
fn enclosed(what: &str, program: &Program, extent: [f32; 2], boxes: usize, random: &mut ChaCha8Rng) -> usize {
    let all = program.bounds([extent[0]; 3], [extent[1]; 3]).expect("bounds")[0];
    let mut tighter = 0;
    for number in 0..boxes {
        let widest = (extent[1] - extent[0]) * [1e-4, 0.02, 0.2, 1.0][number % 4];
        let low: [f32; 3] = std::array::from_fn(|_| random.random_range(extent[0]..extent[1]));
        let high: [f32; 3] = std::array::from_fn(|axis| low[axis] + random.random_range(0.0..widest));
        let found: Interval = program.bounds(low, high).expect("bounds")[0];
        let mut places: Vec<[f32; 3]> = (0..24)
            .map(|_| {
                std::array::from_fn(|axis| random.random_range(low[axis]..=high[axis]).clamp(low[axis], high[axis]))
            })
            .collect();
        places.extend([low, high]);
        for arithmetic in [Arithmetic::Single, Arithmetic::Oracle, Arithmetic::Unrounded] {
            for (place, value) in places.iter().zip(program.evaluate(Points::new(&places), arithmetic).expect("values"))
            {
                let is_inside = found.contains(value) || (value.is_nan() && found.may_be_nan);
                assert!(
                    is_inside,
                    "{what}, {arithmetic:?} at {place:?}: {value} outside of {found:?}, {low:?} to {high:?}"
                );
            }
        }
        let width = |interval: &Interval| f64::from(interval.high) - f64::from(interval.low);
        tighter += usize::from(width(&found) < 0.5 * width(&all));
    }
    tighter
}

#[test]
fn enclosures_of_textures_hold_their_values() {
    let mut random = ChaCha8Rng::seed_from_u64(18);
    let mut tighter = 0;
    for_each(|what, texture, _| {
        let program = Program::of_texture("texture", TextureHandle::new(texture), IDENTITY);
        tighter += enclosed(what, &program, [-4.0, 10.0], 40, &mut random);
        // So far out that f32 knows whole indices alone.
        enclosed(what, &program, [-3e9, 3e9], 8, &mut random);
    });
    assert!(tighter > 300, "hardly an enclosure says anything: {tighter}");
}

#[test]
fn enclosures_of_caches_and_averages_hold_their_values() {
    let scene = support::scene("noise-anisotropic");
    let medium = Medium::new(&scene).expect("a medium");
    let mut random = ChaCha8Rng::seed_from_u64(19);
    for format in [CacheFormat::F32, CacheFormat::F16, CacheFormat::Unorm8] {
        let samples = Samples::bake(&medium.density, &medium.to_object, 16, format, &|_| ()).expect("samples");
        for filter in [CacheFilter::Nearest, CacheFilter::Trilinear] {
            let cache = DensityCache::new(&samples, format, filter).expect("a cache");
            let tighter =
                enclosed(&format!("cache {format} {filter}"), cache.density.program(), [-1.0, 1.0], 200, &mut random);
            assert!(tighter > 20, "{tighter}");
        }
    }
    let averages = Averages::of(&medium.density).expect("averages");
    for program in [&averages.along, &averages.around] {
        let tighter = enclosed("averages", program, [-1.0, 1.0], 200, &mut random);
        assert!(tighter > 20, "{tighter}");
    }
}

/// Clouds of several seeds and parameters, by name; the last ones are not on the adapter.
fn clouds() -> Vec<(String, Arc<Cloud>)> {
    let sets: &[(&str, &[(&str, f64)])] = &[
        ("defaults", &[]),
        ("another seed, tiling 3.7 and a moving texture", &[("seed", 7.5), ("tiling", 3.7), ("speed_x", 0.31)]),
        ("threshold", &[("threshold", 0.4), ("softness", 0.4)]),
        ("the mask alone", &[("show_mask", 1.0), ("noise_strength", 0.2)]),
        ("no radius", &[("mask_radius", -0.2)]),
        (
            "a large mask, soft",
            &[("mask_radius", 1.1), ("mask_softness", 1.0), ("flatten_top", 1.8), ("mask_seed", 3.0)],
        ),
        ("exact", &[("exact", 1.0), ("octaves", 2.0)]),
    ];
    let mut found: Vec<(String, Arc<Cloud>)> = Vec::new();
    for (name, changes) in sets {
        for defects in [Defects::NONE, Defects::ALL] {
            let mut values = Values::defaults(settings::PARAMETERS);
            for &(name, value) in [("texture_size", 32.0), ("octaves", 3.0)].iter().chain(*changes) {
                values.set(settings::PARAMETERS, name, value, "a test").expect("in range");
            }
            // As published the mask's textures read as 0.
            let (parameters, _) = settings::parameters(&values, &defects, 2.0).expect("in range");
            let cloud = Cloud::new_after(parameters, found.last().map(|(_, cloud)| cloud.as_ref())).expect("in range");
            found.push((format!("{name}, defects {defects}"), Arc::new(cloud)));
        }
    }
    found
}

#[test]
fn enclosures_of_perlin_fbm_hold_its_values() {
    let mut random = ChaCha8Rng::seed_from_u64(20);
    for (name, cloud) in clouds() {
        let program = support::cloud::program(cloud, IDENTITY);
        let tighter = enclosed(&name, &program, [-0.6, 0.6], 160, &mut random);
        assert!(tighter > 20 || name.contains("no radius"), "{name}: {tighter}");
    }
}

/// Places of the box, on its axes, in its planes, at its middle and next to it.
fn places(random: &mut ChaCha8Rng) -> Vec<[f32; 3]> {
    let mut places: Vec<[f32; 3]> =
        (0..4000).map(|_| std::array::from_fn(|_| random.random_range(-0.55..0.55))).collect();
    for place in places.iter_mut().take(400) {
        place[random.random_range(0..3)] = [0.0, -0.0, 0.5, -0.5, 0.25, 1e-30][random.random_range(0..6)];
    }
    places.extend([[0.0; 3], [1e-25, 0.0, 0.0], [-1e-4, 1e-4, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, -0.2]]);
    places
}

#[test]
fn perlin_fbm_in_wgsl_is_within_its_rounding() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut random = ChaCha8Rng::seed_from_u64(21);
    for (name, cloud) in clouds() {
        let program = support::cloud::program(cloud, IDENTITY);
        if name.contains("exact") {
            let error = gpu.field(&program).err().expect("it has no shader").to_string();
            assert!(error.contains("noise at each place"), "{error}");
            continue;
        }
        let places = places(&mut random);
        let points = Points::new(&places);
        let found = gpu.field(&program).expect("a kernel").evaluate(points).expect("values");
        let single = program.evaluate_single(points).expect("values");
        let bounds = program.rounding_bounds(points).expect("bounds");
        let (mut largest, mut share, mut unknown) = (0.0_f64, 0.0_f64, 0);
        for (index, (&found, &single)) in found.iter().zip(&single).enumerate() {
            let error = (f64::from(found) - f64::from(single)).abs();
            largest = largest.max(error);
            if error <= bounds[index] + FLUSHED {
                share = share.max(error / (bounds[index] + FLUSHED));
                continue;
            }
            // Beyond it only where a rounding decides whether there is anything: every evaluator is within the enclosure of the place.
            let enclosure = program.bounds(places[index], places[index]).expect("bounds")[0];
            let place = places[index];
            assert!(enclosure.contains(f64::from(found)), "{name} at {place:?}: {found}, {single}, {enclosure:?}");
            assert!(found == 0.0 || single == 0.0, "{name} at {place:?}: {found}, {single}, {:e}", bounds[index]);
            unknown += 1;
        }
        let dense = single.iter().copied().fold(0.0, f32::max);
        println!(
            "{name}: largest error {largest:.2e} of {dense:.2}, {share:.2} of the bound, {unknown} at the threshold"
        );
        assert!(unknown <= places.len() / 200, "{name}: {unknown}");
        assert!(dense > 1.0 || name.contains("no radius") || name.contains("alone"), "{name}: {dense}");
    }
}

#[test]
fn a_density_with_empty_cells_is_the_density() {
    let mut random = ChaCha8Rng::seed_from_u64(22);
    for (name, cloud) in clouds() {
        let boxed = support::cloud::local_box();
        let region = boxed.outline.region();
        let program = Arc::new(support::cloud::program(cloud, IDENTITY));
        let density = Density::new(Arc::clone(&program), region).expect("a density");
        let places = places(&mut random);
        for (place, value) in places.iter().zip(program.evaluate_single(Points::new(&places)).expect("values")) {
            let place = glam::DVec3::from(place.map(f64::from));
            assert!(
                value <= 0.0 || !boxed.outline.holds(place) || density.may_hold(place),
                "{name} at {place}: {value}"
            );
        }
        if name.contains("no radius") {
            assert!(density.occupied.is_empty(), "{name}");
        }
    }
}
