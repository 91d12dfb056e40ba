// A texture of a published cloud at a place in its periods: twin of src/nodes/cloud_texture/mod.rs. TEXTURE is declared before.
#import cloudparity::texture

fn evaluate(vector: vec3f) -> f32 {
    return texture::look_up(TEXTURE, fract(vector) * vec3f(TEXTURE.size) - 0.5);
}
