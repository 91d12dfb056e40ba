// The scalar functions of the integrators, one call per invocation: src/measure/stability/functions.rs numbers them and says what goes in.
#import cloudparity::phase
#import cloudparity::terms
#import cloudparity::transfer

struct Request {
    function: u32,
    count: u32,
    padding: vec2u,
}

@group(0) @binding(0) var<uniform> request: Request;
@group(0) @binding(1) var<storage, read> inputs: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> results: array<f32>;

fn value(input: vec4f) -> f32 {
    switch request.function {
        case 0u: { return transfer::transmittance(vec3f(input.x)).x; }
        case 1u: { return transfer::absorbed(vec3f(input.x)).x; }
        case 2u: { return transfer::mean_transmittance(vec3f(input.x)).x; }
        case 3u: { return transfer::mean_transmittance(vec3f(input.x * input.y)).x * input.y; }
        case 4u: { return phase::henyey_greenstein_by_lack(input.x, input.y); }
        case 5u: { return phase::sample_henyey_greenstein(input.x, input.y); }
        case 6u: { return terms::powder(input.x, input.y, input.z); }
        case 7u: { return terms::silver(input.x, input.y, input.z); }
        case 8u: {
            var weights: array<f32, 16>;
            var share = 1.0;
            for (var octave = 0u; octave < 16u; octave++) {
                weights[octave] = share;
                share *= input.y;
            }
            return terms::octaves(&weights, 16u, input.z, vec3f(input.x)).x;
        }
        case 9u: { return terms::compressed(input.y, vec3f(input.x)).x; }
        default: { return bitcast<f32>(0x7fc00000u + request.padding.x); }
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= request.count { return; }
    results[invocation.x] = value(inputs[invocation.x]);
}
