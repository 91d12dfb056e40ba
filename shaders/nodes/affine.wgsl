// Affine image of a position: Generated coordinates, or the coordinates of another object.
// Columns of the linear part and a translation, added from the left.

fn evaluate(vector: vec3f, x: vec3f, y: vec3f, z: vec3f, translation: vec3f) -> vec3f {
    return ((vector.x * x + vector.y * y) + vector.z * z) + translation;
}
