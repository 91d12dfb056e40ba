// What kernels of an engine hand to each other.
#define_import_path cloudparity::rays

// From where a ray enters the domain on, so that a start far from it costs no accuracy; the camera has no second implementation.
struct Ray {
    origin: vec3f,
    // Of the parts of the ray in the domain together; 0: nothing to march.
    length: f32,
    // Displacement in the density's frame per unit of length.
    way: vec3f,
    jitter: f32,
    // Unit direction in the world.
    direction: vec3f,
    // Beyond it something opaque hides the cloud.
    farthest: f32,
    // Length of the first part, and of what lies between it and the second.
    first: f32,
    gap: f32,
    // Its further gaps, numbers of `gaps`.
    further: u32,
    further_end: u32,
}

// What a ray came to.
struct Pixel {
    radiance: vec3f,
    samples: u32,
    transmittance: vec3f,
    dense: u32,
}
