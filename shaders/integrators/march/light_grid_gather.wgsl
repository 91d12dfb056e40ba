// Depths at the vertices of the light grid from the rays of one sweep: twin of `Sweep::gather` in
// src/integrators/march/light_grid.rs. With no extinctions the depth itself is stored (a sun); else the
// transmittance of each distinct extinction is added to each harmonic (a direction of the world).

struct Sweep {
    size: vec3u,
    rising: u32,
    strides: vec3u,
    rows: u32,
    slope: vec2f,
    distance: f32,
    columns: u32,
    first_row: i32,
    first_column: i32,
    channel: u32,
    padding: u32,
}

struct Offset {
    whole: vec2i,
    fraction: vec2f,
}

// Up to three distinct extinctions and 16 weights of harmonics.
struct World {
    extinction: vec3f,
    extinctions: u32,
    weights: array<vec4f, 4>,
    harmonics: u32,
    padding: vec3u,
}

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> offsets: array<Offset>;
@group(0) @binding(2) var<storage, read> table: array<f32>;
@group(0) @binding(3) var<storage, read_write> light: array<f32>;
@group(0) @binding(4) var<uniform> world: World;

fn table_at(column: i32, cell: u32, slice: u32, whole: i32) -> f32 {
    let row = u32(column - whole - sweep.first_row);
    let index = (row * sweep.size.z + slice) * (sweep.size.x + 1u) + cell;
    return table[min(index, arrayLength(&table) - 1u)];
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    let vertices = sweep.size.x * sweep.size.y * sweep.size.z;
    if invocation.x >= sweep.size.x || invocation.y >= sweep.size.y || invocation.z >= sweep.size.z { return; }
    let slice = select(invocation.z, sweep.size.z - 1u - invocation.z, sweep.rising != 0u);
    let offset = offsets[slice];
    let column = i32(invocation.y);
    let cell = invocation.x;
    let above = table_at(column, cell + 1u, slice, offset.whole.y);
    let near = above + offset.fraction.x * (table_at(column, cell, slice, offset.whole.y) - above);
    let below = table_at(column - 1, cell + 1u, slice, offset.whole.y);
    let far = below + offset.fraction.x * (table_at(column - 1, cell, slice, offset.whole.y) - below);
    let depth = near + offset.fraction.y * (far - near);
    let vertex = dot(invocation, sweep.strides);
    if world.extinctions == 0u {
        let index = sweep.channel * vertices + vertex;
        if index < arrayLength(&light) { light[index] = depth; }
        return;
    }
    for (var number = 0u; number < min(world.extinctions, 3u); number++) {
        let transmittance = exp(-world.extinction[number] * depth);
        for (var harmonic = 0u; harmonic < min(world.harmonics, 16u); harmonic++) {
            let index = (sweep.channel + number * world.harmonics + harmonic) * vertices + vertex;
            if index < arrayLength(&light) {
                light[index] += world.weights[harmonic / 4u][harmonic % 4u] * transmittance;
            }
        }
    }
}
