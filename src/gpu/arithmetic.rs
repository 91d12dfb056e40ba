//! Work of known size: what an adapter can compute at most, and what wakes it (`shaders/gpu/arithmetic.wgsl`).

use super::{Bindings, Gpu, Layout};
use crate::base::error::Result;
use crate::graph::wgsl::Linker;
use crate::shader_struct;
use std::time::Instant;

const SHADER: &str = include_str!("../../shaders/gpu/arithmetic.wgsl");

/// Invocations, and rounds of four chains in each: some tenths of a millisecond on a large adapter.
const INVOCATIONS: u32 = 1 << 20;
const ROUNDS: u32 = 1 << 12;
const CHAINS: u32 = 4;

/// Multiply-adds of [`Gpu::multiply_adds`].
pub const MULTIPLY_ADDS: f64 = INVOCATIONS as f64 * ROUNDS as f64 * CHAINS as f64;

/// Seconds of work after which an adapter that was idle has its full clock: one of hardware computed at a sixth of it before.
const AWAKE: f64 = 0.5;

shader_struct! {
    /// How much there is to do.
    struct Work = "Work" {
        rounds: u32,
        padding: [u32; 7],
    }
}

impl Gpu {
    /// [`MULTIPLY_ADDS`] of 32-bit integers or of f32, each time it is called; it waits for them.
    pub fn multiply_adds(&self, of_integers: bool) -> Result<impl Fn() -> Result<()> + use<'_>> {
        let definitions: &[&str] = if of_integers { &["INTEGERS"] } else { &[] };
        let module = Linker::bare().link_with("gpu/arithmetic.wgsl", SHADER, definitions)?;
        let kernel = self.kernel("arithmetic", &module, &[Layout::of::<Work>()])?;
        let work = Work { rounds: ROUNDS, padding: [0; 7] };
        let work = self.upload("work", bytemuck::bytes_of(&work), wgpu::BufferUsages::UNIFORM);
        let results = self.upload("results", &vec![0; 4 * INVOCATIONS as usize], wgpu::BufferUsages::STORAGE);
        Ok(move || {
            self.dispatch(&kernel, &Bindings::new().group(0, [&work, &results]), [INVOCATIONS, 1, 1])?;
            self.wait()
        })
    }

    /// Has hardware work for a while, so that its clock is no longer that of an idle adapter; software has the processor's.
    pub fn wake(&self) -> Result<()> {
        if self.adapter.is_software() {
            return Ok(());
        }
        let run = self.multiply_adds(false)?;
        let begin = Instant::now();
        while begin.elapsed().as_secs_f64() < AWAKE {
            run()?;
        }
        Ok(())
    }
}
