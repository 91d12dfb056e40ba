// Signed gradient noise of Blender's textures in one to four dimensions, value about [-1, 1].
// Source: Perlin's improved noise; Jenkins hash of the integer cell, quintic weights, interpolation along x first.
// snoise(p) = K * perlin(wrap(p)): period 100000, half a cell added from 1e6 on so that integers do not all give 0.
// Domain: any finite p. Limits: the remainder is exact in 1D and 2D and a rounded quotient in 3D and 4D, as in Blender.
#define_import_path cloudparity::gradient_noise

#import cloudparity::hash::{jenkins1, jenkins2, jenkins3, jenkins4}
#import cloudparity::numeric::{fmod, mix_linear, to_int}

const PERIOD: f32 = 100000.0;
const INVERSE_PERIOD: f32 = 0.00001;
const COARSE: f32 = 1000000.0;

fn signed_by(x: f32, flag: u32) -> f32 {
    return select(x, -x, flag != 0u);
}

fn fade_1d(f: f32) -> f32 {
    return ((f * f) * f) * (f * (f * 6.0 - 15.0) + 10.0);
}

fn fade(f: f32) -> f32 {
    return (f * f) * (f * (f * (f * 6.0 - 15.0) + 10.0));
}

fn gradient_1d(h: u32, x: f32) -> f32 {
    let slope = 1.0 + f32(h & 7u);
    return signed_by(slope, h & 8u) * x;
}

fn gradient_2d(hash: u32, x: f32, y: f32) -> f32 {
    let h = hash & 7u;
    let low = h < 4u;
    let u = select(y, x, low);
    let v = 2.0 * select(x, y, low);
    return signed_by(u, h & 1u) + signed_by(v, h & 2u);
}

fn gradient_3d(hash: u32, x: f32, y: f32, z: f32) -> f32 {
    let h = hash & 15u;
    let u = select(y, x, h < 8u);
    let v = select(select(z, x, h == 12u || h == 14u), y, h < 4u);
    return signed_by(u, h & 1u) + signed_by(v, h & 2u);
}

fn gradient_4d(hash: u32, x: f32, y: f32, z: f32, w: f32) -> f32 {
    let h = hash & 31u;
    let u = select(y, x, h < 24u);
    let v = select(z, y, h < 16u);
    let s = select(w, z, h < 8u);
    return (signed_by(u, h & 1u) + signed_by(v, h & 2u)) + signed_by(s, h & 4u);
}

fn perlin_1d(p: f32) -> f32 {
    let cell = floor(p);
    let f = p - cell;
    let x = bitcast<u32>(to_int(cell));
    return mix_linear(gradient_1d(jenkins1(x), f), gradient_1d(jenkins1(x + 1u), f - 1.0), fade_1d(f));
}

fn perlin_2d(p: vec2f) -> f32 {
    let cell = floor(p);
    let f = p - cell;
    let x = bitcast<u32>(to_int(cell.x));
    let y = bitcast<u32>(to_int(cell.y));
    let g = f - vec2f(1.0);
    let u = fade(f.x);
    return mix_linear(
        mix_linear(gradient_2d(jenkins2(x, y), f.x, f.y), gradient_2d(jenkins2(x + 1u, y), g.x, f.y), u),
        mix_linear(gradient_2d(jenkins2(x, y + 1u), f.x, g.y), gradient_2d(jenkins2(x + 1u, y + 1u), g.x, g.y), u),
        fade(f.y));
}

// One edge of the cube along x.
fn perlin_3d_edge(x: u32, y: u32, z: u32, fx: f32, fy: f32, fz: f32, u: f32) -> f32 {
    return mix_linear(gradient_3d(jenkins3(x, y, z), fx, fy, fz),
        gradient_3d(jenkins3(x + 1u, y, z), fx - 1.0, fy, fz), u);
}

fn perlin_3d(p: vec3f) -> f32 {
    let cell = floor(p);
    let f = p - cell;
    let x = bitcast<u32>(to_int(cell.x));
    let y = bitcast<u32>(to_int(cell.y));
    let z = bitcast<u32>(to_int(cell.z));
    let g = f - vec3f(1.0);
    let u = fade(f.x);
    let v = fade(f.y);
    return mix_linear(
        mix_linear(perlin_3d_edge(x, y, z, f.x, f.y, f.z, u), perlin_3d_edge(x, y + 1u, z, f.x, g.y, f.z, u), v),
        mix_linear(perlin_3d_edge(x, y, z + 1u, f.x, f.y, g.z, u),
            perlin_3d_edge(x, y + 1u, z + 1u, f.x, g.y, g.z, u), v),
        fade(f.z));
}

fn perlin_4d_edge(x: u32, y: u32, z: u32, w: u32, f: vec4f, u: f32) -> f32 {
    return mix_linear(gradient_4d(jenkins4(x, y, z, w), f.x, f.y, f.z, f.w),
        gradient_4d(jenkins4(x + 1u, y, z, w), f.x - 1.0, f.y, f.z, f.w), u);
}

fn perlin_4d_cube(x: u32, y: u32, z: u32, w: u32, f: vec4f, u: f32, v: f32, t: f32) -> f32 {
    let g = f - vec4f(1.0);
    return mix_linear(
        mix_linear(perlin_4d_edge(x, y, z, w, f, u),
            perlin_4d_edge(x, y + 1u, z, w, vec4f(f.x, g.y, f.z, f.w), u), v),
        mix_linear(perlin_4d_edge(x, y, z + 1u, w, vec4f(f.x, f.y, g.z, f.w), u),
            perlin_4d_edge(x, y + 1u, z + 1u, w, vec4f(f.x, g.y, g.z, f.w), u), v),
        t);
}

fn perlin_4d(p: vec4f) -> f32 {
    let cell = floor(p);
    let f = p - cell;
    let x = bitcast<u32>(to_int(cell.x));
    let y = bitcast<u32>(to_int(cell.y));
    let z = bitcast<u32>(to_int(cell.z));
    let w = bitcast<u32>(to_int(cell.w));
    let u = fade(f.x);
    let v = fade(f.y);
    let t = fade(f.z);
    return mix_linear(perlin_4d_cube(x, y, z, w, f, u, v, t),
        perlin_4d_cube(x, y, z, w + 1u, vec4f(f.xyz, f.w - 1.0), u, v, t), fade(f.w));
}

// The half cell is added under a select: a bare sum invites compilers to add it to the large p first, where it is lost.
fn wrap_exactly(p: f32) -> f32 {
    let wrapped = fmod(p, PERIOD);
    return select(wrapped, wrapped + 0.5, abs(p) >= COARSE);
}

fn wrap_rounded(p: vec4f) -> vec4f {
    let wrapped = p - trunc(p * INVERSE_PERIOD) * PERIOD;
    return select(wrapped, wrapped + vec4f(0.5), abs(p) >= vec4f(COARSE));
}

fn snoise_1d(p: f32) -> f32 {
    return 0.25 * perlin_1d(wrap_exactly(p));
}

fn snoise_2d(p: vec2f) -> f32 {
    return 0.6616 * perlin_2d(vec2f(wrap_exactly(p.x), wrap_exactly(p.y)));
}

fn snoise_3d(p: vec3f) -> f32 {
    return 0.982 * perlin_3d(wrap_rounded(vec4f(p, 0.0)).xyz);
}

fn snoise_4d(p: vec4f) -> f32 {
    return 0.8344 * perlin_4d(wrap_rounded(p));
}
