// Vector Transform node (ShaderNodeVectorTransform): a vector of the world in the space of the shaded object, or back.
// VECTOR_TYPE_POINT, _VECTOR (not moved) or _NORMAL (normalised); CONVERT_FROM_ and CONVERT_TO_, each with WORLD or OBJECT.
// MATRIX_X, _Y and _Z, put in front of this text, are the rows that the vector is multiplied with; for normals those of the
// transpose of the opposite matrix.
// Source: Blender. Domain: finite f32. Limits: a normal of length 0 stays 0, where Blender gives NaN towards the world.

fn transformed(v: vec3f) -> vec3f {
#ifdef VECTOR_TYPE_NORMAL
    let n = vec3f(
        (v.x * MATRIX_X.x + v.y * MATRIX_X.y) + v.z * MATRIX_X.z,
        (v.x * MATRIX_Y.x + v.y * MATRIX_Y.y) + v.z * MATRIX_Y.z,
        (v.x * MATRIX_Z.x + v.y * MATRIX_Z.y) + v.z * MATRIX_Z.z,
    );
    let norm = sqrt((n.x * n.x + n.y * n.y) + n.z * n.z);
    return select(n, n * (1.0 / norm), norm != 0.0);
#else ifdef VECTOR_TYPE_POINT
    return vec3f(
        ((MATRIX_X.w + v.z * MATRIX_X.z) + v.y * MATRIX_X.y) + v.x * MATRIX_X.x,
        ((MATRIX_Y.w + v.z * MATRIX_Y.z) + v.y * MATRIX_Y.y) + v.x * MATRIX_Y.x,
        ((MATRIX_Z.w + v.z * MATRIX_Z.z) + v.y * MATRIX_Z.y) + v.x * MATRIX_Z.x,
    );
#else
    return vec3f(
        (v.z * MATRIX_X.z + v.y * MATRIX_X.y) + v.x * MATRIX_X.x,
        (v.z * MATRIX_Y.z + v.y * MATRIX_Y.y) + v.x * MATRIX_Y.x,
        (v.z * MATRIX_Z.z + v.y * MATRIX_Z.y) + v.x * MATRIX_Z.x,
    );
#endif
}

fn evaluate(vector: vec3f) -> vec3f {
#ifdef CONVERT_FROM_WORLD
#ifdef CONVERT_TO_WORLD
    return vector;
#else
    return transformed(vector);
#endif
#else
#ifdef CONVERT_TO_OBJECT
    return vector;
#else
    return transformed(vector);
#endif
#endif
}
