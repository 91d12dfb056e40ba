//! Time on the adapter, by timestamps around each dispatch.

use super::Gpu;
use crate::base::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::{MutexGuard, PoisonError};

/// Timestamps of a query set, two per dispatch; sets are added as work goes on.
const STAMPS: u32 = 2048;

/// Bytes of a timestamp.
const STAMP_BYTES: u64 = 8;

/// Timestamps of the dispatches since it was started.
pub(super) struct Clock {
    device: wgpu::Device,
    sets: Vec<wgpu::QuerySet>,
    /// Timestamps of the last set that are taken.
    taken: u32,
    /// Labels of kernels, and which of them each dispatch ran.
    labels: Vec<String>,
    dispatches: Vec<usize>,
}

/// The two timestamps of a dispatch.
pub(super) struct Stamps {
    set: wgpu::QuerySet,
    first: u32,
}

/// Time of one kernel on the adapter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct KernelTime {
    /// Sum over its dispatches, waits between them left out.
    pub seconds: f64,
    /// How often it was dispatched.
    pub dispatches: u64,
}

/// Time on the adapter by the labels of kernels.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct KernelTimes(pub BTreeMap<String, KernelTime>);

impl KernelTimes {
    /// Seconds of all kernels.
    pub fn seconds(&self) -> f64 {
        // The sum of nothing would be -0.
        self.0.values().fold(0.0, |sum, time| sum + time.seconds)
    }
}

impl Clock {
    fn new(device: &wgpu::Device) -> Self {
        Self { device: device.clone(), sets: Vec::new(), taken: STAMPS, labels: Vec::new(), dispatches: Vec::new() }
    }

    /// Timestamps for the next dispatch.
    pub fn next(&mut self, label: &str) -> Option<Stamps> {
        if self.taken == STAMPS {
            self.sets.push(self.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: STAMPS,
            }));
            self.taken = 0;
        }
        let first = self.taken;
        self.taken += 2;
        let number = self.labels.iter().position(|known| known == label).unwrap_or_else(|| {
            self.labels.push(label.to_owned());
            self.labels.len() - 1
        });
        self.dispatches.push(number);
        self.sets.last().map(|set| Stamps { set: set.clone(), first })
    }
}

impl Stamps {
    pub fn writes(&self) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(self.first),
            end_of_pass_write_index: Some(self.first + 1),
        }
    }
}

impl Gpu {
    /// Whether dispatches can be timed.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Times the dispatches from here to [`Self::end_timing_async`], those of all threads; without effect where the adapter has no timestamps.
    pub fn begin_timing(&self) {
        *self.clock() = self.has_timestamps().then(|| Clock::new(&self.device));
    }

    /// The times since [`Self::begin_timing`]. None where the adapter has no timestamps, or nothing was begun.
    pub async fn end_timing_async(&self) -> Result<Option<KernelTimes>> {
        let clock = self.clock().take();
        match clock {
            Some(clock) => self.times(&clock).await.map(Some),
            None => Ok(None),
        }
    }

    pub(super) fn clock(&self) -> MutexGuard<'_, Option<Clock>> {
        self.clock.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn times(&self, clock: &Clock) -> Result<KernelTimes> {
        let mut times = KernelTimes::default();
        let nanoseconds = f64::from(self.queue.get_timestamp_period());
        let mut dispatches = clock.dispatches.iter();
        for (number, set) in clock.sets.iter().enumerate() {
            let count = if number + 1 == clock.sets.len() { clock.taken } else { STAMPS };
            let size = u64::from(count) * STAMP_BYTES;
            let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            });
            let mut encoder = self.device.create_command_encoder(&Default::default());
            encoder.resolve_query_set(set, 0..count, &buffer, 0);
            self.queue.submit([encoder.finish()]);
            let stamps: Vec<u64> = bytemuck::pod_collect_to_vec(&self.read_back_async(&buffer, size).await?);
            for (pair, &kernel) in stamps.chunks_exact(2).zip(&mut dispatches) {
                let time = times.0.entry(clock.labels[kernel].clone()).or_default();
                time.seconds += pair[1].saturating_sub(pair[0]) as f64 * nanoseconds * 1e-9;
                time.dispatches += 1;
            }
        }
        Ok(times)
    }
}
