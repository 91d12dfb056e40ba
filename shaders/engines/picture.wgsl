// An engine's picture in one fragment shader, for programs that have no compute kernels: the kernels' functions, all data in a texture.
#import cloudparity::camera
#import cloudparity::compositing
#import cloudparity::march
#import cloudparity::rays::Pixel

// What a ray comes to that begins anywhere: `origin` in the density's frame; `way`, its displacement there per unit of length;
// `direction`, its unit vector in the world; `farthest`, where something opaque or the view ends.
fn cloud(origin: vec3f, way: vec3f, direction: vec3f, farthest: f32) -> Pixel {
    let ray = camera::ray_from(origin, way, direction, farthest);
    return march::marched(ray, Pixel(vec3f(0.0), 0u, vec3f(1.0), 0u), 0u, march::march.steps);
}

// Linear colour, and alpha, of a place of the raster, which runs from the bottom-left corner in pixels.
fn picture(raster: vec2f) -> vec4f {
    let line = camera::line_through(raster);
    let found = cloud(line.origin, line.way, line.direction, line.farthest);
    let shown = compositing::over(found, compositing::composite.background);
    return vec4f(shown * compositing::composite.exposure, compositing::alpha_of(found.transmittance));
}

@fragment
fn main(@builtin(position) place: vec4f) -> @location(0) vec4f {
    return picture(vec2f(place.x, f32(camera::view.height) - place.y));
}
