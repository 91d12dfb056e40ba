//! The one way to run a kernel: compiled with its layouts checked, dispatched over numbered resources, timed while something is.

use super::exact::Pipeline;
use super::layout::{self, Layout};
use super::{Gpu, clock};
use crate::base::error::{Error, Result};
use crate::base::files::sha256;
use crate::graph::wgsl::{self, Language};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::PoisonError;
use std::sync::atomic::Ordering;

/// Kernels that are kept at most; then all are forgotten, so that an hour of changes takes no more memory than some minutes.
const MOST_KEPT: usize = 64;

/// A compute kernel that is ready to run.
#[derive(Clone)]
pub struct ComputeKernel {
    label: String,
    pipeline: wgpu::ComputePipeline,
    /// The groups up to the last one that the kernel has, with the bindings that are left in it: a specialised kernel has lost some.
    groups: Vec<(wgpu::BindGroupLayout, BTreeSet<u32>)>,
    /// Invocations of a workgroup along each axis.
    workgroup: [u32; 3],
}

impl ComputeKernel {
    /// Its name in errors and tables of times.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Invocations of a workgroup along each axis, as the shader has them.
    pub fn workgroup(&self) -> [u32; 3] {
        self.workgroup
    }

    /// Whether the kernel still has a binding.
    pub fn has(&self, group: u32, binding: u32) -> bool {
        self.groups.get(group as usize).is_some_and(|(_, bindings)| bindings.contains(&binding))
    }
}

/// Resources by group and binding. What a kernel has lost may be among them.
#[derive(Default)]
pub struct Bindings<'a>(BTreeMap<(u32, u32), wgpu::BindingResource<'a>>);

impl<'a> Bindings<'a> {
    /// None yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Whole buffers of a group, from binding 0 on.
    pub fn group(mut self, group: u32, buffers: impl IntoIterator<Item = &'a wgpu::Buffer>) -> Self {
        let entries = (0..).zip(buffers).map(|(binding, buffer)| ((group, binding), buffer.as_entire_binding()));
        self.0.extend(entries);
        self
    }

    /// One resource: a part of a buffer, a texture, a sampler.
    pub fn bind(mut self, group: u32, binding: u32, resource: wgpu::BindingResource<'a>) -> Self {
        self.0.insert((group, binding), resource);
        self
    }
}

impl Gpu {
    /// Compiles the entry point `main` of a linked module. `layouts` has every struct of the module's buffers.
    pub async fn kernel_async(&self, label: &str, module: &naga::Module, layouts: &[Layout]) -> Result<ComputeKernel> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept().is_none() {
            return self.compiled_async(label, module, layouts, false).await;
        }
        let hash = sha256(wgsl::write(module, Language::Wgsl)?.as_slice());
        if let Some(kernel) = kept().as_ref().and_then(|kept| kept.get(&hash)) {
            return Ok(kernel.clone());
        }
        let kernel = self.compiled_async(label, module, layouts, false).await?;
        if let Some(kept) = kept().as_mut() {
            if kept.len() == MOST_KEPT {
                kept.clear();
            }
            kept.insert(hash, kernel.clone());
        }
        Ok(kernel)
    }

    /// [`Self::kernel_async`] of a kernel whose arithmetic the driver leaves as it is written, where that can be said
    /// ([`Self::has_exact_kernels`]). It is not among those that are kept.
    pub async fn exact_kernel_async(
        &self,
        label: &str,
        module: &naga::Module,
        layouts: &[Layout],
    ) -> Result<ComputeKernel> {
        self.compiled_async(label, module, layouts, self.has_exact_kernels()).await
    }

    async fn compiled_async(
        &self,
        label: &str,
        module: &naga::Module,
        layouts: &[Layout],
        is_exact: bool,
    ) -> Result<ComputeKernel> {
        self.compilations.fetch_add(1, Ordering::Relaxed);
        let info = wgsl::validate(module)?;
        layout::check_all(module, layouts)?;
        let entry = module.entry_points.iter().find(|entry| entry.name == "main").ok_or_else(|| {
            Error::new(
                format!("shader {label}"),
                "no entry point main",
                "a kernel",
                "This is a defect of the program: report it.",
            )
        })?;
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let made = if is_exact {
            self.exact_pipeline(label, module, &info, entry)?
        } else {
            self.free_pipeline(label, module)
        };
        if let Some(cause) = scope.pop().await {
            return Err(Error::new(
                format!("shader {label}"),
                cause.to_string(),
                "a pipeline that the driver accepts",
                "Report it with the adapter's name, or use the CPU evaluator.",
            ));
        }
        let mut bindings: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for place in module.global_variables.iter().filter_map(|(_, variable)| variable.binding) {
            bindings.entry(place.group).or_default().insert(place.binding);
        }
        let layouts = (0..).zip(made.layouts);
        let groups = layouts.map(|(group, layout)| (layout, bindings.remove(&group).unwrap_or_default())).collect();
        Ok(ComputeKernel { label: label.to_owned(), pipeline: made.pipeline, groups, workgroup: entry.workgroup_size })
    }

    /// The pipeline of a module whose arithmetic the driver may fuse, its layouts those that wgpu finds in it.
    fn free_pipeline(&self, label: &str, module: &naga::Module) -> Pipeline {
        let shader = self.module(label, module);
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: None,
            module: &shader,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let places = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
        let groups = places.map(|place| place.group + 1).max().unwrap_or(0);
        let layouts = (0..groups).map(|group| pipeline.get_bind_group_layout(group)).collect();
        Pipeline { pipeline, layouts }
    }

    /// Submits a kernel over a grid of invocations, at least as many along each axis as given: the last workgroup is always whole.
    pub fn dispatch(&self, kernel: &ComputeKernel, bindings: &Bindings<'_>, invocations: [u32; 3]) -> Result<()> {
        let workgroups = self.workgroups(kernel, invocations)?;
        let mut groups = Vec::with_capacity(kernel.groups.len());
        for (group, (layout, wanted)) in (0..).zip(&kernel.groups) {
            let mut entries = Vec::with_capacity(wanted.len());
            for &binding in wanted {
                let resource = bindings.0.get(&(group, binding)).cloned().ok_or_else(|| {
                    Error::new(
                        format!("kernel {}", kernel.label),
                        format!("nothing for binding {binding} of group {group}"),
                        "a resource for each binding that is left in the kernel",
                        "This is a defect of the program: report it with the command.",
                    )
                })?;
                entries.push(wgpu::BindGroupEntry { binding, resource });
            }
            let label = Some(kernel.label.as_str());
            groups.push(self.device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries: &entries }));
        }
        let stamps = self.clock().as_mut().and_then(|clock| clock.next(&kernel.label));
        let mut encoder = self.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(&kernel.label),
                timestamp_writes: stamps.as_ref().map(clock::Stamps::writes),
            });
            pass.set_pipeline(&kernel.pipeline);
            for (number, group) in (0..).zip(&groups) {
                pass.set_bind_group(number, group, &[]);
            }
            let [x, y, z] = workgroups;
            pass.dispatch_workgroups(x, y, z);
        }
        self.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Workgroups along each axis. More than the adapter takes are refused: it would leave them out, and say so somewhere else.
    fn workgroups(&self, kernel: &ComputeKernel, invocations: [u32; 3]) -> Result<[u32; 3]> {
        let most = self.device.limits().max_compute_workgroups_per_dimension;
        let workgroups: [u32; 3] =
            std::array::from_fn(|axis| invocations[axis].div_ceil(kernel.workgroup[axis].max(1)));
        let Some(axis) = (0..3).find(|&axis| workgroups[axis] > most) else { return Ok(workgroups) };
        Err(Error::new(
            format!("kernel {}", kernel.label),
            format!("{} invocations along axis {}", invocations[axis], ["x", "y", "z"][axis]),
            format!(
                "at most {}: adapter {} takes {most} workgroups of {} along an axis",
                u64::from(most) * u64::from(kernel.workgroup[axis]),
                self.adapter.name,
                kernel.workgroup[axis]
            ),
            "Give less work at once, or use the CPU.",
        ))
    }
}
