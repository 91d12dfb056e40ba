// Path tracing without bias, the samples of one pixel per invocation: twin of src/integrators/path/tracer.rs, whose
// head gives the estimators. Camera rays arrive finished (where they enter the medium, how far it goes), so the camera
// has no second implementation. A dispatch ends after `budget` tentative collisions; the state is kept between dispatches.
//
// Conditions: MESH (the medium ends with a mesh, else with its box), WORLD (nodes say what the world sends, else it is
// constant).
//
// Majorants are a tree in flat arrays (src/media/majorant.rs). Lengths along a ray count from where the ray
// enters the medium; places in the tree count cells of its finest level.

#import cloudparity::graph
#ifdef MESH
#import cloudparity::mesh
#endif
#import cloudparity::numeric
#import cloudparity::path::constants
#import cloudparity::phase
#import cloudparity::transfer
#ifdef WORLD
#import cloudparity::surroundings
#endif

const CAMERA: u32 = 0u;
const SHADOW: u32 = 1u;
const BOUNCE: u32 = 2u;
const LAST: u32 = 3u;

// Cells of the finest level along a side.

// Stands for infinity, which WGSL does not promise.
const FAR: f32 = 3e38;
const PI: f32 = 3.1415927;

struct Stage {
    scattering: vec3f,
    anisotropy: f32,
    extinction: vec3f,
    events: u32,
    share: vec3f,
    lights: u32,
    emission: vec3f,
    scatters: u32,
    world: vec3f,
    transparent: u32,
    low: vec3f,
    pixels: u32,
    cells_per_metre: vec3f,
    samples: u32,
    cell: vec3f,
    budget: u32,
    to_object: array<vec4f, 3>,
    first_pixel: u32,
    first_sample: u32,
    seed: u32,
    table: u32,
    // Cells of the finest level along each side of the medium's box; the tree's may have more.
    inside: vec3u,
    end_padding: u32,
}

// Where a camera ray enters the medium, and how much of it lies before the ray; 0: it misses.
struct Ray {
    origin: vec3f,
    length: f32,
    direction: vec3f,
    padding: f32,
}

struct Light {
    // Unit vector towards a sun, or the place of a point.
    place: vec3f,
    // A sun without extent is 0, one with extent SUN_DISC; then POINT and SPOT.
    kind: u32,
    axis: vec3f,
    edge: f32,
    // Irradiance, radiance or intensity.
    power: vec3f,
    blend: f32,
    // Sun: one minus the cosine of its half angle.
    opening: f32,
    strength: f32,
    padding: vec2f,
}

struct Path {
    origin: vec3f,
    stage: u32,
    direction: vec3f,
    sample: u32,
    walk_origin: vec3f,
    distance: f32,
    walk_direction: vec3f,
    end: f32,
    cell: vec3i,
    flight: f32,
    // What arrives at the end of the ray counts `carried * weight`.
    carried: vec3f,
    rate: f32,
    weight: vec3f,
    control: f32,
    analog: vec3f,
    majorant: f32,
    kept: vec3f,
    kept_distance: f32,
    throughput: vec3f,
    total: f32,
    vertex: vec3f,
    kept_mean: f32,
    next: vec3f,
    reference: f32,
    hit: vec3f,
    // Negative: the sampled ray hits no light.
    hit_distance: f32,
    radiance: vec3f,
    scatterings: u32,
    drawn: u32,
    scattered: u32,
    // In a mesh: where the search for the next part goes on, and where the box around it ends.
    cursor: f32,
    reach: f32,
}

struct Outcome {
    // Sums over the samples.
    radiance: vec3f,
    opacity: f32,
    collisions: u32,
    scatterings: u32,
    null_collisions: f32,
    finished: u32,
    // Where an extinction was above its majorant, and what it was; the last is the majorant, 0 if all is well.
    place: vec3f,
    extinction: f32,
    majorant: f32,
    padding: vec3u,
}

@group(0) @binding(0) var<uniform> stage: Stage;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
// The table over cells of TABLE_LEVEL, then per node the first of its children with the level in the upper four bits.
@group(0) @binding(2) var<storage, read> tree: array<u32>;
// Per node: control, residual rate, rate of events, majorant; a majorant that is a cap, not a bound, has a minus sign.
@group(0) @binding(3) var<storage, read> rates: array<vec4f>;
@group(0) @binding(4) var<storage, read> lights: array<Light>;
@group(0) @binding(5) var<storage, read_write> paths: array<Path>;
@group(0) @binding(6) var<storage, read_write> outcomes: array<Outcome>;

var<private> path: Path;
var<private> outcome: Outcome;
var<private> pixel: u32;
var<private> slot: u32;
var<private> numbers: vec4f;

struct Crossing {
    // As in `rates`.
    rates: vec4f,
    exit: f32,
    axis: u32,
    base: vec3i,
    span: i32,
}

// ---------------------------------------------------------------------------------------------------------------------
// Random numbers: pcg4d (Jarzynski and Olano 2020) of pixel, sample, seed and counter

fn next4() -> vec4f {
    path.drawn += 1u;
    var v = vec4u(pixel, stage.first_sample + path.sample, stage.seed, path.drawn) * 1664525u + 1013904223u;
    v = mix_words(v);
    v ^= v >> vec4u(16u);
    v = mix_words(v);
    // 24 bits are what f32 holds below 1.
    return vec4f(v >> vec4u(8u)) * (1.0 / 16777216.0);
}

fn mix_words(words: vec4u) -> vec4u {
    var v = words;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

// ---------------------------------------------------------------------------------------------------------------------
// The walk through the majorants

fn enter(origin: vec3f, direction: vec3f, limit: f32) {
    let local = vec3f(
        dot(stage.to_object[0], vec4f(origin, 1.0)),
        dot(stage.to_object[1], vec4f(origin, 1.0)),
        dot(stage.to_object[2], vec4f(origin, 1.0)),
    );
    let way = vec3f(
        dot(stage.to_object[0].xyz, direction),
        dot(stage.to_object[1].xyz, direction),
        dot(stage.to_object[2].xyz, direction),
    );
    path.origin = origin;
    path.direction = direction;
    path.walk_origin = (local - stage.low) * stage.cells_per_metre;
    path.walk_direction = way * stage.cells_per_metre;
    path.distance = 0.0;
    path.cell = clamp(vec3i(path.walk_origin), vec3i(0), vec3i(stage.inside) - 1);
    var end = limit;
    for (var axis = 0u; axis < 3u; axis++) {
        let slope = path.walk_direction[axis];
        if slope != 0.0 {
            let face = select(0.0, f32(stage.inside[axis]), slope > 0.0);
            end = min(end, (face - path.walk_origin[axis]) / slope);
        }
    }
    // A ray that moves in no direction crosses nothing.
    path.end = select(end, 0.0, all(path.walk_direction == vec3f(0.0)));
#ifdef MESH
    path.reach = path.end;
    path.cursor = -FAR;
    // The walk looks for the first part as for all others, in one place: compilers put functions where they are called.
    path.end = 0.0;
#endif
}

#ifdef MESH
// Goes on with the next part of the ray in the mesh; false where there is none.
fn next_part() -> bool {
    if path.cursor >= FAR || path.reach <= 0.0 { return false; }
    let ray = mesh::ray_of(path.walk_origin, path.walk_direction);
    // Events lie inside, and camera rays arrive where they enter.
    let part = mesh::next_part(ray, path.cursor, path.cursor == -FAR, path.distance, path.reach);
    path.cursor = part.cursor;
    if part.end < part.begin { return false; }
    path.distance = part.begin;
    path.end = part.end;
    path.cell = clamp(vec3i(path.walk_origin + path.walk_direction * part.begin), vec3i(0), vec3i(stage.inside) - 1);
    return true;
}
#endif

// Goes no further along the ray.
fn stop() {
    path.distance = path.end;
#ifdef MESH
    path.cursor = FAR;
#endif
}

fn crossing() -> Crossing {
    let coarse = vec3u(path.cell >> vec3u(constants::LEVELS - constants::TABLE_LEVEL));
    var node = tree[((coarse.z << constants::TABLE_LEVEL) | coarse.y) << constants::TABLE_LEVEL | coarse.x];
    var entry = tree[stage.table + node];
    while (entry & 0x0fffffffu) != 0u {
        let bit = vec3u(constants::LEVELS - (entry >> 28u) - 1u);
        let upper = vec3u(path.cell >> bit) & vec3u(1u);
        node = (entry & 0x0fffffffu) + (upper.x | (upper.y << 1u) | (upper.z << 2u));
        entry = tree[stage.table + node];
    }
    var found: Crossing;
    found.rates = rates[node];
    found.span = i32(1u << (constants::LEVELS - (entry >> 28u)));
    found.base = path.cell & vec3i(~(found.span - 1));
    found.exit = path.end;
    found.axis = 3u;
    for (var axis = 0u; axis < 3u; axis++) {
        let slope = path.walk_direction[axis];
        if slope != 0.0 {
            let face = select(found.base[axis], found.base[axis] + found.span, slope > 0.0);
            let exit = (f32(face) - path.walk_origin[axis]) / slope;
            if exit < found.exit {
                found.exit = exit;
                found.axis = axis;
            }
        }
    }
    // Rounding may put the exit before the place where the ray is.
    found.exit = max(found.exit, path.distance);
    return found;
}

// Goes to the end of a leaf; false where the ray ends.
fn cross_leaf(leaf: Crossing) -> bool {
    path.distance = leaf.exit;
    if leaf.axis == 3u || leaf.exit >= path.end { return false; }
    let place = vec3i(path.walk_origin + path.walk_direction * leaf.exit);
    var cell = clamp(place, leaf.base, leaf.base + vec3i(leaf.span - 1));
    let rising = path.walk_direction[leaf.axis] > 0.0;
    cell[leaf.axis] = select(leaf.base[leaf.axis] - 1, leaf.base[leaf.axis] + leaf.span, rising);
    path.cell = cell;
    return cell[leaf.axis] >= 0 && cell[leaf.axis] < i32(stage.inside[leaf.axis]);
}

fn position() -> vec3f {
    return stage.low + (path.walk_origin + path.walk_direction * path.distance) * stage.cell;
}

// ---------------------------------------------------------------------------------------------------------------------
// Along a ray

// To the next tentative collision; false at the end of the ray.
fn travel() -> bool {
    // -ln(1 - number), of which numeric keeps the relative accuracy.
    var remaining = -numeric::log_of(1.0 - path.flight);
    loop {
        while path.distance < path.end {
            let leaf = crossing();
            var control = leaf.rates.x;
            var rate = leaf.rates.y;
            if path.stage == BOUNCE {
                control = 0.0;
                rate = leaf.rates.z;
            } else if path.stage == CAMERA && stage.scatters != 0u {
                rate = leaf.rates.z;
            }
            let length = leaf.exit - path.distance;
            if remaining < rate * length {
                let step = remaining / rate;
                fly(control, step);
                path.distance += step;
                path.rate = rate;
                path.control = control;
                path.majorant = leaf.rates.w;
                return true;
            }
            remaining -= rate * length;
            fly(control, length);
            if !cross_leaf(leaf) { path.distance = path.end; }
        }
#ifdef MESH
        if !next_part() { return false; }
#else
        return false;
#endif
    }
    return false;
}

// Emission and light along a flight, and its transmittance through the control.
fn fly(control: f32, length: f32) {
    let collects = path.stage != SHADOW;
    let hit = path.hit_distance - path.distance;
    let lit = collects && path.hit_distance >= 0.0 && hit > 0.0 && hit <= length;
    if lit { path.hit_distance = -1.0; }
    let extinction = control * stage.share;
    let depth = extinction * length;
    if collects {
        let arriving = path.carried * path.weight;
        path.radiance += arriving * stage.emission * transfer::mean_transmittance(depth) * length;
        if lit { path.radiance += arriving * exp(-extinction * hit) * path.hit; }
    }
    path.weight *= transfer::transmittance(depth);
}

// The largest magnitude.
fn largest(v: vec3f) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

fn sum(v: vec3f) -> f32 {
    return v.x + v.y + v.z;
}

// Handles a tentative collision whose density is known.
fn collide(density: f32) {
    let extinction = stage.extinction * density;
    let scattering = stage.scattering * density;
    if path.stage == BOUNCE {
        collide_between_events(extinction, scattering);
        path.flight = numbers.w;
        return;
    }
    if path.stage == CAMERA && stage.scatters != 0u {
        // A reservoir of possible first scattering events.
        let weight = path.analog * scattering / path.rate;
        let mean = sum(abs(weight)) / 3.0;
        path.total += mean;
        if numbers.y * path.total < mean {
            path.kept_distance = path.distance;
            path.kept = weight;
            path.kept_mean = mean;
        }
    }
    path.weight *= 1.0 - (extinction - path.control * stage.share) / path.rate;
    path.analog *= 1.0 - extinction / path.rate;
    var most = largest(path.weight);
    if path.stage == CAMERA { most = max(most, largest(path.analog)); }
    if most < constants::FAINT {
        let factor = select(0.0, 2.0, numbers.z < 0.5);
        path.weight *= factor;
        path.analog *= factor;
        if factor == 0.0 || most <= 0.0 { stop(); }
    }
    path.flight = numbers.w;
}

fn collide_between_events(extinction: vec3f, per_metre: vec3f) {
    let weight = path.carried * path.weight;
    let scattering = sum(abs(weight * per_metre));
    let nothing = sum(abs(weight * (path.rate - extinction)));
    let both = scattering + nothing;
    if numbers.y * both < scattering {
        path.throughput = weight * per_metre * (both / (scattering * path.rate));
        path.weight = vec3f(0.0);
        path.kept_distance = path.distance;
        stop();
        path.scattered = 1u;
    } else if nothing > 0.0 {
        path.weight *= (path.rate - extinction) * (both / (nothing * path.rate));
    } else {
        path.weight = vec3f(0.0);
        stop();
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// From ray to ray

// What the world sends against the ray's direction of travel.
fn around_scene() -> vec3f {
#ifdef WORLD
    // What is no number, or infinite, counts as 0.
    let sent = surroundings::evaluate(path.direction);
    return select(vec3f(0.0), sent, abs(sent) < vec3f(FAR));
#else
    return stage.world;
#endif
}

// What the ray finds at its end, and the next ray; false where the path ends.
fn end_ray() -> bool {
    let arriving = path.carried * path.weight;
    if path.stage == SHADOW {
        path.radiance += arriving;
        return leave_event();
    }
    if path.stage == CAMERA {
        if stage.transparent == 0u { path.radiance += arriving * around_scene(); }
        outcome.opacity += 1.0 - sum(path.weight) / 3.0;
        if path.total <= 0.0 { return false; }
        path.throughput = path.kept * (path.total / path.kept_mean);
        path.reference = largest(path.throughput);
        return scatter();
    }
    path.radiance += arriving * (around_scene() + select(vec3f(0.0), path.hit, path.hit_distance > 0.0));
    if path.stage == LAST || path.scattered == 0u { return false; }
    return survives() && scatter();
}

// Roulette by what is left of the throughput: unbiased, since survivors carry more.
fn survives() -> bool {
    if path.scatterings < constants::EVENTS_BEFORE_ROULETTE { return true; }
    let chance = largest(path.throughput) / path.reference;
    if chance >= 1.0 { return true; }
    if next4().x >= chance { return false; }
    path.throughput /= chance;
    return true;
}

fn phase_value(before: vec3f, after: vec3f) -> f32 {
    return phase::henyey_greenstein(stage.anisotropy, before, after);
}

// A unit vector at an angle of cosine `cosine` from `axis`, turned by `turn` of a full circle (frame: Duff et al. 2017).
fn around(axis: vec3f, cosine: f32, sine: f32, turn: f32) -> vec3f {
    let sign = select(-1.0, 1.0, axis.z >= 0.0);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    let first = vec3f(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x);
    let second = vec3f(b, sign + axis.y * axis.y * a, -axis.y);
    let angle = 2.0 * PI * turn;
    let across = first * numeric::cos_of(angle) + second * numeric::sin_of(angle);
    return normalize(across * sine + axis * cosine);
}

fn sample_phase(before: vec3f, first: f32, second: f32) -> vec3f {
    let cosine = phase::sample_henyey_greenstein(stage.anisotropy, 1.0 - first);
    return around(before, cosine, sqrt(max(1.0 - cosine * cosine, 0.0)), second);
}

fn importance(light: Light, place: vec3f) -> f32 {
    if light.kind < constants::POINT { return light.strength; }
    let way = light.place - place;
    return light.strength / (dot(way, way) + 1e-12);
}

// A scattering event at the kept distance: samples the phase function and sends a shadow ray.
fn scatter() -> bool {
    outcome.scatterings += 1u;
    path.scatterings += 1u;
    let directions = next4();
    let choice = next4().x;
    let before = path.direction;
    path.vertex = path.origin + before * path.kept_distance;
    path.next = sample_phase(before, directions.x, directions.y);
    path.hit_distance = -1.0;
    path.hit = vec3f(0.0);
    if stage.lights == 0u { return leave_event(); }
    var total = 0.0;
    for (var number = 0u; number < stage.lights; number++) {
        total += importance(lights[number], path.vertex);
    }
    var chosen = 0u;
    var rest = choice * total;
    loop {
        let part = importance(lights[chosen], path.vertex);
        if rest < part || chosen + 1u >= stage.lights { break; }
        rest -= part;
        chosen += 1u;
    }
    let light = lights[chosen];
    let probability = importance(light, path.vertex) / total;
    var towards = light.place;
    var reach = FAR;
    var arriving = light.power;
    var share = 1.0;
    if light.kind == constants::SUN_DISC {
        let density = 1.0 / (2.0 * PI * light.opening);
        let offset = path.next - light.place;
        if dot(offset, offset) * 0.5 <= light.opening {
            let turned = phase_value(before, path.next);
            path.hit_distance = FAR;
            path.hit = light.power * (turned / (turned + density) / probability);
        }
        let lack = directions.z * light.opening;
        towards = around(light.place, 1.0 - lack, sqrt(lack * (2.0 - lack)), directions.w);
        arriving /= density;
        share = density / (density + phase_value(before, towards));
    } else if light.kind >= constants::POINT {
        let way = light.place - path.vertex;
        reach = length(way);
        towards = way / reach;
        arriving /= reach * reach;
        if light.kind == constants::SPOT {
            let inside = -dot(towards, light.axis) - light.edge;
            let part = saturate(inside / ((1.0 - light.edge) * light.blend));
            arriving *= part * part * (3.0 - 2.0 * part);
        }
        if !(largest(arriving) > 0.0 && largest(arriving) < FAR) { return leave_event(); }
    }
    let turned = phase_value(before, towards);
    send(SHADOW, towards, reach, path.throughput * arriving * (share * turned / probability));
    return true;
}

// Sends the ray that the phase function sampled; false where it cannot find anything.
fn leave_event() -> bool {
    let is_last = path.scatterings >= stage.events;
    let dark = all(stage.world == vec3f(0.0)) && all(stage.emission == vec3f(0.0)) && path.hit_distance < 0.0;
    if is_last && dark { return false; }
    send(select(BOUNCE, LAST, is_last), path.next, FAR, path.throughput);
    return true;
}

fn send(kind: u32, direction: vec3f, limit: f32, carried: vec3f) {
    path.stage = kind;
    enter(path.vertex, direction, limit);
    path.carried = carried;
    path.weight = vec3f(1.0);
    path.scattered = 0u;
    path.flight = next4().x;
}

// Starts the next sample of the pixel; its camera ray waits in `rays`.
fn begin(sample: u32) {
    let ray = rays[slot * stage.samples + sample];
    path.sample = sample;
    path.stage = CAMERA;
    path.drawn = 0u;
    path.carried = vec3f(1.0);
    path.weight = vec3f(1.0);
    path.analog = vec3f(1.0);
    path.total = 0.0;
    path.scatterings = 0u;
    path.scattered = 0u;
    path.hit_distance = -1.0;
    path.hit = vec3f(0.0);
    path.radiance = vec3f(0.0);
#ifdef MESH
    enter(ray.origin, ray.direction, ray.length);
#else
    enter(ray.origin, ray.direction, FAR);
    path.end = min(path.end, ray.length);
#endif
    path.flight = next4().x;
}

fn finish() {
    outcome.radiance += path.radiance;
    if path.sample + 1u < stage.samples {
        begin(path.sample + 1u);
    } else {
        path.stage = constants::FINISHED;
        outcome.finished = 1u;
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    slot = invocation.x;
    if slot >= stage.pixels { return; }
    outcome = outcomes[slot];
    if outcome.finished != 0u { return; }
    pixel = stage.first_pixel + slot;
    path = paths[slot];
    // A new pixel arrives in this stage.
    if path.stage == constants::FINISHED { begin(0u); }
    for (var collision = 0u; collision < stage.budget; collision++) {
        // To the next tentative collision, through the ends of rays and paths.
        var is_paused = false;
        while !travel() {
            if !end_ray() { finish(); }
            if path.stage == constants::FINISHED { break; }
#ifdef MESH
            // The next dispatch goes on with this ray.
            is_paused = mesh::visits > constants::MOST_VISITS;
            if is_paused { break; }
#endif
        }
        if path.stage == constants::FINISHED || is_paused { break; }
        let place = position();
        let value = graph::evaluate(place);
        // Negative density acts as 0; NaN is not below 0 and stays to be seen.
        var density = select(value, 0.0, value < 0.0);
        var extinction = largest(stage.extinction) * density;
        let majorant = abs(path.majorant);
        outcome.collisions += 1u;
        if !(extinction <= majorant) {
            if !(path.majorant < 0.0 && extinction <= FAR) {
                outcome.place = place;
                outcome.extinction = extinction;
                outcome.majorant = max(majorant, 1e-38);
                outcome.finished = 1u;
                break;
            }
            // Where no bound is proven, extinction beyond the cap counts as the cap.
            density = majorant / largest(stage.extinction);
            extinction = majorant;
        }
        outcome.null_collisions += 1.0 - extinction / majorant;
        numbers = next4();
        collide(density);
#ifdef MESH
        if mesh::visits > constants::MOST_VISITS { break; }
#endif
    }
    paths[slot] = path;
    outcomes[slot] = outcome;
}
