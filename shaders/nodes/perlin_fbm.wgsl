// The density of the Perlin-FBM cloud at a place of its local box: twin of Cloud::at in src/nodes/perlin_fbm/mod.rs. Declared before are
// its parameters and the textures VOLUME, MAIN and FINE.
#import cloudparity::texture

fn distance_at(place: vec3f) -> f32 {
    if RADIUS <= 0.0 { return -1.0; }
    let stretched = place / select(FLATTENING_LOW, FLATTENING_HIGH, place > vec3f(0.0));
    let radius = length(stretched);
    // Also where the square is below the smallest number.
    if radius == 0.0 { return RADIUS; }
    var values = vec2f(-1.0);
    if READS_TEXTURES {
        let at = (stretched / radius * RADIUS * 0.5 + 0.5) * vec3f(MAIN.size) - 0.5;
        values = 2.0 * vec2f(texture::look_up(MAIN, at), texture::look_up(FINE, at)) - 1.0;
    }
    return RADIUS + dot(values, vec2f(MAIN_STRENGTH, FINE_STRENGTH)) - radius;
}

fn evaluate(place: vec3f) -> f32 {
    let t = clamp(distance_at(place) / SOFTNESS, 0.0, 1.0);
    let mask = t * t * (3.0 - 2.0 * t);
    if mask <= 0.0 { return 0.0; }
    var value = 1.0;
    if !SHOWS_MASK {
        // Whole periods go first, those of the place before the offset is added, so that the texel's fraction keeps its bits: what is left
        // of the rounding is that of the place itself, as if it were moved by half a unit in its last place.
        value = texture::look_up(VOLUME, fract(fract(place * TILING) + MOVED) * vec3f(VOLUME.size) - 0.5);
    }
    return select(value * MULTIPLIER * mask, 0.0, value < THRESHOLD);
}
