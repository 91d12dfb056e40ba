// Noise on a lattice as published clouds have it: twin of src/nodes/lattice_noise.rs.
// KIND_VALUE ([0, 1]), KIND_SIGNED_VALUE ([-1, 1]), KIND_GRADIENT_289 (unit gradients of a permutation polynomial modulo 289).
// Domain: coordinates within 2^31 cells. Limits: gradients are divided by a root, which differs by units between adapters.
#import cloudparity::hash::pcg3
#import cloudparity::numeric::{mix_linear, to_int}

#ifdef KIND_GRADIENT_289
fn wrapped(coordinate: i32) -> i32 {
    let rest = coordinate % 289;
    return select(rest, rest + 289, rest < 0);
}

fn corner(cell: vec3i, fraction: vec3f, number: vec3i) -> f32 {
    let at = cell + number;
    let first = ((17 * wrapped(at.x) + wrapped(at.y)) * 17 + wrapped(at.z)) % 289;
    let mixed = (34 * first + 1) * first % 289;
    let parts = vec3f(vec3i(2) * (vec3i(mixed, mixed / 7, mixed / 49) % vec3i(7)) - vec3i(1)) + vec3f(0.0001);
    let direction = parts / sqrt(parts.x * parts.x + parts.y * parts.y + parts.z * parts.z);
    let offset = fraction - vec3f(number);
    return direction.x * offset.x + direction.y * offset.y + direction.z * offset.z;
}
#else
fn corner(cell: vec3i, fraction: vec3f, number: vec3i) -> f32 {
    let value = pcg3(cell + number).x;
#ifdef KIND_SIGNED_VALUE
    return 2.0 * value - 1.0;
#else
    return value;
#endif
}
#endif

fn evaluate(vector: vec3f) -> f32 {
    let floors = floor(vector);
    let cell = vec3i(to_int(floors.x), to_int(floors.y), to_int(floors.z));
    let f = vector - floors;
#ifdef KIND_GRADIENT_289
    let weight = (f * f) * (f * (f * (f * 6.0 - 15.0) + 10.0));
#else
    let weight = (f * f) * (3.0 - 2.0 * f);
#endif
    var planes = vec2f(0.0);
    for (var z = 0; z < 2; z++) {
        let low = mix_linear(corner(cell, f, vec3i(0, 0, z)), corner(cell, f, vec3i(1, 0, z)), weight.x);
        let high = mix_linear(corner(cell, f, vec3i(0, 1, z)), corner(cell, f, vec3i(1, 1, z)), weight.x);
        planes[z] = mix_linear(low, high, weight.y);
    }
    return mix_linear(planes.x, planes.y, weight.z);
}
