//! The calls that wait, for native callers; a browser's page may not wait and uses their asynchronous forms.
//!
//! Futures of this folder complete when the device is polled. A browser does that by itself; here [`Gpu::block_on`] does.

use super::dispatch::ComputeKernel;
use super::layout::Layout;
use super::{Gpu, KernelTimes};
use crate::base::error::Result;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

impl Gpu {
    /// Opens the fastest adapter; see [`Gpu::open_async`].
    pub fn open() -> Result<Self> {
        // Opening needs no device to be polled: it completes by itself.
        pollster::block_on(Self::open_async())
    }

    /// See [`Gpu::kernel_async`].
    pub fn kernel(&self, label: &str, module: &naga::Module, layouts: &[Layout]) -> Result<ComputeKernel> {
        self.block_on(self.kernel_async(label, module, layouts))?
    }

    /// See [`Gpu::exact_kernel_async`].
    pub fn exact_kernel(&self, label: &str, module: &naga::Module, layouts: &[Layout]) -> Result<ComputeKernel> {
        self.block_on(self.exact_kernel_async(label, module, layouts))?
    }

    /// See [`Gpu::read_back_async`].
    pub fn read_back(&self, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>> {
        self.block_on(self.read_back_async(buffer, size))?
    }

    /// Waits until all submitted work is done.
    pub fn wait(&self) -> Result<()> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|cause| self.failed(cause.to_string()))?;
        self.check()
    }

    /// Does work, and says how long the adapter was in its dispatches. None where the adapter has no timestamps. Work of other threads meanwhile counts,
    /// too.
    pub fn timed<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<(T, Option<KernelTimes>)> {
        self.begin_timing();
        let done = work();
        let times = self.block_on(self.end_timing_async())?;
        Ok((done?, times?))
    }

    /// Waits for a future of this device: between two looks at it the device does all that was submitted.
    pub fn block_on<T>(&self, future: impl Future<Output = T>) -> Result<T> {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
                return Ok(value);
            }
            self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|cause| self.failed(cause.to_string()))?;
        }
    }
}
