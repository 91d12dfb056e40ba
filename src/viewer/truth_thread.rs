//! The truth of a view, made in a thread while the view rests: path tracing without bias, a sample of every pixel after the other.

use super::engine_thread::{Wanted, newest};
use super::{Changes, Source};
use crate::base::error::{Error, Result};
use crate::gpu::Backend;
use crate::integrators::path::{self, PathSettings, Subject};
use crate::scene::image::Image;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender};

/// Replicas that the samples are dealt out to.
pub const REPLICAS: usize = 8;

/// Samples of a pixel at most: then the truth is as good as it gets here.
const MOST_SAMPLES: u32 = 1 << 16;

/// The truth so far.
#[derive(Clone)]
pub struct Truth {
    /// Mean of all samples.
    pub mean: Arc<Image>,
    /// Replicas of equal weight; none before each has a sample.
    pub replicas: Arc<Vec<Image>>,
    /// Samples per pixel; 0 for pictures that were given.
    pub samples: u32,
    pub(super) wanted: Wanted,
}

/// What the thread says.
pub(super) enum Answer {
    Truth(Box<Truth>),
    Failed(Error),
}

/// The loop of the thread; a request of nothing stops what is going on.
pub(super) fn run(source: &dyn Source, requests: &Receiver<Option<Wanted>>, answers: &Sender<Answer>, wake: &dyn Fn()) {
    let mut next = None;
    loop {
        let request = match next.take() {
            Some(request) => request,
            None => match requests.recv() {
                Ok(request) => request,
                Err(_) => return,
            },
        };
        let Some(newest) = newest(requests, request) else { return };
        let Some(wanted) = newest else { continue };
        match accumulate(source, &wanted, requests, answers, wake) {
            Ok(newer) => next = newer,
            Err(error) => {
                if answers.send(Answer::Failed(error)).is_err() {
                    return;
                }
                wake();
            }
        }
    }
}

/// Accumulates until something else is asked for, which is returned.
fn accumulate(
    source: &dyn Source,
    wanted: &Wanted,
    requests: &Receiver<Option<Wanted>>,
    answers: &Sender<Answer>,
    wake: &dyn Fn(),
) -> Result<Option<Option<Wanted>>> {
    let given = source.pictures();
    if !given.is_empty() && wanted.look.is_of_scene() && wanted.changes == Changes::default() {
        let truth = Truth {
            mean: Arc::new(Image::mean_of(given)?),
            replicas: Arc::new(given.to_vec()),
            samples: 0,
            wanted: wanted.clone(),
        };
        let _ = answers.send(Answer::Truth(Box::new(truth)));
        wake();
        return Ok(None);
    }
    let (scene, medium) = source.truth(&wanted.changes)?;
    // Where the camera goes around is a matter of the engine's domain.
    let (_, engine) = source.engine(&wanted.changes)?;
    let scene = wanted.look.scene(&scene, engine.container.centre());
    let settings =
        PathSettings { samples: 1, pixel_centres: source.sub_pixels(&wanted.changes) == 1, ..PathSettings::default() };
    let seeds: Vec<u32> = (0..MOST_SAMPLES).collect();
    let mut sums = Sums::new(scene.image_size());
    let (mut newer, mut is_stopped) = (None, false);
    let mut receive = |_, image: Image| {
        sums.add(&image);
        let truth = Truth {
            mean: Arc::new(sums.mean()),
            replicas: Arc::clone(&sums.replicas),
            samples: sums.samples,
            wanted: wanted.clone(),
        };
        is_stopped = answers.send(Answer::Truth(Box::new(truth))).is_err();
        wake();
        newer = requests.try_recv().ok();
        is_stopped |= newer.is_some();
        // No error that anybody sees: path tracing ends by one.
        if is_stopped {
            Err(Error::new("the truth", "another view", "this one", "Nothing has to be done."))
        } else {
            Ok(())
        }
    };
    let subject = Subject { scene: &scene, medium: medium.as_ref() };
    match path::render_each(subject, &settings, Backend::Cpu, &seeds, &|_, _| (), &mut receive) {
        Err(error) if !is_stopped => Err(error),
        _ => Ok(newer),
    }
}

/// Samples, dealt out.
struct Sums {
    size: [usize; 2],
    sums: Vec<Vec<[f64; 4]>>,
    samples: u32,
    /// Means of the replicas after the last round.
    replicas: Arc<Vec<Image>>,
}

impl Sums {
    fn new(size: [u32; 2]) -> Self {
        let size = size.map(|side| side as usize);
        let empty = vec![[0.0; 4]; size[0] * size[1]];
        Self { size, sums: vec![empty; REPLICAS], samples: 0, replicas: Arc::default() }
    }

    fn add(&mut self, image: &Image) {
        let replica = self.samples as usize % REPLICAS;
        for (sum, pixel) in self.sums[replica].iter_mut().zip(&image.pixels) {
            (0..4).for_each(|channel| sum[channel] += f64::from(pixel[channel]));
        }
        self.samples += 1;
        if (self.samples as usize).is_multiple_of(REPLICAS) {
            let each = f64::from(self.samples) / REPLICAS as f64;
            self.replicas = Arc::new((0..REPLICAS).map(|replica| self.image(&[replica], each)).collect());
        }
    }

    fn mean(&self) -> Image {
        let all: Vec<usize> = (0..REPLICAS).collect();
        self.image(&all, f64::from(self.samples))
    }

    fn image(&self, replicas: &[usize], samples: f64) -> Image {
        let [width, height] = self.size;
        let mut image = Image::new(width, height);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            for channel in 0..4 {
                let sum: f64 = replicas.iter().map(|&replica| self.sums[replica][index][channel]).sum();
                pixel[channel] = (sum / samples) as f32;
            }
        }
        image
    }
}
