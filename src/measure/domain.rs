//! Points at which fields are compared.
//!
//! * `box`: uniform in the volume's bounds, cut to where the field is not provably constant (by
//!   [`Program::bounds`]), with a tenth of that extent added on each side that was cut;
//! * `wide`: the same in bounds 100 times as large;
//! * `adversarial`: where evaluators go wrong. Cell corners, edges and faces of every texture,
//!   zeros of both signs, huge and denormal coordinates, both sides of the edges of every Map Range,
//!   and points without a Voronoi feature point within distance 1.

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::graph::evaluate::{Arithmetic, Points};
use crate::graph::{Instruction, Program, Target};
use crate::nodes;
use crate::scene::{Bounds, Input, Node, Scene};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How much larger than the volume `wide` is.
const WIDE: f32 = 100.0;

/// Share of the cut region that is added on each side.
const MARGIN: f32 = 0.1;

/// Bisection steps that place an edge: one per bit of an f32 significand and exponent.
const BISECTIONS: usize = 40;

/// Magnitudes of coordinates that evaluators treat specially: zero, the smallest and a larger denormal, the
/// smallest normal number, a tiny one, 2^-24, the number below 1, cell borders, far from the origin.
const SPECIAL: [f32; 11] =
    [0.0, 1e-45, 1e-40, f32::MIN_POSITIVE, 1e-9, 5.960_464_5e-8, 0.999_999_94, 0.5, 1.0, 1e3, 1e5];

choice! {
    "lowercase",
    /// Where points lie.
    pub enum Domain {
        /// The volume's bounds, where the field varies.
        Box,
        /// 100 times the bounds, where the field varies.
        Wide,
        /// Cell borders, special numbers, edges of remaps, far points of Voronoi cells.
        Adversarial,
    }
}

impl Domain {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// `count` points of a domain; `program` is the scene's density. Equal arguments give equal points.
pub fn points(domain: Domain, scene: &Scene, program: &Program, count: usize, seed: u64) -> Result<Vec<[f32; 3]>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let bounds = scene.volume.bounds;
    let wide = Bounds { min: bounds.min.map(|x| x * WIDE), max: bounds.max.map(|x| x * WIDE) };
    match domain {
        Domain::Box => Ok(uniform(&region(program, bounds)?, count, &mut random)),
        Domain::Wide => Ok(uniform(&region(program, wide)?, count, &mut random)),
        Domain::Adversarial => adversarial(scene, program, &region(program, bounds)?, count, &mut random),
    }
}

fn uniform(bounds: &Bounds, count: usize, random: &mut ChaCha8Rng) -> Vec<[f32; 3]> {
    (0..count).map(|_| inside(bounds, random)).collect()
}

fn inside(bounds: &Bounds, random: &mut ChaCha8Rng) -> [f32; 3] {
    std::array::from_fn(|axis| {
        let (low, high) = (bounds.min[axis], bounds.max[axis]);
        (low + (high - low) * random.random::<f32>()).clamp(low, high)
    })
}

/// The part of `bounds` outside of which every output is provably constant, with `MARGIN`.
/// All of `bounds` where nothing can be cut off.
pub fn region(program: &Program, bounds: Bounds) -> Result<Bounds> {
    let constant = |low: [f32; 3], high: [f32; 3]| -> Result<bool> {
        Ok(program.bounds(low, high)?.iter().all(|value| !value.may_be_nan && value.low == value.high))
    };
    if constant(bounds.min, bounds.max)? {
        return Ok(bounds);
    }
    let mut cut = bounds;
    // Height first: clouds are flat, and a thin region makes the bounds of the others tighter.
    for axis in [2, 0, 1] {
        for upper in [false, true] {
            let mut outside = if upper { cut.max[axis] } else { cut.min[axis] };
            let mut within = if upper { cut.min[axis] } else { cut.max[axis] };
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (outside + within);
                let (mut low, mut high) = (cut.min, cut.max);
                if upper {
                    low[axis] = middle
                } else {
                    high[axis] = middle
                }
                if constant(low, high)? { outside = middle } else { within = middle }
            }
            if upper { cut.max[axis] = outside } else { cut.min[axis] = outside }
        }
    }
    let mut result = cut;
    for axis in 0..3 {
        let margin = MARGIN * (cut.max[axis] - cut.min[axis]);
        if cut.min[axis] > bounds.min[axis] {
            result.min[axis] = (cut.min[axis] - margin).max(bounds.min[axis]);
        }
        if cut.max[axis] < bounds.max[axis] {
            result.max[axis] = (cut.max[axis] + margin).min(bounds.max[axis]);
        }
    }
    Ok(result)
}

fn adversarial(
    scene: &Scene,
    program: &Program,
    region: &Bounds,
    count: usize,
    random: &mut ChaCha8Rng,
) -> Result<Vec<[f32; 3]>> {
    let mut kinds: Vec<Vec<[f32; 3]>> = vec![special_points(region, count / 4, random)];
    let textures: Vec<&Instruction> = program.instructions.iter().filter(|node| is_texture(node)).collect();
    let edges: Vec<&Instruction> = program
        .instructions
        .iter()
        .filter(|node| node.node_type.type_name == nodes::map_range::TYPE.type_name)
        .collect();
    let share = |total: usize, parts: usize| total.div_ceil(parts.max(1));
    for texture in &textures {
        kinds.push(lattice_points(scene, texture, region, share(count / 4, textures.len()), random)?);
        if texture.node_type.type_name == nodes::voronoi_texture::TYPE.type_name {
            kinds.push(far_points(scene, texture, region, share(count / 4, textures.len()), random)?);
        }
    }
    for edge in &edges {
        kinds.push(remap_edges(scene, edge, region, share(count / 4, edges.len()), random)?);
    }
    let mut points: Vec<[f32; 3]> = kinds.into_iter().flatten().take(count).collect();
    // What a scene has no cases for is filled with special coordinates.
    let missing = count - points.len();
    points.extend(special_points(region, missing, random));
    Ok(points)
}

/// Special coordinates on some axes, inside the region on the others.
fn special_points(region: &Bounds, count: usize, random: &mut ChaCha8Rng) -> Vec<[f32; 3]> {
    (0..count)
        .map(|_| {
            let base = inside(region, random);
            base.map(|value| {
                let sign = if random.random() { 1.0 } else { -1.0 };
                let special = sign * SPECIAL[random.random_range(0..SPECIAL.len())];
                if random.random() { special } else { value }
            })
        })
        .collect()
}

fn is_texture(node: &Instruction) -> bool {
    node.node_type.inputs_of(&node.mode).any(|socket| socket.generated_when_unlinked)
}

/// The node as a target's place: group nodes and its own name.
fn place(node: &Instruction) -> (Vec<String>, String) {
    let mut groups: Vec<String> = node.label.split('/').map(str::to_owned).collect();
    let name = groups.pop().unwrap_or_default();
    (groups, name)
}

fn input(node: &Instruction, socket: &str) -> Target {
    let (groups, node) = place(node);
    Target { groups, node, output: None, input: Some(socket.to_owned()) }
}

/// Points whose scaled texture coordinates are integers on one, two or three axes, or next to them,
/// where the coordinate is an invertible affine image of the position. No points elsewhere.
fn lattice_points(
    scene: &Scene,
    texture: &Instruction,
    region: &Bounds,
    count: usize,
    random: &mut ChaCha8Rng,
) -> Result<Vec<[f32; 3]>> {
    let program = Program::compile(scene, &[input(texture, "Vector"), input(texture, "Scale")])?;
    let frame = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 2.0, 3.0]];
    let values = program.evaluate(Points::new(&frame), Arithmetic::Unrounded)?;
    let coordinate = |row: usize| glam::DVec3::from_slice(&values[4 * row..]) * values[4 * row + 3];
    let origin = coordinate(0);
    let axes = glam::DMat3::from_cols(coordinate(1) - origin, coordinate(2) - origin, coordinate(3) - origin);
    let predicted = origin + axes * glam::DVec3::new(1.0, 2.0, 3.0);
    // The tolerance only tells affine from not affine; the points need no accuracy.
    let affine = (predicted - coordinate(4)).length() <= 1e-4 * (1.0 + predicted.length());
    if !affine || axes.determinant().abs() < 1e-12 {
        return Ok(Vec::new());
    }
    let inverse = axes.inverse();
    let mut points = Vec::with_capacity(count);
    for number in 0..count {
        let base = glam::DVec3::from(inside(region, random).map(f64::from));
        let scaled = origin + axes * base;
        let on_lattice = 1 + number % 3;
        let first = random.random_range(0..3);
        let mut target = scaled.to_array();
        for step in 0..on_lattice {
            let axis = (first + step) % 3;
            target[axis] = target[axis].round();
        }
        let point = (inverse * (glam::DVec3::from(target) - origin)).to_array().map(|x| x as f32);
        points.push(point.map(|x| nudge(x, random.random_range(-1..=1))));
    }
    Ok(points)
}

/// The f32 value `steps` units in the last place away from zero.
fn nudge(value: f32, steps: i32) -> f32 {
    if value == 0.0 { value } else { f32::from_bits(value.to_bits().wrapping_add_signed(steps)) }
}

/// Points on both sides of the place where a Map Range's value passes an end of its source range.
fn remap_edges(
    scene: &Scene,
    remap: &Instruction,
    region: &Bounds,
    count: usize,
    random: &mut ChaCha8Rng,
) -> Result<Vec<[f32; 3]>> {
    let vector = remap.mode.choice("data_type") != "FLOAT";
    let sockets =
        if vector { ["Vector", "From_Min_FLOAT3", "From_Max_FLOAT3"] } else { ["Value", "From Min", "From Max"] };
    let program = Program::compile(scene, &sockets.map(|socket| input(remap, socket)))?;
    let width = if vector { 3 } else { 1 };
    // Which side of the edge each point is on.
    let above = |positions: &[[f32; 3]], end: usize| -> Result<Vec<bool>> {
        let values = program.evaluate_single(Points::new(positions))?;
        Ok(values.chunks(3 * width).map(|row| row[0] > row[end * width]).collect())
    };
    let mut points = Vec::new();
    for end in [1, 2] {
        let half = count.div_ceil(4);
        let (first, second) = (uniform(region, 4 * half, random), uniform(region, 4 * half, random));
        let (a, b) = (above(&first, end)?, above(&second, end)?);
        let mut pairs: Vec<([f32; 3], [f32; 3], bool)> = (0..4 * half)
            .filter(|&index| a[index] != b[index])
            .map(|index| (first[index], second[index], a[index]))
            .take(half)
            .collect();
        for _ in 0..BISECTIONS {
            let middles: Vec<[f32; 3]> =
                pairs.iter().map(|(a, b, _)| std::array::from_fn(|axis| 0.5 * (a[axis] + b[axis]))).collect();
            for ((pair, middle), side) in pairs.iter_mut().zip(&middles).zip(above(&middles, end)?) {
                if side == pair.2 { pair.0 = *middle } else { pair.1 = *middle }
            }
        }
        points.extend(pairs.into_iter().flat_map(|(a, b, _)| [a, b]));
    }
    Ok(points)
}

/// Points whose nearest feature point of the Voronoi's first octave is farther than 1; where there
/// are fewer than asked for among 64 times as many candidates, the farthest.
fn far_points(
    scene: &Scene,
    texture: &Instruction,
    region: &Bounds,
    count: usize,
    random: &mut ChaCha8Rng,
) -> Result<Vec<[f32; 3]>> {
    if !matches!(texture.mode.choice("feature"), "F1" | "F2" | "SMOOTH_F1") {
        return Ok(Vec::new());
    }
    let (groups, name) = place(texture);
    let mut plain = scene.clone();
    let node = find_node(&mut plain, &groups, &name)?;
    node.properties.insert("normalize".into(), false.into());
    node.properties.insert("feature".into(), "F1".into());
    node.inputs.insert("Detail".into(), Input::Number(0.0));
    let distance = Target { groups, node: name, output: Some("Distance".into()), input: None };
    let program = Program::compile(&plain, &[distance])?;
    // About one point in a thousand has its nearest cell point farther than 1 in 4D.
    let candidates = uniform(region, (64 * count).max(1 << 16), random);
    let values = program.evaluate_single(Points::new(&candidates))?;
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    // Random among those beyond 1, not only the most extreme corner of the field; where none is
    // (fewer dimensions, low Randomness), the farthest there are.
    let beyond = match order.iter().take_while(|&&index| values[index] > 1.0).count() {
        0 => count,
        found => found,
    };
    Ok((0..count).map(|_| candidates[order[random.random_range(0..beyond)]]).collect())
}

/// The node of that name behind these group nodes.
fn find_node<'a>(scene: &'a mut Scene, groups: &[String], name: &str) -> Result<&'a mut Node> {
    let graph = scene.graph_mut();
    let mut tree: Option<String> = None;
    for caller in groups {
        let nodes = match &tree {
            None => &graph.nodes,
            Some(group) => graph.group(group).map_or(&graph.nodes, |group| &group.nodes),
        };
        tree = nodes.iter().find(|node| node.name == *caller).and_then(|node| node.group.clone());
    }
    let nodes = match tree {
        None => Some(&mut graph.nodes),
        Some(name) => graph.groups.iter_mut().find(|group| group.name == name).map(|group| &mut group.nodes),
    };
    nodes.and_then(|nodes| nodes.iter_mut().find(|node| node.name == name)).ok_or_else(|| {
        Error::new(
            format!("node {}/{name}", groups.join("/")),
            "no such node",
            "a node of the graph",
            "Export the scene again.",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clouds() -> Scene {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/procedural-clouds.scene.json");
        Scene::load(&path).expect("the committed scene loads")
    }

    #[test]
    fn every_domain_gives_as_many_points_as_asked_and_the_same_again() {
        let scene = clouds();
        let program = Program::density(&scene).expect("the scene compiles");
        for domain in [Domain::Box, Domain::Wide, Domain::Adversarial] {
            let first = points(domain, &scene, &program, 1000, 7).expect("points");
            let again = points(domain, &scene, &program, 1000, 7).expect("points");
            assert_eq!(first.len(), 1000);
            assert_eq!(first, again);
            assert_ne!(first, points(domain, &scene, &program, 1000, 8).expect("points"));
        }
    }

    #[test]
    fn far_points_are_beyond_one() {
        let scene = clouds();
        let program = Program::density(&scene).expect("the scene compiles");
        let voronoi = program.instructions.iter().find(|node| node.node_type.module == "voronoi_texture");
        let voronoi = voronoi.expect("the cloud has Voronoi textures");
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let bounds = scene.volume.bounds;
        let found = far_points(&scene, voronoi, &bounds, 20, &mut random).expect("points");
        let mut plain = scene.clone();
        let (groups, name) = place(voronoi);
        let node = find_node(&mut plain, &groups, &name).expect("the node");
        node.properties.insert("normalize".into(), false.into());
        node.inputs.insert("Detail".into(), Input::Number(0.0));
        let target = Target { groups, node: name, output: Some("Distance".into()), input: None };
        let values = Program::compile(&plain, &[target]).expect("compiles").evaluate_single(Points::new(&found));
        assert!(values.expect("values").iter().all(|&value| value > 1.0));
    }
}
