//! The adapter: opening a device, creating kernels, reading results back.
//!
//! Whatever waits for the device has an asynchronous form, as a browser asks for it; the forms that wait are for native callers.
//!
//! Any Vulkan, Metal or DirectX 12 adapter serves, Mesa's software Vulkan included. Kernels are
//! native modules created without injected loop and bounds checks: every loop of `shaders/` has a
//! bound and every index is checked by the shader itself. Work is dispatched in slices, so that no
//! single submission holds an adapter for long.

pub mod arithmetic;
mod blocking;
mod clock;
pub mod dispatch;
pub mod draw;
mod exact;
mod field;
pub mod layout;
mod slices;
mod textures;
mod uniforms;

pub use clock::{KernelTime, KernelTimes};
pub use dispatch::{Bindings, ComputeKernel};
pub use field::FieldKernel;
pub use layout::Layout;
pub use slices::Slices;

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use futures_channel::oneshot;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// An open device.
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// The first error that no call returned.
    fault: Arc<Mutex<Option<String>>>,
    adapter: Adapter,
    /// The clock of dispatches while something is timed.
    clock: Mutex<Option<clock::Clock>>,
    /// Kernels by the hash of their text, where they are kept.
    kept: Mutex<Option<BTreeMap<String, ComputeKernel>>>,
    /// Kernels that were compiled.
    compilations: AtomicU64,
}

/// Which adapter and driver did the work.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Adapter {
    /// Marketing name.
    pub name: String,
    /// Vulkan, Metal, Dx12 or Gl.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// Kind: Cpu for a software adapter.
    pub kind: String,
}

/// Iterations after which Mesa's llvmpipe ends the loops of an invocation, all loops together and
/// without a word (its constant `LP_MAX_TGSI_LOOP_ITERATIONS`): a kernel that evaluates the density many times gives wrong values
/// from there on. Found as a density of 402 where 47 is right, and as a picture of a quarter of its brightness. A
/// 4D Voronoi texture alone takes up to 625 iterations per octave, so kernels split their work below it.
pub const SOFTWARE_LOOPS: u32 = 65_535;

choice! { "lowercase",
/// Where the work runs.
#[derive(Default)]
pub enum Backend {
    /// All cores: f64 with the f32 density.
    #[default]
    Cpu,
    /// The adapter: f32.
    Gpu,
}
}

impl Backend {
    /// Whether it is all cores.
    pub fn is_cpu(&self) -> bool {
        *self == Self::Cpu
    }

    /// The adapter, where one is asked for.
    pub fn open(self) -> Result<Option<Gpu>> {
        match self {
            Self::Cpu => Ok(None),
            Self::Gpu => Gpu::open().map(Some),
        }
    }
}

/// What did the work, for a picture's provenance.
pub fn worker(gpu: Option<&Gpu>) -> String {
    gpu.map_or_else(
        || format!("CPU, {} threads", rayon::current_num_threads()),
        |gpu| format!("GPU, {}", crate::base::files::json(gpu.adapter())),
    )
}

impl Adapter {
    /// Whether it computes on the CPU.
    pub fn is_software(&self) -> bool {
        self.kind == "Cpu"
    }

    /// Whether its driver compiles a kernel again for every content of its uniform buffers, with their values as constants: Mesa's lavapipe
    /// does, for values that conditions and ends of loops depend on. That takes 0.16 s for the engine of a Voronoi texture, at every
    /// dispatch; and where a loop's end is known, it is unrolled, which has taken minutes and 12 GB.
    pub(crate) fn compiles_uniforms(&self) -> bool {
        self.driver.starts_with("llvmpipe")
    }
}

impl Gpu {
    /// Opens the fastest adapter; `WGPU_ADAPTER_NAME` chooses another by a part of its name. A browser has one to choose from.
    pub async fn open_async() -> Result<Self> {
        let missing = |cause: String| {
            Error::new(
                "graphics adapter",
                cause,
                "a Vulkan, Metal or DirectX 12 adapter",
                "Install a driver (Debian: apt-get install mesa-vulkan-drivers), or use the CPU evaluator.",
            )
        };
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = instance.enumerate_adapters(wgpu::Backends::all()).await;
        let wanted = std::env::var("WGPU_ADAPTER_NAME").unwrap_or_default().to_lowercase();
        let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Cpu => 3,
            wgpu::DeviceType::Other => 4,
        };
        let adapter = adapters
            .into_iter()
            .filter(|adapter| adapter.get_info().name.to_lowercase().contains(&wanted))
            .min_by_key(rank)
            .ok_or_else(|| missing("no adapter".into()))?;
        let limits = adapter.limits();
        // Timestamps where there are any: without them times are taken on the processor. SPIR-V of our own where that is what the driver takes.
        let mut features = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
        if adapter.get_info().backend == wgpu::Backend::Vulkan {
            features |= adapter.features() & wgpu::Features::PASSTHROUGH_SHADERS;
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("cloudparity"),
            required_limits: limits,
            required_features: features,
            ..Default::default()
        };
        let (device, queue) = adapter.request_device(&descriptor).await.map_err(|cause| missing(cause.to_string()))?;
        Ok(Self::of_device(&adapter, device, queue))
    }

    /// A device that somebody else opened, such as a window. Its callbacks for errors and for its loss are replaced.
    pub fn of_device(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let info = adapter.get_info();
        // Without these wgpu ends the program at an error that no call returns.
        let fault = Arc::new(Mutex::new(None));
        let note = |fault: &Mutex<Option<String>>, cause: String| {
            fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(cause);
        };
        let noted = fault.clone();
        device.on_uncaptured_error(Arc::new(move |cause| note(&noted, cause.to_string())));
        let noted = fault.clone();
        // A device is also "lost" when it is dropped at the end, which nobody asks about then.
        device.set_device_lost_callback(move |_, cause| note(&noted, format!("the device is lost: {cause}")));
        Self {
            device,
            queue,
            fault,
            adapter: Adapter {
                name: info.name,
                backend: format!("{:?}", info.backend),
                driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
                kind: format!("{:?}", info.device_type),
            },
            clock: Mutex::new(None),
            kept: Mutex::new(None),
            compilations: AtomicU64::new(0),
        }
    }

    /// Keeps every kernel from now on: one of the same text is compiled once. For programs in which engines are put together again and
    /// again with other numbers.
    pub fn keep_kernels(&self) {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_default();
    }

    /// Whether kernels are kept.
    pub fn keeps_kernels(&self) -> bool {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// How many kernels were compiled so far; those that were kept count once.
    pub fn compilations(&self) -> u64 {
        self.compilations.load(Ordering::Relaxed)
    }

    /// The adapter and its driver.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The device, for kernels of other modules.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue, for kernels of other modules.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// A buffer with these contents.
    pub fn upload(&self, label: &str, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let size = (contents.len() as u64).next_multiple_of(4).max(16);
        // Gpu::module may read it as storage.
        let is_uniform = usage.contains(wgpu::BufferUsages::UNIFORM);
        let usage = if is_uniform { usage | wgpu::BufferUsages::STORAGE } else { usage };
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, contents);
        buffer
    }

    /// The first `size` bytes of a buffer with usage `COPY_SRC`, after all work that was submitted before this call.
    pub fn read_back_async(&self, buffer: &wgpu::Buffer, size: u64) -> impl Future<Output = Result<Vec<u8>>> + use<'_> {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = oneshot::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody listens where the caller has dropped the future.
            let _ = sender.send(result);
        });
        async move {
            self.check()?;
            let lost = |cause: String| self.failed(cause);
            receiver.await.map_err(|cause| lost(cause.to_string()))?.map_err(|cause| lost(cause.to_string()))?;
            let view = staging.get_mapped_range(..).map_err(|cause| lost(cause.to_string()))?;
            Ok(view.to_vec())
        }
    }

    /// Completes when all work is done that was submitted before this call.
    pub fn wait_async(&self) -> impl Future<Output = Result<()>> + use<'_> {
        let (sender, receiver) = oneshot::channel();
        self.queue.on_submitted_work_done(move || {
            // Nobody listens where the caller has dropped the future.
            let _ = sender.send(());
        });
        async move {
            receiver.await.map_err(|cause| self.failed(cause.to_string()))?;
            self.check()
        }
    }

    /// A module for the device's driver.
    fn module(&self, label: &str, module: &naga::Module) -> wgpu::ShaderModule {
        let mut module = module.clone();
        if self.adapter.compiles_uniforms() {
            uniforms::copied_at_the_start(&mut module);
        }
        let source = wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module));
        trusted_module(&self.device, wgpu::ShaderModuleDescriptor { label: Some(label), source })
    }

    /// An error if the device was lost or refused a call; everything it gives after that is worthless.
    pub(crate) fn check(&self) -> Result<()> {
        match self.fault.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            None => Ok(()),
            Some(cause) => Err(self.failed(cause.clone())),
        }
    }

    fn failed(&self, cause: String) -> Error {
        Error::new(
            format!("adapter {}", self.adapter.name),
            cause,
            "finished work",
            "Try again, or do without the adapter (the CPU gives the same values).",
        )
    }
}

/// Creates a module without the checks that wgpu would inject.
#[allow(unsafe_code, reason = "wgpu offers modules without injected checks as an unsafe function only")]
fn trusted_module(device: &wgpu::Device, descriptor: wgpu::ShaderModuleDescriptor<'_>) -> wgpu::ShaderModule {
    let checks = wgpu::ShaderRuntimeChecks {
        bounds_checks: false,
        force_loop_bounding: false,
        ..wgpu::ShaderRuntimeChecks::checked()
    };
    // SAFETY: the modules come from `shaders/` and from the graph compiler. Their loops run over
    // constant or clamped ranges, and each index into a buffer is compared with its length first.
    unsafe { device.create_shader_module_trusted(descriptor, checks) }
}
