// Magic Texture node (ShaderNodeTexMagic): waves of the coordinates' sums, fed into each other TURBULENCE_DEPTH times.
// Color = 1/2 - (x, y, z), unclamped; Factor is its mean. The coordinate is reduced modulo 2 pi before it is scaled,
// SINCE_BLENDER_5_2 after that.
// Source: Blender's formulas in its order, with own sines and an exact remainder.
// Domain: finite f32. Limits: an error of a wave grows with distortion^TURBULENCE_DEPTH, whoever computes.
#import cloudparity::numeric::{cos_of, fmod, sin_of}

struct Outputs {
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_FAC
    fac: f32,
#endif
}

const TURN: f32 = 6.28318548;
const THIRD: f32 = 0.333333343;

fn waves(p: vec3f, scale: f32, distortion: f32) -> vec3f {
#ifdef SINCE_BLENDER_5_2
    let a = fmod(p.x * scale, TURN);
    let b = fmod(p.y * scale, TURN);
    let c = fmod(p.z * scale, TURN);
    let rest = 1.0;
#else
    let a = fmod(p.x, TURN);
    let b = fmod(p.y, TURN);
    let c = fmod(p.z, TURN);
    let rest = scale;
#endif
    var x = sin_of((((a + b) + c) * 5.0) * rest);
    var y = cos_of((((-a + b) - c) * 5.0) * rest);
    var z = -cos_of((((-a - b) + c) * 5.0) * rest);
    if TURBULENCE_DEPTH > 0 {
        x *= distortion;
        y *= distortion;
        z *= distortion;
        y = -cos_of((x - y) + z) * distortion;
    }
    if TURBULENCE_DEPTH > 1 {
        x = cos_of((x - y) - z) * distortion;
    }
    if TURBULENCE_DEPTH > 2 {
        z = sin_of((-x - y) - z) * distortion;
    }
    if TURBULENCE_DEPTH > 3 {
        x = -cos_of((-x + y) - z) * distortion;
    }
    if TURBULENCE_DEPTH > 4 {
        y = -sin_of((-x + y) + z) * distortion;
    }
    if TURBULENCE_DEPTH > 5 {
        y = -cos_of((-x + y) + z) * distortion;
    }
    if TURBULENCE_DEPTH > 6 {
        x = cos_of((x + y) + z) * distortion;
    }
    if TURBULENCE_DEPTH > 7 {
        z = sin_of((x + y) - z) * distortion;
    }
    if TURBULENCE_DEPTH > 8 {
        x = -cos_of((-x - y) + z) * distortion;
    }
    if TURBULENCE_DEPTH > 9 {
        y = -sin_of((x - y) + z) * distortion;
    }
    var result = vec3f(x, y, z);
    if distortion != 0.0 {
        result *= 1.0 / (distortion * 2.0);
    }
    return result;
}

fn evaluate(vector: vec3f, scale: f32, distortion: f32) -> Outputs {
    let color = vec3f(0.5) - waves(vector, scale, distortion);
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    outputs.color = color;
#endif
#ifdef OUTPUT_FAC
    outputs.fac = ((color.x + color.y) + color.z) * THIRD;
#endif
    return outputs;
}
