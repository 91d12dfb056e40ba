// Height fog over a frame: twin of src/engines/passes/height_fog.rs, one invocation per pixel.
//
// Conditions: TRANSMITTANCE (what the frame lets through is dimmed, too), WITHOUT_PARENTHESES (defect MS-2).

struct HeightFog {
    // Directions of rays: corner + x across + y up, in pixels from the bottom-left corner.
    corner: vec3f,
    width: u32,
    across: vec3f,
    height: u32,
    up: vec3f,
    // 1 - exp(-distance density).
    depth: f32,
    colour: vec3f,
    falloff: f32,
    // Unit vector towards the brightest sun, and its colour.
    sun: vec3f,
    // Largest share of it; 0 without a sun.
    sun_share: f32,
    sun_colour: vec3f,
    // First pixel of this dispatch.
    first: u32,
}

@group(0) @binding(0) var<uniform> fog: HeightFog;
@group(0) @binding(1) var<storage, read_write> colour: array<vec4f>;
#ifdef TRANSMITTANCE
@group(0) @binding(2) var<storage, read_write> transmittance: array<f32>;
#endif

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    let pixel = fog.first + invocation.x;
    if pixel >= fog.width * fog.height { return; }
    let raster = vec2f(f32(pixel % fog.width) + 0.5, f32(fog.height - 1u - pixel / fog.width) + 0.5);
    let direction = normalize(fog.corner + fog.across * raster.x + fog.up * raster.y);
    let above = exp(-max(direction.z, 0.0) * fog.falloff);
#ifdef WITHOUT_PARENTHESES
    let amount = 1.0 - (1.0 - fog.depth) * above;
#else
    let amount = fog.depth * above;
#endif
    let cosine = clamp(dot(direction, fog.sun), 0.0, 1.0);
    let square = cosine * cosine;
    let fourth = square * square;
    let tint = fog.colour + fog.sun_share * fourth * fourth * (fog.sun_colour - fog.colour);
    let before = colour[pixel];
    colour[pixel] = before + amount * (vec4f(tint, 1.0) - before);
#ifdef TRANSMITTANCE
    for (var channel = 0u; channel < 3u; channel++) { transmittance[3u * pixel + channel] *= 1.0 - amount; }
#endif
}
