// Blackbody node (ShaderNodeBlackbody): colour of a temperature in kelvins, linear Rec. 709 of luminance 1, negative
// channels dropped. Source: Blender's fit, piece by piece: a / T + b T + c in red and green, a cubic in blue, constant
// below 800 and from 12000. Domain: finite f32. Limits: the quotient is as exact as the device's division.
// SINCE_BLENDER_5_1 and not SINCE_BLENDER_5_3: the fit is converted to Blender's working space.

// Coefficients of a piece: a, b, c of red and of green, those of the cubic from the highest power down.
struct Piece {
    red: vec3f,
    green: vec3f,
    blue: vec4f,
}

fn piece_of(temperature: f32) -> Piece {
    if temperature < 965.0 {
        return Piece(
            vec3f(1619.191, -0.0020501092, 5.029958),
            vec3f(-488.99976, 0.00060433074, -0.07558075),
            vec4f(5.9694534e-11, -4.857429e-8, -0.00009706223, -0.0040793614),
        );
    }
    if temperature < 1167.0 {
        return Piece(
            vec3f(2488.4546, -0.0011133091, 3.2262154),
            vec3f(-755.99426, 0.0003167301, 0.47830614),
            vec4f(2.4043037e-11, 5.5502106e-8, -0.00019850371, 0.028931286),
        );
    }
    if temperature < 1449.0 {
        return Piece(
            vec3f(3341.432, -0.0004865512, 1.7648677),
            vec3f(-1023.6398, 0.00012022347, 0.9366623),
            vec4f(-1.40949735e-11, 1.8987897e-7, -0.00035663284, 0.09107678),
        );
    }
    if temperature < 1902.0 {
        return Piece(
            vec3f(4094.6174, -0.00012744658, 0.7257316),
            vec3f(-1265.7131, 4.873409e-6, 1.270545),
            vec4f(-3.6146086e-11, 2.8482202e-7, -0.0004932113, 0.15672344),
        );
    }
    if temperature < 3315.0 {
        return Piece(
            vec3f(4670.2803, 0.00002912582, 0.12670344),
            vec3f(-1425.2933, -0.000040115043, 1.4397278),
            vec4f(-1.9707574e-11, 1.7535935e-7, -0.00025054283, -0.022278327),
        );
    }
    if temperature < 6365.0 {
        return Piece(
            vec3f(4595.092, 0.000028749564, 0.15034503),
            vec3f(-1175.5482, -0.000021637805, 1.3040802),
            vec4f(-1.6199795e-13, -1.64216e-8, 0.00038621627, -0.7380774),
        );
    }
    return Piece(
        vec3f(3787.1746, 9.359078e-6, 0.39907587),
        vec3f(-500.79956, -4.59832e-6, 1.0909877),
        vec4f(6.726503e-13, -2.730788e-8, 0.00042409825, -0.75233567),
    );
}

// With negative channels.
fn fit(temperature: f32) -> vec3f {
    if temperature < 800.0 {
        return vec3f(5.4132943, -0.2031939, -0.08225352);
    }
    if temperature >= 12000.0 {
        return vec3f(0.8262955, 0.994508, 1.5663077);
    }
    let p = piece_of(temperature);
    let inverse = 1.0 / temperature;
    let red = (p.red.x * inverse + p.red.y * temperature) + p.red.z;
    let green = (p.green.x * inverse + p.green.y * temperature) + p.green.z;
    let blue = ((p.blue.x * temperature + p.blue.y) * temperature + p.blue.z) * temperature + p.blue.w;
    return vec3f(red, green, blue);
}

fn converted(c: vec3f) -> vec3f {
#ifdef SINCE_BLENDER_5_3
    return c;
#else ifdef SINCE_BLENDER_5_1
    return vec3f(
        (1.0001589 * c.x + -9.872019e-7 * c.y) + -7.748603e-7 * c.z,
        (-8.550705e-8 * c.x + 0.99997663 * c.y) + -3.241002e-7 * c.z,
        (1.6763774e-8 * c.x + 2.086164e-7 * c.y) + 0.9997596 * c.z,
    );
#else
    return c;
#endif
}

fn evaluate(temperature: f32) -> vec3f {
    return max(converted(fit(temperature)), vec3f(0.0));
}
