// Gabor Texture node (ShaderNodeTexGabor): a sum of waves under envelopes around random places, sparse convolution noise.
// GABOR_TYPE_2D (x and y) or GABOR_TYPE_3D. Outputs: Value, Phase and Intensity of the complex sum.
// Source: Lagae et al. 2009 and Tavernier et al. 2019 in Blender's form; eight impulses per cell, each within distance 1.
// Nothing is hashed that cannot change the result: cells out of reach, and signs and directions of impulses out of reach.
// Domain: finite f32; in 3D an orientation other than 0 and, where directions scatter, other than along z.
// Limits: where Intensity is near 0, Phase is as uncertain as rounding over Intensity; it jumps from 1 to 0.
#import cloudparity::hash::{jenkins3, jenkins4, unit_from_bits}
#import cloudparity::numeric::{acos_of, atan2_of, cos_of, exp_of, sin_of}

const PI: f32 = 3.14159274;
const TAU: f32 = 6.28318548;
const INVERSE_TAU: f32 = 0.159154937;
const IMPULSES: u32 = 8u;

#ifdef GABOR_TYPE_2D
const DEPTH: i32 = 0;
const DIVISOR: f32 = 6.0;
#else
const DEPTH: i32 = 1;
const DIVISOR: f32 = 5.0453787;
#endif

struct Outputs {
#ifdef OUTPUT_VALUE
    value: f32,
#endif
#ifdef OUTPUT_PHASE
    phase: f32,
#endif
#ifdef OUTPUT_INTENSITY
    intensity: f32,
#endif
}

// Directions scatter about the angles (in the plane; or inclination and azimuth) by the isotropy; where that is 0, all
// have the common wave vector. In 2D third components are 0.
struct Waves {
    frequency: f32,
    isotropy: f32,
    angles: vec2f,
    common_wave: vec3f,
}

// Bits of a whole number, those of +0 for -0.
fn key_of(x: f32) -> u32 {
    return select(bitcast<u32>(x), 0u, x == 0.0);
}

fn seed_bits(number: u32) -> u32 {
    return bitcast<u32>(f32(number));
}

// Random numbers in [0, 1]: hashes of the same numbers in different orders.
fn random_first(key: vec3u, seed: u32) -> f32 {
#ifdef GABOR_TYPE_2D
    return unit_from_bits(jenkins3(key.x, key.y, seed));
#else
    return unit_from_bits(jenkins4(key.x, key.y, key.z, seed));
#endif
}

fn random_second(key: vec3u, seed: u32) -> f32 {
#ifdef GABOR_TYPE_2D
    return unit_from_bits(jenkins3(seed, key.x, key.y));
#else
    return unit_from_bits(jenkins4(key.z, key.x, seed, key.y));
#endif
}

fn center_of(key: vec3u, seed: u32) -> vec3f {
#ifdef GABOR_TYPE_2D
    return vec3f(random_first(key, seed), random_second(key, seed), 0.0);
#else
    let third = unit_from_bits(jenkins4(seed, key.z, key.y, key.x));
    return vec3f(random_first(key, seed), random_second(key, seed), third);
#endif
}

fn wave_of(waves: Waves, key: vec3u, seed: u32) -> vec3f {
    if waves.isotropy == 0.0 {
        return waves.common_wave;
    }
#ifdef GABOR_TYPE_2D
    let angle = waves.angles.x + ((random_first(key, seed) - 0.5) * PI) * waves.isotropy;
    return waves.frequency * vec3f(cos_of(angle), sin_of(angle), 0.0);
#else
    let inclination = waves.angles.x + (random_first(key, seed) * PI) * waves.isotropy;
    let azimuth = waves.angles.y + (random_second(key, seed) * PI) * waves.isotropy;
    let sine = sin_of(inclination);
    return waves.frequency * vec3f(sine * cos_of(azimuth), sine * sin_of(azimuth), cos_of(inclination));
#endif
}

// Real and imaginary part; the real part is left 0 where no output needs it.
fn impulse(square: f32, projection: f32, sign: f32) -> vec2f {
    let amplitude = sign * (exp_of(-PI * square) * (0.5 + 0.5 * cos_of(PI * square)));
    let angle = TAU * projection;
    var parts = vec2f(0.0, amplitude * sin_of(angle));
#ifdef OUTPUT_PHASE
    parts.x = amplitude * cos_of(angle);
#else ifdef OUTPUT_INTENSITY
    parts.x = amplitude * cos_of(angle);
#endif
    return parts;
}

fn cell_sum(cell: vec3f, local: vec3f, waves: Waves) -> vec2f {
    let key = vec3u(key_of(cell.x), key_of(cell.y), key_of(cell.z));
    var sum = vec2f(0.0);
    for (var number = 0u; number < IMPULSES; number++) {
        let d = local - center_of(key, seed_bits(3u * number + 1u));
        let square = (d.x * d.x + d.y * d.y) + d.z * d.z;
        if square < 1.0 {
            let wave = wave_of(waves, key, seed_bits(3u * number));
            let sign = select(1.0, -1.0, random_first(key, seed_bits(3u * number + 2u)) < 0.5);
            sum += impulse(square, (d.x * wave.x + d.y * wave.y) + d.z * wave.z, sign);
        }
    }
    return sum;
}

fn gabor(p: vec3f, waves: Waves) -> vec2f {
    let corner = floor(p);
    let fraction = p - corner;
    var total = vec2f(0.0);
    for (var z = -DEPTH; z <= DEPTH; z++) {
        for (var y = -1; y <= 1; y++) {
            for (var x = -1; x <= 1; x++) {
                let offset = vec3f(f32(x), f32(y), f32(z));
                let local = fraction - offset;
                // The cell's impulses are at hash - local, the hash in [0, 1].
                let upper = select(vec3f(0.0), local, offset > vec3f(0.0));
                let least = select(upper, local - vec3f(1.0), offset < vec3f(0.0));
                if dot(least, least) < 1.0 {
                    total += cell_sum(corner + offset, local, waves);
                }
            }
        }
    }
    return total;
}

fn evaluate(
    vector: vec3f,
    scale: f32,
    frequency: f32,
    anisotropy: f32,
#ifdef GABOR_TYPE_2D
    orientation: f32,
#else
    orientation: vec3f,
#endif
) -> Outputs {
    var waves: Waves;
    waves.frequency = max(frequency, 0.001);
    waves.isotropy = 1.0 - clamp(anisotropy, 0.0, 1.0);
#ifdef GABOR_TYPE_2D
    let p = vec3f(vector.xy * scale, 0.0);
    if waves.isotropy == 0.0 {
        waves.common_wave = waves.frequency * vec3f(cos_of(orientation), sin_of(orientation), 0.0);
    }
    waves.angles = vec2f(orientation, 0.0);
#else
    let p = vector * scale;
    let v = orientation;
    let direction = v / sqrt((v.x * v.x + v.y * v.y) + v.z * v.z);
    waves.common_wave = waves.frequency * direction;
    if waves.isotropy != 0.0 {
        let flat = direction.xy;
        let azimuth = acos_of(clamp(flat.x / sqrt(flat.x * flat.x + flat.y * flat.y), -1.0, 1.0));
        waves.angles = vec2f(acos_of(clamp(direction.z, -1.0, 1.0)), select(azimuth, -azimuth, flat.y < 0.0));
    }
#endif
    let sum = gabor(p, waves);
    var outputs: Outputs;
#ifdef OUTPUT_VALUE
    outputs.value = (sum.y / DIVISOR) * 0.5 + 0.5;
#endif
#ifdef OUTPUT_PHASE
    outputs.phase = (atan2_of(sum.y, sum.x) + PI) * INVERSE_TAU;
#endif
#ifdef OUTPUT_INTENSITY
    outputs.intensity = sqrt(sum.x * sum.x + sum.y * sum.y) / DIVISOR;
#endif
    return outputs;
}
