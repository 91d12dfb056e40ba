// Rays of a camera through a box, for a picture whose camera moves: twin of src/engines/march/camera.rs, one invocation per pixel.
//
// Conditions: IN_PICTURE (a part of a kernel or shader that makes a whole picture; else a kernel), IN_FRAME (of frame.wgsl).
#define_import_path cloudparity::camera
#import cloudparity::camera::constants
#import cloudparity::rays::Ray

// Linear in the raster position, which runs from the bottom-left corner in pixels: where a ray begins, in the density's frame; its
// displacement there per unit of length, before it is divided by the length of its direction; its direction in the world, likewise.
struct View {
    start: vec3f,
    width: u32,
    start_across: vec3f,
    height: u32,
    start_up: vec3f,
    // Units of length from where a ray begins to where it ends, along an axis at which the direction has length 1.
    farthest: f32,
    way: vec3f,
    // Pixels of this dispatch, row by row from the top.
    first: u32,
    way_across: vec3f,
    count: u32,
    way_up: vec3f,
    // Part of a step before the first sample.
    jitter: f32,
    direction: vec3f,
    // 1 where the box has no end, so that rays end where the view does.
    is_endless: u32,
    direction_across: vec3f,
    padding: f32,
    direction_up: vec3f,
    more_padding: f32,
    low: vec3f,
    further_padding: f32,
    high: vec3f,
    end_padding: f32,
}

#ifdef IN_FRAME
@group(2) @binding(0) var<uniform> view: View;
#else
@group(0) @binding(0) var<uniform> view: View;
#endif
#ifndef IN_PICTURE
@group(0) @binding(1) var<storage, read_write> rays: array<Ray>;
#endif

const LARGEST = 3.40282347e38;

// Lengths at which a ray enters and leaves the box; the first is not below the second where it misses.
fn segment(origin: vec3f, way: vec3f) -> vec2f {
    var enter = -LARGEST;
    var leave = LARGEST;
    for (var axis = 0u; axis < 3u; axis++) {
        // A ray that runs in a face is inside.
        if way[axis] == 0.0 {
            if origin[axis] < view.low[axis] || origin[axis] > view.high[axis] { return vec2f(0.0); }
            continue;
        }
        let near = (view.low[axis] - origin[axis]) / way[axis];
        let far = (view.high[axis] - origin[axis]) / way[axis];
        enter = max(enter, min(near, far));
        leave = min(leave, max(near, far));
    }
    return vec2f(enter, leave);
}

// The part of a ray in the box. `way` is its displacement in the density's frame per unit of length, `direction` the unit vector in the
// world, `farthest` where the view ends.
fn ray_from(origin: vec3f, way: vec3f, direction: vec3f, farthest: f32) -> Ray {
    let ends = segment(origin, way);
    let start = max(ends.x, 0.0);
    var span = ends.y - start;
    if view.is_endless != 0u { span = min(span, max(farthest - start, 0.0)); }
    var ray = Ray(origin, 0.0, way, view.jitter, direction, farthest, 0.0, 0.0, 0u, 0u);
    if span >= constants::SHORTEST {
        ray.origin = origin + way * start;
        ray.length = span;
        ray.farthest = farthest - start;
    }
    ray.first = ray.length;
    return ray;
}

// A ray before it is known where it meets the box: the arguments of `ray_from`.
struct Line {
    origin: vec3f,
    farthest: f32,
    way: vec3f,
    direction: vec3f,
}

// The line of a place of the raster, which runs from the bottom-left corner in pixels.
fn line_through(raster: vec2f) -> Line {
    let direction = view.direction + raster.x * view.direction_across + raster.y * view.direction_up;
    let stretch = length(direction);
    let way = (view.way + raster.x * view.way_across + raster.y * view.way_up) / stretch;
    let origin = view.start + raster.x * view.start_across + raster.y * view.start_up;
    return Line(origin, view.farthest * stretch, way, direction / stretch);
}

// The ray through the middle of a pixel.
fn ray_of(pixel: u32) -> Ray {
    let raster = vec2f(f32(pixel % view.width) + 0.5, f32(view.height - 1u - pixel / view.width) + 0.5);
    let line = line_through(raster);
    return ray_from(line.origin, line.way, line.direction, line.farthest);
}

#ifndef IN_PICTURE
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= view.count { return; }
    rays[invocation.x] = ray_of(view.first + invocation.x);
}
#endif
