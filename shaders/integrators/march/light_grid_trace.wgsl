// One sweep of parallel rays through the slices of the light grid: twin of `Sweep::trace` in
// src/integrators/march/light_grid.rs, where the method is described. An invocation follows one ray of the
// lattice from the light's side away and writes its depth at every slice that it meets.

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

// Where the lattice lies in a slice: whole cells, and fractions.
struct Offset {
    whole: vec2i,
    fraction: vec2f,
}

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> offsets: array<Offset>;
@group(0) @binding(2) var<storage, read> density: array<f32>;
@group(0) @binding(3) var<storage, read_write> table: array<f32>;

fn inside(cell: i32, fraction: f32, count: i32) -> bool {
    return cell >= 0 && (cell + 1 < count || (cell + 1 == count && fraction == 0.0));
}

// Part of a step between a point inside and the face where the ray entered (way 1) or leaves (-1).
fn part_inside(place: vec2f, way: f32) -> f32 {
    let high = vec2f(sweep.size.xy - 1u);
    var part = 1.0;
    for (var axis = 0u; axis < 2u; axis++) {
        let slope = sweep.slope[axis] * way;
        if slope != 0.0 {
            let distance = select(high[axis] - place[axis], place[axis], slope > 0.0);
            part = min(part, distance / abs(slope));
        }
    }
    return part;
}

fn table_at(place: vec2i, slice: u32) -> f32 {
    let limited = vec2u(clamp(place, vec2i(0), vec2i(sweep.size.xy) - 1));
    return density[limited.x * sweep.strides.x + limited.y * sweep.strides.y + slice * sweep.strides.z];
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= sweep.columns || invocation.y >= sweep.rows { return; }
    let ray = vec2i(sweep.first_column + i32(invocation.x), sweep.first_row + i32(invocation.y));
    let count = vec2i(sweep.size.xy);
    var known = false;
    var old_inside = false;
    var old_density = 0.0;
    var old_place = vec2f(0.0);
    var depth = 0.0;
    for (var slice = 0u; slice < sweep.size.z; slice++) {
        let offset = offsets[slice];
        let cell = ray + offset.whole;
        if any(cell < vec2i(-1)) || any(cell >= count) {
            known = false;
            depth = 0.0;
            continue;
        }
        let place = vec2f(cell) + offset.fraction;
        let now = inside(cell.x, offset.fraction.x, count.x) && inside(cell.y, offset.fraction.y, count.y);
        var value = 0.0;
        if now {
            let level = select(slice, sweep.size.z - 1u - slice, sweep.rising != 0u);
            let lower = table_at(cell, level);
            let upper = table_at(cell + vec2i(0, 1), level);
            let near = lower + offset.fraction.x * (table_at(cell + vec2i(1, 0), level) - lower);
            let far = upper + offset.fraction.x * (table_at(cell + vec2i(1, 1), level) - upper);
            value = near + offset.fraction.y * (far - near);
        }
        if slice > 0u {
            if known && old_inside && now {
                depth += 0.5 * sweep.distance * (old_density + value);
            } else if known && old_inside {
                depth += old_density * sweep.distance * part_inside(old_place, -1.0);
            } else if now {
                depth = value * sweep.distance * part_inside(place, 1.0);
            }
        }
        let index = (invocation.y * sweep.size.z + slice) * (sweep.size.x + 1u) + u32(cell.x + 1);
        if index < arrayLength(&table) { table[index] = depth; }
        known = true;
        old_inside = now;
        old_density = value;
        old_place = place;
    }
}
