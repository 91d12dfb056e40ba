// What an adapter can compute at most: four chains of multiply-adds per invocation, which wait for nothing but each other's arithmetic;
// src/gpu/arithmetic.rs counts them. Condition: INTEGERS (else f32).
struct Work {
    rounds: u32,
    padding: vec3u,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= arrayLength(&results) { return; }
#ifdef INTEGERS
    var state = vec4u(invocation.x) + vec4u(1u, 2u, 3u, 4u);
    for (var round = 0u; round < work.rounds; round++) {
        state = state * 1664525u + 1013904223u;
    }
    results[invocation.x] = f32(state.x ^ state.y ^ state.z ^ state.w);
#else
    var state = vec4f(f32(invocation.x)) + vec4f(1.0, 2.0, 3.0, 4.0);
    for (var round = 0u; round < work.rounds; round++) {
        state = fma(state, vec4f(0.999), vec4f(0.25));
    }
    results[invocation.x] = state.x + state.y + state.z + state.w;
#endif
}
