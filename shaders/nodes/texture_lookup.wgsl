// The value of a texture at an index: TEXTURE is declared before.
#import cloudparity::texture

fn evaluate(index: vec3f) -> f32 {
    return texture::look_up(TEXTURE, index);
}
