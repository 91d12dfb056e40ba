// Phase functions: twin of src/integrate/phase.rs, per steradian.
#define_import_path cloudparity::phase

const SMALLEST_ANISOTROPY = 0.001;

// Below it the closed inverse of the distribution divides a difference of nearly equal numbers by the anisotropy.
const SMALL_ANISOTROPY = 0.25;

// The same in all directions.
fn isotropic() -> f32 {
    return 0.07957747;
}

// Henyey and Greenstein 1941, for the cosine between the directions of travel; isotropic below |g| = 0.001. The base
// 1 + g^2 - 2 g c is a sum of parts that are not negative: it neither cancels nor falls below (1 - |g|)^2, whatever
// rounding makes of a cosine.
fn henyey_greenstein(anisotropy: f32, cosine: f32) -> f32 {
    let g = abs(anisotropy);
    if g < SMALLEST_ANISOTROPY { return isotropic(); }
    let c = select(cosine, -cosine, anisotropy < 0.0);
    // NaN is not below 0 and stays to be seen.
    let lack = select(1.0 - c, 0.0, c > 1.0);
    let least = 1.0 - g;
    let base = least * least + 2.0 * g * lack;
    return least * (1.0 + g) * isotropic() / (base * sqrt(base));
}

// The cosine of henyey_greenstein for a number uniform in [0, 1).
fn sample_henyey_greenstein(anisotropy: f32, uniform: f32) -> f32 {
    let g = anisotropy;
    let s = 2.0 * uniform - 1.0;
    if abs(g) < SMALLEST_ANISOTROPY { return s; }
    var cosine = 0.0;
    if abs(g) < SMALL_ANISOTROPY {
        // The same quotient without the division by g.
        let below = 1.0 + g * s;
        cosine = (s + 0.5 * g * (s * s + 3.0) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)) / (below * below);
    } else {
        let ratio = (1.0 - g) * (1.0 + g) / ((1.0 - g) + 2.0 * g * uniform);
        cosine = (1.0 + g * g - ratio * ratio) / (2.0 * g);
    }
    return clamp(cosine, -1.0, 1.0);
}
