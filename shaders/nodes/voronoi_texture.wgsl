// Voronoi Texture node (ShaderNodeTexVoronoi): distances to one random point per cell, summed over octaves.
// VORONOI_DIMENSIONS_1D (w) to _4D (vector and w); FEATURE_F1, _F2, _SMOOTH_F1, _DISTANCE_TO_EDGE, _N_SPHERE_RADIUS;
// DISTANCE_EUCLIDEAN, _MANHATTAN, _CHEBYCHEV, _MINKOWSKI (2D and up, first three features); NORMALIZE.
// Source: Worley 1996 and Quilez' smooth and edge variants in Blender's form; the point of cell C + o lies, relative to
// C, at o + randomness * hash(C + o), and only the 3^n cells around the own one are searched (5^n for Smooth F1).
// Nothing is hashed that cannot change the result: see "Search". Ties go to the first cell of Blender's scan.
// Domain: finite f32; detail is limited to [0, 15]. Limits: cells from 2^31 on are all the same; above 1 the distance
// may miss a nearer point outside the searched cells, as it does in Blender.
// BEFORE_BLENDER_5: the random numbers of a cell in 2D to 4D are hashed from its corner as floats, as in Blender 4.5.
#import cloudparity::hash::{pcg2_rounds, pcg3_rounds, pcg4_rounds, pcg3, pcg4, hash_float1, hash_float2}
#import cloudparity::hash::{jenkins2, jenkins3, jenkins4, unit_from_bits}
#import cloudparity::hash::{FourHashes, pcg3_rounds_of_four, pcg4_rounds_of_four}
#import cloudparity::hash::{PCG_MULTIPLIER, PCG_INCREMENT, PCG_UNIT}
#import cloudparity::numeric::{exp_of, safe_pow, to_int, LARGEST, SMALLEST_NORMAL}

struct Parameters {
    randomness: f32,
    smoothness: f32,
    exponent: f32,
    // See combine().
    one: f32,
}

// Points and cells have four components in all dimensions: composed modules cannot export an alias of a built-in type.
// Those beyond the dimension stay 0, which costs nothing: compilers fold them away.

// What one octave gives, as far as it is wanted.
struct Octave {
    distance: f32,
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_POSITION
    position: vec4f,
#else ifdef OUTPUT_W
    position: vec4f,
#endif
}

// How much of a cell goes into a smooth minimum that is farther by gap.
fn smooth_weight(gap: f32, p: Parameters) -> f32 {
    let t = 0.5 + (0.5 * gap) / p.smoothness;
    return select(select((3.0 - 2.0 * t) * (t * t), 1.0, t >= 1.0), 0.0, t < 0.0);
}

fn mix_point(a: vec4f, b: vec4f, t: f32) -> vec4f {
    return a + t * (b - a);
}

// ---------------------------------------------------------------------------------------------------------------------
// Metric: the axes' terms, their sum (or maximum) in Blender's order, and the root that makes a distance of it.

#ifndef VORONOI_DIMENSIONS_1D

// C's power of a base from 0 to infinity: with an exponent below 0, 0 becomes infinity and infinity 0.
fn power(base: f32, exponent: f32) -> f32 {
    if exponent < 0.0 && base < SMALLEST_NORMAL {
        return exp_of(LARGEST);
    }
    if base > LARGEST && exponent != 0.0 {
        return select(0.0, base, exponent > 0.0);
    }
    return safe_pow(base, exponent);
}

fn power_each(v: vec4f, exponent: f32) -> vec4f {
    var t = vec4f(power(v.x, exponent), power(v.y, exponent), 0.0, 0.0);
#ifndef VORONOI_DIMENSIONS_2D
    t.z = power(v.z, exponent);
#endif
#ifdef VORONOI_DIMENSIONS_4D
    t.w = power(v.w, exponent);
#endif
    return t;
}

fn terms(v: vec4f, exponent: f32) -> vec4f {
#ifdef FEATURE_DISTANCE_TO_EDGE
    return v * v;
#else ifdef FEATURE_N_SPHERE_RADIUS
    return v * v;
#else ifdef DISTANCE_MANHATTAN
    return abs(v);
#else ifdef DISTANCE_CHEBYCHEV
    return abs(v);
#else ifdef DISTANCE_MINKOWSKI
    return power_each(abs(v), exponent);
#else
    return v * v;
#endif
}

fn join(a: f32, b: f32) -> f32 {
#ifdef FEATURE_DISTANCE_TO_EDGE
    return a + b;
#else ifdef FEATURE_N_SPHERE_RADIUS
    return a + b;
#else ifdef DISTANCE_CHEBYCHEV
    return max(a, b);
#else
    return a + b;
#endif
}

// Compilers may reorder sums, and Mesa's does so with a sum of two sums of products. The factor, 1 when it runs,
// keeps it from that in 4D without cost.
fn combine(t: vec4f, one: f32) -> f32 {
#ifdef VORONOI_DIMENSIONS_2D
    return join(t.x, t.y);
#else ifdef VORONOI_DIMENSIONS_3D
    return join(join(t.x, t.y), t.z);
#else
    return join(join(t.x, t.y), join(t.z, t.w) * one);
#endif
}

fn root(measure: f32, exponent: f32) -> f32 {
#ifdef FEATURE_DISTANCE_TO_EDGE
    return sqrt(measure);
#else ifdef FEATURE_N_SPHERE_RADIUS
    return sqrt(measure);
#else ifdef DISTANCE_MANHATTAN
    return measure;
#else ifdef DISTANCE_CHEBYCHEV
    return measure;
#else ifdef DISTANCE_MINKOWSKI
    return power(measure, 1.0 / exponent);
#else
    return sqrt(measure);
#endif
}

fn distance_of(v: vec4f, p: Parameters) -> f32 {
    return root(combine(terms(v, p.exponent), p.one), p.exponent);
}

// F2 compares distances, the others compare without the root.
fn comparable(measure: f32, exponent: f32) -> f32 {
#ifdef FEATURE_F2
    return root(measure, exponent);
#else
    return measure;
#endif
}

fn squared_length(v: vec4f, p: Parameters) -> f32 {
    return combine(v * v, p.one);
}

// The sum of an inner product's terms, which may be negative.
fn total(t: vec4f) -> f32 {
#ifdef VORONOI_DIMENSIONS_2D
    return t.x + t.y;
#else ifdef VORONOI_DIMENSIONS_3D
    return (t.x + t.y) + t.z;
#else
    return (t.x + t.y) + (t.z + t.w);
#endif
}

// ---------------------------------------------------------------------------------------------------------------------
// Cells

// The cell of x and the place of x in it.
struct Site {
    corner: vec4f,
    local: vec4f,
    cell: vec4i,
}

fn site_of(x: vec4f) -> Site {
    let corner = floor(x);
    let cell = vec4i(to_int(corner.x), to_int(corner.y), to_int(corner.z), to_int(corner.w));
    return Site(corner, x - corner, cell);
}

// The hash of a cell starts from a key per axis: its number after the linear step of the hash, or the bits of its corner.
#ifdef BEFORE_BLENDER_5

const BITS_OF_ONE: u32 = 0x3f800000u;
const BITS_OF_TWO: u32 = 0x40000000u;

// From 2^30 on a corner's neighbours are itself. Below, its number has it without the sign of a zero, which counts in a hash.
fn keys_of(site: Site, o: vec4i) -> vec4i {
    let corner = select(vec4f(site.cell + o), site.corner, abs(site.corner) >= vec4f(1073741824.0));
    return bitcast<vec4i>(corner);
}

fn next_key(key: i32, step: i32) -> i32 {
    return bitcast<i32>(bitcast<f32>(key) + f32(step));
}

// Values in [0, 1] of a cell's hash.
fn rounds(keys: vec4i) -> vec4f {
    let k = bitcast<vec4u>(keys);
#ifdef VORONOI_DIMENSIONS_2D
    return vec4f(unit_from_bits(jenkins2(k.x, k.y)), unit_from_bits(jenkins3(k.x, k.y, BITS_OF_ONE)), 0.0, 0.0);
#else ifdef VORONOI_DIMENSIONS_3D
    return vec4f(
        unit_from_bits(jenkins3(k.x, k.y, k.z)),
        unit_from_bits(jenkins4(k.x, k.y, k.z, BITS_OF_ONE)),
        unit_from_bits(jenkins4(k.x, k.y, k.z, BITS_OF_TWO)),
        0.0
    );
#else
    return vec4f(
        unit_from_bits(jenkins4(k.x, k.y, k.z, k.w)),
        unit_from_bits(jenkins4(k.w, k.x, k.y, k.z)),
        unit_from_bits(jenkins4(k.z, k.w, k.x, k.y)),
        unit_from_bits(jenkins4(k.y, k.z, k.w, k.x))
    );
#endif
}

// What a component of the hash counts.
fn jitter(p: Parameters) -> f32 {
    return p.randomness;
}

// The colour of White Noise Texture at the cell's corner.
fn color_of(site: Site, o: vec4i) -> vec3f {
    let k = bitcast<vec4u>(keys_of(site, o));
#ifdef VORONOI_DIMENSIONS_2D
    return vec3f(rounds(bitcast<vec4i>(k)).xy, unit_from_bits(jenkins3(k.x, k.y, BITS_OF_TWO)));
#else ifdef VORONOI_DIMENSIONS_3D
    return rounds(bitcast<vec4i>(k)).xyz;
#else
    return vec3f(
        unit_from_bits(jenkins4(k.x, k.y, k.z, k.w)),
        unit_from_bits(jenkins4(k.z, k.x, k.w, k.y)),
        unit_from_bits(jenkins4(k.w, k.z, k.y, k.x))
    );
#endif
}

#else

fn keys_of(site: Site, o: vec4i) -> vec4i {
    return (site.cell + o) * PCG_MULTIPLIER + PCG_INCREMENT;
}

fn next_key(key: i32, step: i32) -> i32 {
    return key + step;
}

// Hash of a cell, times 2^31.
fn rounds(linear: vec4i) -> vec4f {
#ifdef VORONOI_DIMENSIONS_2D
    return vec4f(pcg2_rounds(linear.xy), 0.0, 0.0);
#else ifdef VORONOI_DIMENSIONS_3D
    return vec4f(pcg3_rounds(linear.xyz), 0.0);
#else
    return pcg4_rounds(linear);
#endif
}

// Randomness and the scale of the hash in one factor: a power of two commutes with rounding.
fn jitter(p: Parameters) -> f32 {
    return p.randomness * PCG_UNIT;
}

fn color_of(site: Site, o: vec4i) -> vec3f {
    let cell = site.cell + o;
#ifdef VORONOI_DIMENSIONS_2D
    return pcg3(vec3i(cell.xy, 0));
#else ifdef VORONOI_DIMENSIONS_3D
    return pcg3(cell.xyz);
#else
    return pcg4(cell).xyz;
#endif
}

#endif

// The point of cell C + o, relative to C.
fn point_of(site: Site, o: vec4i, p: Parameters) -> vec4f {
    return vec4f(o) + rounds(keys_of(site, o)) * jitter(p);
}

// What next_key() takes for one cell.
#ifdef BEFORE_BLENDER_5
const KEY_STEP: i32 = 1;
#else
const KEY_STEP: i32 = PCG_MULTIPLIER;
#endif

// Blender's scans run over [-1, 1] (Smooth F1: [-2, 2]) in every axis, x fastest; axes beyond the dimension are still.
#ifdef VORONOI_DIMENSIONS_2D
const NEAR: vec4i = vec4i(1, 1, 0, 0);
#else ifdef VORONOI_DIMENSIONS_3D
const NEAR: vec4i = vec4i(1, 1, 1, 0);
#else
const NEAR: vec4i = vec4i(1, 1, 1, 1);
#endif
const WIDE: vec4i = vec4i(2, 2, 2, 2) * NEAR;

// ---------------------------------------------------------------------------------------------------------------------
// Search: the nearest points in the 3^n cells.
//
// Each axis goes from the own cell to the nearer neighbour, then to the farther one, and stops where no point there can
// be near enough. For offset +1 the point's distance along the axis is at least 1 - l, for -1 at least l, also after
// rounding, and the bound is summed in the same order as the measure. Rounding is monotone, so the bound never exceeds
// a measure that it stands for: leaving the cell out is exact, not an approximation. (Where a device fuses the two sums
// differently, the result may differ in its last bit.)

// A cell's rank is its place in Blender's scan: it decides ties, and it names the cell.
struct Search {
    nearest: f32,
    nearest_rank: f32,
    second: f32,
    second_rank: f32,
}

struct Axes {
    local: vec4f,
    // Keys of the own cell, and the step of next_key() towards the near side.
    keys: vec4i,
    key_step: vec4i,
    near: vec4f,
    near_bound: vec4f,
    far_bound: vec4f,
    jitter: f32,
    exponent: f32,
    one: f32,
}

fn rank(o: vec4f) -> f32 {
    return (o.x + 3.0 * o.y) + (9.0 * o.z + 27.0 * o.w);
}

fn offset_of(rank: f32) -> vec4i {
    let r = u32(rank + 40.0);
    return vec4i(vec4u(r % 3u, (r / 3u) % 3u, (r / 9u) % 3u, r / 27u)) - vec4i(1);
}

fn visit_nearest(s: ptr<function, Search>, measure: f32) {
    (*s).nearest = min((*s).nearest, measure);
}

fn visit_ranked(s: ptr<function, Search>, r: f32, measure: f32) {
    let nearer = (measure < (*s).nearest) | ((measure == (*s).nearest) & (r < (*s).nearest_rank));
    (*s).nearest_rank = select((*s).nearest_rank, r, nearer);
    (*s).nearest = min((*s).nearest, measure);
}

fn visit_two(s: ptr<function, Search>, r: f32, measure: f32) {
    let first = (measure < (*s).nearest) | ((measure == (*s).nearest) & (r < (*s).nearest_rank));
    let second = (measure < (*s).second) | ((measure == (*s).second) & (r < (*s).second_rank));
    (*s).second_rank = select(select((*s).second_rank, r, second), (*s).nearest_rank, first);
    (*s).second = select(select((*s).second, measure, second), (*s).nearest, first);
    (*s).nearest_rank = select((*s).nearest_rank, r, first);
    (*s).nearest = min((*s).nearest, measure);
}

fn count(s: ptr<function, Search>, o: vec4f, measure: f32) {
#ifdef FEATURE_F2
    visit_two(s, rank(o), measure);
#else ifdef FEATURE_DISTANCE_TO_EDGE
    visit_ranked(s, rank(o), measure);
#else ifdef FEATURE_N_SPHERE_RADIUS
    visit_ranked(s, rank(o), measure);
#else ifdef OUTPUT_COLOR
    visit_ranked(s, rank(o), measure);
#else ifdef OUTPUT_POSITION
    visit_ranked(s, rank(o), measure);
#else ifdef OUTPUT_W
    visit_ranked(s, rank(o), measure);
#else
    visit_nearest(s, measure);
#endif
}

fn visit(s: ptr<function, Search>, a: Axes, o: vec4f, keys: vec4i) {
    let v = (o + rounds(keys) * a.jitter) - a.local;
    count(s, o, comparable(combine(terms(v, a.exponent), a.one), a.exponent));
}

// Where the cell matters, an equal measure may still win by its rank.
fn beyond(s: ptr<function, Search>, bound: f32) -> bool {
#ifdef FEATURE_F2
    return bound > (*s).second;
#else ifdef FEATURE_DISTANCE_TO_EDGE
    return bound > (*s).nearest;
#else ifdef FEATURE_N_SPHERE_RADIUS
    return bound > (*s).nearest;
#else ifdef OUTPUT_COLOR
    return bound > (*s).nearest;
#else ifdef OUTPUT_POSITION
    return bound > (*s).nearest;
#else ifdef OUTPUT_W
    return bound > (*s).nearest;
#else
    return bound >= (*s).nearest;
#endif
}

fn hopeless(s: ptr<function, Search>, a: Axes, bounds: vec4f) -> bool {
#ifdef FEATURE_F2
#ifdef DISTANCE_MINKOWSKI
    // Powers and their root round within a few ulp, not monotonically, and fall where the exponent is below 0.
    return false;
#endif
#endif
    return beyond(s, comparable(combine(bounds, a.one), a.exponent));
}

// The loops test at their end: the own cell of an axis is never in doubt, and a wave leaves once all its lanes do.
// The innermost axis, x, is written out, and only its farther neighbour is tested. An axis' state is three scalars:
// vectors would be carried around the loops with all their components.
fn scan_y(s: ptr<function, Search>, a: Axes, o: vec4f, keys: vec4i, bounds: vec4f) {
    var o_y = 0.0;
    var key_y = a.keys.y;
    var bound_y = 0.0;
    var place = 0;
    loop {
        visit(s, a, vec4f(0.0, o_y, o.zw), vec4i(a.keys.x, key_y, keys.zw));
        visit(s, a, vec4f(a.near.x, o_y, o.zw), vec4i(next_key(a.keys.x, a.key_step.x), key_y, keys.zw));
        if !hopeless(s, a, vec4f(a.far_bound.x, bound_y, bounds.zw)) {
            visit(s, a, vec4f(-a.near.x, o_y, o.zw), vec4i(next_key(a.keys.x, -a.key_step.x), key_y, keys.zw));
        }
        continuing {
            place += 1;
            o_y = select(-a.near.y, a.near.y, place == 1);
            key_y = next_key(a.keys.y, select(-a.key_step.y, a.key_step.y, place == 1));
            bound_y = select(a.far_bound.y, a.near_bound.y, place == 1);
            break if (place > 2) | hopeless(s, a, vec4f(0.0, bound_y, bounds.zw));
        }
    }
}

#ifdef VORONOI_DIMENSIONS_2D
// Nine cheap hashes cost less than deciding which of them to leave out, unless each needs powers.
fn scan_all(s: ptr<function, Search>, a: Axes) {
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let o = vec4i(x, y, 0, 0);
            visit(s, a, vec4f(o), vec4i(next_key(a.keys.x, x * KEY_STEP), next_key(a.keys.y, y * KEY_STEP), a.keys.zw));
        }
    }
}
#endif

#ifndef VORONOI_DIMENSIONS_2D
fn scan_z(s: ptr<function, Search>, a: Axes, o: vec4f, keys: vec4i, bounds: vec4f) {
    var o_z = 0.0;
    var key_z = a.keys.z;
    var bound_z = 0.0;
    var place = 0;
    loop {
        scan_y(s, a, vec4f(0.0, 0.0, o_z, o.w), vec4i(a.keys.xy, key_z, keys.w), vec4f(0.0, 0.0, bound_z, bounds.w));
        continuing {
            place += 1;
            o_z = select(-a.near.z, a.near.z, place == 1);
            key_z = next_key(a.keys.z, select(-a.key_step.z, a.key_step.z, place == 1));
            bound_z = select(a.far_bound.z, a.near_bound.z, place == 1);
            break if (place > 2) | hopeless(s, a, vec4f(0.0, 0.0, bound_z, bounds.w));
        }
    }
}
#endif

#ifdef VORONOI_DIMENSIONS_4D
fn scan_w(s: ptr<function, Search>, a: Axes) {
    var o_w = 0.0;
    var key_w = a.keys.w;
    var bound_w = 0.0;
    var place = 0;
    loop {
        scan_z(s, a, vec4f(0.0, 0.0, 0.0, o_w), vec4i(a.keys.xyz, key_w), vec4f(0.0, 0.0, 0.0, bound_w));
        continuing {
            place += 1;
            o_w = select(-a.near.w, a.near.w, place == 1);
            key_w = next_key(a.keys.w, select(-a.key_step.w, a.key_step.w, place == 1));
            bound_w = select(a.far_bound.w, a.near_bound.w, place == 1);
            break if (place > 2) | hopeless(s, a, vec4f(0.0, 0.0, 0.0, bound_w));
        }
    }
}
#endif

#ifndef VORONOI_DIMENSIONS_2D
fn scan_rows(s: ptr<function, Search>, a: Axes) {
#ifdef VORONOI_DIMENSIONS_3D
    scan_z(s, a, vec4f(0.0), a.keys, vec4f(0.0));
#else
    scan_w(s, a);
#endif
}
#endif

#ifndef VORONOI_DIMENSIONS_2D
// Lists of cells
//
// A wave takes as many turns of a loop as the lane that needs most, and what one lane lets in all lanes wait for: rows of
// cells that eight lanes need together are some 60 cells in 4D, of which each lane needs 18. So the own cell and the
// nearer neighbours, nearly all of which are needed, are visited without a test, and of the others each lane makes a list,
// a bit for each cell that its bound does not leave out, and goes through its own. Cells are visited four at a time, and
// where a list ends within four, the cell that is far along all axes is visited for the rest: a cell more does not change
// which is nearest. It may be visited twice, which F2 does not bear: its second would be the same cell.

// Four cells, a component of all four in a vector.
struct FourCells {
    x: vec4f,
    y: vec4f,
    z: vec4f,
    w: vec4f,
    key_x: vec4i,
    key_y: vec4i,
    key_z: vec4i,
    key_w: vec4i,
}

fn join_each(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(join(a.x, b.x), join(a.y, b.y), join(a.z, b.z), join(a.w, b.w));
}

fn visit_four(s: ptr<function, Search>, a: Axes, c: FourCells) {
#ifdef VORONOI_DIMENSIONS_3D
    let hash = pcg3_rounds_of_four(c.key_x, c.key_y, c.key_z);
#else
    let hash = pcg4_rounds_of_four(c.key_x, c.key_y, c.key_z, c.key_w);
#endif
    let x = terms((c.x + hash.x * a.jitter) - a.local.x, a.exponent);
    let y = terms((c.y + hash.y * a.jitter) - a.local.y, a.exponent);
    let z = terms((c.z + hash.z * a.jitter) - a.local.z, a.exponent);
#ifdef VORONOI_DIMENSIONS_3D
    let measures = join_each(join_each(x, y), z);
#else
    let w = terms((c.w + hash.w * a.jitter) - a.local.w, a.exponent);
    let measures = join_each(join_each(x, y), join_each(z, w) * a.one);
#endif
    count(s, vec4f(c.x.x, c.y.x, c.z.x, c.w.x), measures.x);
    count(s, vec4f(c.x.y, c.y.y, c.z.y, c.w.y), measures.y);
    count(s, vec4f(c.x.z, c.y.z, c.z.z, c.w.z), measures.z);
    count(s, vec4f(c.x.w, c.y.w, c.z.w, c.w.w), measures.w);
}

// The own cell and the nearer neighbours: four of x and y for each of z and w.
fn visit_near(s: ptr<function, Search>, a: Axes) {
    let near_keys = vec4i(
        next_key(a.keys.x, a.key_step.x),
        next_key(a.keys.y, a.key_step.y),
        next_key(a.keys.z, a.key_step.z),
        next_key(a.keys.w, a.key_step.w)
    );
    var c: FourCells;
    c.x = vec4f(0.0, a.near.x, 0.0, a.near.x);
    c.y = vec4f(0.0, 0.0, a.near.y, a.near.y);
    c.key_x = vec4i(a.keys.x, near_keys.x, a.keys.x, near_keys.x);
    c.key_y = vec4i(a.keys.yy, near_keys.yy);
    c.w = vec4f(0.0);
    c.key_w = vec4i(a.keys.w);
    c.z = vec4f(0.0);
    c.key_z = vec4i(a.keys.z);
    visit_four(s, a, c);
    c.z = vec4f(a.near.z);
    c.key_z = vec4i(near_keys.z);
    visit_four(s, a, c);
#ifdef VORONOI_DIMENSIONS_4D
    c.w = vec4f(a.near.w);
    c.key_w = vec4i(near_keys.w);
    visit_four(s, a, c);
    c.z = vec4f(0.0);
    c.key_z = vec4i(a.keys.z);
    visit_four(s, a, c);
#endif
}

// Keys of four cells along an axis.
fn keys_at(key: i32, step: i32, is_near: vec4<bool>, is_far: vec4<bool>) -> vec4i {
    let near = next_key(key, step);
    let far = next_key(key, -step);
    // GLSL ES selects no integers by a vector.
    return vec4i(
        select(select(key, near, is_near.x), far, is_far.x),
        select(select(key, near, is_near.y), far, is_far.y),
        select(select(key, near, is_near.z), far, is_far.z),
        select(select(key, near, is_near.w), far, is_far.w)
    );
}

// Visits the cells of a list. Per axis, which bits stand for cells on the near side and which for those on the far side. No
// bit at all stands for the cell that is far along all axes.
fn visit_list(s: ptr<function, Search>, a: Axes, list: u32, near_bits: vec4u, far_bits: vec4u) {
    var left = list;
    loop {
        var bits = vec4u(left & (~left + 1u), 0u, 0u, 0u);
        left &= left - 1u;
        bits.y = left & (~left + 1u);
        left &= left - 1u;
        bits.z = left & (~left + 1u);
        left &= left - 1u;
        bits.w = left & (~left + 1u);
        left &= left - 1u;
        var c: FourCells;
        let near_x = (bits & vec4u(near_bits.x)) != vec4u(0u);
        let far_x = (bits & vec4u(~far_bits.x)) == vec4u(0u);
        c.x = select(select(vec4f(0.0), vec4f(a.near.x), near_x), vec4f(-a.near.x), far_x);
        c.key_x = keys_at(a.keys.x, a.key_step.x, near_x, far_x);
        let near_y = (bits & vec4u(near_bits.y)) != vec4u(0u);
        let far_y = (bits & vec4u(~far_bits.y)) == vec4u(0u);
        c.y = select(select(vec4f(0.0), vec4f(a.near.y), near_y), vec4f(-a.near.y), far_y);
        c.key_y = keys_at(a.keys.y, a.key_step.y, near_y, far_y);
        let near_z = (bits & vec4u(near_bits.z)) != vec4u(0u);
        let far_z = (bits & vec4u(~far_bits.z)) == vec4u(0u);
        c.z = select(select(vec4f(0.0), vec4f(a.near.z), near_z), vec4f(-a.near.z), far_z);
        c.key_z = keys_at(a.keys.z, a.key_step.z, near_z, far_z);
        c.w = vec4f(0.0);
        c.key_w = vec4i(a.keys.w);
#ifdef VORONOI_DIMENSIONS_4D
        let near_w = (bits & vec4u(near_bits.w)) != vec4u(0u);
        let far_w = (bits & vec4u(~far_bits.w)) == vec4u(0u);
        c.w = select(select(vec4f(0.0), vec4f(a.near.w), near_w), vec4f(-a.near.w), far_w);
        c.key_w = keys_at(a.keys.w, a.key_step.w, near_w, far_w);
#endif
        visit_four(s, a, c);
        continuing {
            break if left == 0u;
        }
    }
}

// A bit for each of four bounds that leaves no cell out.
fn hopeful(s: ptr<function, Search>, bounds: vec4f) -> u32 {
    return (select(0u, 1u, !beyond(s, bounds.x)) | select(0u, 2u, !beyond(s, bounds.y)))
        | (select(0u, 4u, !beyond(s, bounds.z)) | select(0u, 8u, !beyond(s, bounds.w)));
}

fn scan_lists(s: ptr<function, Search>, a: Axes) {
    visit_near(s, a);
    let near = a.near_bound;
    let far = a.far_bound;
    // Of x and y: neither far (bit 0: x is near, bit 1: y is); one far (x and y own, x and y near, y and x own, y and x near); both.
    let near_xy = vec4f(0.0, near.x, near.y, join(near.x, near.y));
    let far_xy = vec4f(far.x, join(far.x, near.y), far.y, join(near.x, far.y));
    let both_xy = vec4f(join(far.x, far.y));
#ifdef VORONOI_DIMENSIONS_3D
    let list = hopeful(s, far_xy)
        | (hopeful(s, join_each(far_xy, vec4f(near.z))) << 4u)
        | (hopeful(s, join_each(near_xy, vec4f(far.z))) << 8u)
        | (hopeful(s, join_each(far_xy, vec4f(far.z))) << 12u)
        | ((hopeful(s, join_each(both_xy, vec4f(0.0, near.z, far.z, far.z))) & 7u) << 16u);
    let near_bits = vec4u(0x08a88u, 0x02c22u, 0x200f0u, 0u);
    let far_bits = vec4u(0x73033u, 0x7c0ccu, 0x4ff00u, 0u);
    visit_list(s, a, list, near_bits, far_bits);
#else
    // Likewise of z and w, with the factor of combine().
    let near_zw = vec4f(0.0, near.z, near.w, join(near.z, near.w)) * a.one;
    let far_zw = vec4f(far.z, join(far.z, near.w), far.w, join(near.z, far.w)) * a.one;
    let both_zw = vec4f(join(far.z, far.w)) * a.one;
    // Far along one axis.
    var list = ((hopeful(s, join_each(vec4f(far_xy.x), near_zw)) | (hopeful(s, join_each(vec4f(far_xy.y), near_zw)) << 4u))
        | ((hopeful(s, join_each(vec4f(far_xy.z), near_zw)) << 8u) | (hopeful(s, join_each(vec4f(far_xy.w), near_zw)) << 12u)))
        | (((hopeful(s, join_each(near_xy, vec4f(far_zw.x))) << 16u) | (hopeful(s, join_each(near_xy, vec4f(far_zw.y))) << 20u))
        | ((hopeful(s, join_each(near_xy, vec4f(far_zw.z))) << 24u) | (hopeful(s, join_each(near_xy, vec4f(far_zw.w))) << 28u)));
    var near_bits = vec4u(0xaaaaf000u, 0xcccc00f0u, 0xf000aaaau, 0x00f0ccccu);
    var far_bits = vec4u(0x000000ffu, 0x0000ff00u, 0x00ff0000u, 0xff000000u);
    var lists = 1;
    loop {
        visit_list(s, a, list, near_bits, far_bits);
        continuing {
            // Far along two or three axes; then along all four, which no bit stands for. Few waves come so far.
            list = ((hopeful(s, join_each(both_xy, near_zw)) | (hopeful(s, join_each(near_xy, both_zw)) << 4u))
                | ((hopeful(s, join_each(far_xy, vec4f(far_zw.x))) << 8u) | (hopeful(s, join_each(far_xy, vec4f(far_zw.y))) << 12u)))
                | (((hopeful(s, join_each(far_xy, vec4f(far_zw.z))) << 16u) | (hopeful(s, join_each(far_xy, vec4f(far_zw.w))) << 20u))
                | ((hopeful(s, join_each(both_xy, far_zw)) << 24u) | (hopeful(s, join_each(far_xy, both_zw)) << 28u)));
            list = select(0u, list, lists == 1);
            near_bits = vec4u(0x808888a0u, 0x202222c0u, 0x08f0000au, 0x0200f00cu);
            far_bits = vec4u(0x3f33330fu, 0xcfcccc0fu, 0xf300fff0u, 0xfcff00f0u);
            let ends = beyond(s, join(both_xy.x, both_zw.x)) | (lists == 3);
            lists += 1;
            break if (list == 0u) & ends;
        }
    }
#endif
}
#endif

// Lower bounds of the terms at a distance along each axis.
fn bound_terms(axis_distance: vec4f, exponent: f32) -> vec4f {
#ifdef FEATURE_DISTANCE_TO_EDGE
    return terms(axis_distance, exponent);
#else ifdef FEATURE_N_SPHERE_RADIUS
    return terms(axis_distance, exponent);
#else ifdef DISTANCE_MINKOWSKI
    // The power rounds within a few ulp, not monotonically, and with exponents up to 0 it falls with the distance.
#ifdef FEATURE_F2
    return vec4f(0.0);
#else
    return select(vec4f(-1.0), terms(axis_distance, exponent) * 0.999998, vec4f(exponent) > vec4f(0.0));
#endif
#else
    return terms(axis_distance, exponent);
#endif
}

fn search(site: Site, p: Parameters) -> Search {
    let upper = site.local >= vec4f(0.5);
    let rest = vec4f(1.0) - site.local;
    var a: Axes;
    a.local = site.local;
    a.keys = keys_of(site, vec4i(0));
    // GLSL ES selects no integers by a vector.
    a.key_step = KEY_STEP * (2 * vec4i(upper) - 1);
    a.near = select(vec4f(-1.0), vec4f(1.0), upper);
    a.near_bound = bound_terms(select(site.local, rest, upper), p.exponent);
    a.far_bound = bound_terms(select(rest, site.local, upper), p.exponent);
    a.jitter = jitter(p);
    a.exponent = p.exponent;
    a.one = p.one;
    var s = Search(LARGEST, 0.0, LARGEST, 0.0);
#ifdef VORONOI_DIMENSIONS_2D
#ifdef DISTANCE_MINKOWSKI
    scan_y(&s, a, vec4f(0.0), a.keys, vec4f(0.0));
#else
    scan_all(&s, a);
#endif
#else ifdef FEATURE_F2
    scan_rows(&s, a);
#else ifdef DISTANCE_MINKOWSKI
    scan_rows(&s, a);
#else ifdef BEFORE_BLENDER_5
    scan_rows(&s, a);
#else
    scan_lists(&s, a);
#endif
    return s;
}

// ---------------------------------------------------------------------------------------------------------------------
// Features

// Distance, colour and position of the cell at an offset. Where all distances overflow (Exponents of 0 and far below)
// nothing is found, and the point stays at the corner of the own cell.
fn octave_at(site: Site, o: vec4i, distance: f32, is_found: bool, p: Parameters) -> Octave {
    var octave: Octave;
    octave.distance = distance;
#ifdef OUTPUT_COLOR
    octave.color = color_of(site, o);
#endif
#ifdef OUTPUT_POSITION
    octave.position = select(vec4f(0.0), point_of(site, o, p), is_found) + site.corner;
#else ifdef OUTPUT_W
    octave.position = select(vec4f(0.0), point_of(site, o, p), is_found) + site.corner;
#endif
    return octave;
}

fn first_feature(x: vec4f, p: Parameters) -> Octave {
    let site = site_of(x);
    let s = search(site, p);
    let is_found = s.nearest < LARGEST;
#ifdef OUTPUT_DISTANCE
#ifdef DISTANCE_MINKOWSKI
    let own = combine(terms(-site.local, p.exponent), p.one);
    return octave_at(site, offset_of(s.nearest_rank), root(select(own, s.nearest, is_found), p.exponent), is_found, p);
#else
    return octave_at(site, offset_of(s.nearest_rank), root(s.nearest, p.exponent), is_found, p);
#endif
#else
    return octave_at(site, offset_of(s.nearest_rank), 0.0, is_found, p);
#endif
}

fn second_feature(x: vec4f, p: Parameters) -> Octave {
    let site = site_of(x);
    let s = search(site, p);
    return octave_at(site, offset_of(s.second_rank), s.second, s.second < LARGEST, p);
}

// Folds one more cell into a smooth minimum.
fn fold(octave: ptr<function, Octave>, site: Site, o: vec4i, p: Parameters) {
    let point = point_of(site, o, p);
    let d = distance_of(point - site.local, p);
    let h = select(smooth_weight((*octave).distance - d, p), 1.0, all(o == -WIDE));
    let correction = (p.smoothness * h) * (1.0 - h);
    (*octave).distance = (*octave).distance + h * (d - (*octave).distance) - correction;
#ifdef OUTPUT_COLOR
    (*octave).color = (*octave).color + h * (color_of(site, o) - (*octave).color)
        - correction / (1.0 + 3.0 * p.smoothness);
#endif
#ifdef OUTPUT_POSITION
    (*octave).position = mix_point((*octave).position, point, h) - correction / (1.0 + 3.0 * p.smoothness);
#else ifdef OUTPUT_W
    (*octave).position = mix_point((*octave).position, point, h) - correction / (1.0 + 3.0 * p.smoothness);
#endif
}

// The smooth minimum over 5^n cells depends on their order.
fn smooth_feature(x: vec4f, p: Parameters) -> Octave {
    let site = site_of(x);
    var octave: Octave;
    for (var w = -WIDE.w; w <= WIDE.w; w++) {
        for (var z = -WIDE.z; z <= WIDE.z; z++) {
            for (var y = -WIDE.y; y <= WIDE.y; y++) {
                for (var x = -WIDE.x; x <= WIDE.x; x++) {
                    fold(&octave, site, vec4i(x, y, z, w), p);
                }
            }
        }
    }
#ifdef OUTPUT_POSITION
    octave.position += site.corner;
#else ifdef OUTPUT_W
    octave.position += site.corner;
#endif
    return octave;
}

fn unit(v: vec4f, p: Parameters) -> vec4f {
    let l = sqrt(squared_length(v, p));
#ifdef VORONOI_DIMENSIONS_3D
    return vec4f(v.xyz / l, 0.0);
#else
    return v * (1.0 / l);
#endif
}

// The smallest distance to a plane halfway between the nearest point and another one.
fn edge_feature(x: vec4f, p: Parameters) -> f32 {
    let site = site_of(x);
    let nearest = point_of(site, offset_of(search(site, p).nearest_rank), p) - site.local;
    var edge = LARGEST;
    for (var w = -NEAR.w; w <= NEAR.w; w++) {
        for (var z = -NEAR.z; z <= NEAR.z; z++) {
            for (var y = -NEAR.y; y <= NEAR.y; y++) {
                for (var x = -NEAR.x; x <= NEAR.x; x++) {
                    let v = point_of(site, vec4i(x, y, z, w), p) - site.local;
                    let across = v - nearest;
                    // Leaves out the nearest point itself. Masking the terms, not the sum, also keeps the sum's order.
                    let apart = squared_length(across, p) > 0.0001;
                    let along = total(select(vec4f(0.0), ((nearest + v) * 0.5) * unit(across, p), apart));
                    edge = select(edge, min(edge, along), apart);
                }
            }
        }
    }
    return edge;
}

// Half the distance from the nearest point to its own nearest neighbour.
fn sphere_feature(x: vec4f, p: Parameters) -> f32 {
    let site = site_of(x);
    let home = offset_of(search(site, p).nearest_rank);
    let centre = point_of(site, home, p);
    var least = LARGEST;
    for (var w = -NEAR.w; w <= NEAR.w; w++) {
        for (var z = -NEAR.z; z <= NEAR.z; z++) {
            for (var y = -NEAR.y; y <= NEAR.y; y++) {
                for (var x = -NEAR.x; x <= NEAR.x; x++) {
                    let o = vec4i(x, y, z, w);
                    let squared = squared_length(point_of(site, home + o, p) - centre, p);
                    least = select(min(least, squared), least, all(o == vec4i(0)));
                }
            }
        }
    }
    return sqrt(least) * 0.5;
}

// From a corner to the farthest point of a cell, h in [1/2, 1] along each axis. The maximum changes nothing; it keeps
// compilers from making 3 h^2 of the sum of squares, which rounds otherwise.
fn corner_distance(h: f32, p: Parameters) -> f32 {
    return distance_of(vec4f(h, max(h, 0.5), h, h), p);
}

#else

// ---------------------------------------------------------------------------------------------------------------------
// One dimension: the float C + o is hashed, three or five cells in a row.

fn point_of(corner: f32, o: f32, p: Parameters) -> f32 {
    return o + hash_float1(corner + o) * p.randomness;
}

fn color_of(cell: f32) -> vec3f {
    return vec3f(hash_float1(cell), hash_float2(cell, 1.0), hash_float2(cell, 2.0));
}

fn octave_at(corner: f32, o: f32, distance: f32, p: Parameters) -> Octave {
    var octave: Octave;
    octave.distance = distance;
#ifdef OUTPUT_COLOR
    octave.color = color_of(corner + o);
#endif
#ifdef OUTPUT_W
    octave.position.x = point_of(corner, o, p) + corner;
#endif
    return octave;
}

fn first_feature(x: vec4f, p: Parameters) -> Octave {
    let corner = floor(x.x);
    let local = x.x - corner;
    var nearest = LARGEST;
    var offset = 0.0;
    for (var i = 0; i < 3; i++) {
        let o = f32(i - 1);
        let d = abs(point_of(corner, o, p) - local);
        if d < nearest {
            nearest = d;
            offset = o;
        }
    }
    return octave_at(corner, offset, nearest, p);
}

fn second_feature(x: vec4f, p: Parameters) -> Octave {
    let corner = floor(x.x);
    let local = x.x - corner;
    var nearest = LARGEST;
    var nearest_offset = 0.0;
    var second = LARGEST;
    var offset = 0.0;
    for (var i = 0; i < 3; i++) {
        let o = f32(i - 1);
        let d = abs(point_of(corner, o, p) - local);
        if d < nearest {
            second = nearest;
            offset = nearest_offset;
            nearest = d;
            nearest_offset = o;
        } else if d < second {
            second = d;
            offset = o;
        }
    }
    return octave_at(corner, offset, second, p);
}

fn smooth_feature(x: vec4f, p: Parameters) -> Octave {
    let corner = floor(x.x);
    let local = x.x - corner;
    var octave: Octave;
    for (var i = 0; i < 5; i++) {
        let o = f32(i - 2);
        let point = point_of(corner, o, p);
        let d = abs(point - local);
        let h = select(smooth_weight(octave.distance - d, p), 1.0, i == 0);
        let correction = (p.smoothness * h) * (1.0 - h);
        octave.distance = octave.distance + h * (d - octave.distance) - correction;
#ifdef OUTPUT_COLOR
        octave.color = octave.color + h * (color_of(corner + o) - octave.color)
            - correction / (1.0 + 3.0 * p.smoothness);
#endif
#ifdef OUTPUT_W
        let place = vec4f(point, 0.0, 0.0, 0.0);
        octave.position = mix_point(octave.position, place, h) - correction / (1.0 + 3.0 * p.smoothness);
#endif
    }
#ifdef OUTPUT_W
    octave.position.x += corner;
#endif
    return octave;
}

// The own cell hashes C itself, not C + 0: that keeps the sign of a zero.
fn edge_feature(x: vec4f, p: Parameters) -> f32 {
    let corner = floor(x.x);
    let local = x.x - corner;
    let left = point_of(corner, -1.0, p);
    let own = hash_float1(corner) * p.randomness;
    let right = point_of(corner, 1.0, p);
    return min(abs((own + left) * 0.5 - local), abs((own + right) * 0.5 - local));
}

fn sphere_feature(x: vec4f, p: Parameters) -> f32 {
    let corner = floor(x.x);
    let local = x.x - corner;
    var nearest = LARGEST;
    var centre = 0.0;
    var home = 0.0;
    for (var i = 0; i < 3; i++) {
        let o = f32(i - 1);
        let point = point_of(corner, o, p);
        let d = abs(point - local);
        if d < nearest {
            nearest = d;
            centre = point;
            home = o;
        }
    }
    let left = abs(point_of(corner, home - 1.0, p) - centre);
    let right = abs(point_of(corner, home + 1.0, p) - centre);
    return min(left, right) * 0.5;
}

fn corner_distance(h: f32, p: Parameters) -> f32 {
    return h;
}

#endif

// ---------------------------------------------------------------------------------------------------------------------
// Fractal sums

struct Fractal {
    detail: f32,
    roughness: f32,
    lacunarity: f32,
}

fn feature(x: vec4f, p: Parameters) -> Octave {
#ifdef FEATURE_F2
    return second_feature(x, p);
#else ifdef FEATURE_SMOOTH_F1
#ifndef INPUT_SMOOTHNESS_IS_ZERO
    if p.smoothness != 0.0 {
        return smooth_feature(x, p);
    }
#endif
    return first_feature(x, p);
#else
    return first_feature(x, p);
#endif
}

// The largest distance that a sum of weight 1 can have.
fn unit_distance(p: Parameters) -> f32 {
#ifdef FEATURE_F2
    return corner_distance(0.5 + 0.5 * p.randomness, p) * 2.0;
#else
    return corner_distance(0.5 + 0.5 * p.randomness, p);
#endif
}

// Detail 0 and roughness 0 mean one octave with weight 1.
fn single_sum(q: vec4f, p: Parameters) -> Octave {
    var sum = feature(q, p);
#ifdef NORMALIZE
#ifdef OUTPUT_DISTANCE
    sum.distance = sum.distance / unit_distance(p);
#endif
#endif
    return sum;
}

fn octave_sum(q: vec4f, f: Fractal, p: Parameters) -> Octave {
    var sum: Octave;
    var weights = 0.0;
    // The sum with a fractional last octave.
    var longer: Octave;
    var longer_weights = 0.0;
    var amplitude = 1.0;
    var scale = 1.0;
    let last = select(i32(ceil(f.detail)), 0, f.roughness == 0.0);
    for (var i = 0; i < 16; i++) {
        if i > last {
            break;
        }
        let octave = feature(q * scale, p);
        longer_weights = weights + amplitude;
#ifdef OUTPUT_DISTANCE
        longer.distance = sum.distance + octave.distance * amplitude;
#endif
#ifdef OUTPUT_COLOR
        longer.color = sum.color + octave.color * amplitude;
#endif
#ifdef OUTPUT_POSITION
        longer.position = mix_point(sum.position, octave.position * (1.0 / scale), amplitude);
#else ifdef OUTPUT_W
        longer.position = mix_point(sum.position, octave.position * (1.0 / scale), amplitude);
#endif
        if f32(i) <= f.detail {
            weights = longer_weights;
            sum = longer;
        }
        scale *= f.lacunarity;
        amplitude *= f.roughness;
    }
    if f32(last) > f.detail {
        let rest = f.detail - floor(f.detail);
        weights = weights + rest * (longer_weights - weights);
#ifdef OUTPUT_DISTANCE
        sum.distance = sum.distance + rest * (longer.distance - sum.distance);
#endif
#ifdef OUTPUT_COLOR
        sum.color = sum.color + rest * (longer.color - sum.color);
#endif
#ifdef OUTPUT_POSITION
        sum.position = mix_point(sum.position, longer.position, rest);
#else ifdef OUTPUT_W
        sum.position = mix_point(sum.position, longer.position, rest);
#endif
    }
#ifdef NORMALIZE
#ifdef OUTPUT_DISTANCE
    sum.distance = sum.distance / (weights * unit_distance(p));
#endif
#ifdef OUTPUT_COLOR
    sum.color = sum.color * (1.0 / weights);
#endif
#endif
    return sum;
}

fn fractal(q: vec4f, f: Fractal, p: Parameters) -> Octave {
#ifdef INPUT_DETAIL_IS_ZERO
    return single_sum(q, p);
#else ifdef INPUT_ROUGHNESS_IS_ZERO
    return single_sum(q, p);
#else
    return octave_sum(q, f, p);
#endif
}

fn single_edge(q: vec4f, p: Parameters) -> f32 {
#ifdef NORMALIZE
    return edge_feature(q, p) / (0.5 + 0.5 * p.randomness);
#else
    return edge_feature(q, p);
#endif
}

// Edges of octaves do not add: the sum goes towards the smallest of them.
fn octave_edges(q: vec4f, f: Fractal, p: Parameters) -> f32 {
    let unit_edge = 0.5 + 0.5 * p.randomness;
    var edge = 8.0;
    var largest = unit_edge;
    // With a fractional last octave.
    var longer_edge = 8.0;
    var longer_largest = unit_edge;
    var amplitude = 1.0;
    var scale = 1.0;
    let single = f.detail == 0.0 || f.roughness == 0.0;
    let last = select(i32(ceil(f.detail)), 0, single);
    for (var i = 0; i < 16; i++) {
        if i > last {
            break;
        }
        let octave = edge_feature(q * scale, p);
        longer_largest = largest + amplitude * (unit_edge / scale - largest);
        longer_edge = edge + amplitude * (min(edge, octave / scale) - edge);
        if single {
            edge = octave;
        } else if f32(i) <= f.detail {
            largest = longer_largest;
            edge = longer_edge;
        }
        scale *= f.lacunarity;
        amplitude *= f.roughness;
    }
    if f32(last) > f.detail {
        let rest = f.detail - floor(f.detail);
        largest = largest + rest * (longer_largest - largest);
        edge = edge + rest * (min(edge, longer_edge) - edge);
    }
#ifdef NORMALIZE
    return edge / largest;
#else
    return edge;
#endif
}

fn fractal_edge(q: vec4f, f: Fractal, p: Parameters) -> f32 {
#ifdef INPUT_DETAIL_IS_ZERO
    return single_edge(q, p);
#else ifdef INPUT_ROUGHNESS_IS_ZERO
    return single_edge(q, p);
#else
    return octave_edges(q, f, p);
#endif
}

// ---------------------------------------------------------------------------------------------------------------------
// The node

#ifdef FEATURE_DISTANCE_TO_EDGE
#else ifdef FEATURE_N_SPHERE_RADIUS
#else
struct Outputs {
#ifdef OUTPUT_DISTANCE
    distance: f32,
#endif
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_POSITION
    position: vec3f,
#endif
#ifdef OUTPUT_W
    w: f32,
#endif
}

fn outputs_of(sum: Octave, scale: f32) -> Outputs {
    var outputs: Outputs;
#ifdef OUTPUT_DISTANCE
    outputs.distance = sum.distance;
#endif
#ifdef OUTPUT_COLOR
    outputs.color = sum.color;
#endif
    // Without a scale everything is 0, an infinite sum (of octaves without Lacunarity), too.
    let has_scale = scale != 0.0;
    let inverse = 1.0 / scale;
#ifdef OUTPUT_POSITION
#ifdef VORONOI_DIMENSIONS_2D
    outputs.position = vec3f(select(vec2f(0.0), sum.position.xy * inverse, has_scale), 0.0);
#else
    outputs.position = select(vec3f(0.0), sum.position.xyz * inverse, has_scale);
#endif
#endif
#ifdef OUTPUT_W
#ifdef VORONOI_DIMENSIONS_1D
    outputs.w = select(0.0, sum.position.x * inverse, has_scale);
#else
    outputs.w = select(0.0, sum.position.w * inverse, has_scale);
#endif
#endif
    return outputs;
}
#endif

fn evaluate(
#ifdef VORONOI_DIMENSIONS_1D
    w: f32,
#else
    vector: vec3f,
#endif
#ifdef VORONOI_DIMENSIONS_4D
    w: f32,
#endif
    scale: f32,
#ifndef FEATURE_N_SPHERE_RADIUS
    detail: f32,
    roughness: f32,
    lacunarity: f32,
#endif
#ifdef FEATURE_SMOOTH_F1
    smoothness: f32,
#endif
#ifndef VORONOI_DIMENSIONS_1D
#ifdef DISTANCE_MINKOWSKI
#ifndef FEATURE_DISTANCE_TO_EDGE
#ifndef FEATURE_N_SPHERE_RADIUS
    exponent: f32,
#endif
#endif
#endif
#endif
    randomness: f32,
#ifdef FEATURE_DISTANCE_TO_EDGE
) -> f32 {
#else ifdef FEATURE_N_SPHERE_RADIUS
) -> f32 {
#else
) -> Outputs {
#endif
#ifdef VORONOI_DIMENSIONS_1D
    let q = vec4f(w * scale, 0.0, 0.0, 0.0);
#else ifdef VORONOI_DIMENSIONS_2D
    let q = vec4f(vector.xy * scale, 0.0, 0.0);
#else ifdef VORONOI_DIMENSIONS_3D
    let q = vec4f(vector * scale, 0.0);
#else
    let q = vec4f(vector, w) * scale;
#endif
    var p: Parameters;
    p.randomness = clamp(randomness, 0.0, 1.0);
    let sign = select(-1.0, 1.0, scale > 0.0);
    p.one = sign * sign;
#ifdef FEATURE_SMOOTH_F1
    p.smoothness = clamp(smoothness / 2.0, 0.0, 0.5);
#endif
#ifndef VORONOI_DIMENSIONS_1D
#ifdef DISTANCE_MINKOWSKI
#ifndef FEATURE_DISTANCE_TO_EDGE
#ifndef FEATURE_N_SPHERE_RADIUS
    p.exponent = exponent;
#endif
#endif
#endif
#endif
#ifdef FEATURE_N_SPHERE_RADIUS
    return sphere_feature(q, p);
#else
    let f = Fractal(clamp(detail, 0.0, 15.0), clamp(roughness, 0.0, 1.0), lacunarity);
#ifdef FEATURE_DISTANCE_TO_EDGE
    return fractal_edge(q, f, p);
#else
    return outputs_of(fractal(q, f, p), scale);
#endif
#endif
}
