// The periodic noise of the Perlin-FBM cloud, thresholded: twin of Bake::blend and Bake::byte in
// src/density/perlin_fbm/bake.rs, one invocation per texel.
//
// A coordinate of the noise depends on one axis, one copy of the blend and one octave: the tables hold its place in the
// cell, computed in f64, so that high frequencies lose no bits here. The permutation comes folded: two look-ups in one table of
// 256 x 256 entries, the last two in another of 256, which holds the number of a gradient.

struct Bake {
    side: u32,
    octaves: u32,
    // Numbers of texels that are to be made.
    first: u32,
    count: u32,
    coverage: f32,
    softness: f32,
    intensity: f32,
    amplitude_sum: f32,
}

@group(0) @binding(0) var<uniform> bake: Bake;
// Per copy, octave and texel of an axis: place in the cell, its fade, and the cell as bits.
@group(0) @binding(1) var<storage, read> axes: array<vec4f>;
@group(0) @binding(2) var<storage, read> amplitudes: array<f32>;
// Entry x + 256 y: two look-ups for a lattice point in x and y, four entries to a word.
@group(0) @binding(3) var<storage, read> pairs: array<u32>;
@group(0) @binding(4) var<storage, read> gradients: array<u32>;
@group(0) @binding(5) var<storage, read_write> texels: array<u32>;

fn axis_at(copy_number: u32, octave: u32, place: u32) -> vec4f {
    return axes[(copy_number * bake.octaves + octave) * bake.side + place];
}

fn pair(x: u32, y: u32) -> u32 {
    let entry = (x & 255u) + 256u * (y & 255u);
    return (pairs[entry >> 2u] >> (8u * (entry & 3u))) & 255u;
}

fn signed(value: f32, is_negative: bool) -> f32 {
    return select(value, -value, is_negative);
}

fn corner(hash: u32, z: u32, from_corner: vec3f) -> f32 {
    let gradient = gradients[(hash + z) & 255u];
    let u = select(from_corner.y, from_corner.x, gradient < 8u);
    let v = select(select(from_corner.z, from_corner.x, gradient == 12u || gradient == 14u), from_corner.y, gradient < 4u);
    return signed(u, (gradient & 1u) != 0u) + signed(v, (gradient & 2u) != 0u);
}

fn lerp(t: f32, a: f32, b: f32) -> f32 {
    return a + t * (b - a);
}

fn noise(x: vec4f, y: vec4f, z: vec4f) -> f32 {
    let cell = vec3u(bitcast<u32>(x.z), bitcast<u32>(y.z), bitcast<u32>(z.z));
    let low = vec3f(x.x, y.x, z.x);
    let high = low - 1.0;
    let h00 = pair(cell.x, cell.y);
    let h10 = pair(cell.x + 1u, cell.y);
    let h01 = pair(cell.x, cell.y + 1u);
    let h11 = pair(cell.x + 1u, cell.y + 1u);
    let below = lerp(
        y.y,
        lerp(x.y, corner(h00, cell.z, low), corner(h10, cell.z, vec3f(high.x, low.yz))),
        lerp(x.y, corner(h01, cell.z, vec3f(low.x, high.y, low.z)), corner(h11, cell.z, vec3f(high.xy, low.z))),
    );
    let up = cell.z + 1u;
    let above = lerp(
        y.y,
        lerp(x.y, corner(h00, up, vec3f(low.xy, high.z)), corner(h10, up, vec3f(high.x, low.y, high.z))),
        lerp(x.y, corner(h01, up, vec3f(low.x, high.yz)), corner(h11, up, high)),
    );
    return lerp(z.y, below, above);
}

// A power as Math.pow has it: a negative base with a broken exponent is not a number, which is told by -1 of the second part.
fn power(base: f32, exponent: f32) -> vec2f {
    if exponent == 1.0 { return vec2f(base, 1.0); }
    if base >= 0.0 { return vec2f(pow(base, exponent), 1.0); }
    if fract(exponent) != 0.0 { return vec2f(0.0, -1.0); }
    let is_odd = fract(exponent * 0.5) != 0.0;
    return vec2f(signed(pow(-base, exponent), is_odd), 1.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= bake.count { return; }
    let index = bake.first + invocation.x;
    let place = vec3u(index % bake.side, index / bake.side % bake.side, index / (bake.side * bake.side));
    let part = vec3f(place) / f32(bake.side - 1u);
    var sum = 0.0;
    for (var copy_number = 0u; copy_number < 8u; copy_number++) {
        let copies = vec3u(copy_number & 1u, (copy_number >> 1u) & 1u, copy_number >> 2u);
        var value = 0.0;
        for (var octave = 0u; octave < bake.octaves; octave++) {
            let found = noise(
                axis_at(copies.x, octave, place.x),
                axis_at(copies.y, octave, place.y),
                axis_at(copies.z, octave, place.z),
            );
            value += found * amplitudes[octave];
        }
        let weight = select(1.0 - part, part, copies == vec3u(1u));
        sum += value / bake.amplitude_sum * weight.x * weight.y * weight.z;
    }
    let raised = power((sum + 1.0) * 0.5, bake.intensity);
    let t = clamp((raised.x - (bake.coverage - bake.softness)) / (2.0 * bake.softness), 0.0, 1.0);
    let byte = floor(t * t * (3.0 - 2.0 * t) * 255.0);
    texels[invocation.x] = select(0u, u32(byte), raised.y > 0.0);
}
