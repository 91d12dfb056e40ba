// Averages of a density over cells: twin of src/media/averages.rs. Two levels, x fastest, the finer one first.
#define_import_path cloudparity::coarse
#import cloudparity::coarse::constants

@group(0) @binding(3) var<storage, read> levels: array<f32>;

// Trilinear between the centres of the cells of a level that begins at `first`.
fn level_at(first: u32, cells: u32, place: vec3f) -> f32 {
    if any(abs(place) > vec3f(0.5)) { return 0.0; }
    let last = f32(cells - 1u);
    let at = clamp((place + 0.5) * f32(cells) - 0.5, vec3f(0.0), vec3f(last));
    let low = min(floor(at), vec3f(last - 1.0));
    let part = at - low;
    let cell = vec3u(low);
    var corners: array<f32, 8>;
    for (var corner = 0u; corner < 8u; corner++) {
        let index = cell + vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        corners[corner] = levels[first + (index.z * cells + index.y) * cells + index.x];
    }
    let low_plane = mix(mix(corners[0], corners[1], part.x), mix(corners[2], corners[3], part.x), part.y);
    let high_plane = mix(mix(corners[4], corners[5], part.x), mix(corners[6], corners[7], part.x), part.y);
    return mix(low_plane, high_plane, part.z);
}

// As a march towards the sun reads it.
fn along(place: vec3f) -> f32 { return level_at(0u, constants::CELLS, place); }

// Wider.
fn around(place: vec3f) -> f32 { return level_at(constants::CELLS * constants::CELLS * constants::CELLS, constants::CELLS / 2u, place); }
