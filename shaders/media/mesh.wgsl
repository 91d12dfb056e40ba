// Parts of rays in a triangle mesh: twin of src/media/mesh.rs in f32, which gives the rules. What a ray crosses is decided without
// error here, too (its vertices being rounded once in the frame of the ray), so that a closed mesh is left as often as it is
// entered; distances round, and crossings whose order is lost in rounding count together. Unlike the CPU's, a group is what overlaps its first
// crossing, without those that overlap the second.
#define_import_path cloudparity::mesh

// A head (number of nodes, element of the first triangle, largest coordinate), nodes of two elements (low, entry; high, exit), triangles of
// three. An entry with its highest bit set names a triangle.
@group(0) @binding(7) var<storage, read> mesh: array<vec4u>;

const LEAF: u32 = 0x80000000u;
const FAR: f32 = 3e38;
const EPSILON: f32 = 1.1920929e-7;
// As in src/media/mesh.rs, in units of f32.
const WEIGHT_ROUNDING: f32 = 32.0 * EPSILON;
const DEPTH_ROUNDING: f32 = 4.0 * EPSILON;
const BOX_PADDING: f32 = 32.0 * EPSILON;
// A begin is three products and sums of places up to the size of the mesh, in a frame of its own twice.
const BEGIN_ROUNDING: f32 = 16.0 * EPSILON;

// Nodes that this invocation has looked at.
var<private> visits: u32 = 0u;

struct MeshRay {
    origin: vec3f,
    axis: u32,
    direction: vec3f,
    flipped: bool,
    shear: vec3f,
    // Padding of boxes, and how far behind its begin faces count.
    padding: f32,
    slack: f32,
}

struct Crossing {
    distance: f32,
    error: f32,
    // 0: none; 1: from the front; -1: from the back.
    side: i32,
}

struct Face {
    distance: f32,
    // As of a crossing; 0 where those of a group take each other away.
    side: i32,
    found: bool,
    // Up to where crossings have been used up.
    end: f32,
}

struct Part {
    begin: f32,
    // Below the begin: there is none.
    end: f32,
    // Where the search for the next one goes on.
    cursor: f32,
}

fn coordinates(index: u32) -> vec3f {
    return bitcast<vec3f>(mesh[index].xyz);
}

// A vector with the main axis of the ray as its third, right-handed along the ray.
fn turned(ray: MeshRay, v: vec3f) -> vec3f {
    var found = v;
    if ray.axis == 0u { found = v.yzx; }
    if ray.axis == 1u { found = v.zxy; }
    return select(found, found.yxz, ray.flipped);
}

fn ray_of(origin: vec3f, direction: vec3f) -> MeshRay {
    var ray: MeshRay;
    ray.origin = origin;
    ray.direction = direction;
    let size = abs(direction);
    ray.axis = 0u;
    if size.y > size.x { ray.axis = 1u; }
    if size.z > max(size.x, size.y) { ray.axis = 2u; }
    ray.flipped = direction[ray.axis] < 0.0;
    let along = turned(ray, direction);
    ray.shear = vec3f(along.xy, 1.0) / along.z;
    let largest = max(max(abs(origin.x), abs(origin.y)), max(abs(origin.z), bitcast<f32>(mesh[0].z)));
    ray.padding = BOX_PADDING * largest;
    ray.slack = BEGIN_ROUNDING * largest * abs(ray.shear.z);
    return ray;
}

// Whether the ray may pass a box between two distances.
fn meets(ray: MeshRay, low: vec3f, high: vec3f, begin: f32, end: f32) -> bool {
    var enter = begin;
    var leave = end;
    for (var axis = 0u; axis < 3u; axis++) {
        let lower = low[axis] - ray.padding - ray.origin[axis];
        let upper = high[axis] + ray.padding - ray.origin[axis];
        let slope = ray.direction[axis];
        if slope == 0.0 {
            if lower > 0.0 || upper < 0.0 { return false; }
            continue;
        }
        enter = max(enter, min(lower / slope, upper / slope));
        leave = min(leave, max(lower / slope, upper / slope));
    }
    return enter <= leave + ray.padding * abs(ray.shear.z);
}

// The product of two numbers as a whole number of 48 bits, highest one set, and its exponent; 0 for 0 and what is below normal numbers.
fn product(a: f32, b: f32) -> vec3u {
    let x = bitcast<u32>(a);
    let y = bitcast<u32>(b);
    let exponents = vec2u(x >> 23u, y >> 23u) & vec2u(0xffu);
    if exponents.x == 0u || exponents.y == 0u { return vec3u(0u); }
    let p = (x & 0x7fffffu) | 0x800000u;
    let q = (y & 0x7fffffu) | 0x800000u;
    let middle = (p >> 12u) * (q & 0xfffu) + (p & 0xfffu) * (q >> 12u);
    let lowest = (p & 0xfffu) * (q & 0xfffu) + ((middle & 0xfffu) << 12u);
    var high = (p >> 12u) * (q >> 12u) + (middle >> 12u) + (lowest >> 24u);
    var low = lowest & 0xffffffu;
    var exponent = exponents.x + exponents.y + 1u;
    if (high & 0x800000u) == 0u {
        high = (high << 1u) | (low >> 23u);
        low = (low << 1u) & 0xffffffu;
        exponent -= 1u;
    }
    return vec3u(exponent, high, low);
}

fn order(a: u32, b: u32) -> i32 {
    return i32(a > b) - i32(a < b);
}

// The sign of a b - c d, without error.
fn compare(a: f32, b: f32, c: f32, d: f32) -> i32 {
    let left = product(a, b);
    let right = product(c, d);
    let is_left_below = ((bitcast<u32>(a) ^ bitcast<u32>(b)) >> 31u) != 0u;
    let is_right_below = ((bitcast<u32>(c) ^ bitcast<u32>(d)) >> 31u) != 0u;
    let left_sign = select(select(1, -1, is_left_below), 0, left.x == 0u);
    let right_sign = select(select(1, -1, is_right_below), 0, right.x == 0u);
    if left_sign != right_sign { return select(-1, 1, left_sign > right_sign); }
    var found = order(left.x, right.x);
    if found == 0 { found = order(left.y, right.y); }
    if found == 0 { found = order(left.z, right.z); }
    return found * left_sign;
}

// On which side of the ray the line from `p` to `q` runs; of a ray that is moved by an infinitesimal amount, so that only a line without
// length has none.
fn turn(p: vec3f, q: vec3f) -> i32 {
    let left = p.x * q.y;
    let right = p.y * q.x;
    let difference = left - right;
    // Products and difference round by half a unit each, whether or not they are fused.
    let bound = 2.0 * EPSILON * (abs(left) + abs(right));
    if difference > bound { return 1; }
    if difference < -bound { return -1; }
    var found = compare(p.x, q.y, p.y, q.x);
    if found == 0 { found = i32(q.y < p.y) - i32(q.y > p.y); }
    if found == 0 { found = i32(q.x > p.x) - i32(q.x < p.x); }
    return found;
}

fn in_frame(ray: MeshRay, index: u32) -> vec3f {
    let away = turned(ray, coordinates(index) - ray.origin);
    return vec3f(away.xy - ray.shear.xy * away.z, ray.shear.z * away.z);
}

fn cross_triangle(ray: MeshRay, triangle: u32) -> Crossing {
    let first = mesh[0].y + 3u * triangle;
    let a = in_frame(ray, first);
    let b = in_frame(ray, first + 1u);
    let c = in_frame(ray, first + 2u);
    var found = Crossing(0.0, 0.0, 0);
    // In loops, here and below, what is long stands once in a kernel: compilers put functions where they are called.
    var corners = array(a, b, c);
    var side = 0;
    for (var edge = 0u; edge < 3u; edge++) {
        let turned = turn(corners[edge], corners[(edge + 1u) % 3u]);
        if turned == 0 || (edge > 0u && turned != side) { return found; }
        side = turned;
    }
    let weights = vec3f(b.x * c.y - b.y * c.x, c.x * a.y - c.y * a.x, a.x * b.y - a.y * b.x);
    let determinant = weights.x + weights.y + weights.z;
    let depths = vec3f(a.z, b.z, c.z);
    let least = min(a.z, min(b.z, c.z));
    let most = max(a.z, max(b.z, c.z));
    let across = max(abs(a.xy), max(abs(b.xy), abs(c.xy)));
    let away = max(abs(coordinates(first) - ray.origin),
        max(abs(coordinates(first + 1u) - ray.origin), abs(coordinates(first + 2u) - ray.origin)));
    let reach = max(away.x, max(away.y, away.z));
    let depth = most - least;
    var blurred = depth;
    var distance = 0.5 * (least + most);
    if determinant != 0.0 {
        blurred = min(WEIGHT_ROUNDING * max(across.x, across.y) * reach * depth / abs(determinant), depth);
        distance = clamp(dot(weights, depths) / determinant, least, most);
    }
    return Crossing(distance, blurred + DEPTH_ROUNDING * max(abs(least), abs(most)), -side);
}

// The next face behind what has been used up, and before `limit`. Crossings whose order is lost in rounding are one, or none where they take
// each other away.
fn next_face(ray: MeshRay, cursor: f32, limit: f32) -> Face {
    var first = FAR;
    var end = FAR;
    // Where the second begins: it may overlap the first.
    var second = FAR;
    var face = Face(0.0, 0, false, FAR);
    let begin = max(cursor, -ray.slack);
    var balance = 0;
    var sharpest = vec2f(FAR);
    var distances = vec2f(0.0);
    // The first crossing, and then those that overlap it.
    for (var round = 0u; round < 2u; round++) {
        var node = 0u;
        while node < mesh[0].x {
            visits++;
            let low = mesh[1u + 2u * node];
            let high = mesh[2u + 2u * node];
            if (low.w & LEAF) == 0u {
                let is_met = meets(ray, bitcast<vec3f>(low.xyz), bitcast<vec3f>(high.xyz), begin, min(end, limit));
                node = select(high.w, low.w, is_met);
                continue;
            }
            node = high.w;
            let found = cross_triangle(ray, low.w & ~LEAF);
            if found.side == 0 || found.distance + found.error < -ray.slack || found.distance > limit { continue; }
            let key = max(found.distance - found.error, -ray.slack);
            if key <= cursor { continue; }
            if round == 1u {
                if key > end { continue; }
                balance += found.side;
                let side = u32(found.side > 0);
                if found.error < sharpest[side] {
                    sharpest[side] = found.error;
                    distances[side] = found.distance;
                }
            } else if key < first {
                second = first;
                first = key;
                end = found.distance + found.error;
                face = Face(found.distance, found.side, true, end);
            } else {
                second = min(second, key);
            }
        }
        if !face.found || second > end { return face; }
    }
    face.side = sign(balance);
    face.distance = distances[u32(balance > 0)];
    return face;
}

// The next part of a ray behind what has been used up, `from` a distance where the ray is inside or not, up to `limit`.
fn next_part(ray: MeshRay, cursor: f32, inside: bool, origin: f32, limit: f32) -> Part {
    var is_inside = inside;
    var begin = origin;
    var at = cursor;
    loop {
        let face = next_face(ray, at, limit);
        if !face.found { break; }
        at = face.end;
        let distance = clamp(face.distance, origin, limit);
        if is_inside && face.side < 0 {
            if begin < distance { return Part(begin, distance, at); }
            is_inside = false;
        }
        if !is_inside && face.side > 0 {
            begin = distance;
            is_inside = true;
        }
    }
    if is_inside && begin < limit { return Part(begin, limit, FAR); }
    return Part(0.0, -1.0, FAR);
}
