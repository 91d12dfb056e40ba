// What programs read, in words of 32 bits. Condition: IN_FRAGMENT (a picture of 8 bits a channel, which every engine imports; else a buffer).
#define_import_path cloudparity::words
#ifdef IN_FRAGMENT
#import cloudparity::words::constants

// A texel is a word, its bytes from the low end in red, green, blue and alpha; words run along rows.
@group(1) @binding(0) var data: texture_2d<f32>;

fn word(index: u32) -> u32 {
    let place = vec2u(index % constants::ROW, index / constants::ROW);
    let bytes = vec4u(textureLoad(data, place, 0) * 255.0 + 0.5);
    return bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (bytes.w << 24u);
}
#else
// The texels of all textures of the programs one behind the other.
@group(1) @binding(0) var<storage, read> texels: array<u32>;

fn word(index: u32) -> u32 {
    return texels[index];
}
#endif
