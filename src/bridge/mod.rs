//! The Python boundary: finding the interpreter, running a script of `blend/`, reading its answers.
//!
//! A script reads one JSON request on stdin and answers with JSON lines (`hello`, `progress`,
//! `warning`, then `done` or `error`). The scripts are embedded in the program and unpacked once
//! per version, so that the program works from any folder.

pub mod probe;
pub mod reference;
pub mod volume_grid;

/// Tells the rest of the program what only Python can do: reading OpenVDB files. Further calls do nothing.
pub fn install() {
    crate::scene::volume_grid::register_reader(volume_grid::read);
}

use crate::base::error::{Error, Result};
use crate::base::files;
use serde_json::Value as Json;
use std::io::{BufRead, BufReader, Lines, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

macro_rules! scripts {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../blend/", $name)))),*]
    };
}

/// Every script and module of `blend/` that the program runs, by file name.
pub const SCRIPTS: &[(&str, &str)] = scripts!(
    "blender_file.py",
    "build_scene.py",
    "compare_images.py",
    "convergence_plot.py",
    "cycles_settings.py",
    "display_picture.py",
    "export_scene.py",
    "false_colour.py",
    "graph_builder.py",
    "graph_reader.py",
    "image_metrics.py",
    "model_comparison_plot.py",
    "node_data.py",
    "optimiser.py",
    "picture_grid.py",
    "plots.py",
    "point_probe.py",
    "probe.py",
    "probe_graph.py",
    "protocol.py",
    "reference.py",
    "reference_render.py",
    "replica_statistics.py",
    "rna.py",
    "sample_errors.py",
    "scene_builder.py",
    "scene_io.py",
    "scene_reader.py",
    "study_plot.py",
    "tuning_plot.py",
    "volume_grid.py",
);

/// Environment variable that names the interpreter.
pub const INTERPRETER_VARIABLE: &str = "CLOUDPARITY_PYTHON";

/// Cycles' kernel for a script that renders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CyclesKernel {
    /// No fused operations: the reference for values.
    Sse42,
    /// What Cycles chooses by itself.
    Default,
}

impl CyclesKernel {
    /// The name in requests and results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sse42 => "sse42",
            Self::Default => "default",
        }
    }
}

/// Progress of a running script. What it leaves out or changes is a warning of [`log`].
#[derive(Debug, Clone)]
pub struct Message {
    /// Fraction done.
    pub done: f64,
    /// Of what.
    pub what: String,
}

/// The interpreter: `CLOUDPARITY_PYTHON`, else `.venv` in this folder or one above, else beside the
/// source, else `python3`.
pub fn interpreter() -> PathBuf {
    if let Some(path) = std::env::var_os(INTERPRETER_VARIABLE) {
        return PathBuf::from(path);
    }
    let current = std::env::current_dir().unwrap_or_default();
    let folders = current.ancestors().chain([Path::new(env!("CARGO_MANIFEST_DIR"))]);
    folders.map(|folder| folder.join(".venv/bin/python")).find(|path| path.exists()).unwrap_or_else(|| "python3".into())
}

/// Folder with the scripts of this version, which are unpacked where they are missing.
pub fn script_folder() -> Result<PathBuf> {
    let all: String = SCRIPTS.iter().flat_map(|(name, text)| [*name, *text]).collect();
    let user = std::env::var("USER").unwrap_or_default();
    let folder = std::env::temp_dir().join(format!("cloudparity-{user}-{}", &files::sha256(all.as_bytes())[..16]));
    for (name, text) in SCRIPTS {
        let path = folder.join(name);
        // A file that was changed or cut short by a full disk is written again.
        if std::fs::read_to_string(&path).ok().as_deref() != Some(*text) {
            files::write_atomically(&path, text.as_bytes())?;
        }
    }
    Ok(folder)
}

/// Runs a script of `blend/` and returns the result of its `done` message.
pub fn run_script(name: &str, request: &Json, kernel: CyclesKernel, receive: impl FnMut(Message)) -> Result<Json> {
    let mut conversation = Conversation::start(name, kernel)?;
    // A script that stops before it has read its request breaks the pipe; its answer says why.
    let _ = conversation.say(&request.to_string());
    conversation.requests = None;
    conversation.answer(receive)
}

/// A script of `blend/` that answers one request after another, in one process that ends with the value.
pub struct Conversation {
    name: String,
    child: Child,
    requests: Option<ChildStdin>,
    answers: Lines<BufReader<ChildStdout>>,
    /// The last lines that it wrote to stderr, when it has ended.
    log: Option<JoinHandle<String>>,
}

impl Conversation {
    /// Starts a script.
    pub fn start(name: &str, kernel: CyclesKernel) -> Result<Self> {
        let python = interpreter();
        let script = script_folder()?.join(name);
        let mut command = Command::new(&python);
        command.arg(&script).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.env("PYTHONDONTWRITEBYTECODE", "1");
        match kernel {
            CyclesKernel::Sse42 => command.env("CYCLES_CPU_NO_AVX2", "1"),
            CyclesKernel::Default => command.env_remove("CYCLES_CPU_NO_AVX2"),
        };
        let mut child = command.spawn().map_err(|cause| {
            Error::new(
                format!("interpreter {}", python.display()),
                cause.to_string(),
                "CPython 3.11 with the packages of requirements.txt",
                format!("Run make setup, or set {INTERPRETER_VARIABLE} to the interpreter."),
            )
        })?;
        let stderr = child.stderr.take().expect("stderr is piped");
        let log = std::thread::spawn(move || {
            let lines: Vec<String> = BufReader::new(stderr).lines().map_while(std::result::Result::ok).collect();
            lines[lines.len().saturating_sub(8)..].join(" | ")
        });
        Ok(Self {
            name: name.to_owned(),
            requests: child.stdin.take(),
            answers: BufReader::new(child.stdout.take().expect("stdout is piped")).lines(),
            child,
            log: Some(log),
        })
    }

    /// Sends a request, which has one line, and returns the result of its `done` message.
    pub fn ask(&mut self, request: &Json, receive: impl FnMut(Message)) -> Result<Json> {
        let _ = self.say(&format!("{request}\n"));
        self.answer(receive)
    }

    fn say(&mut self, text: &str) -> std::io::Result<()> {
        let Some(stdin) = &mut self.requests else { return Ok(()) };
        stdin.write_all(text.as_bytes())?;
        stdin.flush()
    }

    fn answer(&mut self, mut receive: impl FnMut(Message)) -> Result<Json> {
        while let Some(Ok(line)) = self.answers.next() {
            let Ok(message) = serde_json::from_str::<Json>(&line) else { continue };
            let text = |key: &str| message[key].as_str().unwrap_or_default().to_owned();
            match message["event"].as_str() {
                Some("progress") => {
                    receive(Message { done: message["done"].as_f64().unwrap_or(0.0), what: text("what") });
                }
                Some("warning") => log::warn!("{}: {}", text("place"), text("message")),
                Some("done") => return Ok(message["result"].clone()),
                Some("error") => {
                    return Err(Error::new(text("place"), text("found"), text("expected"), text("remedy")));
                }
                _ => {}
            }
        }
        let status = self.child.wait().map_or_else(|cause| cause.to_string(), |status| status.to_string());
        let log = self.log.take().and_then(|log| log.join().ok()).unwrap_or_default();
        Err(Error::new(
            format!("script {}", self.name),
            format!("it ended without an answer ({status}): {log}"),
            "a result",
            "Run cloudparity doctor; it checks the interpreter and its packages.",
        ))
    }
}

impl Drop for Conversation {
    fn drop(&mut self) {
        // The end of its input is the end of the script.
        self.requests = None;
        let _ = self.child.wait();
    }
}

/// Whether a Python module can be imported, with its version or the failure.
pub fn module_version(module: &str, expression: &str) -> std::result::Result<String, String> {
    let code = format!("import {module}; print({expression})");
    let output = Command::new(interpreter()).args(["-c", &code]).output().map_err(|cause| cause.to_string())?;
    let tail = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().lines().last().unwrap_or_default().to_owned();
    if output.status.success() { Ok(tail(&output.stdout)) } else { Err(tail(&output.stderr)) }
}

/// Whether live Cycles can be asked.
pub fn has_bpy() -> bool {
    static FOUND: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *FOUND.get_or_init(|| module_version("bpy", "bpy.app.version_string").is_ok())
}
