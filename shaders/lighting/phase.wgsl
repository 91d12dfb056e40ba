// Phase functions: twin of src/integrate/phase.rs, per steradian.
#define_import_path cloudparity::phase

const SMALLEST_ANISOTROPY = 0.001;

// The same in all directions.
fn isotropic() -> f32 {
    return 0.07957747;
}

// Henyey and Greenstein 1941, for the cosine between the directions of travel; isotropic below |g| = 0.001.
fn henyey_greenstein(anisotropy: f32, cosine: f32) -> f32 {
    let g = anisotropy;
    if abs(g) < SMALLEST_ANISOTROPY { return isotropic(); }
    let base = 1.0 + g * g - 2.0 * g * cosine;
    return (1.0 - g * g) * isotropic() / (base * sqrt(base));
}
