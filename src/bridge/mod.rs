//! The Python boundary: finding the interpreter, running a script of `blend/`, reading its answers.
//!
//! A script reads one JSON request on stdin and answers with JSON lines (`hello`, `progress`,
//! `warning`, then `done` or `error`). The scripts are embedded in the program and handed to the interpreter on its input
//! (`blend/start.py`): the program works from any folder, and no file of a script lies where another user could change it.

pub mod cache;
mod ending;
pub mod interpreter;
pub mod limits;
pub mod probe;
pub mod reference;
pub mod releases;
pub mod saved_by;
mod starter;
pub mod volume_grid;

/// Tells the rest of the program what only Python can do: reading OpenVDB files. Further calls do nothing.
pub fn install() {
    crate::scene::volume_grid::register_reader(volume_grid::read);
}

use crate::base::error::{Error, Result};
use crate::base::temporary::{self, TemporaryFolder};
use indexmap::IndexMap;
pub use interpreter::INTERPRETER_VARIABLE;
use limits::Limits;
use serde_json::Value as Json;
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

macro_rules! scripts {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../blend/", $name)))),*]
    };
}

/// Every script and module of `blend/` that the program runs, by file name.
pub const SCRIPTS: &[(&str, &str)] = scripts!(
    "animation_reader.py",
    "attribution_plot.py",
    "blender_file.py",
    "build_scene.py",
    "compare_images.py",
    "convergence_plot.py",
    "cycles_findings.py",
    "cycles_settings.py",
    "display_picture.py",
    "export_scene.py",
    "false_colour.py",
    "findings_plot.py",
    "graph_builder.py",
    "graph_reader.py",
    "growth_plot.py",
    "image_metrics.py",
    "light_nodes.py",
    "light_reader.py",
    "model_comparison_plot.py",
    "node_data.py",
    "older_releases.py",
    "optimiser.py",
    "overlaps.py",
    "picture_file.py",
    "picture_grid.py",
    "plots.py",
    "point_probe.py",
    "preparation.py",
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
    "subset_reference.py",
    "tuning_plot.py",
    "volume_grid.py",
    "volume_reader.py",
    "world_reader.py",
);

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

/// The interpreter that runs scripts; [`interpreter::choose`] says why.
pub fn interpreter() -> PathBuf {
    interpreter::choose().path
}

/// How threads of OpenMP wait for work: at work (the default of GCC's library) or asleep.
const OPENMP_WAITING: &str = "OMP_WAIT_POLICY";

/// A command that runs the interpreter apart from its surroundings: no module comes from the working folder, from the folder of the user or
/// from variables of the environment (`-I`), nothing is written beside modules (`-B`), and text is UTF-8 everywhere.
fn isolated(path: &Path) -> Command {
    let mut command = Command::new(path);
    command.args(["-I", "-B", "-X", "utf8"]);
    // Where these lead, Blender looks for modules and start-up scripts.
    let is_folder = |name: &str| name.starts_with("BLENDER_USER_") || name.starts_with("BLENDER_SYSTEM_");
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_str().is_some_and(is_folder)) {
        command.env_remove(name);
    }
    // Threads of a metric that have nothing to do would keep the cores busy, which this program and other scripts wait for.
    if std::env::var_os(OPENMP_WAITING).is_none() {
        command.env(OPENMP_WAITING, "passive");
    }
    command
}

/// Runs a script of `blend/` and returns the result of its `done` message.
///
/// A script that reads a file of the user's has [`Limits`] of time and memory.
pub fn run_script(name: &str, request: &Json, kernel: CyclesKernel, mut receive: impl FnMut(Message)) -> Result<Json> {
    run_and_tell(name, request, kernel, &mut receive)
}

/// [`run_script`], compiled once for all that listen.
fn run_and_tell(name: &str, request: &Json, kernel: CyclesKernel, receive: &mut dyn FnMut(Message)) -> Result<Json> {
    let mut conversation = Conversation::start_within(name, kernel, Limits::of(name, request)?)?;
    // A script that stops before it has read its request breaks the pipe; its answer says why.
    let _ = conversation.say(&request.to_string());
    conversation.requests = None;
    conversation.answer(receive)
}

/// A script of `blend/` that answers one request after another, in one process that ends with the value, and with this program.
pub struct Conversation {
    name: String,
    child: Child,
    requests: Option<ChildStdin>,
    answers: Receiver<String>,
    /// The last lines that it wrote to stderr, when that has ended.
    log: Receiver<String>,
    limits: Option<Limits>,
    /// Where it, Blender and other libraries keep what they need for a while. Removed when the
    /// script has ended.
    _temporary: TemporaryFolder,
    started: Instant,
    /// Its own words for what it works at, such as "opening a.blend".
    activity: Option<String>,
    /// It answers and has nothing left to do.
    is_idle: bool,
}

/// How long a script that has nothing left to do may take to end.
const FAREWELL: Duration = Duration::from_secs(5);

/// Lines of stderr that an error shows.
const SHOWN_LINES: usize = 8;

/// What starts a script.
const START: &str = include_str!("../../blend/start.py");

impl Conversation {
    /// Starts a script.
    pub fn start(name: &str, kernel: CyclesKernel) -> Result<Self> {
        Self::start_within(name, kernel, None)
    }

    fn start_within(name: &str, kernel: CyclesKernel, limits: Option<Limits>) -> Result<Self> {
        let python = interpreter();
        let mut command = isolated(&python);
        let temporary = temporary::folder()?;
        command.env("TMPDIR", temporary.path());
        command.args(["-c", START]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        match kernel {
            CyclesKernel::Sse42 => command.env("CYCLES_CPU_NO_AVX2", "1"),
            CyclesKernel::Default => command.env_remove("CYCLES_CPU_NO_AVX2"),
        };
        let mut child = starter::spawn(command).map_err(|cause| {
            Error::new(
                format!("interpreter {}", python.display()),
                cause.to_string(),
                "a CPython with the packages of requirements.txt",
                format!("Run make setup, or set {INTERPRETER_VARIABLE} to the interpreter."),
            )
        })?;
        let stderr = child.stderr.take().expect("stderr is piped");
        let stdout = child.stdout.take().expect("stdout is piped");
        // An answer waits here until it is asked for, as it would in the pipe.
        let (sender, answers) = sync_channel(1);
        std::thread::spawn(move || {
            // Nobody listens any more where the conversation has ended.
            let _ = lines(stdout).try_for_each(|line| sender.send(line));
        });
        let (ended, log) = sync_channel(1);
        std::thread::spawn(move || {
            let _ = ended.send(last_lines(stderr));
        });
        let mut conversation = Self {
            name: name.to_owned(),
            requests: child.stdin.take(),
            answers,
            child,
            log,
            started: Instant::now(),
            activity: None,
            is_idle: false,
            limits: None,
            _temporary: temporary,
        };
        let modules: serde_json::Map<String, Json> =
            SCRIPTS.iter().map(|(name, text)| ((*name).to_owned(), (*text).into())).collect();
        let order = serde_json::json!({
            "script": name, "modules": modules, "parent": std::process::id(),
            "memory": limits.as_ref().map(|limits| limits.memory),
            "seconds": limits.as_ref().map(Limits::processor_seconds),
        });
        conversation.limits = limits;
        // What cannot take the order ends without an answer, which says why.
        let _ = conversation.say(&format!("{order}\n"));
        Ok(conversation)
    }

    /// Sends a request, which has one line, and returns the result of its `done` message.
    pub fn ask(&mut self, request: &Json, mut receive: impl FnMut(Message)) -> Result<Json> {
        let _ = self.say(&format!("{request}\n"));
        self.answer(&mut receive)
    }

    fn say(&mut self, text: &str) -> std::io::Result<()> {
        self.is_idle = false;
        let Some(stdin) = &mut self.requests else { return Ok(()) };
        stdin.write_all(text.as_bytes())?;
        stdin.flush()
    }

    /// The next line of the script's; none when it has ended, an error when its time is over.
    fn line(&self) -> Result<Option<String>> {
        let Some(limits) = &self.limits else { return Ok(self.answers.recv().ok()) };
        match self.answers.recv_timeout(limits.time.saturating_sub(self.started.elapsed())) {
            Ok(line) => Ok(Some(line)),
            Err(RecvTimeoutError::Disconnected) => Ok(None),
            Err(RecvTimeoutError::Timeout) => Err(limits.overrun()),
        }
    }

    fn answer(&mut self, receive: &mut dyn FnMut(Message)) -> Result<Json> {
        while let Some(line) = self.line()? {
            let Ok(message) = serde_json::from_str::<Json>(&line) else { continue };
            let text = |key: &str| message[key].as_str().unwrap_or_default().to_owned();
            match message["event"].as_str() {
                Some("progress") => {
                    receive(Message { done: message["done"].as_f64().unwrap_or(0.0), what: text("what") });
                }
                Some("activity") => self.activity = Some(text("what")),
                Some("warning") => log::warn!("{}: {}", text("place"), text("message")),
                Some("done") => {
                    self.is_idle = true;
                    return Ok(message["result"].clone());
                }
                Some("error") => {
                    self.is_idle = true;
                    return Err(error_of(&message));
                }
                _ => {}
            }
        }
        Err(self.broken_off())
    }

    /// The error where the script ended without an answer: what it did, how it ended, and who may have ended it.
    fn broken_off(&mut self) -> Error {
        let ending = end(&mut self.child, FAREWELL);
        // A process that it has started may keep stderr open.
        let log = self.log.recv_timeout(FAREWELL).unwrap_or_default();
        let ending = match ending {
            Ok(Ending::OnItsOwn(status)) => ending::of(status, &log),
            Ok(Ending::Forced) => ending::Cause::ClosedOutput,
            Err(cause) => ending::Cause::Unknown(cause.to_string()),
        };
        ending.error(&self.name, self.activity.as_deref(), &log, self.limits.as_ref())
    }
}

/// The error that a script reports, with the further faults of the same input.
fn error_of(message: &Json) -> Error {
    let text = |key: &str| message[key].as_str().unwrap_or_default().to_owned();
    let fault = Error::new(text("place"), text("found"), text("expected"), text("remedy"));
    let others = message["others"].as_array().into_iter().flatten().map(error_of);
    Error::of_all(std::iter::once(fault).chain(others)).expect("there is one")
}

impl Drop for Conversation {
    fn drop(&mut self) {
        // The end of its input is the end of a script that waits for a request. One that works is not waited for.
        self.requests = None;
        let _ = end(&mut self.child, if self.is_idle { FAREWELL } else { Duration::ZERO });
    }
}

/// How a process came to its end.
enum Ending {
    /// By itself, or by a signal of somebody else's.
    OnItsOwn(ExitStatus),
    /// It went on after its time, and was killed.
    Forced,
}

/// Waits for a process to end, and ends it where that takes longer.
fn end(child: &mut Child, grace: Duration) -> std::io::Result<Ending> {
    const BETWEEN_LOOKS: Duration = Duration::from_millis(5);
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Ending::OnItsOwn(status));
        }
        if begin.elapsed() >= grace {
            child.kill()?;
            child.wait()?;
            return Ok(Ending::Forced);
        }
        std::thread::sleep(BETWEEN_LOOKS);
    }
}

/// The lines of a stream, whatever its bytes are, until it ends.
fn lines(stream: impl Read) -> impl Iterator<Item = String> {
    let mut stream = BufReader::new(stream);
    std::iter::from_fn(move || {
        let mut line = Vec::new();
        let count = stream.read_until(b'\n', &mut line).ok()?;
        (count > 0).then(|| String::from_utf8_lossy(&line).trim_end().to_owned())
    })
}

/// What a script's stderr says last. Of Python's own account of an exception only the exception is kept.
fn last_lines(stream: impl Read) -> String {
    let mut last = VecDeque::new();
    for line in lines(stream).filter(|line| !line.starts_with([' ', '\t']) && !line.starts_with("Traceback")) {
        if last.len() == SHOWN_LINES {
            last.pop_front();
        }
        last.push_back(line);
    }
    Vec::from(last).join(" | ")
}

/// Whether a Python module can be imported, with its version or the failure.
pub fn module_version(module: &str, expression: &str) -> std::result::Result<String, String> {
    let code = format!("import {module}; print({expression})");
    let output = isolated(&interpreter()).args(["-c", &code]).output().map_err(|cause| cause.to_string())?;
    let tail = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().lines().last().unwrap_or_default().to_owned();
    if output.status.success() { Ok(tail(&output.stdout)) } else { Err(tail(&output.stderr)) }
}

/// Packages whose versions belong to the provenance of a result.
const PACKAGES: [&str; 8] =
    ["bpy", "OpenImageIO", "numpy", "scipy", "matplotlib", "flip-evaluator", "opencolorio", "cma"];

/// Versions of Python and of those packages that are installed, by name; nothing where Python does not answer. Asked once.
pub fn package_versions() -> IndexMap<String, String> {
    static FOUND: std::sync::OnceLock<IndexMap<String, String>> = std::sync::OnceLock::new();
    let ask = || {
        let names = serde_json::to_string(&PACKAGES).unwrap_or_default();
        let expression = format!(
            "json.dumps({{'Python': platform.python_version()}} | {{name: importlib.metadata.version(name) for name in {names} \
             if any(True for _ in importlib.metadata.distributions(name=name))}})"
        );
        let text = module_version("json, platform, importlib.metadata", &expression).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    };
    FOUND.get_or_init(ask).clone()
}

/// Whether live Cycles can be asked.
pub fn has_bpy() -> bool {
    static FOUND: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *FOUND.get_or_init(|| module_version("bpy", "bpy.app.version_string").is_ok())
}
