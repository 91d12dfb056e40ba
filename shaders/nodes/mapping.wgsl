// Mapping node (ShaderNodeMapping): scales, rotates by Euler angles (about X, then Y, then Z) and moves a vector.
// VECTOR_TYPE_POINT does so in this order, VECTOR_TYPE_TEXTURE undoes it, VECTOR_TYPE_VECTOR has no location, and
// VECTOR_TYPE_NORMAL divides by the scale, rotates and normalises.
// Source: Blender. A component of the scale that is 0 gives 0 where it divides, and so does a normal without length.
// Domain: finite f32. Limits: quotients are as exact as the device's division; the angles' functions are the module's own.
#import cloudparity::numeric::{safe_divide3, sin_of, cos_of}

// The matrix of the angles, as columns.
fn euler(angles: vec3f) -> mat3x3f {
    let s = vec3f(sin_of(angles.x), sin_of(angles.y), sin_of(angles.z));
    let c = vec3f(cos_of(angles.x), cos_of(angles.y), cos_of(angles.z));
    let a = s.y * s.x;
    let b = s.y * c.x;
    return mat3x3f(
        vec3f(c.y * c.z, c.y * s.z, -s.y),
        vec3f(a * c.z - c.x * s.z, a * s.z + c.x * c.z, c.y * s.x),
        vec3f(b * c.z + s.x * s.z, b * s.z - s.x * c.z, c.y * c.x),
    );
}

#ifdef VECTOR_TYPE_TEXTURE
fn evaluate(vector: vec3f, location: vec3f, rotation: vec3f, scale: vec3f) -> vec3f {
    let m = euler(rotation);
    let v = vector - location;
    let turned = vec3f(
        (v.x * m[0].x + v.y * m[0].y) + v.z * m[0].z,
        (v.x * m[1].x + v.y * m[1].y) + v.z * m[1].z,
        (v.x * m[2].x + v.y * m[2].y) + v.z * m[2].z,
    );
    return safe_divide3(turned, scale);
}
#else

// Added from the right.
fn turn(v: vec3f, angles: vec3f) -> vec3f {
    let m = euler(angles);
    return v.x * m[0] + (v.y * m[1] + v.z * m[2]);
}

#ifdef VECTOR_TYPE_POINT
fn evaluate(vector: vec3f, location: vec3f, rotation: vec3f, scale: vec3f) -> vec3f {
    return turn(vector * scale, rotation) + location;
}
#else ifdef VECTOR_TYPE_VECTOR
fn evaluate(vector: vec3f, rotation: vec3f, scale: vec3f) -> vec3f {
    return turn(vector * scale, rotation);
}
#else
fn evaluate(vector: vec3f, rotation: vec3f, scale: vec3f) -> vec3f {
    let turned = turn(safe_divide3(vector, scale), rotation);
    let norm = sqrt((turned.x * turned.x + turned.y * turned.y) + turned.z * turned.z);
    return select(turned, turned * (1.0 / norm), norm != 0.0);
}
#endif

#endif
