// God rays over a frame: twin of src/engines/passes/god_rays.rs, in three kernels.
//
// Conditions: OCCLUSION (the sun's glow times what the medium lets through, one invocation per texel of a layer at half the resolution;
// with ALPHA_OF_RED all channels let through what red does), BLUR (a layer towards the sun), neither (a layer added to the frame, one
// invocation per pixel).

struct GodRays {
    // Directions of rays: corner + x across + y up, in pixels from the bottom-left corner.
    corner: vec3f,
    width: u32,
    across: vec3f,
    height: u32,
    up: vec3f,
    half_width: u32,
    // Unit vector to the middle of the glow.
    glow: vec3f,
    half_height: u32,
    colour: vec3f,
    samples: u32,
    // The sun's place in texels from the centre of the top-left one.
    sun: vec2f,
    // Texels of a layer in a pixel of the frame.
    scale: vec2f,
    // Part of the way to the sun from read to read.
    inverse_samples: f32,
    weight: f32,
    decay: f32,
    gain: f32,
    sun_glow: f32,
    // Invocations of this dispatch: the number of the first, and how many.
    first: u32,
    count: u32,
    // Weight of a texel's own read; where it is not 0 the sum begins one read farther.
    centre: f32,
}

@group(0) @binding(0) var<uniform> rays: GodRays;
@group(0) @binding(1) var<storage, read> source: array<f32>;
@group(0) @binding(2) var<storage, read_write> result: array<f32>;
@group(0) @binding(3) var<storage, read_write> colour: array<vec4f>;
// Of the frame, three numbers per pixel.
@group(0) @binding(4) var<storage, read> transmittance: array<f32>;

// Bilinear read of the source at a place in texels; outside is the nearest texel.
fn sample(place: vec2f) -> f32 {
    let base = floor(place);
    let f = place - base;
    let last = vec2f(vec2u(rays.half_width, rays.half_height) - 1u);
    let low = vec2u(clamp(base, vec2f(0.0), last));
    let high = vec2u(clamp(base + 1.0, vec2f(0.0), last));
    let g = 1.0 - f;
    let above = source[low.y * rays.half_width + low.x] * g.x + source[low.y * rays.half_width + high.x] * f.x;
    let below = source[high.y * rays.half_width + low.x] * g.x + source[high.y * rays.half_width + high.x] * f.x;
    return above * g.y + below * f.y;
}

// Share of the background that is seen at a pixel.
fn through(pixel: u32) -> f32 {
#ifdef ALPHA_OF_RED
    return transmittance[3u * pixel];
#else
    return (transmittance[3u * pixel] + transmittance[3u * pixel + 1u] + transmittance[3u * pixel + 2u]) / 3.0;
#endif
}

// Parts of a pixel, `halved` of them to the pixel, that the texel `index` covers of a pixel.
fn covered(index: u32, halved: u32, full: u32, pixel: u32) -> f32 {
    let begin = max(index * full, pixel * halved);
    let end = min((index + 1u) * full, (pixel + 1u) * halved);
    return f32(select(0u, end - begin, end > begin));
}

fn occlusion(column: u32, row: u32) -> f32 {
    let left = column * rays.width / rays.half_width;
    let top = row * rays.height / rays.half_height;
    var sum = 0.0;
    for (var y = top; y < min(top + 3u, rays.height); y++) {
        let down = covered(row, rays.half_height, rays.height, y);
        if down == 0.0 { continue; }
        for (var x = left; x < min(left + 3u, rays.width); x++) {
            let across = covered(column, rays.half_width, rays.width, x);
            if across > 0.0 { sum += across / f32(rays.width) * (down / f32(rays.height)) * through(y * rays.width + x); }
        }
    }
    let raster = vec2f(
        (f32(column) + 0.5) / f32(rays.half_width) * f32(rays.width),
        (f32(rays.half_height - 1u - row) + 0.5) / f32(rays.half_height) * f32(rays.height),
    );
    let direction = normalize(rays.corner + rays.across * raster.x + rays.up * raster.y);
    let t = clamp(1.0 - length(direction - rays.glow) / rays.sun_glow, 0.0, 1.0);
    return sum * (t * t * (3.0 - 2.0 * t));
}

fn blurred(column: u32, row: u32) -> f32 {
    let own = vec2f(f32(column), f32(row));
    let way = rays.sun - own;
    let has_centre = rays.centre != 0.0;
    var sum = select(0.0, rays.centre * source[row * rays.half_width + column], has_centre);
    let first = select(0u, 1u, has_centre);
    var weight = rays.weight;
    for (var number = 0u; number < rays.samples; number++) {
        sum += weight * sample(own + f32(number + first) * rays.inverse_samples * way);
        weight *= rays.decay;
    }
    return rays.gain * sum;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= rays.count { return; }
    let index = rays.first + invocation.x;
#ifdef OCCLUSION
    result[index] = occlusion(index % rays.half_width, index / rays.half_width);
#else ifdef BLUR
    result[index] = blurred(index % rays.half_width, index / rays.half_width);
#else
    let pixel = vec2f(f32(index % rays.width), f32(index / rays.width));
    let found = sample((pixel + 0.5) * rays.scale - 0.5);
    colour[index] += vec4f(rays.colour * found, 0.0);
#endif
}
