// Noise Texture node (ShaderNodeTexNoise): fractal sums of gradient noise at p = coordinates * scale.
// NOISE_DIMENSIONS_1D (w), _2D (vector.xy), _3D (vector), _4D (vector and w); one NOISE_TYPE_<NAME>; NORMALIZE (FBM).
// Factor = F(p), Color = (F(p), F(p + R(n)), F(p + R(n + 1))) with random offsets R; the distortion moves p first.
// F sums noise at p * lacunarity^i with weights roughness^i, i = 0 .. detail; a fractional detail blends the last one.
// Source: Musgrave's fractals in Blender's form and order of operations. FBM scales the original p, the others go on
// from the last p: in f32 these differ. Domain: finite f32; detail is limited to [0, 15], so no loop exceeds 16 steps.
// Limits: a fused multiply-add changes the last bits, and a distortion multiplies such changes.
#import cloudparity::gradient_noise::{snoise_1d, snoise_2d, snoise_3d, snoise_4d}
#import cloudparity::numeric::mix_linear

// Points have four components in all dimensions, because composed modules cannot export an alias of a built-in type;
// those beyond the dimension are never read.

struct Outputs {
#ifdef OUTPUT_FAC
    fac: f32,
#endif
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
}

fn snoise(p: vec4f) -> f32 {
#ifdef NOISE_DIMENSIONS_1D
    return snoise_1d(p.x);
#else ifdef NOISE_DIMENSIONS_2D
    return snoise_2d(p.xy);
#else ifdef NOISE_DIMENSIONS_3D
    return snoise_3d(p.xyz);
#else ifdef NOISE_DIMENSIONS_4D
    return snoise_4d(p);
#endif
}

// R(s) for s = 0 .. 5: 100 + 100 * (Jenkins hash of s and, from 2D on, of the component's index), written out.
fn random_offset(s: u32) -> vec4f {
    switch s {
        case 0u: {
#ifdef NOISE_DIMENSIONS_1D
            return vec4f(158.242584, 0.0, 0.0, 0.0);
#else
            return vec4f(186.031281, 114.955956, 154.44751, 142.504913);
#endif
        }
        case 1u: {
#ifdef NOISE_DIMENSIONS_1D
            return vec4f(114.836052, 0.0, 0.0, 0.0);
#else
            return vec4f(199.839996, 162.292603, 154.048233, 142.267609);
#endif
        }
        case 2u: {
#ifdef NOISE_DIMENSIONS_1D
            return vec4f(188.488693, 0.0, 0.0, 0.0);
#else
            return vec4f(111.633842, 157.369385, 199.088104, 178.436127);
#endif
        }
        case 3u: {
            return vec4f(165.445282, 162.768219, 193.408417, 145.255508);
        }
        case 4u: {
            return vec4f(155.580917, 177.154633, 138.14003, 180.18573);
        }
        default: {
            return vec4f(188.85379, 132.677689, 162.052155, 185.268158);
        }
    }
}

#ifdef NOISE_DIMENSIONS_1D
const DIMENSIONS: u32 = 1u;
#else ifdef NOISE_DIMENSIONS_2D
const DIMENSIONS: u32 = 2u;
#else ifdef NOISE_DIMENSIONS_3D
const DIMENSIONS: u32 = 3u;
#else ifdef NOISE_DIMENSIONS_4D
const DIMENSIONS: u32 = 4u;
#endif

struct Fractal {
    // Octaves after the first one, and the weight of one more.
    octaves: i32,
    rest: f32,
    roughness: f32,
    lacunarity: f32,
    offset: f32,
    gain: f32,
}

// The sum of a single octave.
fn one_octave(noise: f32, offset: f32) -> f32 {
#ifdef NOISE_TYPE_FBM
#ifdef NORMALIZE
    return 0.5 * noise + 0.5;
#else
    return noise;
#endif
#else ifdef NOISE_TYPE_MULTIFRACTAL
    return noise + 1.0;
#else ifdef NOISE_TYPE_HETERO_TERRAIN
    return offset + noise;
#else ifdef NOISE_TYPE_HYBRID_MULTIFRACTAL
    return noise + offset;
#else ifdef NOISE_TYPE_RIDGED_MULTIFRACTAL
    let signal = offset - abs(noise);
    return signal * signal;
#endif
}

// Whole octaves and the fractional one share a loop, so that the noise is inlined once.
#ifdef NOISE_TYPE_FBM

fn finish(sum: f32, weights: f32) -> f32 {
#ifdef NORMALIZE
    return (0.5 * sum) / weights + 0.5;
#else
    return sum;
#endif
}

fn octave_sum(p: vec4f, f: Fractal) -> f32 {
    var sum = 0.0;
    var weights = 0.0;
    var amplitude = 1.0;
    var scale = 1.0;
    var blended_sum = 0.0;
    var blended_weights = 1.0;
    let count = f.octaves + select(1, 2, f.rest != 0.0);
    for (var i = 0; i < 16; i++) {
        if i >= count {
            break;
        }
        let next_sum = sum + snoise(scale * p) * amplitude;
        let next_weights = weights + amplitude;
        if i <= f.octaves {
            sum = next_sum;
            weights = next_weights;
        } else {
            blended_sum = next_sum;
            blended_weights = next_weights;
        }
        amplitude *= f.roughness;
        scale *= f.lacunarity;
    }
    let value = finish(sum, weights);
    return select(value, mix_linear(value, finish(blended_sum, blended_weights), f.rest), f.rest != 0.0);
}

#else ifdef NOISE_TYPE_MULTIFRACTAL

fn octave_sum(point: vec4f, f: Fractal) -> f32 {
    var p = point;
    var value = 1.0;
    var amplitude = 1.0;
    let count = f.octaves + select(1, 2, f.rest != 0.0);
    for (var i = 0; i < 16; i++) {
        if i >= count {
            break;
        }
        let weight = select(f.rest * amplitude, amplitude, i <= f.octaves);
        value *= weight * snoise(p) + 1.0;
        amplitude *= f.roughness;
        p *= f.lacunarity;
    }
    return value;
}

#else ifdef NOISE_TYPE_HETERO_TERRAIN

fn octave_sum(point: vec4f, f: Fractal) -> f32 {
    var p = point;
    var value = 0.0;
    var amplitude = f.roughness;
    let count = f.octaves + select(1, 2, f.rest != 0.0);
    for (var i = 0; i < 16; i++) {
        if i >= count {
            break;
        }
        let raised = snoise(p) + f.offset;
        if i == 0 {
            value = raised;
        } else {
            let increment = (raised * amplitude) * value;
            value += select(f.rest * increment, increment, i <= f.octaves);
            amplitude *= f.roughness;
        }
        p *= f.lacunarity;
    }
    return value;
}

#else ifdef NOISE_TYPE_HYBRID_MULTIFRACTAL

fn octave_sum(point: vec4f, f: Fractal) -> f32 {
    var p = point;
    var value = 0.0;
    var amplitude = 1.0;
    var weight = 1.0;
    let count = f.octaves + select(1, 2, f.rest != 0.0);
    for (var i = 0; i < 16; i++) {
        // The noise fades out where the weight has vanished.
        if i >= count || !(weight > 0.001) {
            break;
        }
        weight = min(weight, 1.0);
        let signal = (snoise(p) + f.offset) * amplitude;
        value += select(f.rest * weight, weight, i <= f.octaves) * signal;
        weight *= f.gain * signal;
        amplitude *= f.roughness;
        p *= f.lacunarity;
    }
    return value;
}

#else ifdef NOISE_TYPE_RIDGED_MULTIFRACTAL

// Has no fractional octave.
fn octave_sum(point: vec4f, f: Fractal) -> f32 {
    var p = point;
    var value = 0.0;
    var signal = 0.0;
    var amplitude = f.roughness;
    for (var i = 0; i < 16; i++) {
        if i > f.octaves {
            break;
        }
        let ridge = f.offset - abs(snoise(p));
        if i == 0 {
            signal = ridge * ridge;
            value = signal;
        } else {
            let weight = clamp(signal * f.gain, 0.0, 1.0);
            signal = (ridge * ridge) * weight;
            value += signal * amplitude;
            amplitude *= f.roughness;
        }
        p *= f.lacunarity;
    }
    return value;
}

#endif

fn fractal(p: vec4f, f: Fractal) -> f32 {
#ifdef INPUT_DETAIL_IS_ZERO
    return one_octave(snoise(p), f.offset);
#else ifdef INPUT_ROUGHNESS_IS_ZERO
    return one_octave(snoise(p), f.offset);
#else
    return octave_sum(p, f);
#endif
}

// Every axis moves by a noise of its own, all of them read at the undistorted point.
fn distort(p: vec4f, distortion: f32) -> vec4f {
#ifdef INPUT_DISTORTION_IS_ZERO
    return p;
#else
    var moved = p;
    if distortion != 0.0 {
        for (var axis = 0u; axis < DIMENSIONS; axis++) {
            let push = snoise(p + random_offset(axis)) * distortion;
            moved = select(moved, p + push, vec4u(axis) == vec4u(0u, 1u, 2u, 3u));
        }
    }
    return moved;
#endif
}

fn evaluate(
#ifdef NOISE_DIMENSIONS_1D
    w: f32,
#else
    vector: vec3f,
#endif
#ifdef NOISE_DIMENSIONS_4D
    w: f32,
#endif
    scale: f32,
    detail: f32,
    roughness: f32,
    lacunarity: f32,
#ifdef NOISE_TYPE_HETERO_TERRAIN
    offset: f32,
#else ifdef NOISE_TYPE_HYBRID_MULTIFRACTAL
    offset: f32,
    gain: f32,
#else ifdef NOISE_TYPE_RIDGED_MULTIFRACTAL
    offset: f32,
    gain: f32,
#endif
    distortion: f32,
) -> Outputs {
#ifdef NOISE_DIMENSIONS_1D
    let coordinates = vec4f(w * scale, 0.0, 0.0, 0.0);
#else ifdef NOISE_DIMENSIONS_2D
    let coordinates = vec4f(vector.xy * scale, 0.0, 0.0);
#else ifdef NOISE_DIMENSIONS_3D
    let coordinates = vec4f(vector * scale, 0.0);
#else ifdef NOISE_DIMENSIONS_4D
    let coordinates = vec4f(vector, w) * scale;
#endif
    let d = clamp(detail, 0.0, 15.0);
    var f: Fractal;
    f.octaves = i32(d);
    f.rest = d - floor(d);
    f.roughness = max(roughness, 0.0);
    f.lacunarity = lacunarity;
#ifdef NOISE_TYPE_HETERO_TERRAIN
    f.offset = offset;
#else ifdef NOISE_TYPE_HYBRID_MULTIFRACTAL
    f.offset = offset;
    f.gain = gain;
#else ifdef NOISE_TYPE_RIDGED_MULTIFRACTAL
    f.offset = offset;
    f.gain = gain;
#endif
    let p = distort(coordinates, distortion);
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    var color = vec3f(0.0);
    for (var channel = 0u; channel < 3u; channel++) {
        let q = select(p + random_offset(DIMENSIONS + channel - 1u), p, channel == 0u);
        color = select(color, vec3f(fractal(q, f)), vec3u(channel) == vec3u(0u, 1u, 2u));
    }
    outputs.color = color;
#ifdef OUTPUT_FAC
    outputs.fac = color.x;
#endif
#else
    outputs.fac = fractal(p, f);
#endif
    return outputs;
}
