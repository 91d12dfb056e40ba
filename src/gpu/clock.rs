//! Time on the adapter, by timestamps around each dispatch.

use crate::base::error::Result;
use crate::gpu::Gpu;
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
}

/// The two timestamps of a dispatch.
pub(super) struct Stamps {
    set: wgpu::QuerySet,
    first: u32,
}

impl Clock {
    fn new(device: &wgpu::Device) -> Self {
        Self { device: device.clone(), sets: Vec::new(), taken: STAMPS }
    }

    /// Timestamps for the next dispatch.
    pub fn next(&mut self) -> Option<Stamps> {
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
    /// Whether [`Gpu::timed`] can tell the time of dispatches.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Does work, and says how many seconds the adapter spent in its dispatches: the sum of their differences of timestamps, waits between
    /// them left out. None where the adapter has no timestamps. Work of other threads meanwhile counts, too.
    pub fn timed<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<(T, Option<f64>)> {
        if !self.has_timestamps() {
            return Ok((work()?, None));
        }
        *self.clock() = Some(Clock::new(&self.device));
        let done = work();
        let clock = self.clock().take();
        let seconds = clock.map(|clock| self.seconds(&clock)).transpose()?;
        Ok((done?, seconds))
    }

    pub(super) fn clock(&self) -> MutexGuard<'_, Option<Clock>> {
        self.clock.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn seconds(&self, clock: &Clock) -> Result<f64> {
        let mut ticks = 0;
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
            let stamps: Vec<u64> = bytemuck::pod_collect_to_vec(&self.read_back(&buffer, size)?);
            ticks += stamps.chunks_exact(2).map(|pair| pair[1].saturating_sub(pair[0])).sum::<u64>();
        }
        Ok(ticks as f64 * f64::from(self.queue.get_timestamp_period()) * 1e-9)
    }
}
