// The mapping that a texture node of an old file carries itself: an affine image of the coordinate, added from the right.
// UNIT scales it to length 1 (a coordinate of length 0 stays).

fn evaluate(vector: vec3f, x: vec3f, y: vec3f, z: vec3f, translation: vec3f) -> vec3f {
    let image = ((translation + vector.z * z) + vector.y * y) + vector.x * x;
#ifdef UNIT
    let norm = sqrt((image.x * image.x + image.y * image.y) + image.z * image.z);
    return select(image, image * (1.0 / norm), norm != 0.0);
#else
    return image;
#endif
}
