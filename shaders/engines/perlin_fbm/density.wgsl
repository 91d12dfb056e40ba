// The density of the Perlin-FBM cloud: twin of Cloud::at in src/engines/perlin_fbm/mod.rs.
//
// Textures are filtered here, because the filter of graphics hardware has weights of 8 bits.
#define_import_path cloudparity::density_model

struct Model {
    // Of the mask along -x, -y, -z and +x, +y, +z.
    flattening_low: vec3f,
    mask_radius: f32,
    flattening_high: vec3f,
    mask_softness: f32,
    // Of the box's centre in the texture, in periods, 0 to 1.
    offset: vec3f,
    tiling: f32,
    // Of the main and the fine deformation; the value that stands for both textures where they are not read.
    strengths: vec2f,
    threshold: f32,
    multiplier: f32,
    // Texels per axis of the volume and of the mask's textures; whether the latter are read; whether every texel of the volume
    // counts as 1.
    side: u32,
    mask_side: u32,
    reads_textures: u32,
    shows_mask: u32,
}

@group(1) @binding(0) var<uniform> model: Model;
// One byte per texel, four to a word from its low end; x runs fastest.
@group(1) @binding(1) var<storage, read> volume: array<u32>;
// Of the mask: main and fine deformation of two texels to a word.
@group(1) @binding(2) var<storage, read> masks: array<u32>;

struct Filter {
    low: vec3u,
    high: vec3u,
    fraction: vec3f,
}

fn volume_texel(x: u32, y: u32, z: u32) -> f32 {
    let index = (z * model.side + y) * model.side + x;
    return f32((volume[index >> 2u] >> (8u * (index & 3u))) & 255u);
}

// Both deformations of a texel.
fn mask_texel(x: u32, y: u32, z: u32) -> vec2f {
    let index = (z * model.mask_side + y) * model.mask_side + x;
    let bits = masks[index >> 1u] >> (16u * (index & 1u));
    return vec2f(f32(bits & 255u), f32((bits >> 8u) & 255u));
}

// At a place in periods from the box's centre.
fn volume_at(place: vec3f) -> f32 {
    let side = f32(model.side);
    // Whole periods go first, those of the place before the offset is added, so that the texel's fraction keeps its bits: what is left of
    // the rounding is that of the place itself, as if it were moved by half a unit in its last place. The rounding of fract may give 1.
    let scaled = fract(fract(place) + model.offset) * side - 0.5;
    let base = floor(scaled);
    let f = scaled - base;
    let last = i32(model.side) - 1;
    let first = vec3i(base);
    let low = vec3u(select(first, vec3i(last), first < vec3i(0)));
    let next = first + 1;
    let high = vec3u(select(next, vec3i(0), next > vec3i(last)));
    let g = 1.0 - f;
    let below = (volume_texel(low.x, low.y, low.z) * g.x + volume_texel(high.x, low.y, low.z) * f.x) * g.y
        + (volume_texel(low.x, high.y, low.z) * g.x + volume_texel(high.x, high.y, low.z) * f.x) * f.y;
    let above = (volume_texel(low.x, low.y, high.z) * g.x + volume_texel(high.x, low.y, high.z) * f.x) * g.y
        + (volume_texel(low.x, high.y, high.z) * g.x + volume_texel(high.x, high.y, high.z) * f.x) * f.y;
    return (below * g.z + above * f.z) / 255.0;
}

fn mask_at(place: vec3f) -> vec2f {
    let last = f32(model.mask_side - 1u);
    let scaled = place * f32(model.mask_side) - 0.5;
    let base = floor(scaled);
    let f = scaled - base;
    let low = vec3u(clamp(base, vec3f(0.0), vec3f(last)));
    let high = vec3u(clamp(base + 1.0, vec3f(0.0), vec3f(last)));
    let g = 1.0 - f;
    let below = (mask_texel(low.x, low.y, low.z) * g.x + mask_texel(high.x, low.y, low.z) * f.x) * g.y
        + (mask_texel(low.x, high.y, low.z) * g.x + mask_texel(high.x, high.y, low.z) * f.x) * f.y;
    let above = (mask_texel(low.x, low.y, high.z) * g.x + mask_texel(high.x, low.y, high.z) * f.x) * g.y
        + (mask_texel(low.x, high.y, high.z) * g.x + mask_texel(high.x, high.y, high.z) * f.x) * f.y;
    return (below * g.z + above * f.z) / 255.0;
}

fn distance_at(place: vec3f) -> f32 {
    if model.mask_radius <= 0.0 { return -1.0; }
    let stretched = place / select(model.flattening_low, model.flattening_high, place > vec3f(0.0));
    let radius = length(stretched);
    // Also where the square is below the smallest number.
    if radius == 0.0 { return model.mask_radius; }
    var values = vec2f(0.0);
    if model.reads_textures != 0u {
        values = mask_at(stretched / radius * model.mask_radius * 0.5 + 0.5);
    }
    return model.mask_radius + dot(2.0 * values - 1.0, model.strengths) - radius;
}

// The density at a place of the local box.
fn density(place: vec3f) -> f32 {
    let t = clamp(distance_at(place) / model.mask_softness, 0.0, 1.0);
    let mask = t * t * (3.0 - 2.0 * t);
    if mask <= 0.0 { return 0.0; }
    var value = 1.0;
    if model.shows_mask == 0u { value = volume_at(place * model.tiling); }
    return select(value * model.multiplier * mask, 0.0, value < model.threshold);
}
