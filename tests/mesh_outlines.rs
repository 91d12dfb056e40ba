//! Meshes as outlines of media: the parts of rays inside them, against other methods and closed forms; transport through them; Cycles.

mod support;

use cloudparity::bridge;
use cloudparity::bridge::reference::{ReferenceSettings, references};
use cloudparity::engines::defects::Defects;
use cloudparity::engines::domain::{Domain, Outline};
use cloudparity::engines::light::ShadowLength;
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use cloudparity::engines::{self, Engine};
use cloudparity::gpu::{Backend, Bindings, Gpu};
use cloudparity::graph::wgsl::Linker;
use cloudparity::integrators::path::PathSettings;
use cloudparity::integrators::{self, LightMode, MarchSettings, path};
use cloudparity::media::mesh::{Mesh, PlacedMesh, Span};
use cloudparity::media::objects::ObjectMedium;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Bounds, Input, LightKind, Scene};
use glam::{DMat4, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::cube::{SCATTERING, SUN, color, exact, homogeneous, phase, ramp, set, slanted_sun};
use support::estimate::{all_meet, bounces, estimate, estimate_on, furnace, meets};
use support::meshes::TestMesh;

/// Lengths of random rays agree to this, over the size of the mesh: a distance is off by about 1e-15 of it over the sine of the angle
/// at which the ray meets the triangle, and of a million rays few meet one at less than 1e-6.
const LENGTH: f64 = 1e-8;

fn placed(mesh: &TestMesh, to_object: DMat4) -> PlacedMesh {
    PlacedMesh::new(Mesh::new("shape", &mesh.vertices, &mesh.triangles).expect("a mesh"), to_object)
}

fn on_sphere(random: &mut ChaCha8Rng) -> DVec3 {
    loop {
        let place = DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if (0.1..1.0).contains(&place.length()) {
            return place.normalize();
        }
    }
}

/// A sphere with bumps and dents, no part of which meets another: a star about its middle.
fn blob(random: &mut ChaCha8Rng, levels: u32) -> TestMesh {
    let waves: Vec<(DVec3, f64)> =
        (0..6).map(|_| (on_sphere(random) * random.random_range(2.0..6.0), random.random_range(0.05..0.14))).collect();
    TestMesh::icosphere(levels)
        .moved(|place| place * (1.0 + waves.iter().map(|(wave, height)| height * wave.dot(place).sin()).sum::<f64>()))
}

/// A closed mesh of five corners without order: four of them and one pulled in through a face.
fn dart(random: &mut ChaCha8Rng) -> TestMesh {
    let corners: Vec<DVec3> = [
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(1.0, -1.0, -1.0),
        DVec3::new(-1.0, 1.0, -1.0),
        DVec3::new(-1.0, -1.0, 1.0),
    ]
    .map(|corner| corner + 0.5 * on_sphere(random))
    .into();
    let dent = corners.iter().sum::<DVec3>() / 4.0 * 0.9 + (corners[0] + corners[1] + corners[2]) / 3.0 * 0.1;
    let mut mesh = TestMesh {
        vertices: corners.iter().chain([&dent]).map(|corner| corner.as_vec3().to_array()).collect(),
        triangles: vec![[0, 1, 4], [1, 2, 4], [2, 0, 4], [0, 3, 1], [1, 3, 2], [2, 3, 0]],
    };
    let outward = Mesh::new("shape", &mesh.vertices, &mesh.triangles).expect("a mesh").volume() > 0.0;
    if !outward {
        mesh = mesh.turned_inside_out();
    }
    mesh
}

fn hollow() -> TestMesh {
    TestMesh::icosphere(2).with(&TestMesh::icosphere(1).moved(|place| place * 0.5).turned_inside_out())
}

/// The mark that Cycles keeps, over crossings in their order: parts between two distances.
fn parts_of(crossings: &[(f64, bool)], [from, to]: Span, mut inside: bool) -> Vec<Span> {
    let (mut parts, mut begin) = (Vec::new(), from);
    for &(distance, enters) in crossings.iter().filter(|(distance, _)| (from..to).contains(distance)) {
        if inside && !enters {
            parts.push([begin, distance]);
        }
        if !inside && enters {
            begin = distance;
        }
        inside = enters;
    }
    if inside {
        parts.push([begin, to]);
    }
    parts
}

fn length(parts: &[Span]) -> f64 {
    parts.iter().map(|[from, to]| to - from).sum()
}

#[test]
fn a_million_random_rays_meet_the_triangles_one_by_one() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let overlapping = TestMesh::icosphere(2).with(&TestMesh::icosphere(1).moved(|place| place + DVec3::X));
    let nested = TestMesh::icosphere(2).with(&TestMesh::icosphere(1).moved(|place| place * 0.5));
    let mut meshes = vec![TestMesh::icosphere(2), TestMesh::torus(12), hollow(), overlapping, nested];
    for _ in 0..4 {
        meshes.push(blob(&mut random, 2));
        meshes.push(dart(&mut random));
    }
    let meshes: Vec<_> = meshes
        .into_iter()
        .map(|mesh| {
            // Scaled, turned, sheared, away from the origin, and mirrored in half of the cases.
            let columns: [DVec3; 3] = std::array::from_fn(|_| on_sphere(&mut random) * random.random_range(0.5..2.0));
            let at = 10.0 * on_sphere(&mut random);
            let [x, y, z] = columns.map(|column| column.extend(0.0));
            let to_world = DMat4::from_cols(x, y, z, at.extend(1.0));
            let to_object = to_world.inverse();
            let size = columns.iter().map(|column| column.length()).sum::<f64>() * 2.0;
            (placed(&mesh, to_object), mesh, to_world, to_object, size)
        })
        .filter(|(.., to_world, _, _)| to_world.determinant().abs() > 0.2)
        .collect();
    assert!(meshes.len() >= 8, "{} meshes are left", meshes.len());
    let (rays, mut hits, mut worst) = (1_000_000, 0, 0.0_f64);
    for ray in 0..rays {
        let (ours, mesh, to_world, to_object, size) = &meshes[ray % meshes.len()];
        let middle = to_world.transform_point3(DVec3::ZERO);
        // From within half of the cases.
        let reach = if ray / meshes.len() % 2 == 0 { *size } else { 0.3 };
        let origin = middle + on_sphere(&mut random) * reach;
        let target = middle + on_sphere(&mut random) * 0.5 * random.random_range(0.0..*size);
        let direction = (target - origin).normalize();
        let local = [to_object.transform_point3(origin), to_object.transform_vector3(direction)];
        let crossings = mesh.crossings(local[0], local[1]);
        let inside = ours.begins_inside(origin);
        let up = mesh.crossings(local[0], to_object.transform_vector3(DVec3::Z));
        let above = up.iter().find(|(distance, _)| *distance > 0.0).is_some_and(|(_, enters)| !enters);
        assert_eq!(inside, above, "ray {ray}: where it begins");
        let mut parts = Vec::new();
        ours.spans(origin, direction, [0.0, f64::INFINITY], inside, &mut parts);
        let expected = parts_of(&crossings, [0.0, f64::INFINITY], inside);
        hits += usize::from(!expected.is_empty());
        let error = (length(&parts) - length(&expected)).abs() / size;
        worst = worst.max(error);
        assert!(error <= LENGTH, "ray {ray} {origin} {direction}: {parts:?} are not {expected:?}");
    }
    println!("{hits} of {rays} rays meet a mesh; lengths differ by {worst:.1e} at most");
    assert!(hits > rays / 3);
}

#[test]
fn rays_aimed_at_vertices_and_edges_are_not_lost() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut meshes = vec![
        TestMesh::icosphere(2),
        TestMesh::torus(12),
        hollow(),
        TestMesh::cuboid([-1.0; 3], [1.0, 2.0, 0.5]).divided(),
    ];
    for _ in 0..4 {
        meshes.push(blob(&mut random, 2));
        meshes.push(dart(&mut random));
    }
    let (mut rays, mut looked_at) = (0, 0);
    for mesh in &meshes {
        let ours = Mesh::new("shape", &mesh.vertices, &mesh.triangles).expect("a mesh");
        assert!(ours.is_closed() && ours.volume() > 0.0);
        let targets: Vec<DVec3> =
            mesh.corners().flat_map(|[a, b, c]| [a, b, c, a.midpoint(b), b.midpoint(c), c.midpoint(a)]).collect();
        for round in 0..40 {
            for (number, &target) in targets.iter().enumerate() {
                // From anywhere, from another vertex along edges and faces, and along an axis.
                let origin = match round % 4 {
                    0 => targets[random.random_range(0..targets.len())],
                    1 => target + DVec3::AXES[number % 3] * 5.0,
                    _ => on_sphere(&mut random) * random.random_range(0.0..4.0),
                };
                if origin.distance(target) < 1e-3 {
                    continue;
                }
                rays += 1;
                let direction = (target - origin).normalize();
                let faces = ours.faces(origin, direction, f64::NEG_INFINITY, f64::INFINITY);
                for (place, face) in faces.iter().enumerate() {
                    assert_eq!(face.enters, place % 2 == 0, "from {origin} to {target}: {faces:?}");
                }
                assert!(faces.len().is_multiple_of(2), "from {origin} to {target}: {faces:?}");
                // Places in parts and gaps, where they are no graze.
                if number % 16 != 0 {
                    continue;
                }
                for (gap, pair) in faces.windows(2).enumerate() {
                    // Not the middle, where symmetric meshes are touched.
                    let part = pair[0].distance + 0.38 * (pair[1].distance - pair[0].distance);
                    let place = origin + direction * part;
                    // In a face or along an edge a ray may count as inside or outside.
                    if pair[1].distance - pair[0].distance > 1e-3 && mesh.distance(place) > 1e-6 {
                        looked_at += 1;
                        let winding = mesh.winding(place).round();
                        assert_eq!(winding, if gap % 2 == 0 { 1.0 } else { 0.0 }, "{place} of {faces:?}");
                    }
                }
            }
        }
    }
    println!("{rays} rays aimed at vertices and edges, {looked_at} parts and gaps looked at");
    assert!(rays > 200_000 && looked_at > 10_000);
}

#[test]
fn lines_through_vertices_have_their_closed_lengths() {
    let along_x = |mesh: &TestMesh, origin: DVec3| {
        let mut parts = Vec::new();
        placed(mesh, DMat4::IDENTITY).spans(origin, DVec3::X, [0.0, f64::INFINITY], false, &mut parts);
        parts
    };
    let meets = |found: &[Span], expected: &[Span]| {
        assert_eq!(found.len(), expected.len(), "{found:?}");
        // Vertices are f32.
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6;
        assert!(found.as_flattened().iter().zip(expected.as_flattened()).all(near), "{found:?} {expected:?}");
    };
    // A line through four vertices of the torus.
    meets(&along_x(&TestMesh::torus(12), DVec3::new(-5.0, 0.0, 0.0)), &[[3.7, 4.3], [5.7, 6.3]]);
    // Two cubes: apart, with a face in common, and one through the other, where Cycles leaves the medium with the first.
    let cube = |at: f32| TestMesh::cuboid([at, -1.0, -1.0], [at + 2.0, 1.0, 1.0]);
    let origin = DVec3::new(-5.0, 0.0, 0.0);
    meets(&along_x(&cube(0.0).with(&cube(3.0)), origin), &[[5.0, 7.0], [8.0, 10.0]]);
    meets(&along_x(&cube(0.0).with(&cube(2.0)), origin), &[[5.0, 9.0]]);
    meets(&along_x(&cube(0.0).with(&cube(1.0)), origin), &[[5.0, 7.0]]);
    // Along a face of a cube, whose triangles it does not cross, and along an edge: in or out, but not lost.
    for origin in [DVec3::new(-5.0, 1.0, 0.3), DVec3::new(-5.0, 1.0, 1.0), DVec3::new(-5.0, -1.0, 1.0)] {
        let parts = along_x(&cube(0.0), origin);
        assert!(parts.is_empty() || parts == [[5.0, 7.0]], "{parts:?}");
    }
    // Inside out there is nothing, seen from outside, until something ends the ray.
    let parts = along_x(&TestMesh::icosphere(2).turned_inside_out(), DVec3::new(-5.0, 0.1, 0.2));
    assert!(length(&parts) < 0.1, "{parts:?}");
}

/// The volume's outline with this mesh: whether it counts as its box.
fn counts_as_box(mesh: &TestMesh) -> bool {
    let mut scene = homogeneous();
    mesh.fill(&mut scene);
    let medium = ObjectMedium::new(scene.graph(), &scene.volume).expect("a medium");
    if medium.mesh.is_none() {
        let [low, high] = [scene.volume.bounds.min, scene.volume.bounds.max].map(|end| DVec3::from(end.map(f64::from)));
        assert_eq!([medium.bounds.low, medium.bounds.high], [low, high]);
    }
    medium.mesh.is_none()
}

#[test]
fn a_box_up_to_the_rounding_of_its_corners_is_a_box() {
    let cube = TestMesh::cuboid([-1.0, -2.0, 0.1], [1.0, 0.5, 3.0]);
    assert!(counts_as_box(&cube) && counts_as_box(&cube.divided()) && counts_as_box(&cube.divided().divided()));
    // By 1 and 2 units in the last place, each corner its own way.
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..1000 {
        let mut moved = cube.clone();
        for coordinate in moved.vertices.as_flattened_mut() {
            let bits = i64::from(coordinate.to_bits()) + random.random_range(-2..=2);
            *coordinate = f32::from_bits(u32::try_from(bits).expect("bits"));
        }
        assert!(counts_as_box(&moved), "{:?}", moved.vertices);
    }
    // Turned by right angles in f32, whose sines and cosines are not exact.
    let (sine, cosine) = std::f32::consts::FRAC_PI_2.sin_cos();
    let mut turned = cube.clone();
    for [_, y, z] in &mut turned.vertices {
        (*y, *z) = (cosine * *y - sine * *z, sine * *y + cosine * *z);
    }
    assert!(counts_as_box(&turned) && turned.vertices != cube.vertices);
    // Off by more, sheared, open, inside out, a hole beside a double face, a flat one.
    let mut corner = cube.clone();
    corner.vertices[7][0] += 1e-5;
    let sheared = cube.clone().moved(|place| place + DVec3::X * 1e-5 * place.z);
    let mut open = cube.clone();
    open.triangles.pop();
    let mut doubled = cube.clone();
    doubled.triangles[2] = doubled.triangles[0];
    let flat = TestMesh::cuboid([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]);
    let twice = cube.clone().with(&cube);
    for (number, mesh) in
        [corner, sheared, open, cube.clone().turned_inside_out(), doubled, flat, twice].iter().enumerate()
    {
        assert!(!counts_as_box(mesh), "number {number}");
    }
}

/// The scene with a mesh that is the cube of edge 2 in the world, but turned in the object's frame, so that it is no box there.
fn disguised(mut scene: Scene) -> Scene {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
    TestMesh::cuboid([-1.0; 3], [1.0; 3]).moved(|place| turn.inverse() * place).fill(&mut scene);
    let matrix = DMat4::from_quat(turn);
    scene.volume.matrix_world = std::array::from_fn(|row| std::array::from_fn(|column| matrix.col(column)[row] as f32));
    assert!(ObjectMedium::new(scene.graph(), &scene.volume).expect("a medium").mesh.is_some());
    scene
}

fn marched(scene: &Scene) -> [f64; 4] {
    integrators::render(scene, &exact(), Backend::Cpu, &|_, _| {}).expect("the scene renders").mean()
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found / expected - 1.0).abs() <= tolerance, "{found} is not {expected}");
}

/// An absorbing medium before a white world.
fn absorbing() -> Scene {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    set(&mut scene, "Color", color([0.0; 3]));
    scene
}

#[test]
fn transmittance_through_meshes_is_that_of_the_lengths_inside() {
    // The ray is the line along +Y through the origin, from y = -5; pixels differ by less than a thousandth.
    let torus = TestMesh::torus(12).moved(|place| DVec3::new(-place.y, place.x, place.z));
    let shell = TestMesh::cuboid([-1.0; 3], [1.0; 3]).with(&TestMesh::cuboid([-0.5; 3], [0.5; 3]).turned_inside_out());
    let inside_out = TestMesh::icosphere(2).turned_inside_out();
    let behind = TestMesh::icosphere(2).moved(|place| place - DVec3::Y * 4.0);
    let open_bowl = {
        let mut bowl = TestMesh::cuboid([-1.0; 3], [1.0; 3]);
        // Without the face at y = 1, which the ray leaves through.
        bowl.triangles.drain(6..8);
        bowl
    };
    // Pixels spread over 0.001, and corners round to f32.
    for (name, mesh, near, far, expected) in [
        ("torus", &torus, 0.1, 100.0, 1.2),
        ("torus, camera in the tube", &torus, 4.0, 100.0, 0.9),
        ("torus, far clip in the second part", &torus, 0.1, 6.0, 0.6),
        ("shell", &shell, 0.1, 100.0, 1.0),
        ("shell, camera in the hollow", &shell, 5.2, 100.0, 0.5),
        ("inside out", &inside_out, 0.1, 100.0, 0.0),
        ("camera in what is inside out", &inside_out, 5.0, 100.0, 0.0),
        ("an open bowl", &open_bowl, 0.1, 100.0, 0.0),
        ("a camera that is past the mesh", &behind, 3.0, 100.0, 0.0),
    ] {
        let mut scene = absorbing();
        mesh.fill(&mut scene);
        (scene.camera.clip_start, scene.camera.clip_end) = (near, far);
        let expected = f64::exp(-expected);
        let settings = PathSettings { samples: 16, ..PathSettings::default() };
        let traced = path::render(&scene, &settings, Backend::Cpu, None, &|_, _| {}).expect("it renders").mean();
        println!("{name}: path {:.6}, march {:.6}, expected {expected:.6}", traced[0], marched(&scene)[0]);
        for found in [traced, marched(&scene)] {
            close(found[0], expected, 1e-3);
        }
    }
    // The planted difference: a percent of length is seen.
    let mut scene = absorbing();
    torus.moved(|place| place * 1.01).fill(&mut scene);
    assert!((marched(&scene)[0] / (-1.2_f64).exp() - 1.0).abs() > 5e-3);
}

#[test]
fn single_scattering_in_a_mesh_of_two_parts_meets_its_closed_form() {
    let mut scene = homogeneous();
    let parts = TestMesh::cuboid([-1.0, -1.0, -1.0], [1.0, 1.0, 0.25])
        .with(&TestMesh::cuboid([-1.0, -1.0, 0.5], [1.0, 1.0, 1.0]));
    parts.fill(&mut scene);
    bounces(&mut scene, 0);
    // Light from above goes through half a metre of the upper part, a gap and a quarter of the lower one.
    let common = SUN * phase(0.0, 0.0) * (-0.75_f64).exp() * (1.0 - (-2.0_f64).exp());
    let (traced, marched) = (estimate(&scene, 1 << 14), marched(&scene));
    for channel in 0..3 {
        meets(traced[channel], SCATTERING[channel] * common, 1e-3 * SCATTERING[channel] * common);
        // The ray spreads over a thousandth of a metre.
        close(marched[channel], SCATTERING[channel] * common, 1e-3);
    }
}

#[test]
fn a_cube_in_disguise_is_the_cube() {
    // Multiple scattering, absorption, a sun and a bright world: what paths through the box give, too.
    let mut cube = homogeneous();
    slanted_sun(&mut cube);
    cube.world.color = [0.5; 3];
    set(&mut cube, "Density", Input::Number(2.0));
    bounces(&mut cube, 8);
    let mesh = disguised(cube.clone());
    let (expected, found) = (estimate(&cube, 1 << 12), estimate(&mesh, 1 << 12));
    all_meet(found, expected);
    // A density that varies, marched: the same sums at places that are rounded differently.
    bounces(&mut cube, 0);
    ramp(&mut cube, "Y", 2.0);
    let mut mesh = cube.clone();
    // Generated coordinates are the mesh's: a box cut in two, with a face in common.
    TestMesh::cuboid([-1.0; 3], [1.0, 0.25, 1.0]).with(&TestMesh::cuboid([-1.0, 0.25, -1.0], [1.0; 3])).fill(&mut mesh);
    let (expected, found) = (marched(&cube), marched(&mesh));
    for channel in 0..3 {
        close(found[channel], expected[channel], 1e-6);
    }
    let (expected, found) = (estimate(&cube, 1 << 14), estimate(&mesh, 1 << 14));
    all_meet(found, expected);
}

#[test]
fn a_cube_in_disguise_is_the_cube_beside_other_objects() {
    // Two cubes that overlap, of one material, with multiple scattering: as boxes, one as a mesh, both as meshes.
    let mut boxes = homogeneous();
    slanted_sun(&mut boxes);
    boxes.world.color = [0.5; 3];
    bounces(&mut boxes, 4);
    let mut second = boxes.volume.clone();
    second.object = "Second".into();
    second.matrix_world[0][3] = 0.5;
    second.matrix_world[1][3] = 0.75;
    boxes.other_volumes.push(second.clone());
    let mut one = disguised(boxes.clone());
    let expected = estimate(&boxes, 1 << 13);
    let found = estimate(&one, 1 << 13);
    let mut hidden = boxes.clone();
    hidden.volume = second;
    hidden = disguised(hidden);
    hidden.volume.matrix_world[0][3] = 0.5;
    hidden.volume.matrix_world[1][3] = 0.75;
    one.other_volumes = vec![hidden.volume];
    let both = estimate(&one, 1 << 13);
    all_meet(found, expected);
    all_meet(both, expected);
}

#[test]
fn a_soft_light_between_the_parts_of_a_mesh_shines_as_between_two_boxes() {
    let mut boxes = homogeneous();
    bounces(&mut boxes, 2);
    boxes.world.color = [0.1; 3];
    let light = &mut boxes.lights[0];
    light.kind = LightKind::Point { radius: 0.15, soft_falloff: false };
    light.strength = 100.0;
    for (axis, place) in [0.3, 0.2, 0.4].into_iter().enumerate() {
        light.matrix_world[axis][3] = place;
    }
    let mut second = boxes.volume.clone();
    second.object = "Second".into();
    let mut mesh = boxes.clone();
    let (low, high) = ([-1.0; 3], [1.0; 3]);
    let ends = [([-1.0; 3], [1.0, 1.0, 0.2]), ([-1.0, -1.0, 0.6], [1.0; 3])];
    boxes.volume.bounds = Bounds { min: low, max: ends[0].1 };
    second.bounds = Bounds { min: ends[1].0, max: high };
    boxes.other_volumes.push(second);
    TestMesh::cuboid(ends[0].0, ends[0].1).with(&TestMesh::cuboid(ends[1].0, ends[1].1)).fill(&mut mesh);
    let (expected, found) = (estimate(&boxes, 1 << 14), estimate(&mesh, 1 << 14));
    all_meet(found, expected);
}

#[test]
fn a_white_furnace_of_a_mesh_and_a_box_that_overlap_is_white() {
    let mut scene = furnace();
    TestMesh::torus(12).moved(|place| DVec3::new(-place.y, place.x, place.z)).fill(&mut scene);
    bounces(&mut scene, 1 << 20);
    let alone = estimate(&scene, 1 << 10);
    let mut second = homogeneous().volume;
    second.object = "Second".into();
    second.material = scene.volume.material.clone();
    second.matrix_world[0][3] = 0.7;
    scene.other_volumes.push(second);
    let both = estimate(&scene, 1 << 10);
    for channel in 0..3 {
        meets(alone[channel], 1.0, 0.0);
        meets(both[channel], 1.0, 0.0);
    }
}

#[test]
fn a_mesh_and_a_box_absorb_by_the_sum_of_their_depths() {
    let mut scene = absorbing();
    let torus = TestMesh::torus(12).moved(|place| DVec3::new(-place.y, place.x, place.z));
    torus.fill(&mut scene);
    let mut second = homogeneous().volume;
    second.object = "Second".into();
    second.material = scene.volume.material.clone();
    scene.other_volumes.push(second);
    let found = estimate(&scene, 1 << 14);
    for channel in 0..3 {
        meets(found[channel], (-1.2_f64 - 2.0).exp(), 2e-3 * (-3.2_f64).exp());
    }
}

/// Two parts with a gap of a quarter metre between them.
fn in_two_parts(scene: &mut Scene) {
    TestMesh::cuboid([-1.0, -1.0, -1.0], [1.0, 1.0, 0.25])
        .with(&TestMesh::cuboid([-1.0, -1.0, 0.5], [1.0, 1.0, 1.0]))
        .fill(scene);
}

/// The largest difference of two pictures over the brightest value.
fn difference(found: &Image, expected: &Image) -> f64 {
    let values = |image: &Image| image.pixels.iter().map(|pixel| pixel.map(f64::from)).collect::<Vec<_>>();
    let (found, expected) = (values(found), values(expected));
    let brightest = expected.as_flattened().iter().copied().fold(0.0, f64::max);
    let differences = found.as_flattened().iter().zip(expected.as_flattened()).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max) / brightest
}

/// A body with a sun and a world, seen whole in a small picture.
fn seen_whole(mesh: &TestMesh) -> Scene {
    let mut scene = homogeneous();
    mesh.fill(&mut scene);
    slanted_sun(&mut scene);
    bounces(&mut scene, 0);
    scene.world.color = [0.3; 3];
    scene.camera.ortho_scale = 2.8;
    scene.film.resolution = [16, 16];
    set(&mut scene, "Density", Input::Number(2.0));
    scene
}

#[test]
fn a_light_grid_in_a_mesh_meets_its_closed_form() {
    // The scene of single scattering in two parts: depth is linear within a cell but for the kinks at faces, along an axis.
    let mut scene = homogeneous();
    in_two_parts(&mut scene);
    bounces(&mut scene, 0);
    let common = SUN * phase(0.0, 0.0) * (-0.75_f64).exp() * (1.0 - (-2.0_f64).exp());
    let grid = MarchSettings { light: LightMode::Grid, grid_cells: 32, ..exact() };
    for backend in [Backend::Cpu, Backend::Gpu] {
        if backend == Backend::Gpu && !support::require("vulkan") {
            continue;
        }
        let found = integrators::render(&scene, &grid, backend, &|_, _| {}).expect("it renders").mean();
        for channel in 0..3 {
            // Vertices of 32 cells of a sixteenth lie on all faces.
            close(found[channel], SCATTERING[channel] * common, 1e-3);
        }
    }
}

#[test]
fn a_light_grid_in_a_mesh_converges_to_the_light_along_rays() {
    let cases = [("sphere", TestMesh::icosphere(2)), ("torus", TestMesh::torus(12)), ("hollow", hollow())];
    for (name, mesh) in cases {
        for varies in [false, true] {
            let mut scene = seen_whole(&mesh);
            if varies {
                ramp(&mut scene, "X", 4.0);
            }
            let settings = MarchSettings { view_step: 0.05, shadow_step: 0.02, world_directions: 24, ..exact() };
            let render = |settings: &MarchSettings| {
                integrators::render(&scene, settings, Backend::Cpu, &|_, _| {}).expect("it renders")
            };
            let truth = render(&settings);
            let [coarse, fine] = [12, 48].map(|grid_cells| {
                let found = render(&MarchSettings { light: LightMode::Grid, grid_cells, ..settings.clone() });
                let error = |(a, b): (&[f32; 4], &[f32; 4])| f64::from((a[1] - b[1]).abs());
                let sum: f64 = found.pixels.iter().zip(&truth.pixels).map(error).sum();
                sum / truth.pixels.iter().map(|pixel| f64::from(pixel[1])).sum::<f64>()
            });
            println!("{name}, varies {varies}: error of the light grid {coarse:.2e} of 12 cells, {fine:.2e} of 48");
            // At least of first order: cells a fourth as large.
            assert!(coarse > 4.0 * fine, "{name}, {varies}");
        }
    }
}

#[test]
fn the_adapter_marches_through_the_parts_of_a_mesh() {
    if !support::require("vulkan") {
        return;
    }
    for (name, mesh) in [("torus", TestMesh::torus(12)), ("hollow", hollow())] {
        let mut scene = seen_whole(&mesh);
        ramp(&mut scene, "X", 4.0);
        let settings = MarchSettings { light: LightMode::Grid, grid_cells: 16, view_step: 0.05, ..exact() };
        let [ours, theirs] = [Backend::Cpu, Backend::Gpu]
            .map(|backend| integrators::render(&scene, &settings, backend, &|_, _| {}).expect("it renders"));
        // Of boxes: tests/march.rs.
        let found = difference(&theirs, &ours);
        println!("{name}: the adapter differs by {found:.1e}");
        assert!(found <= 5e-5, "{name}: {found:e}");
    }
}

/// An engine of the scene's own material that marches its rays to their ends.
fn engine(scene: &Scene) -> Engine {
    let model = engines::find("graph").expect("it is there");
    let changes = ["march_steps=64", "light_steps=4"].map(String::from);
    let values = model.values(None, &changes).expect("in range");
    let mut engine = model.engine(scene, &values, &Defects::NONE, 0.0).expect("an engine");
    engine.march.least_transmittance = 0.0;
    engine
}

fn engine_picture(scene: &Scene, engine: &Engine, gpu: Option<&Gpu>) -> Image {
    let settings = EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };
    EngineRenderer::new(scene, engine, gpu).expect("a renderer").picture(&settings, &|_, _| ()).expect("a picture")
}

#[test]
fn an_engine_in_a_mesh_meets_closed_forms() {
    let mut scene = homogeneous();
    in_two_parts(&mut scene);
    bounces(&mut scene, 0);
    let common = SUN * phase(0.0, 0.0) * (-0.75_f64).exp() * (1.0 - (-2.0_f64).exp());
    let mut torus = absorbing();
    TestMesh::torus(12).moved(|place| DVec3::new(-place.y, place.x, place.z)).fill(&mut torus);
    let gpu = support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"));
    for gpu in [None, gpu.as_ref()] {
        let found = engine_picture(&scene, &engine(&scene), gpu).mean();
        for channel in 0..3 {
            // The ray spreads over a thousandth of a metre.
            close(found[channel], SCATTERING[channel] * common, 1e-3);
        }
        let found = engine_picture(&torus, &engine(&torus), gpu).mean();
        close(found[0], f64::exp(-1.2), 1e-3);
    }
}

#[test]
fn an_engine_in_a_cube_in_disguise_is_that_in_the_cube() {
    let mut cube = seen_whole(&TestMesh::cuboid([-1.0; 3], [1.0; 3]));
    ramp(&mut cube, "Y", 2.0);
    let mut mesh = cube.clone();
    TestMesh::cuboid([-1.0; 3], [1.0, 0.25, 1.0]).with(&TestMesh::cuboid([-1.0, 0.25, -1.0], [1.0; 3])).fill(&mut mesh);
    let (mut plain, mut hidden) = (engine(&cube), engine(&mesh));
    assert!(matches!(hidden.container.outline, Outline::Mesh(_)) && matches!(plain.container.outline, Outline::Box(_)));
    let gpu = support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"));
    // To the exit, and as far as the engine says, beyond the exit.
    for length in [ShadowLength::ToExit, ShadowLength::Fixed(0.7)] {
        plain.light.shadow.length = length;
        hidden.light.shadow.length = length;
        let expected = engine_picture(&cube, &plain, None);
        let found = difference(&engine_picture(&mesh, &hidden, None), &expected);
        println!("{length:?}: {found:.1e}");
        assert!(found < 1e-6, "{length:?}: {found:e}");
        if let Some(gpu) = &gpu {
            // A picture of f32 against one of f64, as boxes are compared in tests/engine_graph.rs.
            let found = difference(&engine_picture(&mesh, &hidden, Some(gpu)), &expected);
            println!("{length:?} on the adapter: {found:.1e}");
            assert!(found < 200.0 * f64::from(f32::EPSILON), "{length:?}: {found:e}");
        }
    }
}

#[test]
fn an_engine_shows_single_scattering_in_a_mesh() {
    // What the deterministic march shows with light along rays; the torus has up to four parts on a ray, and shadows from part to part.
    let mut scene = seen_whole(&TestMesh::torus(12));
    scene.world.color = [0.0; 3];
    // The sun shines through the ring: along its plane.
    scene.lights[0].matrix_world =
        [[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let expected = integrators::render(&scene, &exact(), Backend::Cpu, &|_, _| {}).expect("it renders");
    let found = engine_picture(&scene, &engine(&scene), None);
    // 64 steps on at most 2.6 m of extinction 2: the midpoint rule of the light along a step errs by (0.08)^2 / 24 of its curvature, and
    // by half a step where light enters another part behind a corner.
    let error = difference(&found, &expected);
    println!("engine against march: {error:.1e}");
    assert!(error < 0.01, "{error:e}");
    // Without shadows of other parts it would be seen.
    let alone = {
        let mut alone = engine(&scene);
        alone.light.shadow.length = ShadowLength::Fixed(0.1);
        engine_picture(&scene, &alone, None)
    };
    assert!(difference(&alone, &expected) > 0.1);
}

/// Length inside, number of parts and whether the last one does not end, of rays given as origin, mark, direction and limit.
const PARTS_OF_RAYS: &str = r#"
#import cloudparity::mesh
@group(0) @binding(0) var<storage, read> asked: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4f>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    let index = invocation.x;
    if index >= arrayLength(&found) { return; }
    let begin = asked[2u * index];
    let way = asked[2u * index + 1u];
    let ray = mesh::ray_of(begin.xyz, way.xyz);
    var part = mesh::next_part(ray, -mesh::FAR, begin.w > 0.0, 0.0, way.w);
    var sum = vec4f(0.0);
    while part.end > part.begin {
        sum += vec4f(part.end - part.begin, 1.0, 0.0, 0.0);
        if part.cursor >= mesh::FAR {
            sum.z = 1.0;
            break;
        }
        part = mesh::next_part(ray, part.cursor, false, part.end, way.w);
    }
    found[index] = sum;
}
"#;

#[test]
fn the_adapter_finds_the_parts_of_rays_and_loses_none() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let module = Linker::bare().link("parts_of_rays.wgsl", PARTS_OF_RAYS).expect("it links");
    let kernel = gpu.kernel("parts_of_rays", &module, &[]).expect("a kernel");
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut meshes = vec![TestMesh::icosphere(2), TestMesh::torus(12), hollow()];
    for _ in 0..3 {
        meshes.push(blob(&mut random, 2));
        meshes.push(dart(&mut random));
    }
    let (mut aimed, mut errors) = (0, Vec::new());
    for mesh in &meshes {
        let ours = placed(mesh, DMat4::IDENTITY);
        let corners: Vec<DVec3> =
            mesh.corners().flat_map(|[a, b, c]| [a, b, c, a.midpoint(b), b.midpoint(c), c.midpoint(a)]).collect();
        let mut rays: Vec<[f32; 8]> = Vec::new();
        // What the f32 of both sides is.
        let mut add = |origin: DVec3, direction: DVec3| {
            let (origin, direction) = (origin.as_vec3(), direction.as_vec3());
            let mark = if ours.begins_inside_in_object(origin.as_dvec3()) { 1.0 } else { 0.0 };
            rays.push([origin.x, origin.y, origin.z, mark, direction.x, direction.y, direction.z, 20.0]);
        };
        for number in 0..6000 {
            let reach = if number % 2 == 0 { 4.0 } else { 0.7 };
            let origin = on_sphere(&mut random) * reach;
            add(origin, (on_sphere(&mut random) * 1.2 - origin).normalize());
        }
        let random_rays = 6000;
        for (number, &corner) in corners.iter().enumerate() {
            // Through it exactly, along an axis; and about there, from anywhere.
            let axis = DVec3::AXES[number % 3];
            let mut origin = corner;
            origin[number % 3] = -4.0;
            add(origin, axis);
            let origin = on_sphere(&mut random) * 4.0;
            add(origin, (corner - origin).normalize());
        }
        let storage = wgpu::BufferUsages::STORAGE;
        let asked = gpu.upload("asked", bytemuck::cast_slice(&rays), storage);
        let found = vec![[f32::NAN; 4]; rays.len()];
        let found = gpu.upload("found", bytemuck::cast_slice(&found), storage | wgpu::BufferUsages::COPY_SRC);
        let outline = ours.mesh().upload(&gpu, DVec3::ZERO, DVec3::ONE).expect("it fits");
        let bindings = Bindings::new().group(0, [&asked, &found]).bind(0, 7, outline.as_entire_binding());
        gpu.dispatch(&kernel, &bindings, [rays.len() as u32, 1, 1]).expect("it runs");
        let found: Vec<[f32; 4]> =
            bytemuck::pod_collect_to_vec(&gpu.read_back(&found, 16 * rays.len() as u64).expect("read"));
        for (number, (ray, [sum, _, open, _])) in rays.iter().zip(&found).enumerate() {
            // Every ray ends far outside: a part that does not end before has lost a face.
            assert!(*open == 0.0 && sum.is_finite(), "ray {number} {ray:?} is lost");
            let [origin, direction] =
                [0, 4].map(|at| DVec3::from_array(std::array::from_fn(|axis| f64::from(ray[at + axis]))));
            let mut spans = Vec::new();
            ours.spans_in_object(origin, direction, [0.0, 20.0], ray[3] > 0.0, &mut spans);
            if number < random_rays {
                errors.push((f64::from(*sum) - length(&spans)).abs());
            } else {
                aimed += 1;
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    let at = |part: f64| errors[((errors.len() - 1) as f64 * part) as usize];
    println!(
        "{aimed} rays aimed at vertices and edges, none lost; lengths of {} others differ by {:.1e} in the middle, {:.1e} for 99.9 %, {:.1e} at most",
        errors.len(),
        at(0.5),
        at(0.999),
        at(1.0)
    );
    // Distances up to 6 round to f32 a few times, 1e-6, over the sine of the angle at which a face is met: of random rays
    // a thousandth meet one at less than 0.03, and a part may be left out that is shorter than its error.
    assert!(at(0.5) <= 2e-6 && at(0.999) <= 1e-4, "{} {}", at(0.5), at(0.999));
}

#[test]
fn the_adapter_traces_paths_through_meshes() {
    if !support::require("vulkan") {
        return;
    }
    // Multiple scattering, absorption, a sun and a world; a density that varies. One scene: software adapters take a minute for its kernel.
    let mut scene = seen_whole(&TestMesh::torus(12));
    scene.film.resolution = [8, 8];
    bounces(&mut scene, 4);
    ramp(&mut scene, "X", 4.0);
    all_meet(estimate_on(Backend::Gpu, &scene, 1 << 8), estimate(&scene, 1 << 9));
}

#[test]
fn paths_through_an_engines_medium_stay_in_the_mesh() {
    let scene = seen_whole(&TestMesh::torus(12));
    let engine = engine(&scene);
    let medium = engine.medium().expect("a medium");
    let direct = ObjectMedium::new(scene.graph(), &scene.volume).expect("a medium");
    assert!(medium.mesh.is_some() && direct.mesh.is_some() && medium.bounds == direct.bounds);
}

#[test]
fn what_meshes_cannot_be_and_where_they_are_refused_is_said() {
    let read = |vertices: serde_json::Value, triangles: serde_json::Value| {
        let mut value = serde_json::to_value(homogeneous()).expect("JSON");
        value["volume"]["shape"] = serde_json::json!({"type": "mesh", "vertices": vertices, "triangles": triangles});
        Scene::from_value(value, "x").expect_err("it is refused").to_string()
    };
    let corners = serde_json::json!([[0, 0, 0], [1, 0, 0], [0, 1, 0]]);
    for (error, expected) in [
        (read(serde_json::json!([]), serde_json::json!([])), "$.volume.shape.triangles"),
        (read(corners.clone(), serde_json::json!([])), "$.volume.shape.triangles"),
        (read(corners.clone(), serde_json::json!([[0, 1, 2], [0, 1, 3]])), "$.volume.shape.triangles[1]"),
        (
            read(serde_json::json!([[0, 0, 0], [1, 0, 0], [0, 3, 0]]), serde_json::json!([[0, 1, 2]])),
            "$.volume.shape.vertices[2]",
        ),
        (read(serde_json::json!([[0, 0, 0], [1, null, 0]]), serde_json::json!([[0, 1, 1]])), "$.volume.shape"),
    ] {
        assert!(error.contains(expected), "{error}");
    }
    let bad = Mesh::new("$.volume.shape", &[[0.0, f32::NAN, 0.0]], &[[0, 0, 0]]).err().expect("no number");
    assert!(bad.to_string().contains("$.volume.shape.vertices[0]"), "{bad}");
    let mut moved = homogeneous();
    TestMesh::cuboid([-1.0; 3], [1.0; 3]).divided().fill(&mut moved);
    let unit = Domain::Object.place(&moved).expect("a divided cube is a box").unit;
    assert!((unit - 2.0).abs() < 1e-12, "{unit}");
}

/// Meshes of Blender's own operators, as JSON by name.
const OPERATORS: &str = r#"
import json
import bpy

def mesh(operator, **arguments):
    operator(**arguments)
    item = bpy.context.object
    if operator is bpy.ops.mesh.primitive_cube_add:
        bevel = item.modifiers.new("Bevel", "BEVEL")
        bevel.width, bevel.segments = 0.3, 2
    found = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    found.calc_loop_triangles()
    return {"vertices": [list(vertex.co) for vertex in found.vertices],
            "triangles": [list(triangle.vertices) for triangle in found.loop_triangles]}

bpy.ops.wm.read_factory_settings(use_empty=True)
create = bpy.ops.mesh
print("MESHES " + json.dumps({
    "sphere": mesh(create.primitive_uv_sphere_add),
    "torus": mesh(create.primitive_torus_add),
    "monkey": mesh(create.primitive_monkey_add),
    "bevel": mesh(create.primitive_cube_add),
}))
"#;

fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0) / count).sqrt())
}

/// Means of the quadrants of a picture.
fn quadrants(image: &Image) -> [f64; 4] {
    let mut sums = [0.0; 4];
    for (index, pixel) in image.pixels.iter().enumerate() {
        let (column, line) = (index % image.width, index / image.width);
        let quadrant = 2 * usize::from(2 * line >= image.height) + usize::from(2 * column >= image.width);
        sums[quadrant] += f64::from(pixel[1]) * 4.0 / image.pixels.len() as f64;
    }
    sums
}

#[test]
fn cycles_agrees_on_meshes_of_its_own_operators() {
    if !support::require("bpy") {
        return;
    }
    let output =
        std::process::Command::new(bridge::interpreter()).args(["-B", "-c", OPERATORS]).output().expect("Python runs");
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().find_map(|line| line.strip_prefix("MESHES ")).expect("the meshes are printed");
    let meshes: serde_json::Value = serde_json::from_str(line).expect("JSON");
    let cache = tempfile::tempdir().expect("a folder");
    let seeds: Vec<u32> = (0..6).collect();
    // Cycles' own systematic error at 256 samples (specification of Cycles' transport, 5.3).
    let systematic = 0.005;
    for (name, mesh, camera) in [
        ("sphere", "sphere", [0.0, -5.0, 0.0]),
        ("torus", "torus", [0.0, -5.0, 0.0]),
        ("monkey", "monkey", [0.0, -5.0, 0.0]),
        ("bevelled cube", "bevel", [0.0, -5.0, 0.0]),
        ("camera in the sphere", "sphere", [0.2, -0.3, 0.1]),
        ("camera in the tube of the torus", "torus", [0.0, -1.0, 0.05]),
    ] {
        let mut scene = homogeneous();
        let mesh = TestMesh {
            vertices: serde_json::from_value(meshes[mesh]["vertices"].clone()).expect("vertices"),
            triangles: serde_json::from_value(meshes[mesh]["triangles"].clone()).expect("triangles"),
        };
        mesh.fill(&mut scene);
        // Looked at from above at an angle, turned, stretched.
        scene.volume.matrix_world =
            [[0.9, -0.3, 0.0, 0.0], [0.3, 0.9, -0.4, 0.0], [0.1, 0.4, 1.1, 0.0], [0.0, 0.0, 0.0, 1.0]];
        scene.film.resolution = [16, 16];
        scene.camera.ortho_scale = 2.4;
        if name.starts_with("camera") {
            scene.camera.projection = cloudparity::scene::Projection::Perspective;
            // Places of the object's frame: the camera stays in the tube.
            let matrix = cloudparity::scene::matrix_to_glam(&scene.volume.matrix_world);
            let place = matrix.transform_point3(DVec3::from(camera));
            for axis in 0..3 {
                scene.camera.matrix_world[axis][3] = place[axis] as f32;
            }
            scene.camera.clip_start = 0.01;
        }
        set(&mut scene, "Density", Input::Number(1.5));
        set(&mut scene, "Anisotropy", Input::Number(0.3));
        scene.world.color = [0.3; 3];
        bounces(&mut scene, 2);
        let settings = ReferenceSettings { samples: 256, ..ReferenceSettings::default() };
        let theirs: Vec<[f64; 4]> = references(&scene, &settings, &seeds, cache.path(), |_| {})
            .expect("Cycles renders")
            .iter()
            .map(|reference| quadrants(&Image::read_exr(&reference.path).expect("a picture")))
            .collect();
        let settings = PathSettings { samples: 256, ..PathSettings::default() };
        let ours: Vec<[f64; 4]> = path::render_replicas(&scene, &settings, Backend::Cpu, &seeds, &|_, _| {})
            .expect("it renders")
            .iter()
            .map(quadrants)
            .collect();
        for quadrant in 0..4 {
            let of = |pictures: &[[f64; 4]]| {
                mean_and_error(&pictures.iter().map(|picture| picture[quadrant]).collect::<Vec<_>>())
            };
            let ((own, own_error), (cycles, error)) = (of(&ours), of(&theirs));
            let together = own_error.hypot(error);
            println!(
                "{name}, quadrant {quadrant}: {own:.5} ({own_error:.1e}), Cycles {cycles:.5} ({error:.1e}): {:+.2} %, {:+.1} errors",
                100.0 * (own / cycles - 1.0),
                (own - cycles) / together
            );
            assert!(together < 0.01 * cycles, "{name}: too noisy to tell");
            assert!((own - cycles).abs() <= 4.0 * together + systematic * cycles, "{name}, quadrant {quadrant}");
        }
    }
}
