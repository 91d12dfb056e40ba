struct hash_JenkinsState {
    a: u32,
    b: u32,
    c: u32,
}

struct noise_texture_1i_Outputs {
    fac: f32,
}

struct noise_texture_1i_Fractal {
    octaves: i32,
    rest: f32,
    roughness: f32,
    lacunarity: f32,
    offset: f32,
    gain: f32,
}

struct hash_FourHashes {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    w: vec4<f32>,
}

struct voronoi_texture_1i_Outputs {
    distance: f32,
}

struct voronoi_texture_1i_Parameters {
    randomness: f32,
    smoothness: f32,
    exponent: f32,
    one: f32,
}

struct voronoi_texture_1i_Fractal {
    detail: f32,
    roughness: f32,
    lacunarity: f32,
}

struct voronoi_texture_1i_Octave {
    distance: f32,
}

struct voronoi_texture_1i_Site {
    corner: vec4<f32>,
    local: vec4<f32>,
    cell: vec4<i32>,
}

struct voronoi_texture_1i_Search {
    nearest: f32,
    nearest_rank: f32,
    second: f32,
    second_rank: f32,
}

struct voronoi_texture_1i_Axes {
    local: vec4<f32>,
    keys: vec4<i32>,
    key_step: vec4<i32>,
    near: vec4<f32>,
    near_bound: vec4<f32>,
    far_bound: vec4<f32>,
    jitter: f32,
    exponent: f32,
    one: f32,
}

struct voronoi_texture_1i_FourCells {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    w: vec4<f32>,
    key_x: vec4<i32>,
    key_y: vec4<i32>,
    key_z: vec4<i32>,
    key_w: vec4<i32>,
}

const hash_JENKINS_SEED_ONE: u32 = 3735928576u;
const hash_JENKINS_SEED_TWO: u32 = 3735928580u;
const hash_JENKINS_SEED_THREE: u32 = 3735928584u;
const hash_JENKINS_SEED_FOUR: u32 = 3735928588u;
const gradient_noise_PERIOD: f32 = 100000f;
const gradient_noise_COARSE: f32 = 1000000f;
const gradient_noise_INVERSE_PERIOD: f32 = 0.00001f;
const numeric_SMALLEST_NORMAL: f32 = 0.000000000000000000000000000000000000011754944f;
const numeric_LN_TWO: f32 = 0.6931472f;
const numeric_LARGEST: f32 = 0x1.fffffep+127f;
const numeric_QUARTER_PI: f32 = 0.7853982f;
const numeric_HALF_PI: f32 = 1.5707964f;
const numeric_PI: f32 = 3.1415927f;
const hash_PCG_MULTIPLIER: i32 = 1664525i;
const hash_PCG_INCREMENT: i32 = 1013904223i;
const hash_PCG_UNIT: f32 = 0.0000000004656613f;
const voronoi_texture_1i_KEY_STEP: i32 = 1664525i;

@group(0) @binding(0) 
var<storage> points: array<f32>;
@group(0) @binding(1) 
var<storage, read_write> densities: array<f32>;

fn map_range_1i_factor(value: f32, from_min: f32, from_max: f32, steps: f32) -> f32 {
    return ((value - from_min) / (from_max - from_min));
}

fn map_range_1i_map(value_1: f32, from_min_1: f32, from_max_1: f32, to_min: f32, to_max: f32, steps_1: f32) -> f32 {
    let _e4 = map_range_1i_factor(value_1, from_min_1, from_max_1, steps_1);
    let inside = (to_min + (_e4 * (to_max - to_min)));
    let result = select(inside, 0f, (from_min_1 == from_max_1));
    return clamp(result, min(to_min, to_max), max(to_min, to_max));
}

fn map_range_1i_evaluate(value_2: f32, from_min_2: f32, from_max_2: f32, to_min_1: f32, to_max_1: f32) -> f32 {
    let _e6 = map_range_1i_map(value_2, from_min_2, from_max_2, to_min_1, to_max_1, 0f);
    return _e6;
}

fn map_range_2i_factor(value_3: f32, from_min_3: f32, from_max_3: f32, steps_2: f32) -> f32 {
    return ((value_3 - from_min_3) / (from_max_3 - from_min_3));
}

fn map_range_2i_map(value_4: f32, from_min_4: f32, from_max_4: f32, to_min_2: f32, to_max_2: f32, steps_3: f32) -> f32 {
    let _e4 = map_range_2i_factor(value_4, from_min_4, from_max_4, steps_3);
    let inside_1 = (to_min_2 + (_e4 * (to_max_2 - to_min_2)));
    let result_1 = select(inside_1, 0f, (from_min_4 == from_max_4));
    return clamp(result_1, min(to_min_2, to_max_2), max(to_min_2, to_max_2));
}

fn map_range_2i_evaluate(value_5: f32, from_min_5: f32, from_max_5: f32, to_min_3: f32, to_max_3: f32) -> f32 {
    let _e6 = map_range_2i_map(value_5, from_min_5, from_max_5, to_min_3, to_max_3, 0f);
    return _e6;
}

fn numeric_to_int(x: f32) -> i32 {
    return select(i32(-2147483648), i32(x), (abs(x) < 2147483600f));
}

fn numeric_mix_linear(a: f32, b: f32, t: f32) -> f32 {
    return (a + (t * (b - a)));
}

fn hash_rotate_left(x_1: u32, k: u32) -> u32 {
    return ((x_1 << k) | (x_1 >> (32u - k)));
}

fn hash_jenkins_final(start: hash_JenkinsState) -> u32 {
    var a_1: u32;
    var b_1: u32;
    var c: u32;

    a_1 = start.a;
    b_1 = start.b;
    c = start.c;
    let _e7 = c;
    let _e8 = b_1;
    c = (_e7 ^ _e8);
    let _e10 = c;
    let _e11 = b_1;
    let _e13 = hash_rotate_left(_e11, 14u);
    c = (_e10 - _e13);
    let _e15 = a_1;
    let _e16 = c;
    a_1 = (_e15 ^ _e16);
    let _e18 = a_1;
    let _e19 = c;
    let _e21 = hash_rotate_left(_e19, 11u);
    a_1 = (_e18 - _e21);
    let _e23 = b_1;
    let _e24 = a_1;
    b_1 = (_e23 ^ _e24);
    let _e26 = b_1;
    let _e27 = a_1;
    let _e29 = hash_rotate_left(_e27, 25u);
    b_1 = (_e26 - _e29);
    let _e31 = c;
    let _e32 = b_1;
    c = (_e31 ^ _e32);
    let _e34 = c;
    let _e35 = b_1;
    let _e37 = hash_rotate_left(_e35, 16u);
    c = (_e34 - _e37);
    let _e39 = a_1;
    let _e40 = c;
    a_1 = (_e39 ^ _e40);
    let _e42 = a_1;
    let _e43 = c;
    let _e45 = hash_rotate_left(_e43, 4u);
    a_1 = (_e42 - _e45);
    let _e47 = b_1;
    let _e48 = a_1;
    b_1 = (_e47 ^ _e48);
    let _e50 = b_1;
    let _e51 = a_1;
    let _e53 = hash_rotate_left(_e51, 14u);
    b_1 = (_e50 - _e53);
    let _e55 = c;
    let _e56 = b_1;
    c = (_e55 ^ _e56);
    let _e58 = c;
    let _e59 = b_1;
    let _e61 = hash_rotate_left(_e59, 24u);
    c = (_e58 - _e61);
    let _e63 = c;
    return _e63;
}

fn hash_jenkins_mix(start_1: hash_JenkinsState) -> hash_JenkinsState {
    var a_2: u32;
    var b_2: u32;
    var c_1: u32;

    a_2 = start_1.a;
    b_2 = start_1.b;
    c_1 = start_1.c;
    let _e7 = a_2;
    let _e8 = c_1;
    a_2 = (_e7 - _e8);
    let _e10 = a_2;
    let _e11 = c_1;
    let _e13 = hash_rotate_left(_e11, 4u);
    a_2 = (_e10 ^ _e13);
    let _e15 = c_1;
    let _e16 = b_2;
    c_1 = (_e15 + _e16);
    let _e18 = b_2;
    let _e19 = a_2;
    b_2 = (_e18 - _e19);
    let _e21 = b_2;
    let _e22 = a_2;
    let _e24 = hash_rotate_left(_e22, 6u);
    b_2 = (_e21 ^ _e24);
    let _e26 = a_2;
    let _e27 = c_1;
    a_2 = (_e26 + _e27);
    let _e29 = c_1;
    let _e30 = b_2;
    c_1 = (_e29 - _e30);
    let _e32 = c_1;
    let _e33 = b_2;
    let _e35 = hash_rotate_left(_e33, 8u);
    c_1 = (_e32 ^ _e35);
    let _e37 = b_2;
    let _e38 = a_2;
    b_2 = (_e37 + _e38);
    let _e40 = a_2;
    let _e41 = c_1;
    a_2 = (_e40 - _e41);
    let _e43 = a_2;
    let _e44 = c_1;
    let _e46 = hash_rotate_left(_e44, 16u);
    a_2 = (_e43 ^ _e46);
    let _e48 = c_1;
    let _e49 = b_2;
    c_1 = (_e48 + _e49);
    let _e51 = b_2;
    let _e52 = a_2;
    b_2 = (_e51 - _e52);
    let _e54 = b_2;
    let _e55 = a_2;
    let _e57 = hash_rotate_left(_e55, 19u);
    b_2 = (_e54 ^ _e57);
    let _e59 = a_2;
    let _e60 = c_1;
    a_2 = (_e59 + _e60);
    let _e62 = c_1;
    let _e63 = b_2;
    c_1 = (_e62 - _e63);
    let _e65 = c_1;
    let _e66 = b_2;
    let _e68 = hash_rotate_left(_e66, 4u);
    c_1 = (_e65 ^ _e68);
    let _e70 = b_2;
    let _e71 = a_2;
    b_2 = (_e70 + _e71);
    let _e73 = a_2;
    let _e74 = b_2;
    let _e75 = c_1;
    return hash_JenkinsState(_e73, _e74, _e75);
}

fn hash_jenkins4_(x_2: u32, y: u32, z: u32, w: u32) -> u32 {
    let _e10 = hash_jenkins_mix(hash_JenkinsState((hash_JENKINS_SEED_FOUR + x_2), (hash_JENKINS_SEED_FOUR + y), (hash_JENKINS_SEED_FOUR + z)));
    let _e17 = hash_jenkins_final(hash_JenkinsState((_e10.a + w), _e10.b, _e10.c));
    return _e17;
}

fn gradient_noise_signed_by(x_3: f32, flag: u32) -> f32 {
    return select(x_3, -(x_3), (flag != 0u));
}

fn gradient_noise_fade(f: f32) -> f32 {
    return ((f * f) * (f * ((f * ((f * 6f) - 15f)) + 10f)));
}

fn gradient_noise_wrap_rounded(p: vec4<f32>) -> vec4<f32> {
    let wrapped = (p - (trunc((p * gradient_noise_INVERSE_PERIOD)) * gradient_noise_PERIOD));
    return select(wrapped, (wrapped + vec4(0.5f)), (abs(p) >= vec4(1000000f)));
}

fn gradient_noise_gradient_4d(hash: u32, x_4: f32, y_1: f32, z_1: f32, w_1: f32) -> f32 {
    let h_1 = (hash & 31u);
    let u_2 = select(y_1, x_4, (h_1 < 24u));
    let v_3 = select(z_1, y_1, (h_1 < 16u));
    let s_9 = select(w_1, z_1, (h_1 < 8u));
    let _e18 = gradient_noise_signed_by(u_2, (h_1 & 1u));
    let _e21 = gradient_noise_signed_by(v_3, (h_1 & 2u));
    let _e25 = gradient_noise_signed_by(s_9, (h_1 & 4u));
    return ((_e18 + _e21) + _e25);
}

fn gradient_noise_perlin_4d_edge(x_5: u32, y_2: u32, z_2: u32, w_2: u32, f_1: vec4<f32>, u: f32) -> f32 {
    let _e4 = hash_jenkins4_(x_5, y_2, z_2, w_2);
    let _e10 = gradient_noise_gradient_4d(_e4, f_1.x, f_1.y, f_1.z, f_1.w);
    let _e13 = hash_jenkins4_((x_5 + 1u), y_2, z_2, w_2);
    let _e20 = gradient_noise_gradient_4d(_e13, (f_1.x - 1f), f_1.y, f_1.z, f_1.w);
    let _e22 = numeric_mix_linear(_e10, _e20, u);
    return _e22;
}

fn gradient_noise_perlin_4d_cube(x_6: u32, y_3: u32, z_3: u32, w_3: u32, f_2: vec4<f32>, u_1: f32, v: f32, t_1: f32) -> f32 {
    let g = (f_2 - vec4(1f));
    let _e9 = gradient_noise_perlin_4d_edge(x_6, y_3, z_3, w_3, f_2, u_1);
    let _e17 = gradient_noise_perlin_4d_edge(x_6, (y_3 + 1u), z_3, w_3, vec4<f32>(f_2.x, g.y, f_2.z, f_2.w), u_1);
    let _e19 = numeric_mix_linear(_e9, _e17, v);
    let _e27 = gradient_noise_perlin_4d_edge(x_6, y_3, (z_3 + 1u), w_3, vec4<f32>(f_2.x, f_2.y, g.z, f_2.w), u_1);
    let _e37 = gradient_noise_perlin_4d_edge(x_6, (y_3 + 1u), (z_3 + 1u), w_3, vec4<f32>(f_2.x, g.y, g.z, f_2.w), u_1);
    let _e38 = numeric_mix_linear(_e27, _e37, v);
    let _e40 = numeric_mix_linear(_e19, _e38, t_1);
    return _e40;
}

fn gradient_noise_perlin_4d(p_1: vec4<f32>) -> f32 {
    let cell = floor(p_1);
    let f_7 = (p_1 - cell);
    let _e4 = numeric_to_int(cell.x);
    let x_15 = bitcast<u32>(_e4);
    let _e7 = numeric_to_int(cell.y);
    let y_5 = bitcast<u32>(_e7);
    let _e10 = numeric_to_int(cell.z);
    let z_5 = bitcast<u32>(_e10);
    let _e13 = numeric_to_int(cell.w);
    let w_7 = bitcast<u32>(_e13);
    let _e16 = gradient_noise_fade(f_7.x);
    let _e18 = gradient_noise_fade(f_7.y);
    let _e20 = gradient_noise_fade(f_7.z);
    let _e21 = gradient_noise_perlin_4d_cube(x_15, y_5, z_5, w_7, f_7, _e16, _e18, _e20);
    let _e29 = gradient_noise_perlin_4d_cube(x_15, y_5, z_5, (w_7 + 1u), vec4<f32>(f_7.xyz, (f_7.w - 1f)), _e16, _e18, _e20);
    let _e31 = gradient_noise_fade(f_7.w);
    let _e32 = numeric_mix_linear(_e21, _e29, _e31);
    return _e32;
}

fn gradient_noise_snoise_4d(p_2: vec4<f32>) -> f32 {
    let _e1 = gradient_noise_wrap_rounded(p_2);
    let _e2 = gradient_noise_perlin_4d(_e1);
    return (0.8344f * _e2);
}

fn noise_texture_1i_distort(p_3: vec4<f32>, distortion: f32) -> vec4<f32> {
    return p_3;
}

fn noise_texture_1i_snoise(p_4: vec4<f32>) -> f32 {
    let _e1 = gradient_noise_snoise_4d(p_4);
    return _e1;
}

fn noise_texture_1i_one_octave(noise: f32, offset: f32) -> f32 {
    return ((0.5f * noise) + 0.5f);
}

fn noise_texture_1i_fractal(p_5: vec4<f32>, f_3: noise_texture_1i_Fractal) -> f32 {
    let _e1 = noise_texture_1i_snoise(p_5);
    let _e4 = noise_texture_1i_one_octave(_e1, f_3.offset);
    return _e4;
}

fn noise_texture_1i_evaluate(vector: vec3<f32>, w_4: f32, scale: f32, detail: f32, roughness: f32, lacunarity: f32, distortion_1: f32) -> noise_texture_1i_Outputs {
    var f_4: noise_texture_1i_Fractal;
    var outputs: noise_texture_1i_Outputs;

    let coordinates = (vec4<f32>(vector, w_4) * scale);
    let d = clamp(detail, 0f, 15f);
    f_4.octaves = i32(d);
    f_4.rest = (d - floor(d));
    f_4.roughness = max(roughness, 0f);
    f_4.lacunarity = lacunarity;
    let _e22 = noise_texture_1i_distort(coordinates, distortion_1);
    let _e25 = f_4;
    let _e26 = noise_texture_1i_fractal(_e22, _e25);
    outputs.fac = _e26;
    let _e27 = outputs;
    return _e27;
}

fn math_1i_finish(x_7: f32) -> f32 {
    return clamp(x_7, 0f, 1f);
}

fn math_1i_evaluate(a_3: f32, b_3: f32) -> f32 {
    let _e3 = math_1i_finish((a_3 * b_3));
    return _e3;
}

fn hash_pcg4_rounds_of_four(linear_x: vec4<i32>, linear_y: vec4<i32>, linear_z: vec4<i32>, linear_w: vec4<i32>) -> hash_FourHashes {
    var x_8: vec4<i32>;
    var y_4: vec4<i32>;
    var z_4: vec4<i32>;
    var w_5: vec4<i32>;

    x_8 = linear_x;
    y_4 = linear_y;
    z_4 = linear_z;
    w_5 = linear_w;
    let _e8 = x_8;
    let _e9 = y_4;
    let _e10 = w_5;
    x_8 = (_e8 + (_e9 * _e10));
    let _e13 = y_4;
    let _e14 = z_4;
    let _e15 = x_8;
    y_4 = (_e13 + (_e14 * _e15));
    let _e18 = z_4;
    let _e19 = x_8;
    let _e20 = y_4;
    z_4 = (_e18 + (_e19 * _e20));
    let _e23 = w_5;
    let _e24 = y_4;
    let _e25 = z_4;
    w_5 = (_e23 + (_e24 * _e25));
    let _e28 = x_8;
    let _e29 = x_8;
    x_8 = (_e28 ^ (_e29 >> vec4(16u)));
    let _e34 = y_4;
    let _e35 = y_4;
    y_4 = (_e34 ^ (_e35 >> vec4(16u)));
    let _e40 = z_4;
    let _e41 = z_4;
    z_4 = (_e40 ^ (_e41 >> vec4(16u)));
    let _e46 = w_5;
    let _e47 = w_5;
    w_5 = (_e46 ^ (_e47 >> vec4(16u)));
    let _e52 = x_8;
    let _e53 = y_4;
    let _e54 = w_5;
    x_8 = (_e52 + (_e53 * _e54));
    let _e57 = y_4;
    let _e58 = z_4;
    let _e59 = x_8;
    y_4 = (_e57 + (_e58 * _e59));
    let _e62 = z_4;
    let _e63 = x_8;
    let _e64 = y_4;
    z_4 = (_e62 + (_e63 * _e64));
    let _e67 = w_5;
    let _e68 = y_4;
    let _e69 = z_4;
    w_5 = (_e67 + (_e68 * _e69));
    let mask = vec4(2147483647i);
    let _e74 = x_8;
    let _e77 = y_4;
    let _e80 = z_4;
    let _e83 = w_5;
    return hash_FourHashes(vec4<f32>((_e74 & mask)), vec4<f32>((_e77 & mask)), vec4<f32>((_e80 & mask)), vec4<f32>((_e83 & mask)));
}

fn voronoi_texture_1i_site_of(x_9: vec4<f32>) -> voronoi_texture_1i_Site {
    let corner = floor(x_9);
    let _e3 = numeric_to_int(corner.x);
    let _e5 = numeric_to_int(corner.y);
    let _e7 = numeric_to_int(corner.z);
    let _e9 = numeric_to_int(corner.w);
    let cell_1 = vec4<i32>(_e3, _e5, _e7, _e9);
    return voronoi_texture_1i_Site(corner, (x_9 - corner), cell_1);
}

fn voronoi_texture_1i_keys_of(site: voronoi_texture_1i_Site, o: vec4<i32>) -> vec4<i32> {
    return (((site.cell + o) * hash_PCG_MULTIPLIER) + vec4(1013904223i));
}

fn voronoi_texture_1i_terms(v_1: vec4<f32>, exponent: f32) -> vec4<f32> {
    return (v_1 * v_1);
}

fn voronoi_texture_1i_bound_terms(axis_distance: vec4<f32>, exponent_1: f32) -> vec4<f32> {
    let _e2 = voronoi_texture_1i_terms(axis_distance, exponent_1);
    return _e2;
}

fn voronoi_texture_1i_jitter(p_6: voronoi_texture_1i_Parameters) -> f32 {
    return (p_6.randomness * hash_PCG_UNIT);
}

fn voronoi_texture_1i_next_key(key: i32, step_: i32) -> i32 {
    return (key + step_);
}

fn voronoi_texture_1i_join(a_4: f32, b_4: f32) -> f32 {
    return (a_4 + b_4);
}

fn voronoi_texture_1i_join_each(a_5: vec4<f32>, b_5: vec4<f32>) -> vec4<f32> {
    let _e4 = voronoi_texture_1i_join(a_5.x, b_5.x);
    let _e7 = voronoi_texture_1i_join(a_5.y, b_5.y);
    let _e10 = voronoi_texture_1i_join(a_5.z, b_5.z);
    let _e13 = voronoi_texture_1i_join(a_5.w, b_5.w);
    return vec4<f32>(_e4, _e7, _e10, _e13);
}

fn voronoi_texture_1i_visit_nearest(s: ptr<function, voronoi_texture_1i_Search>, measure: f32) {
    let _e4 = (*s).nearest;
    (*s).nearest = min(_e4, measure);
    return;
}

fn voronoi_texture_1i_count(s_1: ptr<function, voronoi_texture_1i_Search>, o_1: vec4<f32>, measure_1: f32) {
    voronoi_texture_1i_visit_nearest(s_1, measure_1);
    return;
}

fn voronoi_texture_1i_visit_four(s_2: ptr<function, voronoi_texture_1i_Search>, a_6: voronoi_texture_1i_Axes, c_2: voronoi_texture_1i_FourCells) {
    let _e5 = hash_pcg4_rounds_of_four(c_2.key_x, c_2.key_y, c_2.key_z, c_2.key_w);
    let _e17 = voronoi_texture_1i_terms(((c_2.x + (_e5.x * a_6.jitter)) - vec4(a_6.local.x)), a_6.exponent);
    let _e28 = voronoi_texture_1i_terms(((c_2.y + (_e5.y * a_6.jitter)) - vec4(a_6.local.y)), a_6.exponent);
    let _e39 = voronoi_texture_1i_terms(((c_2.z + (_e5.z * a_6.jitter)) - vec4(a_6.local.z)), a_6.exponent);
    let _e50 = voronoi_texture_1i_terms(((c_2.w + (_e5.w * a_6.jitter)) - vec4(a_6.local.w)), a_6.exponent);
    let _e51 = voronoi_texture_1i_join_each(_e17, _e28);
    let _e52 = voronoi_texture_1i_join_each(_e39, _e50);
    let _e55 = voronoi_texture_1i_join_each(_e51, (_e52 * a_6.one));
    voronoi_texture_1i_count(s_2, vec4<f32>(c_2.x.x, c_2.y.x, c_2.z.x, c_2.w.x), _e55.x);
    voronoi_texture_1i_count(s_2, vec4<f32>(c_2.x.y, c_2.y.y, c_2.z.y, c_2.w.y), _e55.y);
    voronoi_texture_1i_count(s_2, vec4<f32>(c_2.x.z, c_2.y.z, c_2.z.z, c_2.w.z), _e55.z);
    voronoi_texture_1i_count(s_2, vec4<f32>(c_2.x.w, c_2.y.w, c_2.z.w, c_2.w.w), _e55.w);
    return;
}

fn voronoi_texture_1i_visit_near(s_3: ptr<function, voronoi_texture_1i_Search>, a_7: voronoi_texture_1i_Axes) {
    var c_3: voronoi_texture_1i_FourCells;

    let _e5 = voronoi_texture_1i_next_key(a_7.keys.x, a_7.key_step.x);
    let _e10 = voronoi_texture_1i_next_key(a_7.keys.y, a_7.key_step.y);
    let _e15 = voronoi_texture_1i_next_key(a_7.keys.z, a_7.key_step.z);
    let _e20 = voronoi_texture_1i_next_key(a_7.keys.w, a_7.key_step.w);
    let near_keys = vec4<i32>(_e5, _e10, _e15, _e20);
    c_3.x = vec4<f32>(0f, a_7.near.x, 0f, a_7.near.x);
    c_3.y = vec4<f32>(0f, 0f, a_7.near.y, a_7.near.y);
    c_3.key_x = vec4<i32>(a_7.keys.x, near_keys.x, a_7.keys.x, near_keys.x);
    c_3.key_y = vec4<i32>(a_7.keys.yy, near_keys.yy);
    c_3.w = vec4(0f);
    c_3.key_w = vec4(a_7.keys.w);
    c_3.z = vec4(0f);
    c_3.key_z = vec4(a_7.keys.z);
    let _e66 = c_3;
    voronoi_texture_1i_visit_four(s_3, a_7, _e66);
    c_3.z = vec4(a_7.near.z);
    c_3.key_z = vec4(near_keys.z);
    let _e75 = c_3;
    voronoi_texture_1i_visit_four(s_3, a_7, _e75);
    c_3.w = vec4(a_7.near.w);
    c_3.key_w = vec4(near_keys.w);
    let _e83 = c_3;
    voronoi_texture_1i_visit_four(s_3, a_7, _e83);
    c_3.z = vec4(0f);
    c_3.key_z = vec4(a_7.keys.z);
    let _e91 = c_3;
    voronoi_texture_1i_visit_four(s_3, a_7, _e91);
    return;
}

fn voronoi_texture_1i_beyond(s_4: ptr<function, voronoi_texture_1i_Search>, bound: f32) -> bool {
    let _e3 = (*s_4).nearest;
    return (bound >= _e3);
}

fn voronoi_texture_1i_hopeful(s_5: ptr<function, voronoi_texture_1i_Search>, bounds: vec4<f32>) -> u32 {
    let _e3 = voronoi_texture_1i_beyond(s_5, bounds.x);
    let _e9 = voronoi_texture_1i_beyond(s_5, bounds.y);
    let _e16 = voronoi_texture_1i_beyond(s_5, bounds.z);
    let _e22 = voronoi_texture_1i_beyond(s_5, bounds.w);
    return ((select(0u, 1u, !(_e3)) | select(0u, 2u, !(_e9))) | (select(0u, 4u, !(_e16)) | select(0u, 8u, !(_e22))));
}

fn voronoi_texture_1i_keys_at(key_1: i32, step_1: i32, is_near: vec4<bool>, is_far: vec4<bool>) -> vec4<i32> {
    let _e2 = voronoi_texture_1i_next_key(key_1, step_1);
    let _e4 = voronoi_texture_1i_next_key(key_1, -(step_1));
    return vec4<i32>(select(select(key_1, _e2, is_near.x), _e4, is_far.x), select(select(key_1, _e2, is_near.y), _e4, is_far.y), select(select(key_1, _e2, is_near.z), _e4, is_far.z), select(select(key_1, _e2, is_near.w), _e4, is_far.w));
}

fn voronoi_texture_1i_visit_list(s_6: ptr<function, voronoi_texture_1i_Search>, a_8: voronoi_texture_1i_Axes, list: u32, near_bits: vec4<u32>, far_bits: vec4<u32>) {
    var left: u32;
    var bits: vec4<u32>;
    var c_4: voronoi_texture_1i_FourCells;

    left = list;
    loop {
        let _e2 = left;
        let _e3 = left;
        bits = vec4<u32>((_e2 & (~(_e3) + 1u)), 0u, 0u, 0u);
        let _e13 = left;
        let _e14 = left;
        left = (_e13 & (_e14 - 1u));
        let _e19 = left;
        let _e20 = left;
        bits.y = (_e19 & (~(_e20) + 1u));
        let _e25 = left;
        let _e26 = left;
        left = (_e25 & (_e26 - 1u));
        let _e31 = left;
        let _e32 = left;
        bits.z = (_e31 & (~(_e32) + 1u));
        let _e37 = left;
        let _e38 = left;
        left = (_e37 & (_e38 - 1u));
        let _e43 = left;
        let _e44 = left;
        bits.w = (_e43 & (~(_e44) + 1u));
        let _e49 = left;
        let _e50 = left;
        left = (_e49 & (_e50 - 1u));
        c_4 = voronoi_texture_1i_FourCells();
        let _e57 = bits;
        let near_x = ((_e57 & vec4(near_bits.x)) != vec4(0u));
        let _e65 = bits;
        let far_x = ((_e65 & vec4(~(far_bits.x))) == vec4(0u));
        c_4.x = select(select(vec4(0f), vec4(a_8.near.x), near_x), vec4(-(a_8.near.x)), far_x);
        let _e91 = voronoi_texture_1i_keys_at(a_8.keys.x, a_8.key_step.x, near_x, far_x);
        c_4.key_x = _e91;
        let _e92 = bits;
        let near_y = ((_e92 & vec4(near_bits.y)) != vec4(0u));
        let _e99 = bits;
        let far_y = ((_e99 & vec4(~(far_bits.y))) == vec4(0u));
        c_4.y = select(select(vec4(0f), vec4(a_8.near.y), near_y), vec4(-(a_8.near.y)), far_y);
        let _e124 = voronoi_texture_1i_keys_at(a_8.keys.y, a_8.key_step.y, near_y, far_y);
        c_4.key_y = _e124;
        let _e125 = bits;
        let near_z = ((_e125 & vec4(near_bits.z)) != vec4(0u));
        let _e132 = bits;
        let far_z = ((_e132 & vec4(~(far_bits.z))) == vec4(0u));
        c_4.z = select(select(vec4(0f), vec4(a_8.near.z), near_z), vec4(-(a_8.near.z)), far_z);
        let _e157 = voronoi_texture_1i_keys_at(a_8.keys.z, a_8.key_step.z, near_z, far_z);
        c_4.key_z = _e157;
        c_4.w = vec4(0f);
        c_4.key_w = vec4(a_8.keys.w);
        let _e165 = bits;
        let near_w = ((_e165 & vec4(near_bits.w)) != vec4(0u));
        let _e172 = bits;
        let far_w = ((_e172 & vec4(~(far_bits.w))) == vec4(0u));
        c_4.w = select(select(vec4(0f), vec4(a_8.near.w), near_w), vec4(-(a_8.near.w)), far_w);
        let _e197 = voronoi_texture_1i_keys_at(a_8.keys.w, a_8.key_step.w, near_w, far_w);
        c_4.key_w = _e197;
        let _e198 = c_4;
        voronoi_texture_1i_visit_four(s_6, a_8, _e198);
        continuing {
            let _e200 = left;
            break if (_e200 == 0u);
        }
    }
    return;
}

fn voronoi_texture_1i_scan_lists(s_7: ptr<function, voronoi_texture_1i_Search>, a_9: voronoi_texture_1i_Axes) {
    var list_1: u32;
    var near_bits_1: vec4<u32> = vec4<u32>(2863329280u, 3435921648u, 4026575530u, 15781068u);
    var far_bits_1: vec4<u32> = vec4<u32>(255u, 65280u, 16711680u, 4278190080u);
    var lists: i32 = 1i;

    voronoi_texture_1i_visit_near(s_7, a_9);
    let near = a_9.near_bound;
    let far = a_9.far_bound;
    let _e19 = voronoi_texture_1i_join(near.x, near.y);
    let near_xy = vec4<f32>(0f, near.x, near.y, _e19);
    let _e25 = voronoi_texture_1i_join(far.x, near.y);
    let _e29 = voronoi_texture_1i_join(near.x, far.y);
    let far_xy = vec4<f32>(far.x, _e25, far.y, _e29);
    let _e33 = voronoi_texture_1i_join(far.x, far.y);
    let both_xy = vec4(_e33);
    let _e39 = voronoi_texture_1i_join(near.z, near.w);
    let near_zw = (vec4<f32>(0f, near.z, near.w, _e39) * a_9.one);
    let _e47 = voronoi_texture_1i_join(far.z, near.w);
    let _e51 = voronoi_texture_1i_join(near.z, far.w);
    let far_zw = (vec4<f32>(far.z, _e47, far.w, _e51) * a_9.one);
    let _e57 = voronoi_texture_1i_join(far.z, far.w);
    let both_zw = (vec4(_e57) * a_9.one);
    let _e63 = voronoi_texture_1i_join_each(vec4(far_xy.x), near_zw);
    let _e64 = voronoi_texture_1i_hopeful(s_7, _e63);
    let _e67 = voronoi_texture_1i_join_each(vec4(far_xy.y), near_zw);
    let _e68 = voronoi_texture_1i_hopeful(s_7, _e67);
    let _e74 = voronoi_texture_1i_join_each(vec4(far_xy.z), near_zw);
    let _e75 = voronoi_texture_1i_hopeful(s_7, _e74);
    let _e80 = voronoi_texture_1i_join_each(vec4(far_xy.w), near_zw);
    let _e81 = voronoi_texture_1i_hopeful(s_7, _e80);
    let _e88 = voronoi_texture_1i_join_each(near_xy, vec4(far_zw.x));
    let _e89 = voronoi_texture_1i_hopeful(s_7, _e88);
    let _e94 = voronoi_texture_1i_join_each(near_xy, vec4(far_zw.y));
    let _e95 = voronoi_texture_1i_hopeful(s_7, _e94);
    let _e101 = voronoi_texture_1i_join_each(near_xy, vec4(far_zw.z));
    let _e102 = voronoi_texture_1i_hopeful(s_7, _e101);
    let _e107 = voronoi_texture_1i_join_each(near_xy, vec4(far_zw.w));
    let _e108 = voronoi_texture_1i_hopeful(s_7, _e107);
    list_1 = (((_e64 | (_e68 << 4u)) | ((_e75 << 8u) | (_e81 << 12u))) | (((_e89 << 16u) | (_e95 << 20u)) | ((_e102 << 24u) | (_e108 << 28u))));
    loop {
        let _e117 = list_1;
        let _e118 = near_bits_1;
        let _e119 = far_bits_1;
        voronoi_texture_1i_visit_list(s_7, a_9, _e117, _e118, _e119);
        continuing {
            let _e120 = voronoi_texture_1i_join_each(both_xy, near_zw);
            let _e121 = voronoi_texture_1i_hopeful(s_7, _e120);
            let _e122 = voronoi_texture_1i_join_each(near_xy, both_zw);
            let _e123 = voronoi_texture_1i_hopeful(s_7, _e122);
            let _e129 = voronoi_texture_1i_join_each(far_xy, vec4(far_zw.x));
            let _e130 = voronoi_texture_1i_hopeful(s_7, _e129);
            let _e135 = voronoi_texture_1i_join_each(far_xy, vec4(far_zw.y));
            let _e136 = voronoi_texture_1i_hopeful(s_7, _e135);
            let _e143 = voronoi_texture_1i_join_each(far_xy, vec4(far_zw.z));
            let _e144 = voronoi_texture_1i_hopeful(s_7, _e143);
            let _e149 = voronoi_texture_1i_join_each(far_xy, vec4(far_zw.w));
            let _e150 = voronoi_texture_1i_hopeful(s_7, _e149);
            let _e154 = voronoi_texture_1i_join_each(both_xy, far_zw);
            let _e155 = voronoi_texture_1i_hopeful(s_7, _e154);
            let _e158 = voronoi_texture_1i_join_each(far_xy, both_zw);
            let _e159 = voronoi_texture_1i_hopeful(s_7, _e158);
            list_1 = (((_e121 | (_e123 << 4u)) | ((_e130 << 8u) | (_e136 << 12u))) | (((_e144 << 16u) | (_e150 << 20u)) | ((_e155 << 24u) | (_e159 << 28u))));
            let _e166 = list_1;
            let _e167 = lists;
            list_1 = select(0u, _e166, (_e167 == 1i));
            near_bits_1 = vec4<u32>(2156431520u, 539108032u, 149946378u, 33615884u);
            far_bits_1 = vec4<u32>(1060320015u, 3486305295u, 4076929008u, 4244570352u);
            let _e184 = voronoi_texture_1i_join(both_xy.x, both_zw.x);
            let _e185 = voronoi_texture_1i_beyond(s_7, _e184);
            let _e186 = lists;
            let ends = (_e185 | (_e186 == 3i));
            let _e190 = lists;
            lists = (_e190 + 1i);
            let _e193 = list_1;
            break if ((_e193 == 0u) & ends);
        }
    }
    return;
}

fn voronoi_texture_1i_search(site_1: voronoi_texture_1i_Site, p_7: voronoi_texture_1i_Parameters) -> voronoi_texture_1i_Search {
    var a_10: voronoi_texture_1i_Axes;
    var s_8: voronoi_texture_1i_Search = voronoi_texture_1i_Search(0x1.fffffep+127f, 0f, 0x1.fffffep+127f, 0f);

    let upper = (site_1.local >= vec4(0.5f));
    let rest = (vec4(1f) - site_1.local);
    a_10.local = site_1.local;
    let _e18 = voronoi_texture_1i_keys_of(site_1, vec4(0i));
    a_10.keys = _e18;
    a_10.key_step = (voronoi_texture_1i_KEY_STEP * ((2i * vec4<i32>(upper)) - vec4(1i)));
    a_10.near = select(vec4(-1f), vec4(1f), upper);
    let _e39 = voronoi_texture_1i_bound_terms(select(site_1.local, rest, upper), p_7.exponent);
    a_10.near_bound = _e39;
    let _e44 = voronoi_texture_1i_bound_terms(select(rest, site_1.local, upper), p_7.exponent);
    a_10.far_bound = _e44;
    let _e46 = voronoi_texture_1i_jitter(p_7);
    a_10.jitter = _e46;
    a_10.exponent = p_7.exponent;
    a_10.one = p_7.one;
    let _e51 = a_10;
    voronoi_texture_1i_scan_lists((&s_8), _e51);
    let _e53 = s_8;
    return _e53;
}

fn voronoi_texture_1i_offset_of(rank: f32) -> vec4<i32> {
    let r = u32((rank + 40f));
    return (vec4<i32>(vec4<u32>((r % 3u), ((r / 3u) % 3u), ((r / 9u) % 3u), (r / 27u))) - vec4(1i));
}

fn voronoi_texture_1i_root(measure_2: f32, exponent_2: f32) -> f32 {
    return sqrt(measure_2);
}

fn voronoi_texture_1i_octave_at(site_2: voronoi_texture_1i_Site, o_2: vec4<i32>, distance_: f32, is_found: bool, p_8: voronoi_texture_1i_Parameters) -> voronoi_texture_1i_Octave {
    var octave: voronoi_texture_1i_Octave;

    octave.distance = distance_;
    let _e3 = octave;
    return _e3;
}

fn voronoi_texture_1i_first_feature(x_10: vec4<f32>, p_9: voronoi_texture_1i_Parameters) -> voronoi_texture_1i_Octave {
    let _e1 = voronoi_texture_1i_site_of(x_10);
    let _e3 = voronoi_texture_1i_search(_e1, p_9);
    let is_found_1 = (_e3.nearest < numeric_LARGEST);
    let _e8 = voronoi_texture_1i_offset_of(_e3.nearest_rank);
    let _e11 = voronoi_texture_1i_root(_e3.nearest, p_9.exponent);
    let _e12 = voronoi_texture_1i_octave_at(_e1, _e8, _e11, is_found_1, p_9);
    return _e12;
}

fn voronoi_texture_1i_feature(x_11: vec4<f32>, p_10: voronoi_texture_1i_Parameters) -> voronoi_texture_1i_Octave {
    let _e2 = voronoi_texture_1i_first_feature(x_11, p_10);
    return _e2;
}

fn voronoi_texture_1i_combine(t_2: vec4<f32>, one: f32) -> f32 {
    let _e3 = voronoi_texture_1i_join(t_2.x, t_2.y);
    let _e6 = voronoi_texture_1i_join(t_2.z, t_2.w);
    let _e9 = voronoi_texture_1i_join(_e3, (_e6 * one));
    return _e9;
}

fn voronoi_texture_1i_distance_of(v_2: vec4<f32>, p_11: voronoi_texture_1i_Parameters) -> f32 {
    let _e3 = voronoi_texture_1i_terms(v_2, p_11.exponent);
    let _e5 = voronoi_texture_1i_combine(_e3, p_11.one);
    let _e7 = voronoi_texture_1i_root(_e5, p_11.exponent);
    return _e7;
}

fn voronoi_texture_1i_corner_distance(h: f32, p_12: voronoi_texture_1i_Parameters) -> f32 {
    let _e5 = voronoi_texture_1i_distance_of(vec4<f32>(h, max(h, 0.5f), h, h), p_12);
    return _e5;
}

fn voronoi_texture_1i_unit_distance(p_13: voronoi_texture_1i_Parameters) -> f32 {
    let _e6 = voronoi_texture_1i_corner_distance((0.5f + (0.5f * p_13.randomness)), p_13);
    return _e6;
}

fn voronoi_texture_1i_octave_sum(q: vec4<f32>, f_5: voronoi_texture_1i_Fractal, p_14: voronoi_texture_1i_Parameters) -> voronoi_texture_1i_Octave {
    var sum: voronoi_texture_1i_Octave;
    var weights: f32 = 0f;
    var longer: voronoi_texture_1i_Octave;
    var longer_weights: f32 = 0f;
    var amplitude: f32 = 1f;
    var scale_1: f32 = 1f;
    var i: i32 = 0i;

    let last = select(i32(ceil(f_5.detail)), 0i, (f_5.roughness == 0f));
    loop {
        let _e13 = i;
        if (_e13 < 16i) {
        } else {
            break;
        }
        {
            let _e16 = i;
            if (_e16 > last) {
                break;
            }
            let _e20 = scale_1;
            let _e23 = voronoi_texture_1i_feature((q * _e20), p_14);
            let _e26 = weights;
            let _e27 = amplitude;
            longer_weights = (_e26 + _e27);
            let _e34 = sum.distance;
            let _e36 = amplitude;
            longer.distance = (_e34 + (_e23.distance * _e36));
            let _e39 = i;
            if (f32(_e39) <= f_5.detail) {
                let _e43 = longer_weights;
                weights = _e43;
                let _e44 = longer;
                sum = _e44;
            }
            let _e45 = scale_1;
            scale_1 = (_e45 * f_5.lacunarity);
            let _e48 = amplitude;
            amplitude = (_e48 * f_5.roughness);
        }
        continuing {
            let _e52 = i;
            i = (_e52 + 1i);
        }
    }
    if (f32(last) > f_5.detail) {
        let rest_1 = (f_5.detail - floor(f_5.detail));
        let _e61 = weights;
        let _e62 = longer_weights;
        let _e63 = weights;
        weights = (_e61 + (rest_1 * (_e62 - _e63)));
        let _e69 = sum.distance;
        let _e71 = longer.distance;
        let _e73 = sum.distance;
        sum.distance = (_e69 + (rest_1 * (_e71 - _e73)));
    }
    let _e79 = sum.distance;
    let _e80 = weights;
    let _e81 = voronoi_texture_1i_unit_distance(p_14);
    sum.distance = (_e79 / (_e80 * _e81));
    let _e84 = sum;
    return _e84;
}

fn voronoi_texture_1i_fractal(q_1: vec4<f32>, f_6: voronoi_texture_1i_Fractal, p_15: voronoi_texture_1i_Parameters) -> voronoi_texture_1i_Octave {
    let _e3 = voronoi_texture_1i_octave_sum(q_1, f_6, p_15);
    return _e3;
}

fn voronoi_texture_1i_outputs_of(sum_1: voronoi_texture_1i_Octave, scale_2: f32) -> voronoi_texture_1i_Outputs {
    var outputs_1: voronoi_texture_1i_Outputs;

    outputs_1.distance = sum_1.distance;
    let has_scale = (scale_2 != 0f);
    let inverse = (1f / scale_2);
    let _e9 = outputs_1;
    return _e9;
}

fn voronoi_texture_1i_evaluate(vector_1: vec3<f32>, w_6: f32, scale_3: f32, detail_1: f32, roughness_1: f32, lacunarity_1: f32, randomness: f32) -> voronoi_texture_1i_Outputs {
    var p_16: voronoi_texture_1i_Parameters;

    let q_2 = (vec4<f32>(vector_1, w_6) * scale_3);
    p_16.randomness = clamp(randomness, 0f, 1f);
    let sign_ = select(-1f, 1f, (scale_3 > 0f));
    p_16.one = (sign_ * sign_);
    let f_8 = voronoi_texture_1i_Fractal(clamp(detail_1, 0f, 15f), clamp(roughness_1, 0f, 1f), lacunarity_1);
    let _e28 = p_16;
    let _e29 = voronoi_texture_1i_fractal(q_2, f_8, _e28);
    let _e30 = voronoi_texture_1i_outputs_of(_e29, scale_3);
    return _e30;
}

fn math_2i_finish(x_12: f32) -> f32 {
    return clamp(x_12, 0f, 1f);
}

fn math_2i_evaluate(a_11: f32, b_6: f32) -> f32 {
    let _e3 = math_2i_finish((a_11 + b_6));
    return _e3;
}

fn math_3i_finish(x_13: f32) -> f32 {
    return clamp(x_13, 0f, 1f);
}

fn math_3i_evaluate(a_12: f32, b_7: f32) -> f32 {
    let _e3 = math_3i_finish((a_12 - b_7));
    return _e3;
}

fn map_range_3i_factor(value_6: f32, from_min_6: f32, from_max_6: f32, steps_4: f32) -> f32 {
    return ((value_6 - from_min_6) / (from_max_6 - from_min_6));
}

fn map_range_3i_map(value_7: f32, from_min_7: f32, from_max_7: f32, to_min_4: f32, to_max_4: f32, steps_5: f32) -> f32 {
    let _e4 = map_range_3i_factor(value_7, from_min_7, from_max_7, steps_5);
    let inside_2 = (to_min_4 + (_e4 * (to_max_4 - to_min_4)));
    let result_2 = select(inside_2, 0f, (from_min_7 == from_max_7));
    return clamp(result_2, min(to_min_4, to_max_4), max(to_min_4, to_max_4));
}

fn map_range_3i_evaluate(value_8: f32, from_min_8: f32, from_max_8: f32, to_min_5: f32, to_max_5: f32) -> f32 {
    let _e6 = map_range_3i_map(value_8, from_min_8, from_max_8, to_min_5, to_max_5, 0f);
    return _e6;
}

fn math_4i_finish(x_14: f32) -> f32 {
    return x_14;
}

fn math_4i_evaluate(a_13: f32, b_8: f32) -> f32 {
    let _e3 = math_4i_finish((a_13 * b_8));
    return _e3;
}

fn graph_evaluate(position: vec3<f32>) -> f32 {
    let _e6 = map_range_1i_evaluate(position.z, 0.5f, 0f, 0f, 1f);
    let _e12 = map_range_2i_evaluate(position.z, 0f, 0.1f, 0.8f, 1f);
    let _e19 = noise_texture_1i_evaluate(position, 0f, 2f, 0f, 0f, 0f, 0f);
    let _e21 = math_1i_evaluate(_e12, _e19.fac);
    let _e28 = voronoi_texture_1i_evaluate(position, 0f, 5f, 1f, 0.5f, 3f, 1f);
    let _e34 = map_range_2i_evaluate(_e28.distance, 0f, 0.75f, -0.4f, 1f);
    let _e36 = math_1i_evaluate(_e34, 0.5f);
    let _e37 = math_2i_evaluate(_e21, _e36);
    let _e44 = voronoi_texture_1i_evaluate(position, 0f, 2f, 5f, 0.75f, 2.5f, 1f);
    let _e50 = map_range_2i_evaluate(_e44.distance, 0f, 1f, -0.25f, 1f);
    let _e51 = math_2i_evaluate(_e37, _e50);
    let _e52 = math_3i_evaluate(_e6, _e51);
    let _e54 = math_3i_evaluate(_e52, 0.19999999f);
    let _e60 = map_range_3i_evaluate(position.z, 0f, 0.5f, 0f, 1f);
    let _e62 = math_4i_evaluate(500f, _e60);
    let _e63 = math_4i_evaluate(_e54, _e62);
    return _e63;
}

fn density(position_1: vec3<f32>) -> f32 {
    let _e1 = graph_evaluate(position_1);
    return _e1;
}

@compute @workgroup_size(64, 1, 1) 
fn main(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let index = invocation.x;
    if (index >= arrayLength((&densities))) {
        return;
    }
    let _e11 = points[(3u * index)];
    let _e18 = points[((3u * index) + 1u)];
    let _e25 = points[((3u * index) + 2u)];
    let _e27 = density(vec3<f32>(_e11, _e18, _e25));
    densities[index] = _e27;
    return;
}
