// The density from a grid: twin of `DensityCache::read` in src/media/density_cache.rs, with its
// operations in their order. Filtered here, because the filter of graphics hardware has weights of 8 bits.
#define_import_path cloudparity::density_cache

struct Cache {
    low: vec3f,
    smallest: f32,
    // Vertices per object unit.
    scale: vec3f,
    largest: f32,
    size: vec3u,
    padding: u32,
}

@group(1) @binding(0) var<uniform> cache: Cache;
// Values in the order x, y, z, two (f16) or four (unorm8) to a word from its low end.
@group(1) @binding(1) var<storage, read> texels: array<u32>;

#ifdef CACHE_F16
// A number of binary16 without sign, exactly: unpack2x16float may flush small ones to zero.
fn half(bits: u32) -> f32 {
    let exponent = (bits >> 10u) & 31u;
    let mantissa = bits & 1023u;
    if exponent == 0u { return f32(mantissa) * 0x1p-24; }
    // Biases of 15 and 127; the largest exponent means infinity or NaN in both.
    let shifted = select(exponent + 112u, 255u, exponent == 31u);
    return bitcast<f32>((shifted << 23u) | (mantissa << 13u));
}
#endif

fn texel(place: vec3u) -> f32 {
    let index = (place.z * cache.size.y + place.y) * cache.size.x + place.x;
#ifdef CACHE_F16
    return half(texels[index / 2u] >> (16u * (index % 2u)));
#else ifdef CACHE_UNORM8
    let part = unpack4x8unorm(texels[index / 4u])[index % 4u];
    return cache.smallest + (cache.largest - cache.smallest) * part;
#else
    return bitcast<f32>(texels[index]);
#endif
}

fn density(position: vec3f) -> f32 {
    let place = clamp((position - cache.low) * cache.scale, vec3f(0.0), vec3f(cache.size - 1u));
#ifdef CACHE_NEAREST
    return texel(min(vec3u(place + 0.5), cache.size - 1u));
#else
    let base = min(vec3u(place), cache.size - 2u);
    let fraction = place - vec3f(base);
    var value = 0.0;
    for (var corner = 0u; corner < 8u; corner++) {
        let up = vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let weight = select(1.0 - fraction, fraction, up == vec3u(1u));
        value += weight.x * weight.y * weight.z * texel(base + up);
    }
    return value;
#endif
}
