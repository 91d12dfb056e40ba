// Numbers on a regular grid: twin of src/nodes/texture_lookup.rs and src/base/texture.rs, with their operations in their order. Filtered
// here, because the filter of graphics hardware has weights of 8 bits.
#define_import_path cloudparity::texture
#import cloudparity::words

// A texture's constants: texels along x, y, z; the first of its words; how texels are stored, what is outside, how it is read between
// them; the values that the bytes 0 and 255 stand for.
struct Texture {
    size: vec3i,
    first: u32,
    format: u32,
    outside: u32,
    filtering: u32,
    low: f32,
    high: f32,
}

const F32 = 0u;
const F16 = 1u;
const UNORM8 = 2u;
const CLAMP = 0u;
const REPEAT = 1u;
const ZERO = 2u;
const NEAREST = 0u;
const TRILINEAR = 1u;

// A number of binary16 without sign, exactly: unpack2x16float may flush small ones to zero.
fn half(bits: u32) -> f32 {
    let sign = (bits & 0x8000u) << 16u;
    let exponent = (bits >> 10u) & 31u;
    let mantissa = bits & 1023u;
    if exponent == 0u { return bitcast<f32>(sign | bitcast<u32>(f32(mantissa) * 0x1p-24)); }
    // Biases of 15 and 127; the largest exponent means infinity or NaN in both.
    let shifted = select(exponent + 112u, 255u, exponent == 31u);
    return bitcast<f32>(sign | (shifted << 23u) | (mantissa << 13u));
}

// The texel at an index that is inside: x fastest, two (f16) or four (unorm8) to a word from its low end.
fn texel(texture: Texture, place: vec3i) -> f32 {
    let index = u32((place.z * texture.size.y + place.y) * texture.size.x + place.x);
    if texture.format == F16 { return half((words::word(texture.first + index / 2u) >> (16u * (index % 2u))) & 0xffffu); }
    if texture.format == UNORM8 {
        let byte = (words::word(texture.first + index / 4u) >> (8u * (index % 4u))) & 255u;
        return texture.low + (texture.high - texture.low) * (f32(byte) / 255.0);
    }
    return bitcast<f32>(words::word(texture.first + index));
}

// Where indices lie, by what lies outside; -1 where that is 0.
fn inside(texture: Texture, place: vec3i) -> vec3i {
    if texture.outside == REPEAT { return (place % texture.size + texture.size) % texture.size; }
    let near = clamp(place, vec3i(0), texture.size - 1);
    // GLSL ES selects no integers by a vector.
    if texture.outside == ZERO { return near - vec3i(near != place) * (near + 1); }
    return near;
}

fn value(texture: Texture, place: vec3i) -> f32 {
    if texture.outside == ZERO && any(place < vec3i(0)) { return 0.0; }
    return texel(texture, place);
}

fn along_x(texture: Texture, low: vec3i, high: i32, part: f32) -> f32 {
    let first = value(texture, low);
    return first + part * (value(texture, vec3i(high, low.y, low.z)) - first);
}

fn along_y(texture: Texture, low: vec3i, high: vec2i, part: vec2f) -> f32 {
    let first = along_x(texture, low, high.x, part.x);
    return first + part.y * (along_x(texture, vec3i(low.x, high.y, low.z), high.x, part.x) - first);
}

// The value between texels.
fn look_up(texture: Texture, index: vec3f) -> f32 {
    var at = index;
    if texture.outside == CLAMP { at = clamp(at, vec3f(0.0), vec3f(texture.size - 1)); }
    // What is far outside has no index: it is as empty as what is two texels beyond.
    if texture.outside == ZERO { at = clamp(at, vec3f(-2.0), vec3f(texture.size + 1)); }
    if texture.filtering == NEAREST { return value(texture, inside(texture, vec3i(floor(at + 0.5)))); }
    let whole = floor(at);
    let part = at - whole;
    let low = inside(texture, vec3i(whole));
    let high = inside(texture, vec3i(whole) + 1);
    let first = along_y(texture, low, high.xy, part.xy);
    return first + part.z * (along_y(texture, vec3i(low.xy, high.z), high.xy, part.xy) - first);
}
