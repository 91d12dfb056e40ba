//! Comparing our evaluators with live Cycles, point by point.
//!
//! `probe` evaluates the same f32 points in Cycles and here and reduces the differences to
//! [`Figures`]; [`crate::measure::domain`] chooses the points, [`slices`] samples planes for pictures. [`super::nodes`] does the same for every
//! mode of every node, for random inputs of a material and for graphs of many nodes.

pub mod slices;

pub use crate::measure::domain::{self, Domain};
pub use crate::measure::errors::values::{Comparison, Figures};
pub use crate::measure::evaluators::{Comparisons, Evaluator, Reference, Request, compare, evaluate, figures};

use crate::base::error::Result;
use crate::base::identity::Identity;
use crate::bridge::Message;
use crate::graph::{Program, Target};
use crate::scene::Scene;
use indexmap::IndexMap;
use serde::Serialize;

/// What a probe found. Serialises as `probe.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Probe {
    /// The build that evaluated ours.
    pub build: Identity,
    /// Name of the scene.
    pub scene: String,
    /// The socket that was evaluated.
    pub target: String,
    /// Number of points.
    pub points: usize,
    /// Where they lie.
    pub domain: &'static str,
    /// Seed of the points.
    pub seed: u64,
    /// What ours are compared with.
    pub reference: Reference,
    /// Ours, by name.
    pub evaluators: IndexMap<&'static str, Figures>,
}

/// The points of a probe and how it judges.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Where the points lie.
    pub domain: Domain,
    /// How many.
    pub points: usize,
    /// Seed of the points.
    pub seed: u64,
    /// See [`Request::rounding_bound`].
    pub rounding_bound: bool,
}

/// Compares sockets of a scene at points of a domain: one probe for each, in their order.
pub fn probe(
    scene: &Scene,
    targets: &[Target],
    sampling: Sampling,
    evaluators: &[Evaluator],
    receive: impl FnMut(Message),
) -> Result<Vec<Probe>> {
    let Sampling { domain, points, seed, rounding_bound } = sampling;
    // Where no closure has the one density, points lie where the target itself varies.
    let positions: Vec<Vec<[f32; 3]>> = targets
        .iter()
        .map(|target| {
            let program = Program::density(scene).or_else(|_| Program::compile(scene, std::slice::from_ref(target)))?;
            domain::points(domain, scene, &program, points, seed)
        })
        .collect::<Result<_>>()?;
    let requests: Vec<Request<'_>> = targets
        .iter()
        .zip(&positions)
        .map(|(target, positions)| Request { scene, target: target.clone(), positions, evaluators, rounding_bound })
        .collect();
    let (found, reference) = compare(&requests, receive)?;
    let probe = |((target, positions), found): ((&Target, &Vec<[f32; 3]>), Comparisons)| Probe {
        build: Identity::current().clone(),
        scene: scene.name.clone(),
        target: target.name(),
        points: positions.len(),
        domain: domain.name(),
        seed,
        reference: reference.clone(),
        evaluators: figures(found),
    };
    Ok(targets.iter().zip(&positions).zip(found).map(probe).collect())
}
