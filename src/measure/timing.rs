//! How time is measured: processor time of all threads, time on the wall, and an adapter's own by its timestamps.

use crate::base::error::{Error, Result};
use crate::gpu::{Backend, Gpu};
use crate::integrators::path;
use crate::integrators::path::{PathSettings, Subject};
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

/// What seconds of work are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Processor time of all threads.
    #[default]
    Processor,
    /// Time that the adapter spent in its dispatches, by its timestamps.
    Timestamps,
    /// Time on the wall.
    Wall,
}

impl Clock {
    /// The clock for work on all cores, or on an adapter: software has no time of its own, and its work is that of the processor.
    pub fn of(gpu: Option<&Gpu>) -> Self {
        match gpu {
            Some(gpu) if gpu.has_timestamps() && !gpu.adapter().is_software() => Self::Timestamps,
            _ => Self::Processor,
        }
    }

    /// Seconds of work by this clock.
    pub fn time(self, gpu: Option<&Gpu>, work: impl FnOnce() -> Result<()>) -> Result<f64> {
        let (begin, wall) = (ProcessTime::now(), Instant::now());
        let stamped = match gpu.filter(|_| self == Self::Timestamps) {
            Some(gpu) => gpu.timed(work)?.1.map(|times| times.seconds()),
            None => work().map(|()| None)?,
        };
        Ok(stamped.unwrap_or_else(|| match self {
            Self::Wall => wall.elapsed().as_secs_f64(),
            _ => begin.elapsed().as_secs_f64(),
        }))
    }

    /// Name for readers.
    pub fn label(self) -> &'static str {
        match self {
            Self::Processor => "processor time of all threads",
            Self::Timestamps => "time on the adapter by its timestamps",
            Self::Wall => "time on the wall",
        }
    }
}

/// Time of repeated work in seconds, by a [`Clock`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// What counts.
    pub median: f64,
    /// The fastest.
    pub smallest: f64,
    /// The slowest.
    pub largest: f64,
}

/// Times work so often, at least once: seconds by the clock that fits, and the wall time of the median repetition. Hardware is woken before.
pub fn repeated(repeats: usize, gpu: Option<&Gpu>, mut work: impl FnMut() -> Result<()>) -> Result<(Seconds, f64)> {
    let clock = Clock::of(gpu);
    if let Some(gpu) = gpu {
        gpu.wake()?;
    }
    let mut times = Vec::with_capacity(repeats);
    for _ in 0..repeats.max(1) {
        let wall = Instant::now();
        let seconds = clock.time(gpu, &mut work)?;
        times.push((seconds, wall.elapsed().as_secs_f64()));
    }
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (median, wall) = times[times.len() / 2];
    Ok((Seconds { median, smallest: times[0].0, largest: times[times.len() - 1].0 }, wall))
}

/// What does the work: processor, operating system, threads.
pub fn machine() -> String {
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let mut system = sysinfo::System::new();
    system.refresh_cpu_all();
    let processor = system.cpus().first().map_or("", |cpu| cpu.brand()).trim();
    let processor = if processor.is_empty() { "processor without a name" } else { processor };
    format!("{processor}, {} {}, {threads} threads", std::env::consts::OS, std::env::consts::ARCH)
}

/// Processor seconds that a picture by Cycles took before its first sample and from there on, as the render noted them; `file` is the
/// place of an error.
pub fn cycles_seconds(picture: &Image, file: &Path) -> Result<[f64; 2]> {
    let seconds = |name: &str| -> Result<f64> {
        picture.provenance.get(name).and_then(|text| text.parse().ok()).ok_or_else(|| {
            Error::new(
                format!("{}, attribute cloudparity:{name}", file.display()),
                "no number",
                "processor seconds that the render noted",
                "Remove the file from the cache, so that the reference is rendered again.",
            )
        })
    };
    let preparation = seconds("preparation_processor_seconds")?;
    Ok([preparation, seconds("processor_seconds")? - preparation])
}

/// A picture by path tracing on all cores, and its processor seconds: preparation, paths.
pub fn timed_picture<'a>(subject: impl Into<Subject<'a>>, settings: &PathSettings) -> Result<(Image, [f64; 2])> {
    timed_picture_by(Clock::Processor, Backend::Cpu, subject, settings)
}

/// [`timed_picture`] by the processor or on the wall, on the adapter, too. There the kernel's compilation is in it: in the preparation
/// where the driver compiles before the first pass, in the paths where it does so at the first dispatch, as Mesa's lavapipe.
pub fn timed_picture_by<'a>(
    clock: Clock,
    backend: Backend,
    subject: impl Into<Subject<'a>>,
    settings: &PathSettings,
) -> Result<(Image, [f64; 2])> {
    let (begin, wall) = (ProcessTime::now(), Instant::now());
    let elapsed = || match clock {
        Clock::Wall => wall.elapsed().as_secs_f64(),
        Clock::Processor | Clock::Timestamps => begin.elapsed().as_secs_f64(),
    };
    let prepared = OnceLock::new();
    let image = path::render(subject, settings, backend, None, &|_, what| {
        // Majorants are announced before they are made; whatever comes next is after them.
        if what != path::PREPARATION {
            prepared.get_or_init(elapsed);
        }
    })?;
    let all = elapsed();
    let preparation = prepared.get().copied().unwrap_or(0.0);
    Ok((image, [preparation, all - preparation]))
}

/// Bytes of this process that were resident at most; none where the system does not say (other than Linux).
pub fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kibibytes| 1024 * kibibytes)
}
