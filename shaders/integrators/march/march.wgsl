// Single scattering by ray marching, one view ray per invocation: twin of src/integrators/march/mod.rs,
// whose head gives the equations. Light comes from the baked grid. Rays arrive finished (their part
// in the medium, their steps), so the camera has no second implementation. A dispatch takes the steps from `first_step` to
// before `end_step`. Definitions leave out what the scene does not need; without any the kernel is generic.

#import cloudparity::graph
#import cloudparity::march::constants
#import cloudparity::phase
#import cloudparity::transfer

struct Stage {
    extinction: vec3f,
    anisotropy: f32,
    scattering: vec3f,
    exit_transmittance: f32,
    emission: vec3f,
    cells: u32,
    world: vec3f,
    lights: u32,
    bounds_low: vec3f,
    harmonics: u32,
    bounds_high: vec3f,
    vertices: u32,
    grid_low: vec3f,
    rays: u32,
    grid_scale: vec3f,
    lit_by_world: u32,
    grid_size: vec3u,
    first_step: u32,
    extinction_of_channel: vec3u,
    end_step: u32,
    emission_of_density: vec3f,
    // Whether rays have results of parts before this one.
    goes_on: u32,
}

// Positions are those of the middle of the first step.
struct Ray {
    local: vec3f,
    step: f32,
    local_step: vec3f,
    steps: u32,
    position: vec3f,
    padding: f32,
    direction: vec3f,
    more_padding: f32,
}

struct Light {
    // Unit vector towards a sun, or the place of a point.
    place: vec3f,
    // A sun is 0; then POINT and SPOT.
    kind: u32,
    axis: vec3f,
    edge: f32,
    power: vec3f,
    blend: f32,
}

struct Outcome {
    radiance: vec3f,
    padding: f32,
    transmittance: vec3f,
    more_padding: f32,
}

@group(0) @binding(0) var<uniform> stage: Stage;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
@group(0) @binding(2) var<storage, read> lights: array<Light>;
// Per ray: the harmonics in its direction, each with its power of the anisotropy.
@group(0) @binding(3) var<storage, read> bases: array<f32>;
@group(0) @binding(4) var<storage, read> occupied: array<u32>;
// Depths per light, then coefficients per extinction and harmonic, each for all vertices.
@group(0) @binding(5) var<storage, read> grid: array<f32>;
@group(0) @binding(6) var<storage, read_write> outcomes: array<Outcome>;

fn phase_value(before: vec3f, after: vec3f) -> f32 {
#ifdef WITHOUT_PHASE
    return phase::isotropic();
#else
    return phase::henyey_greenstein(stage.anisotropy, before, after);
#endif
}

fn may_hold(local: vec3f) -> bool {
    let part = (local - stage.bounds_low) / (stage.bounds_high - stage.bounds_low) * f32(stage.cells);
    let place = min(vec3u(max(part, vec3f(0.0))), vec3u(stage.cells - 1u));
    return occupied[(place.z * stage.cells + place.y) * stage.cells + place.x] != 0u;
}

// Incident light times the phase function, per unit of scattering.
fn incident(local: vec3f, position: vec3f, direction: vec3f, ray: u32) -> vec3f {
    let place = clamp((local - stage.grid_low) * stage.grid_scale, vec3f(0.0), vec3f(stage.grid_size - 1u));
    let base = min(vec3u(place), stage.grid_size - 2u);
    let fraction = place - vec3f(base);
    var corners: array<u32, 8>;
    var weights: array<f32, 8>;
    for (var corner = 0u; corner < 8u; corner++) {
        let up = vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let vertex = base + up;
        corners[corner] = (vertex.z * stage.grid_size.y + vertex.y) * stage.grid_size.x + vertex.x;
        let weight = select(1.0 - fraction, fraction, up == vec3u(1u));
        weights[corner] = weight.x * weight.y * weight.z;
    }
    var light = vec3f(0.0);
#ifndef WITHOUT_LIGHTS
    for (var number = 0u; number < stage.lights; number++) {
        var depth = 0.0;
        for (var corner = 0u; corner < 8u; corner++) {
            depth += weights[corner] * grid[number * stage.vertices + corners[corner]];
        }
        let source = lights[number];
        var towards = source.place;
        var power = source.power;
        if source.kind >= constants::POINT {
            let way = source.place - position;
            towards = normalize(way);
            power /= dot(way, way);
        }
        if source.kind == constants::SPOT {
            let part = saturate((-dot(towards, source.axis) - source.edge) / ((1.0 - source.edge) * source.blend));
            power *= part * part * (3.0 - 2.0 * part);
        }
        light += power * phase_value(direction, towards) * exp(-stage.extinction * depth);
    }
#endif
#ifndef WITHOUT_WORLD
    if stage.lit_by_world != 0u {
        for (var channel = 0u; channel < 3u; channel++) {
            var transmittance = 0.0;
            for (var harmonic = 0u; harmonic < stage.harmonics; harmonic++) {
                let first = stage.lights + stage.extinction_of_channel[channel] * stage.harmonics + harmonic;
                var value = 0.0;
                for (var corner = 0u; corner < 8u; corner++) {
                    value += weights[corner] * grid[first * stage.vertices + corners[corner]];
                }
                transmittance += bases[ray * stage.harmonics + harmonic] * value;
            }
            light[channel] += stage.world[channel] * transmittance;
        }
    }
#endif
    return light;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    let number = invocation.x;
    if number >= stage.rays { return; }
    let ray = rays[number];
    var radiance = vec3f(0.0);
    var transmittance = vec3f(1.0);
    if stage.first_step > 0u || stage.goes_on != 0u {
        radiance = outcomes[number].radiance;
        transmittance = outcomes[number].transmittance;
    }
    for (var step = stage.first_step; step < min(ray.steps, stage.end_step); step++) {
        if all(transmittance < vec3f(stage.exit_transmittance)) { break; }
        let local = ray.local + ray.local_step * f32(step);
#ifndef WITHOUT_EMPTY_CELLS
        if !may_hold(local) { continue; }
#endif
        let value = graph::evaluate(local);
        let density = select(value, 0.0, value < 0.0);
        var light = vec3f(0.0);
#ifndef WITHOUT_IN_SCATTER
        // NaN is not skipped: it has to reach the picture.
        if density != 0.0 {
            light = incident(local, ray.position + ray.direction * (ray.step * f32(step)), ray.direction, number);
        }
#endif
        let depth = stage.extinction * density * ray.step;
        var source = stage.scattering * density * light + stage.emission;
#ifdef EMISSION_OF_DENSITY
        source += stage.emission_of_density * density;
#endif
#ifdef PLAIN_INTEGRATION
        let length = vec3f(ray.step);
#else
        let length = transfer::mean_transmittance(depth) * ray.step;
#endif
        radiance += transmittance * source * length;
        transmittance *= transfer::transmittance(depth);
    }
    outcomes[number].radiance = radiance;
    outcomes[number].transmittance = transmittance;
}
