//! Structs that Rust and WGSL share, compared with naga's layout when a kernel is compiled.
//!
//! [`shader_struct!`](crate::shader_struct) declares the Rust side and records where its fields lie. WGSL aligns by rules of its own, and a field
//! that lies elsewhere is read as its neighbour, without a word from any driver. So every struct in a uniform or storage buffer of a kernel is compared
//! field by field: name, offset, size, and whether its numbers are floats or integers.

use crate::base::error::{Error, Result};
use naga::{AddressSpace, Handle, Module, ScalarKind, Type, TypeInner};

/// A field of a Rust struct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Its name, the same in WGSL.
    pub name: &'static str,
    /// Bytes before it.
    pub offset: usize,
    /// Its bytes.
    pub size: usize,
    /// What its numbers are; none for a struct, whose own layout is compared.
    pub kind: Option<ScalarKind>,
}

impl Field {
    /// Fields of this name fill gaps: what is in them is read by nobody, and either side may count them otherwise.
    pub(crate) fn is_padding(name: &str) -> bool {
        name.contains("padding")
    }
}

/// A Rust type that may be a field of a shared struct.
pub trait ShaderValue: bytemuck::Pod {
    /// What its numbers are; none for a struct.
    const KIND: Option<ScalarKind>;
}

impl ShaderValue for f32 {
    const KIND: Option<ScalarKind> = Some(ScalarKind::Float);
}

impl ShaderValue for u32 {
    const KIND: Option<ScalarKind> = Some(ScalarKind::Uint);
}

impl ShaderValue for i32 {
    const KIND: Option<ScalarKind> = Some(ScalarKind::Sint);
}

impl<T: ShaderValue, const N: usize> ShaderValue for [T; N]
where
    [T; N]: bytemuck::Pod,
{
    const KIND: Option<ScalarKind> = T::KIND;
}

/// A Rust struct with a twin in WGSL; [`shader_struct!`](crate::shader_struct) implements it.
pub trait ShaderStruct: ShaderValue {
    /// Name in the linked module: of an imported module's struct with the module before it, `density_cache_Cache`.
    const NAME: &'static str;
    /// Its fields.
    const FIELDS: &'static [Field];
}

/// Declares a `#[repr(C)]` struct that a kernel reads or writes, `struct Rust = "Name in WGSL" { .. }`, with a record of its layout.
#[macro_export]
macro_rules! shader_struct {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $name:ident = $shader_name:literal {
            $($(#[$field_attribute:meta])* $field_visibility:vis $field:ident: $kind:ty),+ $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
        $visibility struct $name {
            $($(#[$field_attribute])* $field_visibility $field: $kind,)+
        }

        impl $crate::gpu::layout::ShaderValue for $name {
            const KIND: Option<naga::ScalarKind> = None;
        }

        impl $crate::gpu::layout::ShaderStruct for $name {
            const NAME: &'static str = $shader_name;
            const FIELDS: &'static [$crate::gpu::layout::Field] = &[$($crate::gpu::layout::Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                size: size_of::<$kind>(),
                kind: <$kind as $crate::gpu::layout::ShaderValue>::KIND,
            }),+];
        }
    };
}

/// How a struct of a kernel lies in Rust's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Name in the linked module.
    pub name: &'static str,
    /// Bytes, and fields; none of a struct that Rust neither reads nor writes field by field.
    pub shape: Option<(usize, &'static [Field])>,
}

impl Layout {
    /// Of a shared struct.
    pub const fn of<T: ShaderStruct>() -> Self {
        Self { name: T::NAME, shape: Some((size_of::<T>(), T::FIELDS)) }
    }

    /// The same where the struct's module is imported, which puts the module's name before its own.
    pub const fn imported(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    /// Of a struct that only the kernel knows, such as a state between dispatches.
    pub const fn unread(name: &'static str) -> Self {
        Self { name, shape: None }
    }
}

/// Compares a Rust struct with its twin in a module.
pub fn check<T: ShaderStruct>(module: &Module) -> Result<()> {
    compare(module, struct_of(module, T::NAME)?, T::NAME, size_of::<T>(), T::FIELDS)
}

/// Compares every struct in the buffers of a module; one that `layouts` does not have is an error, too. Layouts of structs that the module, specialised,
/// has lost are passed over.
pub fn check_all(module: &Module, layouts: &[Layout]) -> Result<()> {
    for handle in shared(module) {
        let name = module.types[handle].name.as_deref().unwrap_or("without a name");
        let layout = layouts.iter().find(|layout| layout.name == name).ok_or_else(|| {
            defect(name, "a struct in a buffer", "its layout among those that the kernel is compiled with".into())
        })?;
        if let Some((size, fields)) = layout.shape {
            compare(module, handle, name, size, fields)?;
        }
    }
    Ok(())
}

/// Bytes of a struct in WGSL, and where one of its members lies: for what Rust handles as words.
pub fn place(module: &Module, name: &str, member: &str) -> Result<(usize, usize)> {
    let TypeInner::Struct { members, span } = &module.types[struct_of(module, name)?].inner else {
        return Err(defect(name, "no struct", "a struct".into()));
    };
    let found = members.iter().find(|found| found.name.as_deref() == Some(member));
    let found = found.ok_or_else(|| defect(name, "no such member", format!("a member {member}")))?;
    Ok((*span as usize, found.offset as usize))
}

/// The structs of uniform and storage buffers, those within others included.
fn shared(module: &Module) -> Vec<Handle<Type>> {
    let is_shared = |space: AddressSpace| matches!(space, AddressSpace::Uniform | AddressSpace::Storage { .. });
    let variables = module.global_variables.iter().map(|(_, variable)| variable);
    let mut open: Vec<Handle<Type>> =
        variables.filter(|variable| is_shared(variable.space)).map(|variable| variable.ty).collect();
    let mut found = Vec::new();
    while let Some(handle) = open.pop() {
        match &module.types[handle].inner {
            TypeInner::Array { base, .. } => open.push(*base),
            TypeInner::Struct { members, .. } if !found.contains(&handle) => {
                found.push(handle);
                open.extend(members.iter().map(|member| member.ty));
            }
            _ => {}
        }
    }
    found
}

fn struct_of(module: &Module, name: &str) -> Result<Handle<Type>> {
    let found = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(name));
    found.map(|(handle, _)| handle).ok_or_else(|| defect(name, "nothing of this name", "a struct".into()))
}

fn compare(module: &Module, handle: Handle<Type>, name: &str, size: usize, fields: &[Field]) -> Result<()> {
    let TypeInner::Struct { members, span } = &module.types[handle].inner else {
        return Err(defect(name, "no struct", "a struct".into()));
    };
    if *span as usize != size {
        return Err(defect(name, format!("{size} bytes in Rust"), format!("{span} bytes, as in WGSL")));
    }
    let mut theirs = members.iter().filter(|member| !Field::is_padding(member.name.as_deref().unwrap_or_default()));
    let mut ours = fields.iter().filter(|field| !Field::is_padding(field.name));
    loop {
        match (ours.next(), theirs.next()) {
            (None, None) => return Ok(()),
            (Some(field), Some(member)) => {
                let there = Field {
                    name: field.name,
                    offset: member.offset as usize,
                    size: module.types[member.ty].inner.size(module.to_ctx()) as usize,
                    kind: kind_of(module, member.ty),
                };
                if member.name.as_deref() != Some(field.name) || there != *field {
                    let expected = described(member.name.as_deref().unwrap_or_default(), &there);
                    return Err(defect(name, described(field.name, field) + " in Rust", expected + ", as in WGSL"));
                }
            }
            (field, member) => {
                let ours = field.map_or("no further field", |field| field.name);
                let theirs = member.and_then(|member| member.name.as_deref()).unwrap_or("no further field");
                return Err(defect(name, format!("{ours} in Rust"), format!("{theirs}, as in WGSL")));
            }
        }
    }
}

fn described(name: &str, field: &Field) -> String {
    let kind = field.kind.map_or("struct".to_owned(), |kind| format!("{kind:?}"));
    format!("{name} at byte {} of {} bytes ({kind})", field.offset, field.size)
}

/// What the numbers of a type are.
fn kind_of(module: &Module, handle: Handle<Type>) -> Option<ScalarKind> {
    match &module.types[handle].inner {
        TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => Some(scalar.kind),
        TypeInner::Vector { scalar, .. } | TypeInner::Matrix { scalar, .. } => Some(scalar.kind),
        TypeInner::Array { base, .. } => kind_of(module, *base),
        _ => None,
    }
}

fn defect(name: &str, found: impl Into<String>, expected: String) -> Error {
    Error::new(
        format!("shader struct {name}"),
        found,
        expected,
        "This is a defect of the program: report it with the command.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "
        struct Given { place: vec3f, count: u32, way: vec3f, padding: u32, last: vec2i }
        @group(0) @binding(0) var<uniform> given: Given;
        @group(0) @binding(1) var<storage, read_write> several: array<Given>;
        @compute @workgroup_size(1) fn main() { several[0].count = given.count; }
    ";

    fn module() -> Module {
        naga::front::wgsl::parse_str(SOURCE).expect("it parses")
    }

    shader_struct! {
        struct Right = "Given" {
            place: [f32; 3],
            count: u32,
            way: [f32; 3],
            padding: u32,
            last: [i32; 2],
            more_padding: [u32; 2],
        }
    }

    /// What a check says of these fields.
    macro_rules! refusal {
        ($($field:ident: $kind:ty),+) => {{
            shader_struct! { struct Wrong = "Given" { $($field: $kind),+ } }
            check::<Wrong>(&module()).expect_err("the layout differs").to_string()
        }};
    }

    #[test]
    fn equal_layouts_pass() {
        check::<Right>(&module()).expect("the layouts are equal");
        check_all(&module(), &[Layout::of::<Right>()]).expect("the layouts are equal");
        check_all(&module(), &[Layout::unread("Given")]).expect("nothing is read");
        assert_eq!(place(&module(), "Given", "way").expect("it is there"), (48, 16));
        place(&module(), "Given", "there").expect_err("no such member");
        place(&module(), "Other", "way").expect_err("no such struct");
    }

    #[test]
    fn planted_differences_fail() {
        // The order of fields of equal size, which neither bytes nor offsets show.
        let order =
            refusal!(way: [f32; 3], count: u32, place: [f32; 3], padding: u32, last: [i32; 2], gap_padding: [u32; 2]);
        assert!(order.contains("way at byte 0") && order.contains("place at byte 0"), "{order}");
        let size = refusal!(place: [f32; 3], count: u32, way: [f32; 3], padding: u32, last: [i32; 2]);
        assert!(size.contains("40 bytes") && size.contains("48 bytes"), "{size}");
        let kind =
            refusal!(place: [f32; 3], count: f32, way: [f32; 3], padding: u32, last: [i32; 2], gap_padding: [u32; 2]);
        assert!(kind.contains("Float") && kind.contains("Uint"), "{kind}");
        let offset =
            refusal!(place: [f32; 3], padding: u32, count: u32, way: [f32; 3], last: [i32; 2], gap_padding: [u32; 2]);
        assert!(offset.contains("count at byte 16") && offset.contains("count at byte 12"), "{offset}");
        let missing = refusal!(place: [f32; 3], count: u32, way: [f32; 3], gap_padding: [u32; 5]);
        assert!(missing.contains("no further field"), "{missing}");
    }

    #[test]
    fn a_struct_that_nobody_declares_is_refused() {
        let refused = check_all(&module(), &[]).expect_err("a struct without a layout").to_string();
        assert!(refused.contains("Given"), "{refused}");
    }
}
