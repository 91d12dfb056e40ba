// Vector Rotate node (ShaderNodeVectorRotate): a vector turned about a centre. ROTATION_TYPE_AXIS_ANGLE (an axis of any
// length but 0, and an angle), ROTATION_TYPE_X_AXIS, _Y_AXIS, _Z_AXIS (an angle) or ROTATION_TYPE_EULER_XYZ (angles about X,
// then Y, then Z); INVERT turns the other way.
// Source: Blender; Rodrigues' rotation as a matrix. With an axis of length 0 the vector stays what it is.
// Domain: finite f32. Limits: the axis' squares overflow for components above 1.8e19.
#import cloudparity::numeric::{sin_of, cos_of}

#ifdef ROTATION_TYPE_EULER_XYZ

fn evaluate(vector: vec3f, center: vec3f, rotation: vec3f) -> vec3f {
    let s = vec3f(sin_of(rotation.x), sin_of(rotation.y), sin_of(rotation.z));
    let c = vec3f(cos_of(rotation.x), cos_of(rotation.y), cos_of(rotation.z));
    let a = s.y * s.x;
    let b = s.y * c.x;
    // Columns.
    let x = vec3f(c.y * c.z, c.y * s.z, -s.y);
    let y = vec3f(a * c.z - c.x * s.z, a * s.z + c.x * c.z, c.y * s.x);
    let z = vec3f(b * c.z + s.x * s.z, b * s.z - s.x * c.z, c.y * c.x);
    let v = vector - center;
#ifdef INVERT
    let turned = vec3f(
        (v.x * x.x + v.y * x.y) + v.z * x.z,
        (v.x * y.x + v.y * y.y) + v.z * y.z,
        (v.x * z.x + v.y * z.y) + v.z * z.z,
    );
#else
    let turned = v.x * x + (v.y * y + v.z * z);
#endif
    return turned + center;
}

#else

// About a unit axis.
fn turn(vector: vec3f, center: vec3f, a: vec3f, angle: f32) -> vec3f {
#ifdef INVERT
    let s = -sin_of(angle);
#else
    let s = sin_of(angle);
#endif
    let c = cos_of(angle);
    let t = (1.0 - c) * a;
    let v = vector - center;
    // Columns of the matrix.
    let x = vec3f(c + t.x * a.x, t.x * a.y + a.z * s, t.x * a.z - a.y * s);
    let y = vec3f(t.x * a.y - a.z * s, c + t.y * a.y, t.y * a.z + a.x * s);
    let z = vec3f(t.x * a.z + a.y * s, t.y * a.z - a.x * s, c + t.z * a.z);
    return ((x * v.x + y * v.y) + z * v.z) + center;
}

#ifdef ROTATION_TYPE_AXIS_ANGLE
fn evaluate(vector: vec3f, center: vec3f, axis: vec3f, angle: f32) -> vec3f {
    let norm = sqrt((axis.x * axis.x + axis.y * axis.y) + axis.z * axis.z);
    if norm == 0.0 {
        return vector;
    }
    return turn(vector, center, axis / norm, angle);
}
#else ifdef ROTATION_TYPE_X_AXIS
fn evaluate(vector: vec3f, center: vec3f, angle: f32) -> vec3f {
    return turn(vector, center, vec3f(1.0, 0.0, 0.0), angle);
}
#else ifdef ROTATION_TYPE_Y_AXIS
fn evaluate(vector: vec3f, center: vec3f, angle: f32) -> vec3f {
    return turn(vector, center, vec3f(0.0, 1.0, 0.0), angle);
}
#else
fn evaluate(vector: vec3f, center: vec3f, angle: f32) -> vec3f {
    return turn(vector, center, vec3f(0.0, 0.0, 1.0), angle);
}
#endif

#endif
