//! Perlin-FBM in single precision, far from the origin too: noise, bakes and the density's look-up against double precision, within limits
//! that are derived in tests/support/rounding.rs and beside each test.

mod support;

use cloudparity::engines::perlin_fbm::gpu::BakeKernel;
use cloudparity::gpu::{Bindings, Gpu};
use cloudparity::graph::build::IDENTITY;
use cloudparity::graph::evaluate::Points;
use cloudparity::nodes::perlin_fbm::bake::Bake;
use cloudparity::nodes::perlin_fbm::mask::{Deformation, Mask};
use cloudparity::nodes::perlin_fbm::noise::{Field, Octaves, noise, octaves};
use cloudparity::nodes::perlin_fbm::random::permutation;
use cloudparity::nodes::perlin_fbm::{Cloud, Evaluation, Parameters, Volume};
use cloudparity::nodes::running_error::RunningError;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use support::rounding::{Single, U, check_bake};

/// Seeds near and far, negative and broken. At 1e12 a double holds coordinates to 1e-4, and the first octave's parts of cells with them.
const SEEDS: [f64; 10] = [0.0, 42.0, 31_337.0, 1e6, -5.5, 123.456_789, -1e6 - 0.25, 8_388_607.9, 1e9 + 0.5, 1e12];

/// Places about a seed: on lattice points, beside them, and anywhere.
fn places(seed: f64, random: &mut ChaCha8Rng) -> Vec<[f64; 3]> {
    (0..400)
        .map(|number| {
            std::array::from_fn(|_| {
                let offset = random.random_range(-4.0..4.0_f64);
                seed + match number % 4 {
                    0 => offset.round(),
                    1 => offset.round() + 1e-9,
                    2 => offset.round() - 1e-9,
                    _ => offset,
                }
            })
        })
        .collect()
}

#[test]
fn noise_in_single_precision_is_within_its_rounding_at_every_seed() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let sums = [
        Octaves { count: 5, persistence: 0.5, lacunarity: 3.0 },
        Octaves { count: 8, persistence: 0.6, lacunarity: 2.17 },
    ];
    // Limits that are as good as none would let everything pass.
    let mut largest_limit = 0.0_f64;
    let mut naive_errors = 0;
    for seed in SEEDS {
        let table = permutation(seed);
        for place in places(seed, &mut random) {
            let mut check = |double: f64, single: f32, bound: RunningError| {
                assert_eq!(bound.value(), single, "the limit is this value's");
                let (error, limit) = ((f64::from(single) - double).abs(), bound.error());
                assert!(error <= limit, "seed {seed} at {place:?}: {error:e} of {limit:e}");
                largest_limit = largest_limit.max(limit);
            };
            for field in [Field::Volume, Field::Mask] {
                check(noise(field, &table, place), noise(field, &table, place), noise(field, &table, place));
            }
            for sum in &sums {
                check(octaves(&table, place, sum), octaves(&table, place, sum), octaves(&table, place, sum));
            }
            // A coordinate that becomes single before it loses its cell is beyond the limit.
            let rounded = place.map(|coordinate| f64::from(coordinate as f32));
            let naive =
                (noise::<f64>(Field::Volume, &table, rounded) - noise::<f64>(Field::Volume, &table, place)).abs();
            naive_errors += usize::from(naive > noise::<RunningError>(Field::Volume, &table, place).error());
        }
    }
    eprintln!("largest limit {largest_limit:e}; {naive_errors} places beyond theirs with single coordinates");
    assert!(largest_limit < 1e-4, "{largest_limit:e}");
    assert!(naive_errors > 1000, "the limits find single coordinates: {naive_errors}");
}

/// Bakes to try: at each seed a soft threshold and a hard one with powers.
fn bakes() -> impl Iterator<Item = Bake> {
    SEEDS.into_iter().flat_map(|seed| {
        let soft = Bake { seed, ..Bake::default() };
        let hard = Bake {
            coverage: 0.4,
            softness: 0.02,
            noise_scale: 7.3,
            octaves: Octaves { count: 7, persistence: 0.55, lacunarity: 2.3 },
            intensity: 1.7,
            seed,
        };
        [soft, hard]
    })
}

/// Texels per axis: no power of two, and no divisor of a lattice.
const SIDE: usize = 19;

/// Holds a bake of `SIDE` texels per axis against the double one.
fn check(bake: &Bake, ours: &Volume, by: Single) {
    let double = bake.volume(SIDE).expect("in range");
    let differing = check_bake("bake", bake, SIDE, [&ours.texels, &double.texels], by);
    eprintln!("seed {}, softness {}: {differing} of {} texels differ", bake.seed, bake.softness, SIDE.pow(3));
}

#[test]
fn bakes_in_single_precision_are_within_their_rounding_at_every_seed() {
    for bake in bakes() {
        check(&bake, &bake.volume_in::<f32>(SIDE).expect("in range"), Single::Cpu);
    }
}

#[test]
fn bakes_on_the_adapter_are_within_their_rounding_at_every_seed() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let kernel = BakeKernel::new(&gpu).expect("a kernel");
    for bake in bakes() {
        check(&bake, &kernel.volume(&bake, SIDE).expect("in range"), Single::Adapter);
    }
}

/// Largest difference of neighbouring texels of a volume, as values 0 to 1; `wraps`: the last and the first are neighbours.
fn slope(volume: &Volume, wraps: bool) -> f64 {
    let side = volume.side;
    let at = |x: usize, y: usize, z: usize| volume.texels[(z * side + y) * side + x];
    let last = if wraps { side } else { side - 1 };
    let mut largest = 0;
    for (along, second, third) in (0..last).flat_map(|x| (0..side).flat_map(move |y| (0..side).map(move |z| (x, y, z))))
    {
        let next = (along + 1) % side;
        for [here, there] in [
            [at(along, second, third), at(next, second, third)],
            [at(second, along, third), at(second, next, third)],
            [at(second, third, along), at(second, third, next)],
        ] {
            largest = largest.max(here.abs_diff(there));
        }
    }
    f64::from(largest) / 255.0
}

#[test]
fn the_look_up_on_the_adapter_is_within_its_rounding_at_every_tiling() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut last: Option<Arc<Cloud>> = None;
    // A mask that is 1 in all of the box, so that the texture is seen alone; then one that fades through it. Its deformations are smooth,
    // so that their textures add little to the limit.
    let whole = Mask { radius: 2.0, softness: 0.1, deformations: deformations(0.0), ..Mask::default() };
    let fading = Mask { radius: 0.9, softness: 0.4, deformations: deformations(0.02), ..Mask::default() };
    for (mask, tiling, offset) in [
        (whole, 2.0, [0.0; 3]),
        (whole, 2.0, [0.123, 0.456, 0.789]),
        (whole, 1.5, [0.999_999_99, 1e-9, 0.5]),
        (whole, 6.0, [0.02 * 31_337.0, 0.25, 0.01 * 31_337.0]),
        (whole, 37.3, [0.7, 0.1, 0.9]),
        (whole, 1000.7, [0.3, 0.6, 0.2]),
        (fading, 2.0, [0.123, 0.456, 0.789]),
    ] {
        let parameters = Parameters {
            bake: Bake { softness: 0.3, ..Bake::default() },
            texture_size: 32,
            mask,
            tiling,
            offset: offset.map(|periods: f64| periods.rem_euclid(1.0)),
            threshold: 0.0,
            density_multiplier: 50.0,
            evaluation: Evaluation::Baked,
            shows_mask: false,
        };
        let cloud = Arc::new(Cloud::new_after(parameters, last.as_deref()).expect("in range"));
        let program = support::cloud::program(Arc::clone(&cloud), IDENTITY);
        let kernel = gpu.field(&program).expect("a kernel");
        let positions: Vec<[f32; 3]> = (0..4000)
            .map(|number| match number {
                0 => [0.0; 3],
                1 => [0.5; 3],
                2 => [-0.5, 0.5, 0.0],
                _ => std::array::from_fn(|_| random.random_range(-0.5..0.5)),
            })
            .collect();
        let found = kernel.evaluate(Points::new(&positions)).expect("values");
        let expected: Vec<_> = positions.iter().map(|place| cloud.at(place.map(f64::from))).collect();
        let is_whole = expected.iter().all(|sample| sample.mask == 1.0);
        assert_eq!(is_whole, mask == whole);
        // Where the mask is 1 with room to spare, it is 1 in single precision.
        let limit = 50.0 * (texel_error(&cloud) + if is_whole { 0.0 } else { mask_error(&cloud) } + 4.0 * U);
        let errors = found.iter().zip(&expected).map(|(&found, sample)| (f64::from(found) - sample.density).abs());
        let largest = errors.fold(0.0, f64::max);
        eprintln!("tiling {tiling}: {largest:e} of {limit:e}");
        assert!(largest <= limit, "tiling {tiling}, offset {offset:?}: {largest:e} of {limit:e}");
        last = Some(cloud);
    }
}

/// Main and fine deformation of one strength.
fn deformations(strength: f64) -> [Deformation; 2] {
    [1.0, 11.0].map(|seed| Deformation { seed, strength, frequency: 1.3 })
}

/// How far the texture's value may be off on an adapter.
///
/// Tiling and offset are rounded, their product with a place of at most 1/2 and the sum with the offset, at most 2, too: as periods
/// (tiling + 2.5) u, as texels so many times the side, and one rounding more of the product with it. Three axes; a read has a dozen
/// roundings.
fn texel_error(cloud: &Cloud) -> f64 {
    let side = cloud.volume().side as f64;
    3.0 * slope(cloud.volume(), true) * (cloud.parameters().tiling + 3.5) * side * U + 12.0 * U
}

/// How far the mask's factor may be off on an adapter.
///
/// A stretched place is a quotient (5), its length a root of a sum (12), the direction their quotient, and its texture's coordinate two
/// roundings more: 20 u of half the radius, and 2 u. From texels to the deformation it is twice a texel's value, times the strength.
fn mask_error(cloud: &Cloud) -> f64 {
    let mask = cloud.parameters().mask;
    let coordinate = (20.0 * 0.5 * mask.radius + 2.0) * U * 128.0;
    let deformations = cloud.mask().textures.iter().zip(mask.deformations);
    let displacement: f64 = deformations
        .map(|(texture, deformation)| {
            2.0 * deformation.strength * (3.0 * slope(texture, false) * coordinate + 14.0 * U)
        })
        .sum();
    let flattest = mask.flattening.as_flattened().iter().copied().fold(1.0, f64::min);
    let farthest = 3.0_f64.sqrt() * 0.5 / flattest;
    let distance = displacement + (17.0 * farthest + 4.0) * U;
    1.5 * (distance / mask.softness + 7.0 * U) + 6.0 * U
}

/// Quotients and roots of any two bit patterns by `shaders/gpu/exact.wgsl` on the adapter: those of IEEE 754.
#[test]
fn quotients_and_roots_on_the_adapter_round_to_the_nearest() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("an adapter");
    let text = std::fs::read_to_string(support::project("shaders/gpu/exact.wgsl")).expect("a shader");
    let entry = "
        @group(0) @binding(0) var<storage, read> inputs: array<vec2u>;
        @group(0) @binding(1) var<storage, read_write> results: array<vec2u>;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) invocation: vec3u) {
            if invocation.x >= arrayLength(&inputs) { return; }
            let input = inputs[invocation.x];
            let quotient = divide(bitcast<f32>(input.x), bitcast<f32>(input.y));
            results[invocation.x] = vec2u(bitcast<u32>(quotient), bitcast<u32>(square_root(bitcast<f32>(input.x))));
        }";
    let text = text.replace("#define_import_path cloudparity::exact", "") + entry;
    let module = naga::front::wgsl::parse_str(&text).expect("it is WGSL");
    let kernel = gpu.kernel("exact", &module, &[]).expect("it compiles");
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let count = 1_usize << 20;
    let inputs: Vec<[u32; 2]> = (0..count)
        .map(|number| {
            let [first, second]: [u32; 2] = random.random();
            match number % 8 {
                // Denormal dividend, divisor, quotient; nearly equal; powers of two; ordinary numbers.
                0 => [first & 0x807f_ffff, second],
                1 => [first, second & 0x807f_ffff],
                2 => [first & 0x83ff_ffff, second | 0x3f80_0000],
                3 => [first, first ^ (second & 7)],
                4 => [first & 0xff80_0000, second],
                5 => [first & 0x3fff_ffff | 0x3000_0000, second & 0x3fff_ffff | 0x3000_0000],
                _ => [first, second],
            }
        })
        .collect();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let bytes = bytemuck::cast_slice(&inputs);
    let (given, results) = (gpu.upload("inputs", bytes, usage), gpu.upload("results", bytes, usage));
    gpu.dispatch(&kernel, &Bindings::new().group(0, [&given, &results]), [count as u32, 1, 1]).expect("it runs");
    let found = gpu.read_back(&results, bytes.len() as u64).expect("it runs");
    let found: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&found);
    let same = |ours: u32, right: f32| ours == right.to_bits() || f32::from_bits(ours).is_nan() && right.is_nan();
    for ([first, second], [quotient, root]) in inputs.iter().zip(&found) {
        let [a, b] = [*first, *second].map(f32::from_bits);
        assert!(same(*quotient, a / b), "{a:e} / {b:e}: {:e}, not {:e}", f32::from_bits(*quotient), a / b);
        assert!(same(*root, a.sqrt()), "root of {a:e}: {:e}, not {:e}", f32::from_bits(*root), a.sqrt());
    }
}
