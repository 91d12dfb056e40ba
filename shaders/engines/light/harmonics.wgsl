// Real orthonormal spherical harmonics of bands 0 to 3 in a unit direction, band by band: twin of `harmonics` in src/view/lights.rs.
#define_import_path cloudparity::harmonics

fn basis(direction: vec3f) -> array<f32, 16> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    return array<f32, 16>(
        0.28209479,
        0.48860251 * y,
        0.48860251 * z,
        0.48860251 * x,
        1.0925484 * x * y,
        1.0925484 * y * z,
        0.31539157 * (3.0 * z * z - 1.0),
        1.0925484 * x * z,
        0.54627422 * (x * x - y * y),
        0.59004359 * y * (3.0 * x * x - y * y),
        2.8906114 * x * y * z,
        0.45704580 * y * (5.0 * z * z - 1.0),
        0.37317633 * z * (5.0 * z * z - 3.0),
        0.45704580 * x * (5.0 * z * z - 1.0),
        1.4453057 * z * (x * x - y * y),
        0.59004359 * x * (x * x - 3.0 * y * y),
    );
}
