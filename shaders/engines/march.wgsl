// The march of a real-time engine: twin of src/engines/march/mod.rs, one invocation per ray.
//
// Conditions: IN_PICTURE (a part of what makes a whole picture; else a kernel), IN_FRAGMENT (of picture.wgsl, which has all data in a texture), PLAIN (else energy-conserving), EXIT_FADE, SHADOW_TO_EXIT (else of fixed length), SHADOW_VIEW (dimmed as the view
// ray, else by the density), SOURCE_DENSITY (else extinction times albedo), EMPTY_CELLS (the table of what is provably empty is read),
// SHADOW_AT_MOST (but not beyond a length), SHADOW_GROWTH (steps that grow), SHADOW_BY_ANGLE, DRAINE (else Henyey and Greenstein's),
// OWN_PHASE (a gain and a rim), PHASE_TWICE (lobes once more), LEFTOVER_DROPPED and LEFTOVER_RESCALED (what an ended ray has left),
// NO_SUN, SEVERAL_SUNS, SHADOW_MAP (what lies beyond the march is read), SHADOW_LAYERS (a map knows all of it), SHADOW_CASCADES (each part of the view has a map), SHELL (the domain lies between spheres), MESH (in a mesh), else in a box, TERMS (those of a system's own), LIGHT_VOLUME (light that was found
// beforehand), COLUMNS (so was what lies towards the suns), and
// the terms of src/engines/light/terms.rs: OCTAVES (else one), COMPRESSION, SILVER, POWDER, AMBIENT_GRADIENT, RAY_POWDER, BOOST,
// BOOST_BY_ANGLE, BODY, COARSE_SHADOW (both read averages of the density), GROUND (light from below). STEP_GROWTH: steps of the view ray grow. RAY_STEPS: each ray has its own number
// of them. DOUBLED_START: jitter counts twice. Air between the eye and the cloud: AIR, with AIR_HAZE, AIR_LEVEL_HAZE,
// AIR_PERSPECTIVE, AIR_SHAFTS, AIR_RAYS, AIR_RAYS_BY_NUMBER and AIR_ALPHA_TWICE of src/engines/march/air.rs.
#define_import_path cloudparity::march
#import cloudparity::graph
#import cloudparity::averages::along
#import cloudparity::averages::around
#import cloudparity::engines::constants
#import cloudparity::engines::own_terms
#ifdef MESH
#import cloudparity::mesh
#endif
#ifdef LIGHT_VOLUME
#import cloudparity::harmonics
#endif
#import cloudparity::phase
#import cloudparity::rays::{Pixel, Ray}
#import cloudparity::terms
#import cloudparity::transfer
#ifdef AIR
#import cloudparity::air
#endif
#ifdef IN_FRAGMENT
#import cloudparity::engines::data
#import cloudparity::words
#endif

struct March {
    extinction: vec3f,
    steps: u32,
    ambient: vec3f,
    shadow_steps: u32,
    // The box of the density in its frame.
    low: vec3f,
    shadow_length: f32,
    high: vec3f,
    depth_compression: f32,
    albedo: vec3f,
    powder_ambient: f32,
    anisotropy: vec2f,
    second: f32,
    least_density: f32,
    least_transmittance: f32,
    // Rays of this dispatch, and its steps: from `first_step` to before `end_step`.
    count: u32,
    first_step: u32,
    end_step: u32,
    octaves: u32,
    contribution: f32,
    attenuation: f32,
    eccentricity: f32,
    powder_strength: f32,
    powder_length: f32,
    silver_strength: f32,
    silver_exponent: f32,
    ambient_bottom: f32,
    ambient_top: f32,
    body_strength: f32,
    body_length: f32,
    // Radii of a shell.
    inner: f32,
    outer: f32,
    suns: u32,
    phase_gain: f32,
    // Draine's of each lobe.
    alpha: vec2f,
    // Anisotropies of the lobes by which everything is multiplied once more.
    again: vec2f,
    rim: f32,
    // Part of a step towards the sun before the place that is read.
    shadow_sample: f32,
    // Of a growing step over the one before, and the first one as a part of all.
    shadow_growth: f32,
    shadow_first: f32,
    shadow_by_angle: f32,
    boost_light: f32,
    boost_ambient: f32,
    boost_length: f32,
    // Per unit of density, where it is not that of the view ray.
    shadow_extinction: f32,
    // Part of the march towards the sun beyond which a shadow map is asked, and the map's texels along a side.
    map_from: f32,
    map_size: u32,
    // 1 where the cells that may hold something are not known: parameters of the density have changed.
    everywhere: u32,
    // A light volume: place of its first vertex, its first row behind the maps, vertices per length, coefficients of a vertex, vertices, and
    // moments of the phase function by band. Then its columns towards the suns: their first row, vertices per length, and vertices.
    volume_low: vec3f,
    volume_first: u32,
    volume_scale: vec3f,
    volume_coefficients: u32,
    volume_size: vec3f,
    columns_first: u32,
    volume_moments: vec3f,
    volume_last_moment: f32,
    columns_scale: vec3f,
    // Layers of the shadow map, where it has some.
    map_layers: u32,
    columns_size: vec3f,
    // Logarithm of a step of the view ray over the one before.
    step_growth: f32,
}

struct Sun {
    // Displacement in the density's frame per unit of length towards it.
    way: vec3f,
    padding: f32,
    // Unit vector towards it in the world.
    direction: vec3f,
    more_padding: f32,
    irradiance: vec3f,
    end_padding: f32,
}

// Whether each cell of the box may hold something, x fastest: `is_occupied`. Of each sun three rows that give a place's column, row and
// distance below its shadow map, then the map's texels (front depth, density, density times length, tail), and behind those of all suns the
// coefficients of a light volume: `map_row`.
#ifdef IN_FRAGMENT
@group(0) @binding(1) var<uniform> march: March;
@group(0) @binding(3) var<uniform> suns: array<Sun, data::SUNS>;

fn is_occupied(cell: u32) -> bool {
    return march.everywhere != 0u || ((words::word(data::CELLS + cell / 32u) >> (cell % 32u)) & 1u) != 0u;
}

fn map_row(index: u32) -> vec4f {
    let first = data::MAPS + 4u * index;
    return bitcast<vec4f>(vec4u(words::word(first), words::word(first + 1u), words::word(first + 2u), words::word(first + 3u)));
}
#else
@group(0) @binding(0) var<uniform> march: March;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
@group(0) @binding(2) var<storage, read_write> pixels: array<Pixel>;
@group(0) @binding(3) var<storage, read> suns: array<Sun>;
@group(0) @binding(4) var<storage, read> occupied: array<u32>;
// Further gaps in rays: length of the parts before it, and of it and the gaps before it.
@group(0) @binding(5) var<storage, read> gaps: array<vec2f>;

fn is_occupied(cell: u32) -> bool {
    return march.everywhere != 0u || occupied[cell] != 0u;
}

@group(0) @binding(6) var<storage, read> maps: array<vec4f>;

fn map_row(index: u32) -> vec4f {
    return maps[index];
}
#endif

#ifdef SHADOW_CASCADES
// Parts of the view: a place of the density's frame, times `view` and with `view_end` behind it, is its depth as a part of the whole; the ends
// of all but the last.
struct Cascades {
    view: vec3f,
    view_end: f32,
    ends: vec3f,
    count: u32,
}

@group(0) @binding(11) var<uniform> cascades: Cascades;

// Of the ray at work.
var<private> own_jitter: f32;

// The number of the map for a place, of those of a sun; `count` where there is none: twin of `ShadowMap::chosen`.
fn cascade_of(place: vec3f) -> u32 {
    let depth = dot(cascades.view, place) + cascades.view_end;
    var chosen = cascades.count;
    var before = cascades.count;
    var share = 1.0;
    var begin = 0.0;
    for (var number = 0u; number < cascades.count; number++) {
        let is_last = number + 1u == cascades.count;
        var end = 1.0;
        if number < 3u && !is_last { end = cascades.ends[number]; }
        let near = select(end, begin, depth < 0.5 * (begin + end));
        let margin = 0.5 * near * near;
        let from_begin = depth - (begin - 0.5 * margin);
        let to_end = select(end + 0.5 * margin - depth, 3.4e38, is_last);
        if from_begin >= 0.0 && to_end > 0.0 {
            before = chosen;
            chosen = number;
            share = 1.0;
            if margin > 0.0 { share = clamp(min(from_begin, to_end) / margin, 0.0, 1.0); }
        }
        begin = end;
    }
    return select(before, chosen, own_jitter <= share);
}
#endif

#ifdef GROUND
// Light from below: what reaches a place that nothing dims, and a march straight down whose steps double.
struct Ground {
    radiance: vec3f,
    steps: u32,
    // Displacement in the density's frame per unit of length.
    down: vec3f,
    first: f32,
    // Height as a part of the domain's above which there is none.
    highest: f32,
    padding: f32,
    more_padding: f32,
    end_padding: f32,
}

@group(0) @binding(10) var<uniform> ground: Ground;
#endif

#ifdef RAY_STEPS
// The number by which the length of each ray is divided, of which the whole steps are done; of the ray at hand.
@group(0) @binding(12) var<storage, read> ray_steps: array<f32>;
var<private> own_steps: f32;
#endif

#ifdef AIR
// Of each ray the length from the eye to its origin, and the sum of what was taken away times its distance from there.
@group(0) @binding(8) var<storage, read_write> ways: array<vec2f>;
@group(0) @binding(9) var<uniform> between: air::Air;

// Of the ray at work: that sum, and what was taken away.
var<private> taken_distance: f32;
var<private> taken: f32;
#endif

const LARGEST = 3.40282347e38;

#ifdef SHELL
// Where a ray meets a sphere around the origin; both 0 where it misses.
fn sphere(origin: vec3f, way: vec3f, radius: f32) -> vec2f {
    let square = dot(way, way);
    let middle = -dot(origin, way) / square;
    let nearest = length(origin + way * middle);
    let half = (radius - nearest) * (radius + nearest) / square;
    if half <= 0.0 { return vec2f(0.0); }
    return middle + sqrt(half) * vec2f(-1.0, 1.0);
}
#endif

// Length of a ray from a place inside until it leaves the domain.
fn exit(place: vec3f, way: vec3f) -> f32 {
#ifdef SHELL
    let ground = sphere(place, way, march.inner);
    let leave = sphere(place, way, march.outer).y;
    return select(max(leave, 0.0), ground.x, ground.x > 0.0);
#else
    var enter = -LARGEST;
    var leave = LARGEST;
    for (var axis = 0u; axis < 3u; axis++) {
        // A ray that runs in a face is inside.
        if way[axis] == 0.0 {
            if place[axis] >= march.low[axis] && place[axis] <= march.high[axis] { continue; }
            return 0.0;
        }
        let first = (march.low[axis] - place[axis]) / way[axis];
        let second = (march.high[axis] - place[axis]) / way[axis];
        enter = max(enter, min(first, second));
        leave = min(leave, max(first, second));
    }
    return select(0.0, max(leave, 0.0), enter < leave);
#endif
}

// Whether a place is inside; on a face is outside.
fn holds(place: vec3f) -> bool {
#ifdef SHELL
    let radius = length(place);
    return march.inner < radius && radius < march.outer;
#else
    return all(place > march.low) && all(place < march.high);
#endif
}

// The height of a place as a part of the domain's.
fn height_of(place: vec3f) -> f32 {
#ifdef SHELL
    return (length(place) - march.inner) / (march.outer - march.inner);
#else
    return (place.z - march.low.z) / (march.high.z - march.low.z);
#endif
}

// The density, not negative; NaN stays.
fn density_at(place: vec3f) -> f32 {
#ifdef EMPTY_CELLS
    let part = (place - march.low) / (march.high - march.low) * f32(constants::CELLS);
    let cell = min(vec3u(max(part, vec3f(0.0))), vec3u(constants::CELLS - 1u));
    if !is_occupied((cell.z * constants::CELLS + cell.y) * constants::CELLS + cell.x) { return 0.0; }
#endif
    let value = graph::evaluate(place);
    return select(value, 0.0, value < 0.0);
}

// What dims the light: the density, or its average.
fn dimming_at(place: vec3f) -> f32 {
#ifdef COARSE_SHADOW
    return along::evaluate(place);
#else
    return density_at(place);
#endif
}

// Length of the march from a place towards a sun; in a mesh its parts say how far it may go.
fn shadow_length(place: vec3f, way: vec3f) -> f32 {
#ifdef SHADOW_AT_MOST
    return min(exit(place, way), march.shadow_length);
#else ifdef SHADOW_TO_EXIT
    return exit(place, way);
#else
    return march.shadow_length;
#endif
}

#ifdef MESH
// Sum of the densities at the samples towards a sun, and the length that they share; samples lie in the parts of the mesh.
fn sum_in_mesh(place: vec3f, way: vec3f) -> vec2f {
    let ray = mesh::ray_of(place, way);
    let limit = exit(place, way);
#ifdef SHADOW_TO_EXIT
    var length = 0.0;
    var part = mesh::next_part(ray, -mesh::FAR, true, 0.0, limit);
    while part.end > part.begin {
        length += part.end - part.begin;
        if part.cursor >= mesh::FAR { break; }
        part = mesh::next_part(ray, part.cursor, false, part.end, limit);
    }
#ifdef SHADOW_AT_MOST
    length = min(length, march.shadow_length);
#endif
#else
    let length = march.shadow_length;
#endif
    let step = length / f32(march.shadow_steps);
#ifdef SHADOW_GROWTH
    var begin = 0.0;
    var width = march.shadow_first;
#endif
    var sum = 0.0;
    // Length of the parts before.
    var passed = 0.0;
    var number = 0u;
    var next = mesh::next_part(ray, -mesh::FAR, true, 0.0, limit);
    while next.end > next.begin && number < march.shadow_steps {
        loop {
            if number >= march.shadow_steps { break; }
#ifdef SHADOW_GROWTH
            let along_parts = length * (begin + width * march.shadow_sample);
            let weight = width;
#else
            let along_parts = step * (f32(number) + march.shadow_sample);
            let weight = 1.0;
#endif
#ifdef SHADOW_TO_EXIT
            let distance = next.begin + along_parts - passed;
#else
            let distance = along_parts;
#endif
            if distance > next.end { break; }
            if distance >= next.begin { sum += weight * dimming_at(place + way * distance); }
            number++;
#ifdef SHADOW_GROWTH
            begin += width;
            width *= march.shadow_growth;
#endif
        }
        passed += next.end - next.begin;
        if next.cursor >= mesh::FAR { break; }
        next = mesh::next_part(ray, next.cursor, false, next.end, limit);
    }
    return vec2f(sum, length);
}
#endif

#ifdef SHADOW_MAP
// Density times length towards a sun beyond what has been marched of it: twin of src/engines/march/shadow_map.rs.
fn from_map(sun: u32, place: vec3f, marched: f32) -> f32 {
#ifdef SHADOW_CASCADES
    let cascade = cascade_of(place);
    if cascade >= cascades.count { return 0.0; }
    let begin = (sun * cascades.count + cascade) * (3u + march.map_size * march.map_size);
#else
    let begin = sun * (3u + march.map_size * march.map_size);
#endif
    let at_place = vec4f(place, 1.0);
    let column_and_row = vec2f(dot(map_row(begin), at_place), dot(map_row(begin + 1u), at_place));
#ifdef SHADOW_CASCADES
    if any(column_and_row < vec2f(-0.5)) || any(column_and_row > vec2f(f32(march.map_size) - 0.5)) { return 0.0; }
#endif
    let at = clamp(column_and_row, vec2f(0.0), vec2f(f32(march.map_size - 1u)));
    let corner = min(vec2u(at), vec2u(march.map_size - 2u));
    let part = at - vec2f(corner);
    let first = begin + 3u + corner.y * march.map_size + corner.x;
    let second = first + march.map_size;
    let upper = map_row(first) * (1.0 - part.x) + map_row(first + 1u) * part.x;
    let lower = map_row(second) * (1.0 - part.x) + map_row(second + 1u) * part.x;
    let texel = upper * (1.0 - part.y) + lower * part.y;
    let below = dot(map_row(begin + 2u), at_place);
    return min(texel.z + texel.w, texel.y * max(below - marched - texel.x, 0.0));
}
#endif

// A place in a grid: the vertex before it on each axis, and the part of the way to the next.
struct InGrid {
    corner: vec3u,
    part: vec3f,
    size: vec3u,
}

fn in_grid(place: vec3f, scale: vec3f, size: vec3u) -> InGrid {
    return among((place - march.volume_low) * scale, size);
}

// The same of a place whose vertices are those before and behind whole numbers.
fn among(numbers: vec3f, size: vec3u) -> InGrid {
    let last = size - vec3u(1u);
    let at = clamp(numbers, vec3f(0.0), vec3f(last));
    let corner = min(vec3u(at), last - vec3u(1u));
    return InGrid(corner, at - vec3f(corner), size);
}

// One of the eight vertices around a place: its number, and its share.
fn vertex_of(grid: InGrid, number: u32) -> u32 {
    let vertex = grid.corner + vec3u(number & 1u, (number >> 1u) & 1u, number >> 2u);
    return (vertex.z * grid.size.y + vertex.y) * grid.size.x + vertex.x;
}

fn share_of(grid: InGrid, number: u32) -> f32 {
    let shares = select(1.0 - grid.part, grid.part, vec3u(number & 1u, (number >> 1u) & 1u, number >> 2u) == vec3u(1u));
    return shares.x * shares.y * shares.z;
}

// The values around a place, mixed; they lie four in a row, `begin` of them before the grid's.
fn mixed(grid: InGrid, first_row: u32, begin: u32) -> f32 {
    var sum = 0.0;
    for (var number = 0u; number < 8u; number++) {
        let index = begin + vertex_of(grid, number);
        let row = map_row(first_row + index / 4u);
        sum += share_of(grid, number) * row[index % 4u];
    }
    return sum;
}

#ifdef COLUMNS
// Density times length from a place towards a sun: twin of `Columns::read` in src/media/light_volume.rs.
fn column(sun: u32, place: vec3f) -> f32 {
    let grid = in_grid(place, march.columns_scale, vec3u(march.columns_size));
    return mixed(grid, march.columns_first, sun * grid.size.x * grid.size.y * grid.size.z);
}
#endif

#ifdef SHADOW_LAYERS
// The same of a map with layers: twin of `ShadowMap::read_layers` in src/engines/march/shadow_map.rs.
fn from_layers(sun: u32, place: vec3f) -> f32 {
    let size = vec3u(march.map_size, march.map_size, march.map_layers + 1u);
    let begin = sun * (3u + (size.x * size.y * size.z + 3u) / 4u);
    let at_place = vec4f(place, 1.0);
    let numbers = vec3f(dot(map_row(begin), at_place), dot(map_row(begin + 1u), at_place), dot(map_row(begin + 2u), at_place));
    return mixed(among(numbers, size), begin + 3u, 0u);
}
#endif

// Optical depth towards a sun with a number, whose cosine to the view ray is given.
fn shadow_depth(sun: u32, place: vec3f, way: vec3f, cosine: f32) -> vec3f {
#ifdef COLUMNS
    let sum = column(sun, place);
    var step = 1.0;
#else
#ifdef SHADOW_LAYERS
    let sum = from_layers(sun, place);
    var step = 1.0;
#else
#ifdef MESH
    let found = sum_in_mesh(place, way);
    let sum = found.x;
    let length = found.y;
#ifdef SHADOW_GROWTH
    var step = found.y;
#else
    var step = found.y / f32(march.shadow_steps);
#endif
#else
    let length = shadow_length(place, way);
    var sum = 0.0;
#ifdef SHADOW_GROWTH
    // Steps as parts of the length.
    var step = length;
    var begin = 0.0;
    var width = march.shadow_first;
    for (var number = 0u; number < march.shadow_steps; number++) {
        let at = place + way * (length * (begin + width * march.shadow_sample));
        if holds(at) { sum += width * dimming_at(at); }
        begin += width;
        width *= march.shadow_growth;
    }
#else
    var step = length / f32(march.shadow_steps);
    for (var number = 0u; number < march.shadow_steps; number++) {
        let at = place + way * (step * (f32(number) + march.shadow_sample));
        if holds(at) { sum += dimming_at(at); }
    }
#endif
#endif
#endif
#endif
#ifdef SHADOW_BY_ANGLE
    step *= 1.0 - march.shadow_by_angle * cosine;
#endif
    var dense = sum * step;
#ifndef COLUMNS
#ifdef SHADOW_MAP
    dense += from_map(sun, place, length * march.map_from);
#endif
#endif
#ifdef SHADOW_VIEW
    let depth = march.extinction * dense;
#else
    let depth = vec3f(march.shadow_extinction * dense);
#endif
#ifdef COMPRESSION
    return terms::compressed(march.depth_compression, depth);
#else
    return depth;
#endif
}

fn two_lobes(anisotropy: vec2f, direction: vec3f, to_sun: vec3f) -> f32 {
#ifdef DRAINE
    var lobes = vec2f(0.0);
    for (var lobe = 0u; lobe < 2u; lobe++) {
        if march.alpha[lobe] == 0.0 {
            lobes[lobe] = phase::henyey_greenstein(anisotropy[lobe], direction, to_sun);
        } else {
            lobes[lobe] = phase::draine(anisotropy[lobe], march.alpha[lobe], direction, to_sun);
        }
    }
    var sum = lobes.x * (1.0 - march.second) + lobes.y * march.second;
#else
    var sum = phase::henyey_greenstein(anisotropy.x, direction, to_sun) * (1.0 - march.second)
        + phase::henyey_greenstein(anisotropy.y, direction, to_sun) * march.second;
#endif
#ifdef OWN_PHASE
    // The difference of unit vectors gives 1 - |cosine| without a difference of nearly equal numbers.
    let apart = direction - select(to_sun, -to_sun, dot(direction, to_sun) < 0.0);
    let aside = 0.5 * dot(apart, apart);
    sum = march.phase_gain * sum + march.rim * (aside * aside) * (aside * aside);
#endif
#ifdef PHASE_TWICE
    sum *= 12.566371 * (phase::henyey_greenstein(march.again.x, direction, to_sun) * (1.0 - march.second)
        + phase::henyey_greenstein(march.again.y, direction, to_sun) * march.second);
#endif
    return sum;
}

// Prepares the weights of a sun: of its octaves, phase functions included; as many as MOST_OCTAVES.
fn weigh(weights: ptr<function, array<f32, 16>>, direction: vec3f, to_sun: vec3f) {
#ifdef SILVER
    let silver = terms::silver(march.silver_strength, march.silver_exponent, dot(direction, to_sun));
#else
    let silver = 0.0;
#endif
#ifdef OCTAVES
    var share = 1.0;
    var anisotropy = march.anisotropy;
    for (var octave = 0u; octave < march.octaves; octave++) {
        (*weights)[octave] = share * two_lobes(anisotropy, direction, to_sun);
        share *= march.contribution;
        anisotropy *= march.eccentricity;
    }
    (*weights)[0] += silver;
#else
    (*weights)[0] = two_lobes(march.anisotropy, direction, to_sun) + silver;
#endif
}

// What the sun at work sends towards the camera per unit of its irradiance and of scattering.
fn scattered(weights: ptr<function, array<f32, 16>>, depth: vec3f, cosine: f32) -> vec3f {
#ifdef OCTAVES
    let sum = terms::octaves(weights, march.octaves, march.attenuation, depth);
#else
    let sum = (*weights)[0] * transfer::transmittance(depth);
#endif
#ifdef RAY_POWDER
    return terms::ray_powder(sum, depth, cosine);
#else
    return sum;
#endif
}

// What a sun sends towards the camera per unit of scattering, with its weights prepared.
fn from_sun(weights: ptr<function, array<f32, 16>>, number: u32, place: vec3f, direction: vec3f) -> vec3f {
    let cosine = dot(direction, suns[number].direction);
    return suns[number].irradiance * scattered(weights, shadow_depth(number, place, suns[number].way, cosine), cosine);
}

#ifdef SEVERAL_SUNS
// Prepares a ray: the weights of all suns.
fn prepare(weights: ptr<function, array<f32, constants::MOST_SUNS * 16u>>, direction: vec3f) {
    var own: array<f32, 16>;
    for (var sun = 0u; sun < march.suns; sun++) {
        weigh(&own, direction, suns[sun].direction);
        for (var octave = 0u; octave < march.octaves; octave++) { (*weights)[16u * sun + octave] = own[octave]; }
    }
}

// What all suns send towards the camera per unit of scattering.
fn from_suns(weights: ptr<function, array<f32, constants::MOST_SUNS * 16u>>, place: vec3f, direction: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var own: array<f32, 16>;
    for (var sun = 0u; sun < march.suns; sun++) {
        for (var octave = 0u; octave < march.octaves; octave++) { own[octave] = (*weights)[16u * sun + octave]; }
        sum += from_sun(&own, sun, place, direction);
    }
    return sum;
}
#endif

#ifdef LIGHT_VOLUME
// Weights of the coefficients of a light volume for a ray.
fn volume_weights(weights: ptr<function, array<f32, 16>>, direction: vec3f) {
    var own = harmonics::basis(direction);
    var moments = vec4f(march.volume_moments, march.volume_last_moment);
    for (var number = 0u; number < min(march.volume_coefficients, 16u); number++) {
        let band = u32(number >= 1u) + u32(number >= 4u) + u32(number >= 9u);
        (*weights)[number] = moments[band] * own[number];
    }
}

// Radiance of a light volume at a place, under the weights of a ray: twin of src/media/light_volume.rs.
fn from_volume(weights: ptr<function, array<f32, 16>>, place: vec3f) -> vec3f {
    let grid = in_grid(place, march.volume_scale, vec3u(march.volume_size));
    var sum = vec3f(0.0);
    for (var number = 0u; number < 8u; number++) {
        let share = share_of(grid, number);
        let first = march.volume_first + march.volume_coefficients * vertex_of(grid, number);
        for (var one = 0u; one < min(march.volume_coefficients, 16u); one++) {
            sum += (share * (*weights)[one]) * map_row(first + one).xyz;
        }
    }
    return select(sum, vec3f(0.0), sum < vec3f(0.0));
}
#endif

#ifdef STEP_GROWTH
// k^number - 1 for a growth of k: the length of so many first steps over the first one's, times k - 1. By its series for a 2^n-th part of the exponent, doubled n
// times by (1 + y)^2 - 1 = y (y + 2), each within roundings: a device's exp less 1 may be off by 1e-5 of it, which moves samples by metres.
fn grown(number: u32) -> f32 {
    var x = f32(number) * march.step_growth;
    var doublings = 0;
    while x >= 0.05 {
        x *= 0.5;
        doublings++;
    }
    var y = x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x / 24.0)));
    for (; doublings > 0; doublings--) {
        y *= y + 2.0;
    }
    return y;
}
#endif

#ifdef GROUND
// Light from the ground, dimmed by what lies below a place.
fn from_ground(place: vec3f) -> vec3f {
    if height_of(place) > ground.highest { return vec3f(0.0); }
    var sum = 0.0;
    var begin = 0.0;
    var step = ground.first;
    for (var number = 0u; number < ground.steps; number++) {
        let at = place + ground.down * (begin + 0.5 * step);
        if holds(at) { sum += step * density_at(at); }
        begin += step;
        step *= 2.0;
    }
    return ground.radiance * transfer::transmittance(march.extinction * sum);
}
#endif

// What a ray comes to in the steps from `first_step` to before `end_step`, after what it came to before them.
fn marched(ray: Ray, begun: Pixel, first_step: u32, end_step: u32) -> Pixel {
    var pixel = begun;
#ifdef SHADOW_CASCADES
    own_jitter = ray.jitter;
#endif
    // An ended ray is one that is looked at before its first step here.
    let is_done = first_step > 0u && length(pixel.transmittance) < march.least_transmittance;
    if ray.length > 0.0 && !is_done {
#ifdef STEP_GROWTH
        // The first step's over k - 1.
        let first_length = ray.length / grown(march.steps);
        let first_step_length = first_length * grown(1u);
#else ifdef RAY_STEPS
        let step = ray.length / own_steps;
#else
        let step = ray.length / f32(march.steps);
#endif
#ifdef SEVERAL_SUNS
        var weights: array<f32, constants::MOST_SUNS * 16u>;
        prepare(&weights, ray.direction);
#else ifdef NO_SUN
#else
        var weights: array<f32, 16>;
        weigh(&weights, ray.direction, suns[0].direction);
#endif
#ifdef LIGHT_VOLUME
        var of_volume: array<f32, 16>;
        volume_weights(&of_volume, ray.direction);
#endif
#ifdef RAY_STEPS
        for (var number = first_step; number < min(u32(own_steps), end_step); number++) {
#else
        for (var number = first_step; number < min(march.steps, end_step); number++) {
#endif
#ifdef STEP_GROWTH
            let gained = grown(number);
            let begin = first_length * gained;
            let step = first_step_length * (gained + 1.0);
#ifdef DOUBLED_START
            let passed = begin + 2.0 * ray.jitter * step;
#else
            let passed = begin + ray.jitter * step;
#endif
#else ifdef DOUBLED_START
            let passed = (f32(number) + 2.0 * ray.jitter) * step;
#else
            let passed = (f32(number) + ray.jitter) * step;
#endif
            let left = ray.length - passed;
            var distance = select(passed, passed + ray.gap, passed > ray.first);
#ifdef MESH
            for (var further = ray.further; further < ray.further_end; further++) {
                if passed > gaps[further].x { distance = passed + gaps[further].y; }
            }
#endif
#ifdef DOUBLED_START
            // By number, and without one at the very end: twin of `Way::reach`.
            if distance > ray.farthest || f32(number) + 2.0 * ray.jitter >= f32(march.steps) { break; }
#else
            if distance > ray.farthest || left < 0.0 { break; }
#endif
            pixel.samples++;
            let place = ray.origin + ray.way * distance;
            let found = density_at(place);
            if found <= march.least_density { continue; }
            pixel.dense++;
            let extinct = found * march.extinction;
            let mean_extinction = (extinct.x + extinct.y + extinct.z) / 3.0;
#ifdef SOURCE_DENSITY
            let factor = vec3f(found);
#else
            let factor = march.albedo * extinct;
#endif
#ifdef AMBIENT_GRADIENT
            var from_world = march.ambient * mix(march.ambient_bottom, march.ambient_top, height_of(place));
#else
            var from_world = march.ambient;
#endif
#ifdef SEVERAL_SUNS
            var lit = from_suns(&weights, place, ray.direction);
#else ifdef NO_SUN
            var lit = vec3f(0.0);
#else
            var lit = from_sun(&weights, 0u, place, ray.direction);
#endif
#ifdef GROUND
            from_world += from_ground(place);
#endif
#ifdef POWDER
            let powder = terms::powder(march.powder_strength, march.powder_length, mean_extinction);
            lit *= powder;
            from_world *= 1.0 + (powder - 1.0) * march.powder_ambient;
#endif
#ifdef BODY
            let body = around::evaluate(place) * (march.extinction.x + march.extinction.y + march.extinction.z) / 3.0;
            lit *= terms::powder(march.body_strength, march.body_length, body);
#endif
#ifdef LIGHT_VOLUME
            from_world += from_volume(&of_volume, place);
#endif
#ifdef TERMS
            from_world += own_terms::source(place, height_of(place), mean_extinction);
#endif
            var all = lit + from_world;
#ifdef BOOST
            let gathered = transfer::absorbed(vec3f(march.boost_length * mean_extinction)).x;
#ifdef BOOST_BY_ANGLE
#ifdef NO_SUN
            let turned = 0.5;
#else
            let towards = dot(ray.direction, suns[0].direction);
            let turned = 0.5 * (1.0 + towards * towards);
#endif
#else
            let turned = 1.0;
#endif
            all = all * (1.0 + march.boost_light * gathered) + march.ambient * (march.boost_ambient * gathered * turned);
#endif
            var source = factor * all;
#ifdef EXIT_FADE
            let t = clamp(left / (2.0 * step), 0.0, 1.0);
            source *= t * t * (3.0 - 2.0 * t);
#endif
#ifdef PLAIN
            let weight = vec3f(step);
#else
            let weight = transfer::mean_transmittance(extinct * step) * step;
#endif
            pixel.radiance += pixel.transmittance * source * weight;
#ifdef AIR
            taken_distance += dot(pixel.transmittance, transfer::absorbed(extinct * step)) * distance;
#endif
            pixel.transmittance *= transfer::transmittance(extinct * step);
            if length(pixel.transmittance) < march.least_transmittance { break; }
        }
    }
#ifdef AIR
    taken = 3.0 - (pixel.transmittance.x + pixel.transmittance.y + pixel.transmittance.z);
#endif
#ifdef LEFTOVER_DROPPED
    // Once, in the ray's last dispatch.
    if end_step >= march.steps && length(pixel.transmittance) < march.least_transmittance { pixel.transmittance = vec3f(0.0); }
#else ifdef LEFTOVER_RESCALED
    // Once, in the ray's last dispatch.
    if end_step >= march.steps {
        let least = march.least_transmittance * inverseSqrt(3.0);
        let scaled = (pixel.transmittance - least) / (1.0 - least);
        pixel.transmittance = select(scaled, vec3f(0.0), scaled < vec3f(0.0));
    }
#endif
    return pixel;
}

#ifdef AIR
#ifdef AIR_SHAFTS
// Density times length from a place towards a sun, of its map alone; 0 beside it: twin of `ShadowMap::read_below`.
fn below_map(sun: u32, place: vec3f) -> f32 {
#ifdef SHADOW_CASCADES
    return from_map(sun, place, 0.0);
#else
#ifdef SHADOW_LAYERS
    let size = march.map_size;
    let begin = sun * (3u + (size * size * (march.map_layers + 1u) + 3u) / 4u);
#else
    let begin = sun * (3u + march.map_size * march.map_size);
#endif
    let at_place = vec4f(place, 1.0);
    let at = vec2f(dot(map_row(begin), at_place), dot(map_row(begin + 1u), at_place));
    if any(at < vec2f(-0.5)) || any(at > vec2f(f32(march.map_size) - 0.5)) { return 0.0; }
#ifdef SHADOW_LAYERS
    return from_layers(sun, place);
#else
    return from_map(sun, place, 0.0);
#endif
#endif
}

// Metres of a ray up to `end` that lie in the shadow of the cloud from a sun.
fn in_shadow(sun: u32, eye: vec3f, ray: Ray, line: air::Line, end: f32) -> f32 {
    let extinction = (march.extinction.x + march.extinction.y + march.extinction.z) / 3.0;
    var begin = 0.0;
    if line.height > between.top {
        if line.rise >= 0.0 { return 0.0; }
        begin = (line.height - between.top) / -line.rise;
    }
    var step = 50.0;
    var weight = 1.0;
    var sum = 0.0;
    for (var number = 0u; number < 500u; number++) {
        if begin >= end { break; }
        let whole = min(step, end - begin);
        let place = eye + ray.way * ((begin + ray.jitter * whole) / between.metres);
        sum += weight * whole * transfer::absorbed(vec3f(extinction * below_map(sun, place))).x;
        begin += step;
        step *= 1.01;
        weight *= between.shaft_fade;
    }
    return between.shaft_strength * sum;
}
#endif

#ifdef AIR_RAYS
// God rays in the march: some of their samples.
fn march_rays(ray: Ray, start: f32, first: u32, end: u32) -> vec3f {
#ifdef SHADOW_CASCADES
    own_jitter = ray.jitter;
#endif
    let eye = ray.origin - ray.way * start;
    let farthest = ray.farthest + start;
    let length = min(farthest * between.metres, between.ray_length);
    // Published samples that one stands for.
    let share = length / between.ray_length;
    var sum = vec3f(0.0);
    for (var number = first; number < min(end, between.ray_samples); number++) {
        let part = (f32(number) + ray.jitter) / f32(between.ray_samples);
        let place = eye + ray.way * (part * length / between.metres);
        let fog = exp(-max(air::height_of(between, place.z), 0.0) / air::HAZE_HEIGHT);
#ifdef AIR_RAYS_BY_NUMBER
        let weight = fog * pow(between.ray_decay, f32(number));
#else
        let weight = fog * share * between.ray_weight * pow(between.ray_decay, share * f32(number));
#endif
        for (var sun = 0u; sun < march.suns; sun++) {
#ifdef AIR_RAYS_BY_NUMBER
            var through = vec3f(1.0);
            if holds(place) { through -= 0.5 * density_at(place); }
#else
            let way = suns[sun].way;
            let entered = towards_light(place, way);
            var through = vec3f(1.0);
            if entered.w > 0.0 {
                through = transfer::transmittance(shadow_depth(sun, entered.xyz, way, dot(ray.direction, suns[sun].direction)));
            }
#endif
            sum += weight * suns[sun].irradiance * through;
        }
    }
    return between.ray_strength * sum;
}

// Where the way from a place towards a sun enters the box, and 1; 0 where it passes beside: twin of `entered`.
fn towards_light(place: vec3f, way: vec3f) -> vec4f {
    var enter = 0.0;
    var leave = LARGEST;
    for (var axis = 0u; axis < 3u; axis++) {
        if way[axis] == 0.0 {
            if place[axis] < march.low[axis] || place[axis] > march.high[axis] { return vec4f(place, 0.0); }
            continue;
        }
        let first = (march.low[axis] - place[axis]) / way[axis];
        let second = (march.high[axis] - place[axis]) / way[axis];
        enter = max(enter, min(first, second));
        leave = min(leave, max(first, second));
    }
    return vec4f(place + way * enter, select(0.0, 1.0, enter < leave));
}
#endif

// Air over what a ray came to, which began so far behind the eye.
fn through_air(ray: Ray, start: f32, found: Pixel) -> Pixel {
    var pixel = found;
    let eye = ray.origin - ray.way * start;
    let farthest = ray.farthest + start;
#ifdef AIR_ALPHA_TWICE
    pixel.radiance *= 1.0 - pixel.transmittance;
#endif
    let line = air::line_of(between, eye.z, ray.way.z, farthest);
    let opacity = 1.0 - (pixel.transmittance.x + pixel.transmittance.y + pixel.transmittance.z) / 3.0;
    let has_front = taken > 0.0;
    var front = LARGEST;
    if has_front { front = (start + taken_distance / taken) * between.metres; }
    let dark = air::seen(air::end_of(line, between.top), front, opacity);
#ifdef AIR_LEVEL_HAZE
    let end = dark;
#else
    let end = air::seen(air::end_of(line, LARGEST), front, opacity);
#endif
    var of_air = vec3f(0.0);
    var of_haze = vec3f(0.0);
    let haze_depth = air::haze_depth(between, line, end);
    for (var sun = 0u; sun < max(march.suns, 1u); sun++) {
        let direct = suns[sun].irradiance;
        let to_sun = suns[sun].direction;
        let world = select(vec3f(0.0), march.ambient, sun == 0u);
#ifdef AIR_SHAFTS
        let shadow = in_shadow(sun, eye, ray, line, dark);
#else
        let shadow = 0.0;
#endif
#ifdef AIR_PERSPECTIVE
        if has_front {
            let rayleigh = direct * air::rayleigh_phase(ray.direction, to_sun) + world;
            let mie = direct * air::mie_phase(ray.direction, to_sun) + world;
            of_air += air::air_light(between.aerial, line, max(front - shadow, 0.0), rayleigh, mie);
        }
#endif
#ifdef AIR_HAZE
        let lit = transfer::absorbed(vec3f(max(haze_depth - air::haze_depth(between, line, min(shadow, end)), 0.0)));
        let source = direct * two_lobes(march.anisotropy, ray.direction, to_sun) + air::HAZE_AMBIENT * world;
        of_haze += between.haze_albedo * source * lit;
#endif
    }
#ifdef AIR_PERSPECTIVE
    if has_front {
        pixel.radiance *= transfer::transmittance(air::air_depth(between.aerial, line, front));
        pixel.radiance += (1.0 - pixel.transmittance) * of_air;
    }
#endif
#ifdef AIR_HAZE
    let left = exp(-haze_depth);
    pixel.radiance = pixel.radiance * left + of_haze;
    pixel.transmittance *= left;
#endif
    return pixel;
}
#endif

#ifndef IN_PICTURE
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= march.count { return; }
    let index = invocation.x;
#ifdef RAY_STEPS
    own_steps = ray_steps[index];
#endif
    var pixel = Pixel(vec3f(0.0), 0u, vec3f(1.0), 0u);
    if march.first_step > 0u { pixel = pixels[index]; }
#ifdef AIR
#ifdef AIR_RAYS
    // Dispatches behind those of the march have the samples of its rays.
    if march.first_step >= march.steps {
        pixel.radiance += march_rays(rays[index], ways[index].x, march.first_step - march.steps, march.end_step - march.steps);
        pixels[index] = pixel;
        return;
    }
#endif
    taken_distance = ways[index].y;
    pixel = marched(rays[index], pixel, march.first_step, march.end_step);
    // Once, in the ray's last dispatch.
    if march.end_step >= march.steps { pixel = through_air(rays[index], ways[index].x, pixel); }
    ways[index].y = taken_distance;
    pixels[index] = pixel;
#else
    pixels[index] = marched(rays[index], pixel, march.first_step, march.end_step);
#endif
}
#endif
