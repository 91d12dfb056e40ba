// Density at the vertices of the light grid: twin of `LightGrid::bake` in
// src/integrators/march/light_grid.rs. Negative density acts as 0; NaN stays to be seen.

#import cloudparity::graph

struct Bake {
    low: vec3f,
    first: u32,
    step: vec3f,
    count: u32,
    size: vec3u,
    padding: u32,
}

@group(0) @binding(0) var<uniform> bake: Bake;
@group(0) @binding(1) var<storage, read_write> density: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= bake.count { return; }
    let index = bake.first + invocation.x;
    if index >= arrayLength(&density) { return; }
    let place = vec3u(index % bake.size.x, index / bake.size.x % bake.size.y, index / bake.size.x / bake.size.y);
    let value = graph::evaluate(bake.low + bake.step * vec3f(place));
    density[index] = select(value, 0.0, value < 0.0);
}
