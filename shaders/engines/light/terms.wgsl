// Source terms of light models: twin of src/engines/light/terms.rs.
#define_import_path cloudparity::terms
#import cloudparity::transfer

// The sum over octaves (at most MOST_OCTAVES of the twin) of their weights, which hold the phase functions, each dimmed by its part of an optical depth.
fn octaves(weights: ptr<function, array<f32, 16>>, count: u32, attenuation: f32, depth: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var dimmed = depth;
    for (var octave = 0u; octave < min(count, 16u); octave++) {
        sum += (*weights)[octave] * transfer::transmittance(dimmed);
        dimmed *= attenuation;
    }
    return sum;
}

// The depth that counts: as it is where compression times depth is small, its root where that is large.
fn compressed(compression: f32, depth: vec3f) -> vec3f {
    let bent = min(2.0 * compression * depth, vec3f(1e38));
    return 2.0 * depth / (1.0 + sqrt(1.0 + bent));
}

// What the powder of the light ray leaves of the octaves' sum.
fn ray_powder(sum: vec3f, depth: vec3f, cosine: f32) -> vec3f {
    let behind = 2.0 * transfer::absorbed(2.0 * depth);
    return sum * (behind + (1.0 - behind) * (0.5 * (1.0 + cosine)));
}

// 1 - strength exp(-length extinction), of thin parts without the difference of nearly equal numbers.
fn powder(strength: f32, length: f32, extinction: f32) -> f32 {
    return (1.0 - strength) + strength * transfer::absorbed(vec3f(length * extinction)).x;
}

// What is added to the phase function, per steradian. A power of a number that is not above 0 is not defined.
fn silver(strength: f32, exponent: f32, cosine: f32) -> f32 {
    if cosine <= 0.0 { return 0.0; }
    return strength * pow(cosine, exponent);
}
