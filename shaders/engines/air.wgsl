// Air between the eye and what it sees: twin of src/engines/march/air.rs, which has the formulas. Lengths are metres. What reads the density or
// a shadow map is in march.wgsl.
#define_import_path cloudparity::air
#import cloudparity::phase
#import cloudparity::transfer

struct Air {
    metres: f32,
    // A place's height: the third coordinate of the density's frame times the first, plus the second.
    slope: f32,
    base: f32,
    // Height of the layer's upper face.
    top: f32,
    haze_density: f32,
    haze_albedo: f32,
    aerial: f32,
    shaft_fade: f32,
    ray_strength: f32,
    ray_samples: u32,
    ray_length: f32,
    ray_decay: f32,
    ray_weight: f32,
    shaft_strength: f32,
    padding: f32,
    end_padding: f32,
}

struct Line {
    height: f32,
    rise: f32,
    limit: f32,
}

const FARTHEST: f32 = 200000.0;
const RAYLEIGH = vec3f(5.802e-6, 1.3558e-5, 3.31e-5);
const MIE: f32 = 3.996e-6;
const MIE_EXTINCTION: f32 = 4.44e-6;
const AIR_HEIGHT: f32 = 8000.0;
const MIE_HEIGHT: f32 = 1200.0;
const MIE_ANISOTROPY: f32 = 0.8;
const AIR_PARTS = 16u;
const HAZE_HEIGHT: f32 = 1000.0;
const LEAST_HAZE: f32 = 1e-7;
const HAZE_AMBIENT: f32 = 0.625;
const LEAST_RISE: f32 = 1e-5;

fn height_of(air: Air, z: f32) -> f32 {
    return air.slope * z + air.base;
}

// A ray from a place in the frame of the density, whose z is given, with the z of its way per unit of length and the units to what ends the view.
fn line_of(air: Air, z: f32, way_z: f32, farthest: f32) -> Line {
    let rise = clamp(way_z * air.slope / air.metres, -1.0, 1.0);
    return Line(height_of(air, z), rise, min(farthest * air.metres, FARTHEST));
}

// Metres to the ground, or to a height above.
fn end_of(line: Line, top: f32) -> f32 {
    if line.rise < 0.0 && line.height > 0.0 { return min(line.height / -line.rise, line.limit); }
    if line.rise > 0.0 { return min(max(top - line.height, 0.0) / line.rise, line.limit); }
    return line.limit;
}

// Of a part that ends at a distance, what is seen beside a cloud of an opacity at its front.
fn seen(end: f32, front: f32, opacity: f32) -> f32 {
    return end + opacity * (min(front, end) - end);
}

fn scalar_mean(depth: f32) -> f32 {
    return transfer::mean_transmittance(vec3f(depth)).x;
}

// Length of the part up to `length`, weighted by a density that falls by 1/e in `fall` metres.
fn column(line: Line, length: f32, fall: f32) -> f32 {
    let lowest = line.height + min(line.rise * length, 0.0);
    return exp(-max(lowest, 0.0) / fall) * length * scalar_mean(length * abs(line.rise) / fall);
}

// Depth of air of a density up to a length.
fn air_depth(density: f32, line: Line, length: f32) -> vec3f {
    return density * (RAYLEIGH * column(line, length, AIR_HEIGHT) + MIE_EXTINCTION * column(line, length, MIE_HEIGHT));
}

// Radiance that air of a density sends back up to a length, for sources of its two parts per unit of scattering.
fn air_light(density: f32, line: Line, length: f32, of_air: vec3f, of_haze: vec3f) -> vec3f {
    var before = vec2f(0.0);
    var sum = vec3f(0.0);
    var left = vec3f(1.0);
    for (var part = 1u; part <= AIR_PARTS; part++) {
        // Shortest where the ray is lowest.
        let passed = f32(part) / f32(AIR_PARTS);
        let end = length * select(passed * passed, 1.0 - (1.0 - passed) * (1.0 - passed), line.rise < 0.0);
        let columns = density * vec2f(column(line, end, AIR_HEIGHT), column(line, end, MIE_HEIGHT));
        let own = max(columns - before, vec2f(0.0));
        before = columns;
        let depth = RAYLEIGH * own.x + MIE_EXTINCTION * own.y;
        sum += left * (RAYLEIGH * own.x * of_air + MIE * own.y * of_haze) * transfer::mean_transmittance(depth);
        left *= transfer::transmittance(depth);
    }
    return sum;
}

fn rayleigh_phase(direction: vec3f, to_sun: vec3f) -> f32 {
    let cosine = dot(direction, to_sun);
    return 0.059683104 * (1.0 + cosine * cosine);
}

fn mie_phase(direction: vec3f, to_sun: vec3f) -> f32 {
    return phase::draine(MIE_ANISOTROPY, 1.0, direction, to_sun);
}

// Depth of haze up to a length.
fn haze_depth(air: Air, line: Line, length: f32) -> f32 {
#ifdef AIR_LEVEL_HAZE
    let at_eye = air.haze_density * exp(-max(line.height, 0.0) / HAZE_HEIGHT);
    if at_eye < LEAST_HAZE { return 0.0; }
    return at_eye * length * scalar_mean(length * max(line.rise, LEAST_RISE) / HAZE_HEIGHT);
#else
    return air.haze_density * column(line, length, HAZE_HEIGHT);
#endif
}
