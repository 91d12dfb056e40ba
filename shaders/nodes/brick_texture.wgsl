// Brick Texture node (ShaderNodeTexBrick): rows of bricks along y with mortar between them; z is ignored.
// Constants OFFSET, OFFSET_FREQUENCY, SQUASH, SQUASH_FREQUENCY. Outputs: Color, and Fac, the share of mortar.
// Source: Blender. Every SQUASH_FREQUENCY-th row has bricks SQUASH times as wide, every OFFSET_FREQUENCY-th is shifted by
// OFFSET widths; a hash of row and column plus the bias mixes the two colours of the bricks.
// Domain: finite f32, sizes other than 0. Limits: quotients are as exact as the device's division, so that at a face
// between bricks the neighbour may be chosen; with mortar there the factor is the same on both sides.
#import cloudparity::hash::unit_from_bits
#import cloudparity::numeric::to_int

struct Outputs {
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_FAC
    fac: f32,
#endif
}

// In [0, 1].
fn brick_value(row: i32, column: i32) -> f32 {
    let start = ((bitcast<u32>(row) << 16u) + (bitcast<u32>(column) & 0xffffu) + 1013u) & 0x7fffffffu;
    let n = (start >> 13u) ^ start;
    let bits = (n * (n * n * 60493u + 19990303u) + 1376312589u) & 0x7fffffffu;
    return unit_from_bits(bits << 1u);
}

// Share of mortar at the distance from the edge of a brick.
fn mortar_share(edge: f32, size: f32, smoothness: f32) -> f32 {
    if edge >= size {
        return 0.0;
    }
    if smoothness == 0.0 {
        return 1.0;
    }
    let g = (1.0 - edge / size) / smoothness;
    if g <= 0.0 {
        return 0.0;
    }
    if g >= 1.0 {
        return 1.0;
    }
    return 3.0 * (g * g) - (2.0 * (g * g)) * g;
}

fn blend(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a * (1.0 - t) + b * t;
}

fn evaluate(
    vector: vec3f,
    first_color: vec3f,
    second_color: vec3f,
    mortar_color: vec3f,
    scale: f32,
    mortar_size: f32,
    mortar_smooth: f32,
    bias: f32,
    brick_width: f32,
    row_height: f32,
) -> Outputs {
    let p = vector.xy * scale;
    let row = to_int(floor(p.y / row_height));
    var width = brick_width;
    var shift = 0.0;
    if OFFSET_FREQUENCY != 0 && SQUASH_FREQUENCY != 0 {
        // The maximum is for the compiler, which refuses a remainder by the constant 0.
        if row % max(SQUASH_FREQUENCY, 1) == 0 {
            width = width * SQUASH;
        }
        if row % max(OFFSET_FREQUENCY, 1) == 0 {
            shift = width * OFFSET;
        }
    }
    let shifted = p.x + shift;
    let column = to_int(floor(shifted / width));
    let x = shifted - width * f32(column);
    let y = p.y - row_height * f32(row);
    let edge = min(min(x, y), min(width - x, row_height - y));
    let share = mortar_share(edge, mortar_size, mortar_smooth);
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    var base = first_color;
    if share != 1.0 {
        base = blend(base, second_color, clamp(brick_value(row, column) + bias, 0.0, 1.0));
    }
    outputs.color = blend(base, mortar_color, share);
#endif
#ifdef OUTPUT_FAC
    outputs.fac = share;
#endif
    return outputs;
}
