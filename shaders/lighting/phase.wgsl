// Phase functions: twin of src/integrate/phase.rs, per steradian.
#define_import_path cloudparity::phase

const SMALLEST_ANISOTROPY = 0.001;
const SPHERE = 12.566370614359172;

// Henyey and Greenstein 1941, for the cosine between the directions of travel; isotropic below |g| = 0.001.
fn henyey_greenstein(anisotropy: f32, cosine: f32) -> f32 {
    if abs(anisotropy) < SMALLEST_ANISOTROPY { return 1.0 / SPHERE; }
    let base = 1.0 + anisotropy * anisotropy - 2.0 * anisotropy * cosine;
    return (1.0 - anisotropy * anisotropy) / (SPHERE * base * sqrt(base));
}
