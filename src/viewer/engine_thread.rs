//! Pictures of the engine, made in a thread: the newest request counts, what was asked before is dropped.

use super::look::Look;
use super::{Changes, Source};
use crate::base::error::{Error, Result};
use crate::engines::Engine;
use crate::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use crate::gpu::{Backend, Gpu, worker};
use crate::scene::Scene;
use crate::scene::image::Image;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::Instant;

/// What is wanted.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wanted {
    pub look: Look,
    pub changes: Changes,
}

/// A picture that is there.
pub struct Shown {
    /// The picture.
    pub image: Image,
    /// The scene as it is looked at.
    pub scene: Scene,
    /// The engine's light, whose parameters the window shows.
    pub engine: Arc<Engine>,
    /// View and changes that it is of.
    pub(super) wanted: Wanted,
    /// Time of its making without preparation, in milliseconds.
    pub milliseconds: f64,
    /// Time in kernels by the adapter's own clock; none on the CPU and where the adapter has no clock.
    pub kernel_milliseconds: Option<f64>,
    /// Time until everything was ready: the engine put together, kernels linked, compiled where they had to be.
    pub preparation_milliseconds: f64,
    /// Kernels that were compiled so far.
    pub compilations: u64,
    /// Where it was made.
    pub backend: Backend,
    /// What made it, in words.
    pub worker: String,
}

/// What the thread says.
pub(super) enum Answer {
    Shown(Box<Shown>),
    /// The adapter cannot be had: pictures come from all cores.
    NoAdapter(Error),
    Failed(Error),
}

/// The newest of what is asked for; none where nobody asks any more.
pub(super) fn newest<T>(requests: &Receiver<T>, mut request: T) -> Option<T> {
    loop {
        match requests.try_recv() {
            Ok(newer) => request = newer,
            Err(TryRecvError::Empty) => return Some(request),
            Err(TryRecvError::Disconnected) => return None,
        }
    }
}

/// The thread, from the side of the window.
///
/// Dropping it waits for the picture that is being made: a thread that still has an adapter while the process ends meets a driver whose
/// own state is already gone, and dies by a signal where the program was about to end well.
pub(super) struct EngineThread {
    requests: Option<Sender<Wanted>>,
    answers: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
}

impl EngineThread {
    /// Starts it. `wake` is called when there is an answer.
    pub fn start(source: Arc<dyn Source>, backend: Backend, wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (requests, asked) = channel();
        let (answered, answers) = channel();
        let thread = std::thread::spawn(move || run(&*source, backend, &asked, &answered, &*wake));
        Self { requests: Some(requests), answers, thread: Some(thread) }
    }

    /// Asks for a picture; what was asked before and is not begun is dropped.
    pub fn ask(&self, wanted: Wanted) {
        if let Some(requests) = &self.requests {
            // Nobody hears it where the thread panicked, which was said.
            let _ = requests.send(wanted);
        }
    }

    /// The next answer that is there.
    pub fn answer(&self) -> Option<Answer> {
        self.answers.try_recv().ok()
    }
}

impl Drop for EngineThread {
    fn drop(&mut self) {
        // Requests that cannot come any more end its loop.
        drop(self.requests.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The loop of the thread; it ends when the window is gone.
fn run(source: &dyn Source, backend: Backend, requests: &Receiver<Wanted>, answers: &Sender<Answer>, wake: &dyn Fn()) {
    let mut maker = Maker { source, backend, gpu: None, known: None };
    while let Ok(wanted) = requests.recv() {
        let Some(wanted) = newest(requests, wanted) else { return };
        let mut is_again = false;
        let answer = loop {
            if let Err(error) = maker.open() {
                let _ = answers.send(Answer::NoAdapter(error));
            }
            match maker.picture(wanted.clone()) {
                Ok(shown) => break Answer::Shown(Box::new(shown)),
                // A lost device stays lost, and another may be had; a picture that fails there, too, is said.
                Err(error) if !maker.forget_lost() || is_again => break Answer::Failed(error),
                Err(_) => is_again = true,
            }
        };
        if answers.send(answer).is_err() {
            return;
        }
        wake();
    }
}

/// What pictures are made with.
struct Maker<'a> {
    source: &'a dyn Source,
    backend: Backend,
    gpu: Option<Gpu>,
    /// The engine of the last picture, with what it was made of.
    known: Option<(Changes, Scene, Arc<Engine>)>,
}

impl Maker<'_> {
    /// Opens the adapter where one is wanted and none is open; where that fails pictures come from all cores from then on.
    fn open(&mut self) -> Result<()> {
        if self.backend == Backend::Gpu && self.gpu.is_none() {
            let opened = self.source.adapter().inspect_err(|_| self.backend = Backend::Cpu)?;
            opened.keep_kernels();
            self.gpu = Some(opened);
        }
        Ok(())
    }

    /// Lets go of a device that was lost or refused a call; whether it had to.
    fn forget_lost(&mut self) -> bool {
        self.gpu.take_if(|gpu| gpu.check().is_err()).is_some()
    }

    fn picture(&mut self, wanted: Wanted) -> Result<Shown> {
        let begin = Instant::now();
        let Self { source, gpu, known, .. } = self;
        let gpu = gpu.as_ref();
        let known = match known {
            Some(known) if known.0 == wanted.changes => known,
            _ => {
                let (scene, engine) = source.engine(&wanted.changes)?;
                if engine.march.distance_levels.is_some() {
                    return Err(Error::new(
                        "the window",
                        "steps by the camera's distance from the cloud, which the mouse changes",
                        "an engine that is the same from everywhere",
                        "Set distance_levels to 0, or render pictures.",
                    ));
                }
                known.insert((wanted.changes.clone(), scene, Arc::new(engine)))
            }
        };
        let (_, scene, engine) = known;
        let scene = wanted.look.scene(scene, engine.container.centre());
        let settings = EngineSettings {
            jitter: EngineJitter::None,
            frame: 0,
            sub_pixels: source.sub_pixels(&wanted.changes),
            god_rays: false,
        };
        let renderer = EngineRenderer::new(&scene, engine, gpu)?;
        renderer.compile(&settings)?;
        let preparation_milliseconds = begin.elapsed().as_secs_f64() * 1e3;
        let begin = Instant::now();
        let make = || renderer.picture(&settings, &|_, _| ());
        let (image, times) = match gpu {
            Some(gpu) => gpu.timed(make)?,
            None => (make()?, None),
        };
        let milliseconds = begin.elapsed().as_secs_f64() * 1e3;
        image.check_finite("the picture of this engine")?;
        drop(renderer);
        Ok(Shown {
            image,
            scene,
            engine: Arc::clone(engine),
            wanted,
            milliseconds,
            kernel_milliseconds: times.map(|times| times.seconds() * 1e3),
            preparation_milliseconds,
            compilations: gpu.map_or(0, Gpu::compilations),
            backend: if gpu.is_some() { Backend::Gpu } else { Backend::Cpu },
            worker: gpu.map_or_else(|| worker(None), |gpu| gpu.adapter().name.clone()),
        })
    }
}
