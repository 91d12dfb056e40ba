// Gradient Texture node (ShaderNodeTexGradient): a ramp over the coordinate, limited to [0, 1].
// GRADIENT_TYPE_LINEAR, _QUADRATIC, _EASING (along x), _DIAGONAL (x and y), _SPHERICAL, _QUADRATIC_SPHERE (towards the
// origin, 0 from the distance 0.999999 on), _RADIAL (angle around z in turns, 1/2 along positive x).
// Color and Factor are the same value. Source: Blender's formulas in its order. Domain: finite f32 whose squares are.
#import cloudparity::numeric::atan2_of

struct Outputs {
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_FAC
    fac: f32,
#endif
}

const RADIUS: f32 = 0.999999;
// 1 / (2 pi)
const INVERSE_TURN: f32 = 0.159154937;

fn nearness(p: vec3f) -> f32 {
    return max(RADIUS - sqrt((p.x * p.x + p.y * p.y) + p.z * p.z), 0.0);
}

fn ramp(p: vec3f) -> f32 {
#ifdef GRADIENT_TYPE_LINEAR
    return p.x;
#else ifdef GRADIENT_TYPE_QUADRATIC
    let m = max(p.x, 0.0);
    return m * m;
#else ifdef GRADIENT_TYPE_EASING
    let m = clamp(p.x, 0.0, 1.0);
    let t = m * m;
    return 3.0 * t - (2.0 * t) * m;
#else ifdef GRADIENT_TYPE_DIAGONAL
    return (p.x + p.y) * 0.5;
#else ifdef GRADIENT_TYPE_SPHERICAL
    return nearness(p);
#else ifdef GRADIENT_TYPE_QUADRATIC_SPHERE
    let m = nearness(p);
    return m * m;
#else ifdef GRADIENT_TYPE_RADIAL
    return atan2_of(p.y, p.x) * INVERSE_TURN + 0.5;
#endif
}

fn evaluate(vector: vec3f) -> Outputs {
    let value = clamp(ramp(vector), 0.0, 1.0);
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    outputs.color = vec3f(value);
#endif
#ifdef OUTPUT_FAC
    outputs.fac = value;
#endif
    return outputs;
}
