// What a step through constant coefficients lets through and adds: twin of src/media/transfer.rs, for three channels.
#define_import_path cloudparity::transfer

// Below it the difference of 1 and an exponential loses the bits of the depth. The first term that the series leaves out, d^4 / 120,
// is 5.2e-8 here: less than half an ulp of 1.
const SMALL_DEPTH = 0.05;

// Share of light that a step lets through.
fn transmittance(depth: vec3f) -> vec3f {
    return exp(-depth);
}

// (1 - exp(-d)) / d by its series.
fn series(depth: vec3f) -> vec3f {
    return 1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth / 24.0));
}

// Share of light that a step keeps.
fn absorbed(depth: vec3f) -> vec3f {
    return select(1.0 - exp(-depth), depth * series(depth), depth < vec3f(SMALL_DEPTH));
}

// Mean of the transmittance over a step; 1 without depth, where the quotient that is not chosen is 0 / 0. NaN is not below the switch and
// stays to be seen.
fn mean_transmittance(depth: vec3f) -> vec3f {
    return select((1.0 - exp(-depth)) / depth, series(depth), depth < vec3f(SMALL_DEPTH));
}
