// The march of a real-time engine: twin of src/engines/march/mod.rs, one invocation per ray.
//
// Conditions: PLAIN (else energy-conserving), EXIT_FADE, SHADOW_TO_EXIT (else of fixed length), SHADOW_VIEW (dimmed as the view
// ray, else by the density), SOURCE_DENSITY (else extinction times albedo), and the terms of src/engines/light/terms.rs: OCTAVES (else one),
// COMPRESSION, SILVER, POWDER, AMBIENT_GRADIENT, BODY, COARSE_SHADOW (both read averages of the density).
#import cloudparity::density_model
#import cloudparity::coarse
#import cloudparity::phase
#import cloudparity::terms
#import cloudparity::transfer

struct March {
    extinction: vec3f,
    steps: u32,
    // Colour times intensity.
    sun: vec3f,
    shadow_steps: u32,
    ambient: vec3f,
    shadow_length: f32,
    to_sun: vec3f,
    depth_compression: f32,
    anisotropy: vec2f,
    second: f32,
    least_density: f32,
    least_transmittance: f32,
    // Rays of this dispatch, and its steps: from `first_step` to before `end_step`.
    count: u32,
    first_step: u32,
    end_step: u32,
    octaves: u32,
    contribution: f32,
    attenuation: f32,
    eccentricity: f32,
    powder_strength: f32,
    powder_length: f32,
    silver_strength: f32,
    silver_exponent: f32,
    ambient_bottom: f32,
    ambient_top: f32,
    body_strength: f32,
    body_length: f32,
    albedo: vec3f,
    powder_ambient: f32,
}

// From where a ray enters the box on, so that a start far from it costs no accuracy; the camera has no second implementation.
struct Ray {
    origin: vec3f,
    // Part of the ray in the box; 0: nothing to march.
    length: f32,
    direction: vec3f,
    jitter: f32,
    // Beyond it something opaque hides the cloud.
    farthest: f32,
    padding: vec3f,
}

struct Pixel {
    radiance: vec3f,
    samples: u32,
    transmittance: vec3f,
    dense: u32,
}

@group(0) @binding(0) var<uniform> march: March;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
@group(0) @binding(2) var<storage, read_write> pixels: array<Pixel>;

const LARGEST = 3.40282347e38;

// Where a ray enters and leaves the box; leaves before it enters where it misses.
fn crossing(origin: vec3f, direction: vec3f) -> vec2f {
    var enter = -LARGEST;
    var leave = LARGEST;
    for (var axis = 0u; axis < 3u; axis++) {
        // A ray that runs in a face is inside.
        if direction[axis] == 0.0 {
            if abs(origin[axis]) <= 0.5 { continue; }
            return vec2f(0.0);
        }
        let first = (-0.5 - origin[axis]) / direction[axis];
        let second = (0.5 - origin[axis]) / direction[axis];
        enter = max(enter, min(first, second));
        leave = min(leave, max(first, second));
    }
    return vec2f(enter, leave);
}

// Optical depth towards the sun.
fn shadow_depth(place: vec3f) -> vec3f {
#ifdef SHADOW_TO_EXIT
    let length = max(crossing(place, march.to_sun).y, 0.0);
#else
    let length = march.shadow_length;
#endif
    let step = length / f32(march.shadow_steps);
    var sum = 0.0;
    for (var number = 0u; number < march.shadow_steps; number++) {
        let at = place + march.to_sun * (step * (f32(number) + 0.5));
#ifdef COARSE_SHADOW
        if all(abs(at) < vec3f(0.5)) { sum += coarse::along(at); }
#else
        if all(abs(at) < vec3f(0.5)) { sum += density_model::density(at); }
#endif
    }
#ifdef SHADOW_VIEW
    let depth = march.extinction * (sum * step);
#else
    let depth = vec3f(sum * step);
#endif
#ifdef COMPRESSION
    return terms::compressed(march.depth_compression, depth);
#else
    return depth;
#endif
}

fn two_lobes(anisotropy: vec2f, direction: vec3f) -> f32 {
    return phase::henyey_greenstein(anisotropy.x, direction, march.to_sun) * (1.0 - march.second)
        + phase::henyey_greenstein(anisotropy.y, direction, march.to_sun) * march.second;
}

#ifdef OCTAVES
// Of the octaves, phase functions included; as many as MOST_OCTAVES.
var<private> weights: array<f32, 16>;
#else
var<private> weight: f32;
#endif

// Prepares a ray.
fn prepare(direction: vec3f) {
#ifdef SILVER
    let cosine = dot(direction, march.to_sun);
    let silver = terms::silver(march.silver_strength, march.silver_exponent, cosine);
#else
    let silver = 0.0;
#endif
#ifdef OCTAVES
    var share = 1.0;
    var anisotropy = march.anisotropy;
    for (var octave = 0u; octave < march.octaves; octave++) {
        weights[octave] = share * two_lobes(anisotropy, direction);
        share *= march.contribution;
        anisotropy *= march.eccentricity;
    }
    weights[0] += silver;
#else
    weight = two_lobes(march.anisotropy, direction) + silver;
#endif
}

// What the sun sends towards the camera per unit of its irradiance and of scattering.
fn scattered(depth: vec3f) -> vec3f {
#ifdef OCTAVES
    return terms::octaves(&weights, march.octaves, march.attenuation, depth);
#else
    return weight * transfer::transmittance(depth);
#endif
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= march.count { return; }
    let index = invocation.x;
    let ray = rays[index];
    var pixel = Pixel(vec3f(0.0), 0u, vec3f(1.0), 0u);
    // An ended ray is one that is looked at before its first step of this dispatch.
    var is_done = false;
    if march.first_step > 0u {
        pixel = pixels[index];
        is_done = length(pixel.transmittance) < march.least_transmittance;
    }
    if ray.length > 0.0 && !is_done {
        let step = ray.length / f32(march.steps);
        prepare(ray.direction);
        for (var number = march.first_step; number < min(march.steps, march.end_step); number++) {
            let passed = (f32(number) + ray.jitter) * step;
            let left = ray.length - passed;
            if passed > ray.farthest || left < 0.0 { break; }
            pixel.samples++;
            let place = ray.origin + ray.direction * passed;
            let found = density_model::density(place);
            if found <= march.least_density { continue; }
            pixel.dense++;
            let extinct = found * march.extinction;
#ifdef SOURCE_DENSITY
            let factor = vec3f(found);
#else
            let factor = march.albedo * extinct;
#endif
#ifdef AMBIENT_GRADIENT
            let ambient = march.ambient * mix(march.ambient_bottom, march.ambient_top, place.y + 0.5);
#else
            let ambient = march.ambient;
#endif
            var from_sun = march.sun * scattered(shadow_depth(place));
            var from_world = ambient;
#ifdef POWDER
            let mean_extinction = (extinct.x + extinct.y + extinct.z) / 3.0;
            let powder = terms::powder(march.powder_strength, march.powder_length, mean_extinction);
            from_sun *= powder;
            from_world *= 1.0 + (powder - 1.0) * march.powder_ambient;
#endif
#ifdef BODY
            let around = coarse::around(place) * (march.extinction.x + march.extinction.y + march.extinction.z) / 3.0;
            from_sun *= terms::powder(march.body_strength, march.body_length, around);
#endif
            var source = factor * (from_sun + from_world);
#ifdef EXIT_FADE
            let t = clamp(left / (2.0 * step), 0.0, 1.0);
            source *= t * t * (3.0 - 2.0 * t);
#endif
#ifdef PLAIN
            let weight = vec3f(step);
#else
            let weight = transfer::mean_transmittance(extinct * step) * step;
#endif
            pixel.radiance += pixel.transmittance * source * weight;
            pixel.transmittance *= transfer::transmittance(extinct * step);
            if length(pixel.transmittance) < march.least_transmittance { break; }
        }
    }
    pixels[index] = pixel;
}
