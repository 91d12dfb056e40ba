//! Asking live Cycles for the values of a graph at given points.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::temporary;
use crate::bridge::{CyclesKernel, Message, releases, run_script};
use crate::graph::Target;
use crate::scene::{Release, Scene};
use serde_json::{Value as Json, json};

/// One graph, its points and the sockets asked for.
pub struct Job<'a> {
    /// The scene whose graph is asked.
    pub scene: &'a Scene,
    /// Object-space positions.
    pub positions: &'a [[f32; 3]],
    /// Per-point attributes by name.
    pub attributes: &'a [(String, Vec<[f32; 3]>)],
    /// Sockets to read.
    pub targets: Vec<Target>,
    /// Number of renders; more than one only to measure time.
    pub repeat: usize,
    /// Evaluations of each point in a render; more than one only to measure time.
    pub samples: usize,
}

/// What Cycles said about one job.
pub struct Answer {
    /// Per target: point by point, its components.
    pub values: Vec<Vec<f32>>,
    /// Per target: 1 or 3.
    pub components: Vec<usize>,
    /// Seconds of each render.
    pub render_seconds: Vec<f64>,
}

/// Answers of a call and the Blender that gave them.
pub struct Answers {
    /// In the order of the jobs.
    pub jobs: Vec<Answer>,
    /// Blender's version.
    pub blender: String,
}

/// The release whose values the jobs' graphs have, which is one.
fn release_of(jobs: &[Job<'_>]) -> Result<Release> {
    let mut releases = jobs.iter().map(|job| job.scene.graph().blender);
    let first = releases.next().unwrap_or_default();
    match releases.find(|release| *release != first) {
        None => Ok(first),
        Some(other) => Err(Error::new(
            "the graphs that are asked together",
            format!("values of Blender {first} and of {other}"),
            "values of one release",
            "Ask for them one after the other.",
        )),
    }
}

/// Evaluates the jobs in one Blender process, on all cores.
pub fn ask(jobs: &[Job<'_>], kernel: CyclesKernel, mut receive: impl FnMut(Message)) -> Result<Answers> {
    ask_on(jobs, kernel, 0, &mut receive)
}

/// [`ask`] on this many threads of rendering (0 for all).
pub fn ask_on(
    jobs: &[Job<'_>],
    kernel: CyclesKernel,
    threads: u32,
    receive: &mut dyn FnMut(Message),
) -> Result<Answers> {
    let folder = temporary::folder()?;
    let mut requests = Vec::new();
    for (number, job) in jobs.iter().enumerate() {
        let save = |name: &str, points: &[[f32; 3]]| -> Result<String> {
            let path = folder.path().join(format!("{number}-{name}.npy"));
            files::write_values(&path, points.as_flattened(), 3)?;
            Ok(path.display().to_string())
        };
        let points = save("points", job.positions)?;
        let mut attributes = serde_json::Map::new();
        for (index, (name, values)) in job.attributes.iter().enumerate() {
            attributes.insert(name.clone(), save(&format!("attribute-{index}"), values)?.into());
        }
        let outputs: Vec<Json> = job
            .targets
            .iter()
            .enumerate()
            .map(|(index, target)| {
                json!({"target": target, "file": folder.path().join(format!("{number}-output-{index}.npy"))})
            })
            .collect();
        let mut request = json!({
            "scene": job.scene, "points": points, "attributes": attributes, "outputs": outputs, "repeat": job.repeat,
            "samples": job.samples,
        });
        // A surface, which a probe renders, has no grid: its values come with the points.
        if let Some(grid) = &job.scene.volume.grid {
            let path = folder.path().join(format!("{number}-grid.npy"));
            files::write_array(&path, &grid.values())?;
            request["grid"] = json!({"values": path, "to_index": grid.to_index()});
        }
        requests.push(request);
    }
    let request = json!({"jobs": requests, "kernel": kernel.name(), "threads": threads});
    let release = release_of(jobs)?;
    let result = releases::with_values_of(release, || run_script("probe.py", &request, kernel, receive))?;
    let broken = || Error::new("script probe.py", result.to_string(), "an answer per job", "Run cloudparity doctor.");
    let mut answers = Vec::new();
    for (number, job) in jobs.iter().enumerate() {
        let answer = &result["jobs"][number];
        let mut values = Vec::new();
        let mut components = Vec::new();
        for index in 0..job.targets.len() {
            let (found, _) = files::read_values(&folder.path().join(format!("{number}-output-{index}.npy")))?;
            let count = answer["outputs"][index]["components"].as_u64().ok_or_else(broken)? as usize;
            if found.len() != count * job.positions.len() {
                return Err(broken());
            }
            values.push(found);
            components.push(count);
        }
        let render_seconds =
            answer["render_seconds"].as_array().ok_or_else(broken)?.iter().filter_map(Json::as_f64).collect();
        answers.push(Answer { values, components, render_seconds });
    }
    Ok(Answers { jobs: answers, blender: result["blender"].as_str().unwrap_or_default().to_owned() })
}
