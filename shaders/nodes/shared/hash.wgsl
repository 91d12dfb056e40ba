// Integer hashes of Blender's textures and their values in [0, 1].
// Source: Bob Jenkins' lookup3 (final and mix steps) on the bits of floats or on cell numbers (gradient noise, 1D
// Voronoi); the PCG generators of Jarzynski and Olano (2020) on signed cells (Voronoi in 2D, 3D, 4D).
// Domain: every u32 or i32; all integer arithmetic wraps and is exact on every device.
// Limits: a value can be exactly 1, because the conversion to f32 rounds. +0 and -0 hash differently.
#define_import_path cloudparity::hash

fn rotate_left(x: u32, k: u32) -> u32 {
    return (x << k) | (x >> (32u - k));
}

struct JenkinsState {
    a: u32,
    b: u32,
    c: u32,
}

fn jenkins_final(start: JenkinsState) -> u32 {
    var a = start.a;
    var b = start.b;
    var c = start.c;
    c ^= b;
    c -= rotate_left(b, 14u);
    a ^= c;
    a -= rotate_left(c, 11u);
    b ^= a;
    b -= rotate_left(a, 25u);
    c ^= b;
    c -= rotate_left(b, 16u);
    a ^= c;
    a -= rotate_left(c, 4u);
    b ^= a;
    b -= rotate_left(a, 14u);
    c ^= b;
    c -= rotate_left(b, 24u);
    return c;
}

fn jenkins_mix(start: JenkinsState) -> JenkinsState {
    var a = start.a;
    var b = start.b;
    var c = start.c;
    a -= c;
    a ^= rotate_left(c, 4u);
    c += b;
    b -= a;
    b ^= rotate_left(a, 6u);
    a += c;
    c -= b;
    c ^= rotate_left(b, 8u);
    b += a;
    a -= c;
    a ^= rotate_left(c, 16u);
    c += b;
    b -= a;
    b ^= rotate_left(a, 19u);
    a += c;
    c -= b;
    c ^= rotate_left(b, 4u);
    b += a;
    return JenkinsState(a, b, c);
}

// 0xdeadbeef + 4 * n + 13 for n keys.
const JENKINS_SEED_ONE: u32 = 0xdeadbf00u;
const JENKINS_SEED_TWO: u32 = 0xdeadbf04u;
const JENKINS_SEED_THREE: u32 = 0xdeadbf08u;
const JENKINS_SEED_FOUR: u32 = 0xdeadbf0cu;

fn jenkins1(x: u32) -> u32 {
    return jenkins_final(JenkinsState(JENKINS_SEED_ONE + x, JENKINS_SEED_ONE, JENKINS_SEED_ONE));
}

fn jenkins2(x: u32, y: u32) -> u32 {
    return jenkins_final(JenkinsState(JENKINS_SEED_TWO + x, JENKINS_SEED_TWO + y, JENKINS_SEED_TWO));
}

fn jenkins3(x: u32, y: u32, z: u32) -> u32 {
    return jenkins_final(JenkinsState(JENKINS_SEED_THREE + x, JENKINS_SEED_THREE + y, JENKINS_SEED_THREE + z));
}

fn jenkins4(x: u32, y: u32, z: u32, w: u32) -> u32 {
    let mixed = jenkins_mix(JenkinsState(JENKINS_SEED_FOUR + x, JENKINS_SEED_FOUR + y, JENKINS_SEED_FOUR + z));
    return jenkins_final(JenkinsState(mixed.a + w, mixed.b, mixed.c));
}

// Both halves convert exactly, so that only the addition rounds, whatever the device's u32 conversion does.
fn unit_from_bits(h: u32) -> f32 {
    return (f32(h >> 16u) * 65536.0 + f32(h & 0xffffu)) * 2.3283064365386963e-10;
}

fn hash_float1(x: f32) -> f32 {
    return unit_from_bits(jenkins1(bitcast<u32>(x)));
}

fn hash_float2(x: f32, y: f32) -> f32 {
    return unit_from_bits(jenkins2(bitcast<u32>(x), bitcast<u32>(y)));
}

// PCG in parts: all cells of a row share the linear step of a component, and the caller may merge the last scaling with
// a factor of its own. 31 bits are left, so that the signed conversion, one instruction everywhere, serves.
const PCG_MULTIPLIER: i32 = 1664525;
const PCG_INCREMENT: i32 = 1013904223;
const PCG_MASK: i32 = 0x7fffffff;
const PCG_UNIT: f32 = 4.656612873077393e-10;

fn pcg2_rounds(linear: vec2i) -> vec2f {
    var x = linear.x;
    var y = linear.y;
    x += y * PCG_MULTIPLIER;
    y += x * PCG_MULTIPLIER;
    x ^= x >> 16u;
    y ^= y >> 16u;
    x += y * PCG_MULTIPLIER;
    y += x * PCG_MULTIPLIER;
    return vec2f(vec2i(x, y) & vec2i(PCG_MASK));
}

fn pcg3_rounds(linear: vec3i) -> vec3f {
    var x = linear.x;
    var y = linear.y;
    var z = linear.z;
    x += y * z;
    y += z * x;
    z += x * y;
    x ^= x >> 16u;
    y ^= y >> 16u;
    z ^= z >> 16u;
    x += y * z;
    y += z * x;
    z += x * y;
    return vec3f(vec3i(x, y, z) & vec3i(PCG_MASK));
}

fn pcg4_rounds(linear: vec4i) -> vec4f {
    var x = linear.x;
    var y = linear.y;
    var z = linear.z;
    var w = linear.w;
    x += y * w;
    y += z * x;
    z += x * y;
    w += y * z;
    x ^= x >> 16u;
    y ^= y >> 16u;
    z ^= z >> 16u;
    w ^= w >> 16u;
    x += y * w;
    y += z * x;
    z += x * y;
    w += y * z;
    return vec4f(vec4i(x, y, z, w) & vec4i(PCG_MASK));
}

// Hashes of four cells, a component of all four in a vector. A hash is a chain of products that wait for each other: four
// take turns.
struct FourHashes {
    x: vec4f,
    y: vec4f,
    z: vec4f,
    w: vec4f,
}

fn pcg3_rounds_of_four(linear_x: vec4i, linear_y: vec4i, linear_z: vec4i) -> FourHashes {
    var x = linear_x;
    var y = linear_y;
    var z = linear_z;
    x += y * z;
    y += z * x;
    z += x * y;
    x ^= x >> vec4u(16u);
    y ^= y >> vec4u(16u);
    z ^= z >> vec4u(16u);
    x += y * z;
    y += z * x;
    z += x * y;
    let mask = vec4i(PCG_MASK);
    return FourHashes(vec4f(x & mask), vec4f(y & mask), vec4f(z & mask), vec4f(0.0));
}

fn pcg4_rounds_of_four(linear_x: vec4i, linear_y: vec4i, linear_z: vec4i, linear_w: vec4i) -> FourHashes {
    var x = linear_x;
    var y = linear_y;
    var z = linear_z;
    var w = linear_w;
    x += y * w;
    y += z * x;
    z += x * y;
    w += y * z;
    x ^= x >> vec4u(16u);
    y ^= y >> vec4u(16u);
    z ^= z >> vec4u(16u);
    w ^= w >> vec4u(16u);
    x += y * w;
    y += z * x;
    z += x * y;
    w += y * z;
    let mask = vec4i(PCG_MASK);
    return FourHashes(vec4f(x & mask), vec4f(y & mask), vec4f(z & mask), vec4f(w & mask));
}

fn pcg3(cell: vec3i) -> vec3f {
    return pcg3_rounds(cell * PCG_MULTIPLIER + PCG_INCREMENT) * PCG_UNIT;
}

fn pcg4(cell: vec4i) -> vec4f {
    return pcg4_rounds(cell * PCG_MULTIPLIER + PCG_INCREMENT) * PCG_UNIT;
}
