// Phase functions: twin of src/media/phase.rs, per steradian.
#define_import_path cloudparity::phase

const SMALLEST_ANISOTROPY = 0.001;

// Below it the closed inverse of the distribution divides a difference of nearly equal numbers by the anisotropy.
const SMALL_ANISOTROPY = 0.25;

// The same in all directions.
fn isotropic() -> f32 {
    return 0.07957747;
}

// Henyey and Greenstein 1941, for unit vectors along the directions of travel; isotropic below |g| = 0.001. What the cosine c lacks
// to 1, or for g < 0 to -1, comes from the difference of the vectors: f32 holds it to 1e-7 of the angle, and a cosine near 1 to 1e-7 of
// 1, which is the whole peak of g = 0.999.
fn henyey_greenstein(anisotropy: f32, before: vec3f, after: vec3f) -> f32 {
    let apart = before - select(after, -after, anisotropy < 0.0);
    let g = abs(anisotropy);
    if g < SMALLEST_ANISOTROPY { return isotropic(); }
    return henyey_greenstein_by_lack(g, 0.5 * dot(apart, apart));
}

// The same for g >= 0 and 1 - c. The base 1 + g^2 - 2 g c is a sum of parts that are not negative: it neither cancels nor falls below
// (1 - g)^2, so that nothing is divided by 0 below g = 1.
fn henyey_greenstein_by_lack(g: f32, lack: f32) -> f32 {
    let least = 1.0 - g;
    let base = least * least + 2.0 * g * lack;
    return least * (1.0 + g) * isotropic() / (base * sqrt(base));
}

// Draine's phase function for unit vectors along the directions of travel: Cornette and Shanks' for alpha = 1.
fn draine(anisotropy: f32, alpha: f32, before: vec3f, after: vec3f) -> f32 {
    let cosine = dot(before, after);
    let apart = before - select(after, -after, anisotropy < 0.0);
    let norm = 1.0 + alpha * (1.0 + 2.0 * anisotropy * anisotropy) / 3.0;
    return henyey_greenstein_by_lack(abs(anisotropy), 0.5 * dot(apart, apart)) * (1.0 + alpha * cosine * cosine) / norm;
}

// The cosine of henyey_greenstein for a number uniform in [0, 1).
fn sample_henyey_greenstein(anisotropy: f32, uniform: f32) -> f32 {
    // For g < 0 the mirrored cosine of the other end of the distribution: no sum below is a difference then.
    let mirrored = anisotropy < 0.0;
    let g = abs(anisotropy);
    let u = select(uniform, 1.0 - uniform, mirrored);
    let s = 2.0 * u - 1.0;
    var cosine = s;
    if g >= SMALLEST_ANISOTROPY && g < SMALL_ANISOTROPY {
        // The same quotient without the division by g.
        let below = 1.0 + g * s;
        cosine = (s + 0.5 * g * (s * s + 3.0) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)) / (below * below);
    } else if g >= SMALL_ANISOTROPY {
        let ratio = (1.0 - g) * (1.0 + g) / ((1.0 - g) + 2.0 * g * u);
        cosine = (1.0 + g * g - ratio * ratio) / (2.0 * g);
    }
    return clamp(select(cosine, -cosine, mirrored), -1.0, 1.0);
}
