//! Uniforms for Mesa's llvmpipe.
//!
//! It compiles a kernel again for every content of its uniform buffers ([`Adapter::compiles_uniforms`](super::Adapter)), and reads storage buffers lane by lane, at every
//! place that asks. So there uniforms are storage buffers, of which an invocation takes a copy as it begins: what a loop asks for is a register then.

use naga::{
    AddressSpace, Block, Expression, GlobalVariable, Handle, Module, Span, Statement, StorageAccess, TypeInner,
};
use naga::{Range, Type, UniqueArena};

/// Turns uniforms into such storage buffers. Tables stay: they are read at places that are computed, which a copy would make slow, and a driver reads
/// them from uniforms in half the time.
pub(super) fn copied_at_the_start(module: &mut Module) {
    let mut copies: Vec<(Handle<GlobalVariable>, Handle<GlobalVariable>)> = Vec::new();
    let uniforms: Vec<Handle<GlobalVariable>> = module
        .global_variables
        .iter()
        .filter(|(_, variable)| variable.space == AddressSpace::Uniform)
        .filter(|(_, variable)| !matches!(module.types[variable.ty].inner, TypeInner::Array { .. }))
        .map(|(handle, _)| handle)
        .collect();
    for handle in uniforms {
        // The layout of a storage buffer may be that of a uniform one.
        let variable = &mut module.global_variables[handle];
        variable.space = AddressSpace::Storage { access: StorageAccess::LOAD };
        let copy = GlobalVariable {
            name: variable.name.as_ref().map(|name| format!("{name}_read")),
            space: AddressSpace::Private,
            binding: None,
            ..variable.clone()
        };
        if !holds_array(&module.types, copy.ty) {
            copies.push((handle, module.global_variables.append(copy, Span::UNDEFINED)));
        }
    }
    let functions = module.functions.iter_mut().map(|(_, function)| function);
    let entries = module.entry_points.iter_mut().map(|entry| &mut entry.function);
    for function in functions.chain(entries) {
        for (_, expression) in function.expressions.iter_mut() {
            let Expression::GlobalVariable(read) = expression else { continue };
            if let Some((_, copy)) = copies.iter().find(|(uniform, _)| uniform == read) {
                *read = *copy;
            }
        }
    }
    for entry in &mut module.entry_points {
        let function = &mut entry.function;
        let mut body = Block::new();
        for &(uniform, copy) in &copies {
            let [from, to] = [uniform, copy]
                .map(|variable| function.expressions.append(Expression::GlobalVariable(variable), Span::UNDEFINED));
            let value = function.expressions.append(Expression::Load { pointer: from }, Span::UNDEFINED);
            body.push(Statement::Emit(Range::new_from_bounds(value, value)), Span::UNDEFINED);
            body.push(Statement::Store { pointer: to, value }, Span::UNDEFINED);
        }
        body.extend_block(std::mem::take(&mut function.body));
        function.body = body;
    }
}

/// Whether there is an array in a type.
fn holds_array(types: &UniqueArena<Type>, ty: Handle<Type>) -> bool {
    match &types[ty].inner {
        TypeInner::Array { .. } => true,
        TypeInner::Struct { members, .. } => members.iter().any(|member| holds_array(types, member.ty)),
        _ => false,
    }
}
