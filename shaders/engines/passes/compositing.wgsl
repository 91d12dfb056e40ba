// Rays of a march over a background, averaged into pixels: twin of Compositing::compose in src/engines/passes/compositing.rs, one
// invocation per pixel.
//
// Conditions: IN_PICTURE (a part of what makes a whole picture; else a kernel), IN_FRAGMENT (of picture.wgsl), IN_FRAME (of frame.wgsl), BACKGROUND (else the frame gets an alpha), PER_PIXEL (each pixel has its own), ALPHA_OF_RED (all channels let through what
// red does), ALPHA_TWICE (radiance is multiplied by alpha), TRANSMITTANCE (the frame keeps what each channel lets through).
#define_import_path cloudparity::compositing
#import cloudparity::rays::Pixel

struct Composite {
    background: vec3f,
    exposure: f32,
    // Pixels of this dispatch: the first one's number in the frame, how many, rays of each, and pixels before them in `marched`. In a picture
    // they are the camera's.
    first: u32,
    count: u32,
    rays: u32,
    begin: u32,
}

#ifdef IN_FRAGMENT
@group(0) @binding(2) var<uniform> composite: Composite;
#else ifdef IN_FRAME
@group(2) @binding(1) var<uniform> composite: Composite;
@group(2) @binding(2) var<storage, read_write> colour: array<vec4f>;
#ifdef TRANSMITTANCE
@group(2) @binding(3) var<storage, read_write> frame_transmittance: array<f32>;
#endif
#else
@group(0) @binding(0) var<uniform> composite: Composite;
// The rays of a pixel lie one behind the other.
@group(0) @binding(1) var<storage, read> marched: array<Pixel>;
@group(0) @binding(2) var<storage, read_write> colour: array<vec4f>;
#ifdef TRANSMITTANCE
// Three numbers per pixel.
@group(0) @binding(3) var<storage, read_write> frame_transmittance: array<f32>;
#endif
#ifdef PER_PIXEL
// Three numbers per pixel.
@group(0) @binding(4) var<storage, read> backgrounds: array<f32>;
#endif
#endif

// A ray over its background.
fn over(ray: Pixel, background: vec3f) -> vec3f {
#ifdef ALPHA_OF_RED
    let through = vec3f(ray.transmittance.x);
#else
    let through = ray.transmittance;
#endif
    var shown = ray.radiance;
#ifdef BACKGROUND
#ifdef ALPHA_TWICE
    shown *= 1.0 - through;
#endif
    shown += through * background;
#endif
    return shown;
}

fn alpha_of(transmittance: vec3f) -> f32 {
#ifdef BACKGROUND
    return 1.0;
#else ifdef ALPHA_OF_RED
    return 1.0 - transmittance.x;
#else
    return 1.0 - (transmittance.x + transmittance.y + transmittance.z) / 3.0;
#endif
}

#ifndef IN_FRAGMENT
// Puts a pixel into the frame: what is shown of it, exposure included, and the mean transmittance of its rays.
fn put(pixel: u32, shown: vec3f, transmittance: vec3f) {
    colour[pixel] = vec4f(shown, alpha_of(transmittance));
#ifdef TRANSMITTANCE
    frame_transmittance[3u * pixel] = transmittance.x;
    frame_transmittance[3u * pixel + 1u] = transmittance.y;
    frame_transmittance[3u * pixel + 2u] = transmittance.z;
#endif
}
#endif

#ifndef IN_PICTURE
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= composite.count { return; }
    let pixel = composite.first + invocation.x;
    let first_ray = (composite.begin + invocation.x) * composite.rays;
#ifdef PER_PIXEL
    let background = vec3f(backgrounds[3u * pixel], backgrounds[3u * pixel + 1u], backgrounds[3u * pixel + 2u]);
#else
    let background = composite.background;
#endif
    var radiance = vec3f(0.0);
    var transmittance = vec3f(0.0);
    for (var number = 0u; number < composite.rays; number++) {
        let ray = marched[first_ray + number];
        radiance += over(ray, background);
        transmittance += ray.transmittance;
    }
    let share = 1.0 / f32(composite.rays);
    put(pixel, radiance * (share * composite.exposure), transmittance * share);
}
#endif
