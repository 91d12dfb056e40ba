// White Noise Texture node (ShaderNodeTexWhiteNoise): hash of the bits of the coordinates, values in [0, 1].
// NOISE_DIMENSIONS_1D (w), _2D (vector.xy), _3D (vector), _4D (vector and w).
// Value is the hash; Color repeats it and adds hashes with a further number, in 4D of the coordinates in other orders.
// Source: Jenkins' lookup3 of the float bits in Blender's order. Domain: every f32 but NaN; exact.
// Limits: a last bit decides, and the sign of a zero; coordinates that are computed differ between adapters.
#import cloudparity::hash::{jenkins1, jenkins2, jenkins3, jenkins4, unit_from_bits}

struct Outputs {
#ifdef OUTPUT_VALUE
    value: f32,
#endif
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
}

// Bits of 1.0 and 2.0.
const BITS_OF_ONE: u32 = 0x3f800000u;
const BITS_OF_TWO: u32 = 0x40000000u;

fn evaluate(
#ifdef NOISE_DIMENSIONS_1D
    w: f32,
#else
    vector: vec3f,
#endif
#ifdef NOISE_DIMENSIONS_4D
    w: f32,
#endif
) -> Outputs {
#ifdef NOISE_DIMENSIONS_1D
    let d = bitcast<u32>(w);
    let first = jenkins1(d);
#else ifdef NOISE_DIMENSIONS_2D
    let a = bitcast<u32>(vector.x);
    let b = bitcast<u32>(vector.y);
    let first = jenkins2(a, b);
#else ifdef NOISE_DIMENSIONS_3D
    let a = bitcast<u32>(vector.x);
    let b = bitcast<u32>(vector.y);
    let c = bitcast<u32>(vector.z);
    let first = jenkins3(a, b, c);
#else ifdef NOISE_DIMENSIONS_4D
    let a = bitcast<u32>(vector.x);
    let b = bitcast<u32>(vector.y);
    let c = bitcast<u32>(vector.z);
    let d = bitcast<u32>(w);
    let first = jenkins4(a, b, c, d);
#endif
    var outputs: Outputs;
#ifdef OUTPUT_VALUE
    outputs.value = unit_from_bits(first);
#endif
#ifdef OUTPUT_COLOR
#ifdef NOISE_DIMENSIONS_1D
    let second = jenkins2(d, BITS_OF_ONE);
    let third = jenkins2(d, BITS_OF_TWO);
#else ifdef NOISE_DIMENSIONS_2D
    let second = jenkins3(a, b, BITS_OF_ONE);
    let third = jenkins3(a, b, BITS_OF_TWO);
#else ifdef NOISE_DIMENSIONS_3D
    let second = jenkins4(a, b, c, BITS_OF_ONE);
    let third = jenkins4(a, b, c, BITS_OF_TWO);
#else ifdef NOISE_DIMENSIONS_4D
    let second = jenkins4(c, a, d, b);
    let third = jenkins4(d, c, b, a);
#endif
    outputs.color = vec3f(unit_from_bits(first), unit_from_bits(second), unit_from_bits(third));
#endif
    return outputs;
}
