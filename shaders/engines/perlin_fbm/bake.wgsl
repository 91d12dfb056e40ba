// The periodic noise of the Perlin-FBM cloud, thresholded: twin of Bake::blend and Bake::byte in
// src/engines/perlin_fbm/bake.rs. An invocation makes DEPTH texels, one behind the other: what depends on x and y is shared.
//
// A coordinate of the noise depends on one axis, one copy of the blend and one octave: the tables hold its place in the
// cell, computed in f64, so that high frequencies lose no bits here. The permutation comes folded: two look-ups in one table of
// 256 x 256 entries, the last two in another of 256, which holds gradients.

struct Bake {
    side: u32,
    octaves: u32,
    // Invocations of this dispatch: the number of the first, and how many.
    first: u32,
    count: u32,
    // Where the threshold begins, and how wide it is, both from f64: the difference of its ends in f32 would lose bits.
    low: f32,
    width: f32,
    intensity: f32,
    padding: u32,
}

// Tables are uniform buffers, 64 KiB at most, where they fit: software adapters read those several times faster than storage.
@group(0) @binding(0) var<uniform> bake: Bake;
// Per copy, octave and texel of an axis, two words: the bits of the place in the cell, and the cell.
#ifdef LARGE_AXES
@group(0) @binding(1) var<storage, read> axes: array<vec4u>;
#else
@group(0) @binding(1) var<uniform> axes: array<vec4u, 4096>;
#endif
// Over their sum.
@group(0) @binding(2) var<uniform> amplitudes: array<vec4f, 16>;
// Entry x + 256 y: two look-ups for a lattice point in x and y, four entries to a word.
@group(0) @binding(3) var<uniform> pairs: array<vec4u, 4096>;
// Gradients as the sum of two coordinates with signs. Bits 31 and 30: the sign of the first and the second; bit 0: the first is x,
// else y; bit 1: the second is y; bit 2: it is x; neither: it is z.
@group(0) @binding(4) var<uniform> gradients: array<vec4u, 64>;
@group(0) @binding(5) var<storage, read_write> texels: array<u32>;

const DEPTH = 4u;

struct Along {
    part: f32,
    cell: u32,
}

fn axis_at(copy_number: u32, octave: u32, place: u32) -> Along {
    let entry = (copy_number * bake.octaves + octave) * bake.side + place;
    let word = 2u * (entry & 1u);
    return Along(bitcast<f32>(axes[entry >> 1u][word]), axes[entry >> 1u][word + 1u]);
}

fn pair(x: u32, y: u32) -> u32 {
    let entry = (x & 255u) + 256u * (y & 255u);
    return (pairs[entry >> 4u][(entry >> 2u) & 3u] >> (8u * (entry & 3u))) & 255u;
}

fn fade(t: f32) -> f32 {
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
}

fn lerp(t: f32, a: f32, b: f32) -> f32 {
    return a + t * (b - a);
}

fn corner(index: u32, x: f32, y: f32, z: f32) -> f32 {
    let gradient = gradients[(index >> 2u) & 63u][index & 3u];
    let u = select(y, x, (gradient & 1u) != 0u);
    let v = select(select(z, x, (gradient & 4u) != 0u), y, (gradient & 2u) != 0u);
    return bitcast<f32>(bitcast<u32>(u) ^ (gradient & 0x80000000u))
        + bitcast<f32>(bitcast<u32>(v) ^ ((gradient << 1u) & 0x80000000u));
}

// What x and y say of the noise: places in the cell, fades, and look-ups at the cell's corners 00, 10, 01, 11.
struct Column {
    x: f32,
    y: f32,
    fade_x: f32,
    fade_y: f32,
    hashes: vec4u,
}

fn face(column: Column, cell: u32, z: f32) -> f32 {
    let below = lerp(
        column.fade_x,
        corner(column.hashes.x + cell, column.x, column.y, z),
        corner(column.hashes.y + cell, column.x - 1.0, column.y, z),
    );
    let above = lerp(
        column.fade_x,
        corner(column.hashes.z + cell, column.x, column.y - 1.0, z),
        corner(column.hashes.w + cell, column.x - 1.0, column.y - 1.0, z),
    );
    return lerp(column.fade_y, below, above);
}

fn noise(column: Column, along_z: Along) -> f32 {
    let below = face(column, along_z.cell, along_z.part);
    return lerp(fade(along_z.part), below, face(column, along_z.cell + 1u, along_z.part - 1.0));
}

// A power as Math.pow has it: a negative base with a broken exponent is not a number, which is told by -1 of the second part.
fn power(base: f32, exponent: f32) -> vec2f {
    if exponent == 1.0 { return vec2f(base, 1.0); }
    if base >= 0.0 { return vec2f(pow(base, exponent), 1.0); }
    if fract(exponent) != 0.0 { return vec2f(0.0, -1.0); }
    let raised = pow(-base, exponent);
    return vec2f(select(raised, -raised, fract(exponent * 0.5) != 0.0), 1.0);
}

fn byte(value: f32) -> u32 {
    let raised = power(value, bake.intensity);
    let t = clamp((raised.x - bake.low) / bake.width, 0.0, 1.0);
    return select(0u, u32(floor(t * t * (3.0 - 2.0 * t) * 255.0)), raised.y > 0.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= bake.count { return; }
    let number = bake.first + invocation.x;
    let side = bake.side;
    let x = number % side;
    let y = number / side % side;
    let z = number / (side * side) * DEPTH;
    let last = side - 1u;
    // Beyond the last texel the last again; it is not stored.
    let places = min(vec4u(z, z + 1u, z + 2u, z + 3u), vec4u(last));
    let parts = vec4f(places) / f32(last);
    var sums = vec4f(0.0);
    for (var copy_number = 0u; copy_number < 4u; copy_number++) {
        let copy_x = copy_number & 1u;
        let copy_y = copy_number >> 1u;
        let part = vec2f(f32(x), f32(y)) / f32(last);
        let weights = select(1.0 - part, part, vec2u(copy_x, copy_y) == vec2u(1u));
        var low = vec4f(0.0);
        var high = vec4f(0.0);
        for (var octave = 0u; octave < bake.octaves; octave++) {
            let along_x = axis_at(copy_x, octave, x);
            let along_y = axis_at(copy_y, octave, y);
            let cell = vec2u(along_x.cell, along_y.cell);
            let hashes = vec4u(
                pair(cell.x, cell.y),
                pair(cell.x + 1u, cell.y),
                pair(cell.x, cell.y + 1u),
                pair(cell.x + 1u, cell.y + 1u),
            );
            let column = Column(along_x.part, along_y.part, fade(along_x.part), fade(along_y.part), hashes);
            let amplitude = amplitudes[octave >> 2u][octave & 3u];
            low += amplitude * vec4f(
                noise(column, axis_at(0u, octave, places.x)),
                noise(column, axis_at(0u, octave, places.y)),
                noise(column, axis_at(0u, octave, places.z)),
                noise(column, axis_at(0u, octave, places.w)),
            );
            high += amplitude * vec4f(
                noise(column, axis_at(1u, octave, places.x)),
                noise(column, axis_at(1u, octave, places.y)),
                noise(column, axis_at(1u, octave, places.z)),
                noise(column, axis_at(1u, octave, places.w)),
            );
        }
        sums += (low * (1.0 - parts) + high * parts) * weights.x * weights.y;
    }
    let values = (sums + 1.0) * 0.5;
    let layer = side * side;
    let target_texel = x + y * side + z * layer;
    texels[target_texel] = byte(values.x);
    if z + 1u <= last { texels[target_texel + layer] = byte(values.y); }
    if z + 2u <= last { texels[target_texel + 2u * layer] = byte(values.z); }
    if z + 3u <= last { texels[target_texel + 3u * layer] = byte(values.w); }
}
