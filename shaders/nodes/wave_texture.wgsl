// Wave Texture node (ShaderNodeTexWave): bands or rings with a sine, saw or triangle profile, bent by fractal noise.
// WAVE_TYPE_BANDS with BANDS_DIRECTION_X, _Y, _Z, _DIAGONAL; WAVE_TYPE_RINGS with RINGS_DIRECTION_X, _Y, _Z (around the
// axis), _SPHERICAL; WAVE_PROFILE_SIN, _SAW, _TRI. Color and Factor are the same value.
// Source: Blender's formulas in its order. The noise is normalised fBM with a lacunarity of 2.
// Domain: finite f32. Detail is not limited, but octave 128 is infinite and the last one that runs: the exact result is
// NaN from there on, for which WGSL has no promise. Limits: a last bit of the phase, about 100 times the coordinate,
// is a larger share of a wave the farther the point lies; a saw jumps.
#import cloudparity::gradient_noise::snoise_3d
#import cloudparity::numeric::{mix_linear, sin_of, to_int}

struct Outputs {
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_FAC
    fac: f32,
#endif
}

const HALF_PI: f32 = 1.57079637;
// 1 / (2 pi)
const INVERSE_TURN: f32 = 0.159154937;
const MOST_OCTAVES: i32 = 129i;

fn finish(sum: f32, weights: f32) -> f32 {
    return (0.5 * sum) / weights + 0.5;
}

// Whole octaves and the fractional one share a loop, so that the noise is inlined once.
fn fractal(p: vec3f, detail: f32, roughness: f32) -> f32 {
    let octaves = to_int(detail);
    let rest = detail - floor(detail);
    let count = octaves + select(1, 2, rest != 0.0);
    var sum = 0.0;
    var weights = 0.0;
    var amplitude = 1.0;
    var scale = 1.0;
    var blended_sum = 0.0;
    var blended_weights = 1.0;
    for (var i = 0i; i < MOST_OCTAVES; i++) {
        if i >= count {
            break;
        }
        let next_sum = sum + snoise_3d(scale * p) * amplitude;
        let next_weights = weights + amplitude;
        if i <= octaves {
            sum = next_sum;
            weights = next_weights;
        } else {
            blended_sum = next_sum;
            blended_weights = next_weights;
        }
        amplitude *= roughness;
        scale *= 2.0;
    }
    let value = finish(sum, weights);
    return select(value, mix_linear(value, finish(blended_sum, blended_weights), rest), rest != 0.0);
}

fn distance_from_zero(p: vec3f) -> f32 {
    return sqrt((p.x * p.x + p.y * p.y) + p.z * p.z);
}

fn undistorted(p: vec3f) -> f32 {
#ifdef WAVE_TYPE_BANDS
#ifdef BANDS_DIRECTION_X
    return p.x * 20.0;
#else ifdef BANDS_DIRECTION_Y
    return p.y * 20.0;
#else ifdef BANDS_DIRECTION_Z
    return p.z * 20.0;
#else
    return ((p.x + p.y) + p.z) * 10.0;
#endif
#else
#ifdef RINGS_DIRECTION_X
    return distance_from_zero(vec3f(0.0, p.y, p.z)) * 20.0;
#else ifdef RINGS_DIRECTION_Y
    return distance_from_zero(vec3f(p.x, 0.0, p.z)) * 20.0;
#else ifdef RINGS_DIRECTION_Z
    return distance_from_zero(vec3f(p.x, p.y, 0.0)) * 20.0;
#else
    return distance_from_zero(p) * 20.0;
#endif
#endif
}

// The limits stop what a fused product leaves where the phase is coarse.
fn profile(phase: f32) -> f32 {
#ifdef WAVE_PROFILE_SIN
    return 0.5 + 0.5 * sin_of(phase - HALF_PI);
#else
    let turns = phase * INVERSE_TURN;
#ifdef WAVE_PROFILE_SAW
    return clamp(turns - floor(turns), 0.0, 1.0);
#else
    return min(abs(turns - floor(turns + 0.5)) * 2.0, 2.0);
#endif
#endif
}

fn evaluate(
    vector: vec3f,
    scale: f32,
    distortion: f32,
    detail: f32,
    detail_scale: f32,
    detail_roughness: f32,
    phase_offset: f32,
) -> Outputs {
    let p = (vector * scale + vec3f(0.000001)) * 0.999999;
    var phase = undistorted(p) + phase_offset;
#ifndef INPUT_DISTORTION_IS_ZERO
    if distortion != 0.0 {
        phase += distortion * (fractal(p * detail_scale, detail, detail_roughness) * 2.0 - 1.0);
    }
#endif
    let value = profile(phase);
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    outputs.color = vec3f(value);
#endif
#ifdef OUTPUT_FAC
    outputs.fac = value;
#endif
    return outputs;
}
