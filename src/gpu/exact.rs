//! Kernels whose arithmetic no driver may rewrite.
//!
//! WGSL lets a driver fuse a product and a sum into one rounding, and those of hardware do. A field that is to have Cycles' bits must not be
//! fused. WGSL has no word for that, SPIR-V has: `NoContraction` on every sum and product (SPIR-V 1.6, 3.20), which also keeps drivers from
//! reassociating. So such a kernel is written as SPIR-V here, decorated, and handed to the driver as it is. Other backends than Vulkan have no
//! such word; [`Gpu::has_exact_kernels`] says where there is one.
//!
//! Quotients and square roots may be off by some units in the last place by Vulkan's rules. A kernel that imports `cloudparity::exact`
//! (`shaders/gpu/exact.wgsl`) has its own in their place, which round to the nearest. Software adapters take the processor's, which do.

use super::Gpu;
use crate::base::error::{Error, Result};
use naga::back::spv;
use naga::valid::ModuleInfo;
use naga::{AddressSpace, EntryPoint, Module, ShaderStage, StorageAccess};
use std::collections::BTreeMap;

/// SPIR-V: words before the first instruction, and the numbers of what is looked for.
const HEADER: usize = 5;
const DECORATE: u32 = 71;
const MEMBER_DECORATE: u32 = 72;
const NO_CONTRACTION: u32 = 42;
const NAME: u32 = 5;
const EXTENDED: u32 = 12;
const EXTENDED_ROOT: u32 = 31;
const TYPE_FLOAT: u32 = 22;
const TYPE_VECTOR: u32 = 23;
const FUNCTION: u32 = 54;
const FUNCTION_END: u32 = 56;
const CALL: u32 = 57;
const QUOTIENT: u32 = 136;

/// Instructions that may be fused or reassociated: sums, products, quotients, remainders of floats; negation rounds nothing.
const ARITHMETIC: [u32; 8] = [129, 131, 133, 136, 140, 141, 142, 148];

/// Import path and text of the quotients and roots that round to the nearest.
pub(super) const EXACT: (&str, &str) = ("gpu/exact.wgsl", include_str!("../../shaders/gpu/exact.wgsl"));

/// A use of each of them that never happens, for an entry text: what is not reached is not in a module.
pub(super) const REACHED: &str = "let two = exact::divide2(vec2f(f32(index)), vec2f(exact::square_root(f32(index)), exact::divide(1.0, f32(index))));
        let more = exact::divide3(two.xyy, exact::square_root3(two.yxx)) + exact::square_root4(exact::divide4(two.xyxy, two.yyxx)).xyz;
        results[0] = more.x + more.y + more.z + exact::square_root2(two).y;";

/// Functions of [`EXACT`] by what they stand for (a quotient, else a root) and the components of their result.
const STANDING_IN: [(&str, bool, u32); 8] = [
    ("divide", true, 1),
    ("divide2", true, 2),
    ("divide3", true, 3),
    ("divide4", true, 4),
    ("square_root", false, 1),
    ("square_root2", false, 2),
    ("square_root3", false, 3),
    ("square_root4", false, 4),
];

/// A compute pipeline with its layouts, group by group.
pub(super) struct Pipeline {
    pub pipeline: wgpu::ComputePipeline,
    pub layouts: Vec<wgpu::BindGroupLayout>,
}

impl Gpu {
    /// Whether kernels can have arithmetic that no driver rewrites: Vulkan, on a device of our own.
    pub fn has_exact_kernels(&self) -> bool {
        self.adapter.backend == "Vulkan" && self.device.features().contains(wgpu::Features::PASSTHROUGH_SHADERS)
    }

    /// The pipeline of a validated module with this compute entry, its arithmetic as it is written.
    pub(super) fn exact_pipeline(
        &self,
        label: &str,
        module: &Module,
        info: &ModuleInfo,
        entry_point: &EntryPoint,
    ) -> Result<Pipeline> {
        let groups = groups(module);
        let layouts: Vec<wgpu::BindGroupLayout> = (0..groups.keys().next_back().map_or(0, |last| last + 1))
            .map(|group| {
                let entries: Vec<wgpu::BindGroupLayoutEntry> =
                    groups.get(&group).into_iter().flatten().map(|(&binding, &ty)| entry(binding, ty)).collect();
                self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries: &entries,
                })
            })
            .collect();
        let words = words(label, module, info, &groups)?;
        let [x, y, z] = entry_point.workgroup_size;
        let name = entry_point.name.as_str();
        let entry_points = [wgpu::PassthroughShaderEntryPoint { name: name.into(), workgroup_size: (x, y, z) }];
        let shader = given(
            &self.device,
            wgpu::ShaderModuleDescriptorPassthrough {
                label: Some(label),
                entry_points: (&entry_points).into(),
                spirv: Some(words.into()),
                ..Default::default()
            },
        );
        let layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &layouts.iter().map(Some).collect::<Vec<_>>(),
            ..Default::default()
        });
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: Some(&layout),
            module: &shader,
            entry_point: Some(name),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Pipeline { pipeline, layouts })
    }
}

/// The buffers of a module by group and binding.
fn groups(module: &Module) -> BTreeMap<u32, BTreeMap<u32, wgpu::BufferBindingType>> {
    let mut groups: BTreeMap<u32, BTreeMap<u32, wgpu::BufferBindingType>> = BTreeMap::new();
    for (_, variable) in module.global_variables.iter() {
        let Some(place) = variable.binding else { continue };
        let ty = match variable.space {
            AddressSpace::Uniform => wgpu::BufferBindingType::Uniform,
            AddressSpace::Storage { access } => {
                wgpu::BufferBindingType::Storage { read_only: !access.contains(StorageAccess::STORE) }
            }
            _ => continue,
        };
        groups.entry(place.group).or_default().insert(place.binding, ty);
    }
    groups
}

fn entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

/// The module as decorated SPIR-V, its bindings numbered as wgpu numbers them for Vulkan: without gaps, in their order.
fn words(
    label: &str,
    module: &Module,
    info: &ModuleInfo,
    groups: &BTreeMap<u32, BTreeMap<u32, wgpu::BufferBindingType>>,
) -> Result<Vec<u32>> {
    let mut binding_map = spv::BindingMap::default();
    for (&group, bindings) in groups {
        for (number, &binding) in (0..).zip(bindings.keys()) {
            binding_map.insert(
                naga::ResourceBinding { group, binding },
                spv::BindingInfo { descriptor_set: group, binding: number, binding_array_size: None },
            );
        }
    }
    let unchecked = naga::proc::BoundsCheckPolicy::Unchecked;
    let options = spv::Options {
        lang_version: (1, 3),
        binding_map,
        bounds_check_policies: naga::proc::BoundsCheckPolicies {
            index: unchecked,
            buffer: unchecked,
            image_load: unchecked,
            binding_array: unchecked,
        },
        force_loop_bounding: false,
        // Functions are found by their names.
        flags: spv::WriterFlags::DEBUG,
        ..Default::default()
    };
    let entry = spv::PipelineOptions { shader_stage: ShaderStage::Compute, entry_point: "main".into() };
    let failed = |cause: String| {
        Error::new(
            format!("shader {label}"),
            cause,
            "a module that SPIR-V can say",
            "This is a defect of the program: report it.",
        )
    };
    let written = spv::write_vec(module, info, &options, Some(&entry)).map_err(|cause| failed(cause.to_string()))?;
    without_contraction(&with_exact_functions(&written)).ok_or_else(|| failed("no decorations".into()))
}

/// The words of each instruction, its opcode in the first.
fn instructions(words: &[u32]) -> impl Iterator<Item = (u32, &[u32])> {
    let mut rest = words.get(HEADER..).unwrap_or_default();
    std::iter::from_fn(move || {
        let &word = rest.first()?;
        let (instruction, further) = rest.split_at(((word >> 16) as usize).clamp(1, rest.len()));
        rest = further;
        Some((word & 0xFFFF, instruction))
    })
}

/// A name as SPIR-V has it: bytes up to a 0.
fn text(words: &[u32]) -> String {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).take_while(|&byte| byte != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The same module with calls of [`EXACT`]'s functions, where it has them, in the place of quotients and roots.
fn with_exact_functions(words: &[u32]) -> Vec<u32> {
    // Functions by quotient or root and components; components of types.
    let (mut functions, mut components) = (BTreeMap::new(), BTreeMap::new());
    for (code, instruction) in instructions(words) {
        match (code, instruction) {
            (NAME, [_, id, name @ ..]) => {
                let name = text(name);
                let own = name.strip_prefix("exact_").unwrap_or_default();
                if let Some(&(_, is_quotient, count)) = STANDING_IN.iter().find(|(name, ..)| *name == own) {
                    functions.insert((is_quotient, count), *id);
                }
            }
            (TYPE_FLOAT, [_, id, 32, ..]) => drop(components.insert(*id, 1)),
            (TYPE_VECTOR, [_, id, of, count]) if components.get(of) == Some(&1) => drop(components.insert(*id, *count)),
            _ => {}
        }
    }
    let mut changed = words[..HEADER.min(words.len())].to_vec();
    // These functions divide by the adapter's own means.
    let mut is_own = false;
    for (code, instruction) in instructions(words) {
        match (code, instruction) {
            (FUNCTION, [_, _, id, ..]) => is_own = functions.values().any(|function| function == id),
            (FUNCTION_END, _) => is_own = false,
            _ => {}
        }
        let (is_quotient, kind, result, arguments) = match (code, instruction) {
            (QUOTIENT, [_, kind, result, arguments @ ..]) => (true, kind, result, arguments),
            (EXTENDED, [_, kind, result, _, EXTENDED_ROOT, arguments @ ..]) => (false, kind, result, arguments),
            _ => {
                changed.extend(instruction);
                continue;
            }
        };
        let function = components.get(kind).and_then(|&count| functions.get(&(is_quotient, count)));
        match function.filter(|_| !is_own) {
            Some(&function) => {
                changed.extend([((4 + arguments.len() as u32) << 16) | CALL, *kind, *result, function]);
                changed.extend(arguments);
            }
            None => changed.extend(instruction),
        }
    }
    changed
}

/// The same module with `NoContraction` on its arithmetic; none where it has no decoration that the new ones could stand beside.
fn without_contraction(words: &[u32]) -> Option<Vec<u32>> {
    let (mut place, mut first, mut results) = (HEADER, None, Vec::new());
    for (code, instruction) in instructions(words) {
        if [DECORATE, MEMBER_DECORATE].contains(&code) {
            first.get_or_insert(place);
        }
        if ARITHMETIC.contains(&code) {
            results.push(*instruction.get(2)?);
        }
        place += instruction.len();
    }
    let first = first?;
    let mut decorated = Vec::with_capacity(words.len() + 3 * results.len());
    decorated.extend(&words[..first]);
    decorated.extend(results.into_iter().flat_map(|result| [(3 << 16) | DECORATE, result, NO_CONTRACTION]));
    decorated.extend(&words[first..]);
    Some(decorated)
}

/// Creates a module that wgpu does not look into.
#[allow(unsafe_code, reason = "wgpu offers modules that it does not look into as an unsafe function only")]
fn given(device: &wgpu::Device, descriptor: wgpu::ShaderModuleDescriptorPassthrough<'_>) -> wgpu::ShaderModule {
    // SAFETY: the words are what naga wrote of a module that it has validated, with decorations of results that are in it. Loops and indices
    // are those of `shaders/` and of the graph compiler, as in `trusted_module`.
    unsafe { device.create_shader_module_passthrough(descriptor) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "
        @group(0) @binding(2) var<storage, read> inputs: array<vec4f>;
        @group(0) @binding(5) var<storage, read_write> results: array<f32>;
        @group(2) @binding(0) var<uniform> scale: f32;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) invocation: vec3u) {
            let at = inputs[invocation.x];
            results[invocation.x] = (at.x * at.y + at.z - scale * at.w) / dot(at, at * 2.0) + f32(invocation.x * 3u);
        }";

    fn words_of(module: &Module) -> Vec<u32> {
        let info = crate::graph::wgsl::validate(module).expect("it is valid");
        words("test", module, &info, &groups(module)).expect("it can be written")
    }

    #[test]
    fn all_arithmetic_of_floats_is_decorated_and_nothing_else() {
        let module = naga::front::wgsl::parse_str(TEXT).expect("it is WGSL");
        let words = words_of(&module);
        let all: Vec<&[u32]> = instructions(&words).map(|(_, instruction)| instruction).collect();
        let code = |instruction: &[u32]| instruction[0] & 0xFFFF;
        let is_decoration = |one: &[u32]| code(one) == DECORATE && one[2] == NO_CONTRACTION;
        let mut decorated: Vec<u32> = all.iter().filter(|one| is_decoration(one)).map(|one| one[1]).collect();
        // FAdd, FSub, FMul, FDiv, VectorTimesScalar, Dot: by their numbers in the specification, the integer product not among them.
        let floats = [129, 131, 133, 136, 142, 148];
        let mut expected: Vec<u32> = all.iter().filter(|one| floats.contains(&code(one))).map(|one| one[2]).collect();
        decorated.sort_unstable();
        expected.sort_unstable();
        assert_eq!(decorated, expected);
        // x y, + z, s w, -, 2 at, dot, /, +: eight.
        assert_eq!(expected.len(), 8);
        // Decorations stand before the first type, as SPIR-V wants them.
        let last = all.iter().rposition(|one| is_decoration(one)).expect("there are some");
        let first_type = all.iter().position(|one| (19..=39).contains(&code(one))).expect("there are types");
        assert!(last < first_type);
    }

    #[test]
    fn bindings_are_numbered_without_gaps() {
        let module = naga::front::wgsl::parse_str(TEXT).expect("it is WGSL");
        let words = words_of(&module);
        // Decoration 33 is the binding, 34 the set.
        let of = |decoration: u32| {
            let mut values: Vec<(u32, u32)> = instructions(&words)
                .filter(|(code, one)| *code == DECORATE && one[2] == decoration)
                .map(|(_, one)| (one[1], one[3]))
                .collect();
            values.sort_unstable();
            values.into_iter().map(|(_, value)| value).collect::<Vec<u32>>()
        };
        assert_eq!((of(34), of(33)), (vec![0, 0, 2], vec![0, 1, 0]));
    }

    #[test]
    fn quotients_and_roots_are_those_that_stand_in() {
        let entry = format!(
            "#import cloudparity::exact
            @group(0) @binding(0) var<storage, read_write> results: array<f32>;
            @compute @workgroup_size(64)
            fn main(@builtin(global_invocation_id) invocation: vec3u) {{
                let index = invocation.x;
                if index == 0xffffffffu {{ {REACHED} }}
                let at = vec3f(f32(index), 2.0, results[1]);
                let two = sqrt(at.xy) / at.yz;
                results[index] = at.x / at.z + dot(sqrt(at), at.zyx / at) + two.x + sqrt(two.y) + inverseSqrt(two.x);
            }}"
        );
        let mut linker = crate::graph::wgsl::Linker::bare();
        linker.add(EXACT.0, EXACT.1);
        let module = linker.link("generated/test.wgsl", &entry).expect("it links");
        let found = words_of(&module);
        let plain = with_exact_functions(&[]);
        assert!(plain.is_empty(), "nothing stays nothing");
        let count = |code: u32| instructions(&found).filter(|(one, _)| *one == code).count();
        let roots = instructions(&found).filter(|(code, one)| *code == EXTENDED && one[4] == EXTENDED_ROOT).count();
        // Those within `divide` and `square_root`, two each, are the adapter's own.
        assert_eq!((count(QUOTIENT), roots), (2, 2));
        let names: Vec<u32> = instructions(&found)
            .filter(|(code, one)| {
                *code == NAME && text(&one[2..]).starts_with("exact_") && text(&one[2..]) != "exact_parts_of"
            })
            .map(|(_, one)| one[1])
            .collect();
        let calls = instructions(&found).filter(|(code, one)| *code == CALL && names.contains(&one[3])).count();
        // Within those of several components 12, in REACHED 8; of two components a root and a quotient, of three likewise, a quotient and a root of one.
        assert_eq!(calls, 12 + 8 + 6);
    }
}
