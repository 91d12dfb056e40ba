// Density at the points of a storage buffer: x, y, z of the object's frame, three floats a point.
// The standalone form of a specialised graph; `cloudparity shader` writes it.
#import cloudparity::graph

@group(0) @binding(0) var<storage, read> points: array<f32>;
@group(0) @binding(1) var<storage, read_write> densities: array<f32>;

fn density(position: vec3f) -> f32 {
    return graph::evaluate(position);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    let index = invocation.x;
    if index >= arrayLength(&densities) {
        return;
    }
    densities[index] = density(vec3f(points[3u * index], points[3u * index + 1u], points[3u * index + 2u]));
}
