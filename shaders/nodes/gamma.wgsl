// Gamma node (ShaderNodeGamma): color^gamma where a channel is positive, the channel itself elsewhere; white for
// gamma 0. Source: Blender. Domain: finite f32. Accuracy: that of the power in the numeric module.
// Limits: subnormal channels give 0.
#import cloudparity::numeric::safe_pow3

fn evaluate(color: vec3f, gamma: f32) -> vec3f {
    if gamma == 0.0 {
        return vec3f(1.0);
    }
    return select(color, safe_pow3(max(color, vec3f(0.0)), vec3f(gamma)), color > vec3f(0.0));
}
