// Clouds of soft ellipsoids: twin of src/nodes/ellipsoid_clusters.rs.
// KIND_CLUSTERS, KIND_OVERLAPPING_CLUSTERS (random numbers of one sequence), KIND_SPHERES (one sphere a cloud).
#import cloudparity::hash::pcg3
#import cloudparity::numeric::{cos_of, sin_of, to_int}

const CLOUDS = 30;
const PARTICLES = 25;

fn random(index: i32, lane: i32) -> f32 {
    return pcg3(vec3i(index, lane, 0)).x;
}

#ifdef KIND_SPHERES
#else
// Random number of an ellipsoid.
fn drawn(key: i32, lane: i32) -> f32 {
#ifdef KIND_OVERLAPPING_CLUSTERS
    return random(key + lane, 1);
#else
    return random(key, 2 + lane);
#endif
}

// What a cloud's ellipsoids let through together.
fn through(kind: f32, first: i32, place: vec3f) -> f32 {
    var left = 1.0;
    for (var number = 0; number < PARTICLES; number++) {
        let key = first + number;
        let part = f32(number) / f32(PARTICLES);
        let where_to = vec3f(drawn(key, 0), drawn(key, 1), drawn(key, 2));
        let size = vec3f(drawn(key, 3), drawn(key, 4), drawn(key, 5));
        var offset: vec3f;
        var radii: vec3f;
        if kind < 0.4 {
            let angle = 6.2831855 * where_to.x;
            let away = 15.0 * where_to.y;
            offset = vec3f(away * cos_of(angle), max(12.0 * where_to.z - 2.0, 0.0), away * sin_of(angle));
            radii = vec3f(5.0 + 8.0 * size.x, 3.0 + 5.0 * size.y * (1.0 - part), 5.0 + 8.0 * size.z);
        } else if kind < 0.7 {
            offset = vec3f(40.0, 3.0, 40.0) * (where_to - 0.5);
            radii = vec3f(8.0, 1.5, 8.0) + vec3f(12.0, 2.0, 12.0) * size;
        } else {
            offset = vec3f(30.0 * part - 15.0, 0.0, 0.0) + vec3f(5.0, 2.0, 4.0) * (where_to - 0.5);
            radii = vec3f(3.0, 0.5, 1.5) + vec3f(4.0, 1.0, 2.0) * size;
        }
        let q = (place - offset) / radii;
        let inside = clamp(1.0 - sqrt(q.x * q.x + q.y * q.y + q.z * q.z), 0.0, 1.0);
        left *= 1.0 - 0.6 * (inside * inside);
    }
    return left;
}
#endif

fn evaluate(vector: vec3f, seed_number: f32, spread: f32, base: f32, height: f32, radius: f32, passed: f32) -> f32 {
    let seed = to_int(seed_number);
    var left = 1.0;
#ifdef KIND_SPHERES
    let reach = vec3f(abs(radius) * 1.5);
#else
    let reach = vec3f(40.0, 18.0, 40.0);
#endif
    for (var cloud = 0; cloud < CLOUDS; cloud++) {
        let first = seed + 3 * cloud;
        let along = random(first + 1, 0) + passed;
        let middle = vec3f(
            (random(first, 0) - 0.5) * spread,
            base + height * random(first + 2, 0),
            ((along - floor(along)) - 0.5) * spread,
        );
        let place = vector - middle;
        if any(abs(place) > reach) { continue; }
        let kind = random(seed + 7 * cloud, 0);
#ifdef KIND_SPHERES
        let own = radius * (0.5 + kind);
        let q = place / own;
        let inside = clamp(1.0 - sqrt(q.x * q.x + q.y * q.y + q.z * q.z), 0.0, 1.0);
        left *= 1.0 - inside * inside;
#else
        left *= through(kind, seed + 100 * cloud, place);
#endif
    }
    return 1.0 - left;
}
